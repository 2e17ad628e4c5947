"""The centre of a prediction over a step, as forms of what is known at the step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import Enclosure, raised, stack
from lmi.arithmetic.exponential import FLOW_PIECES
from lmi.arithmetic.spectrum import spectral_radius
from obsdesign.runtime.interval.driven_radius import ChordErrors, Forcing
from obsdesign.runtime.interval.drives import FormTable
from obsdesign.runtime.interval.effects import Effect, Effects
from obsdesign.runtime.interval.maps import driven
from obsdesign.runtime.interval.model import Model, exactly, size


@dataclass(frozen=True)
class PredictedPath:
    """x_c' = A x_c + B u + b_mid from m over a step h +- h_error, in pieces.

    nodes: x_c at the ends of pieces, as forms (n, columns) of [m; y0; y1; u; 1]: the start alone
    where no parameter acts on the flow.
    """

    model: Model
    effects: Effects
    h: float
    h_error: float
    nodes: Sequence[Enclosure]

    @staticmethod
    def of_step(model: Model, effects: Effects, h: float, h_error: float) -> PredictedPath:
        """The path of a step: in a power of two of pieces, of half a radian each, or the finest."""
        n, p = model.L.mid.shape
        unused = exactly(np.zeros((n, 2 * p)))
        nodes = [stack([[exactly(np.eye(n)), unused, exactly(np.zeros_like(model.inputs.mid))]])]
        radians = float(spectral_radius(np.abs(model.A.mid))) * h if effects.flow else 0.0
        count = 1
        while count < min(2.0 * radians, FLOW_PIECES):
            count *= 2
        for k in range(1, count + 1) if effects.flow else ():
            flow, forced = driven(model.A, model.inputs, h * (k / count), h_error)
            nodes.append(stack([[flow, unused, forced]]))
        return PredictedPath(model, effects, h, h_error, nodes)

    @property
    def pieces(self) -> int:
        """Number of pieces."""
        return max(len(self.nodes) - 1, 1)

    @property
    def columns(self) -> int:
        """Length of v."""
        return int(self.nodes[0].mid.shape[1])

    def effect_at(self, effect: Effect, node: int) -> Enclosure:
        """A_i x_c + B_i u, (n, columns)."""
        return effect.state @ self.nodes[node] + self._known(effect.known)

    def forcing(self, rows: int, constant: Matrix) -> Forcing:
        """No drive yet; constant (rows, n + 1): of r and of 1."""
        nodes: list[list[tuple[int, Matrix]]] = [[] for _ in range(self.pieces + 1)]
        pieces: list[list[tuple[int, Matrix]]] = [[] for _ in range(self.pieces)]
        terms = 8 + 4 * (len(self.effects.flow) + len(self.effects.output))
        table = FormTable(self.columns)
        return Forcing(rows, len(self.model.A.mid), table, nodes, pieces, constant, terms)

    def drive_states(self, forcing: Forcing, blocks: Sequence[int]) -> None:
        """Add sum |A_i x_c + B_i u| to blocks of n rows of a system, which begin there."""
        n = len(self.model.A.mid)
        for effect in self.effects.flow:
            for node, listed in enumerate(forcing.at_nodes):
                forms = self.effect_at(effect, node)
                for k in active_rows(effect.state, effect.known):
                    direction = unit_rows(forcing.rows, [first + k for first in blocks])
                    listed.append((forcing.table.place(forms.mid[k], forms.rad[k]), direction))
        if self.effects.flow:
            error = np.zeros((forcing.rows, n))
            for first in blocks:
                error[first : first + n] = self.chord_error
            self.drive_chords(forcing, error)

    def drive_chords(self, forcing: Forcing, error: Matrix) -> None:
        """Add error (rows, n) times |x_c'| at the start of each piece."""
        for piece, listed in enumerate(forcing.over_pieces):
            slope = self.model.A @ self.nodes[piece] + self._known(self.model.inputs)
            places = forcing.table.places(slope)
            listed += [(place, error[:, k]) for k, place in enumerate(places)]

    @cached_property
    def chords(self) -> ChordErrors:
        """How far forms of the path are from their chords over each piece."""
        return ChordErrors.of_piece(self.model.A, self.h / self.pieces, self.h_error)

    @cached_property
    def chord_error(self) -> Matrix:
        """Bound of sum |A_i x_c - its chord| per |x_c'| at the start of a piece, (n, n)."""
        listed = [self.chords.bound(effect.state) for effect in self.effects.flow]
        return raised(np.sum(listed, axis=0), len(listed))

    def _known(self, columns: Enclosure) -> Enclosure:
        """Forms of [u; 1] as forms of v."""
        unused = exactly(np.zeros((len(columns.mid), self.columns - columns.mid.shape[1])))
        return stack([[unused, columns]])


def active_rows(*matrices: Enclosure) -> list[int]:
    """Rows in which one of the matrices is not zero."""
    active: Matrix = np.sum([size(X).sum(axis=1) for X in matrices], axis=0)
    return np.flatnonzero(active).tolist()


def unit_rows(rows: int, places: Sequence[int]) -> Matrix:
    """Zeros but for ones at some places."""
    direction = np.zeros(rows)
    direction[list(places)] = 1.0
    return direction
