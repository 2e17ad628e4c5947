"""What parameters add to a plant, in the observer's coordinates, enclosed.

    A(p) = A + sum_i p_i A_i,  |p_i(t)| <= 1,  likewise B, G, E and C

The part of A_i x that the measurement shows is taken from it: Q_i (y - C m), any Q_i (n, p). What
the radius then sees is R_i = A_i - Q_i C.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import Enclosure, raised
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.runtime.interval.model import Model, exactly, rounded, size


@dataclass(frozen=True)
class Effect:
    """What a parameter adds to a flow or a jump as it goes from 0 to 1.

    state (n, n): to A or G; known (n, k + 1): to the columns of [u; 1] or of [w; 1]; gain (n, p):
    Q or T, which acts on y - C m.
    """

    state: Enclosure
    known: Enclosure
    gain: Enclosure


@dataclass(frozen=True)
class Effects:
    """Of all parameters, those on the flow, on the jump, and on the output, C_i (p, n).

    C (p, n): the nominal output.
    """

    flow: tuple[Effect, ...]
    jump: tuple[Effect, ...]
    output: tuple[Enclosure, ...]
    C: Enclosure

    @cached_property
    def of_output(self) -> Matrix:
        """sum |C_i|, (p, n)."""
        return total(self.output, self.C.mid.shape)

    @cached_property
    def of_flow(self) -> Matrix:
        """sum |A_i|, (n, n)."""
        return total((effect.state for effect in self.flow), self._square)

    @cached_property
    def of_jump(self) -> Matrix:
        """sum |G_i|, (n, n)."""
        return total((effect.state for effect in self.jump), self._square)

    def remaining(self, effects: Iterable[Effect]) -> Matrix:
        """sum |A_i - Q_i C|, or of G_i and T_i, (n, n)."""
        return total((each.state - each.gain @ self.C for each in effects), self._square)

    def gains(self, effects: Iterable[Effect]) -> Matrix:
        """sum |Q_i| or sum |T_i|, (n, p)."""
        return total((effect.gain for effect in effects), self.C.mid.shape[::-1])

    @property
    def _square(self) -> tuple[int, int]:
        n = self.C.mid.shape[1]
        return n, n


def total(matrices: Iterable[Enclosure], shape: tuple[int, ...]) -> Matrix:
    """Upper bound of the sum of |X|, zero where every X is."""
    added, terms = np.zeros(shape), 1
    for X in matrices:
        added, terms = added + size(X), terms + 1
    return np.where(added > 0, raised(added, terms), 0.0)


def effects_of(gains: IntervalGains, model: Model) -> Effects:
    """The effects of a design's parameters in the coordinates of its model."""
    flow: list[Effect] = []
    jump: list[Effect] = []
    output: list[Enclosure] = []
    for i, each in enumerate(gains.effects):
        parts = (
            (flow, each.A, each.B, gains.B, gains.flow_correction),
            (jump, each.G, each.E, gains.E, gains.jump_correction),
        )
        for listed, X, Y, inputs, corrections in parts:
            if X is not None or Y is not None:
                gain = np.zeros((gains.n, gains.p)) if corrections is None else corrections[i]
                listed.append(_effect(model, X, Y, inputs, gain))
        if each.C is not None:
            C = rounded(each.C, model.relative_error)
            output.append(C if model.S is None else C @ model.S)
    return Effects(tuple(flow), tuple(jump), tuple(output), model.C)


def _effect(
    model: Model, X: Matrix | None, Y: Matrix | None, inputs: Matrix | None, gain: Matrix
) -> Effect:
    """The effect that adds X to A or G, and Y to `inputs`, B or E."""
    n, columns = len(gain), 0 if inputs is None else inputs.shape[1]
    state = np.zeros((n, n)) if X is None else X
    known = np.hstack([np.zeros((n, columns)) if Y is None else Y, np.zeros((n, 1))])
    return Effect(
        model.similar(rounded(state, model.relative_error)),
        model.inward(rounded(known, model.relative_error)),
        exactly(gain),
    )
