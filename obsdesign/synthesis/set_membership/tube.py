"""Fixed multipliers and half widths that they do not leave, on the nominal pattern.

Policy iteration: multipliers that are optimal for the half widths, then the half widths that these
multipliers lead to, which never grow from one turn to the next.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.exponential import expm
from obsdesign.analysis.set_membership.enclosed import upper_rows
from obsdesign.analysis.set_membership.pieces import pieces_of
from obsdesign.equations.set_membership.gains import SetMembershipGains
from obsdesign.equations.set_membership.nominal import (
    Arithmetic,
    NominalMaps,
    Pieces,
    RowMap,
    StepMap,
    row_maps,
)
from obsdesign.equations.set_membership.pattern import Pattern, Step
from obsdesign.synthesis.set_membership.programs import (
    Reach,
    hidden_trajectory,
    multipliers,
    reach_of,
)

_FLOATS = Arithmetic(np.asarray, lambda X, t: expm(X * t))
_TURNS = 8
_LEAST_CHANGE = 1e-3  # relative change of the half widths that ends the iteration
_LARGE = 100.0  # start of the iteration, in parts of what the disturbances add in a window
_STARTS = 3
_ROOM = 1e-6  # of every entry of the tube, in parts of it
_REFINED = 3
_LEAST = 1e-12  # an entry of zero, in parts of the largest one
_PIECES = ((4, 4), (20, 2))  # constant pieces of the disturbance in a step, by number of states
_HORIZONS = (40, 80, 160)
_CONVERGED = 5e-3
_SPARSE = 8  # a program of trajectories takes so much less than one of multipliers
_LARGEST = 640_000  # entries of the matrix of one such program
# of all linear programs of a design, counted as `Reach.work`
WORK = 300_000_000


@dataclass(frozen=True)
class Tube:
    """multipliers (windows, n, steps, p); radii (rows, n): half widths of the tube."""

    multipliers: Matrix
    radii: Matrix

    @property
    def width(self) -> Matrix:
        """Largest width of each state over the rows of a cycle."""
        return np.asarray(2 * self.radii.max(axis=0))


@dataclass(frozen=True)
class Witness:
    """Disturbances in parts of their radius, (n, R), that no sample notices; least (n,): widths."""

    least: Matrix
    rows: list[int]
    steps: int
    pieces: int
    disturbances: list[Matrix]

    def to_document(self) -> dict[str, object]:
        """Evidence of claim `optimal`."""
        listed = [[float(x) for x in one] for one in self.disturbances]
        return {"rows": self.rows, "steps": self.steps, "pieces": self.pieces,
                "disturbances": listed}  # fmt: skip


@dataclass
class Search:
    """Linear programs of a design on a pattern; work: what they may still take."""

    gains: SetMembershipGains
    pattern: Pattern
    work: float

    def tube(self, count: int) -> Tube | None:
        """Multipliers of windows of `count` steps, and their tube; None if none is found."""
        n, windows = self.gains.n, self.pattern.windows(count)
        zero = np.zeros((n, 0))
        free = [np.abs(self._reach(window, zero).Z).sum(axis=1) for window in windows]
        size = np.max(free, axis=0)
        size = size + (_ROOM * size.max() or self._maps.V.max() or 1.0)
        for k in range(_STARTS):
            start = np.tile(size * _LARGE ** (k + 1), (len(self.pattern.ends), 1))
            tube = self._iterated(count, start)
            tube = None if tube is None else self._certified(tube)
            if tube is not None:
                return tube
        return None

    def _certified(self, tube: Tube) -> Tube | None:
        """Half widths that the multipliers of a tube keep whatever the rounding; None if none.

        In floats q = p - C'mu cancels: where the noise is small beside the disturbances, its
        rounding is what a tube in floats is made of.
        """
        rows = upper_rows(self.gains, self.pattern, tube.multipliers)
        radii = _fixed_point(rows, tube.radii)
        return None if radii is None else Tube(tube.multipliers, radii)

    def witness(self, radii: Matrix) -> Witness | None:
        """Trajectories that no sample notices, each to the row of the widest bound of a state."""
        rows = [int(row) for row in radii.argmax(axis=0)]
        best = None
        for steps in _HORIZONS:
            now = self._witness(rows, steps)
            if now is None:
                return best
            if best is not None and (now.least - best.least <= _CONVERGED * now.least).all():
                return now
            best = now
        return best

    def _witness(self, rows: list[int], steps: int) -> Witness | None:
        none, disturbances, least = np.zeros((self.gains.n, 0)), [], []
        for i, row in enumerate(rows):
            reach = self._reach(self.pattern.window(self.pattern.ends[row], steps), none)
            xi = None
            if reach.H.size <= _LARGEST and self._affords(reach.work // _SPARSE):
                xi = hidden_trajectory(reach, self._maps.V, i)
            if xi is None:
                return None
            disturbances.append(xi)
            least.append(2 * float(reach.Z[i] @ xi))
        return Witness(np.array(least), rows, steps, self._fine, disturbances)

    def _affords(self, work: int) -> bool:
        self.work -= work
        return self.work >= 0

    @cached_property
    def _fine(self) -> int:
        """Pieces of constant disturbance in a step."""
        return next((count for most, count in _PIECES if self.gains.n <= most), 1)

    @cached_property
    def _maps(self) -> NominalMaps:
        return NominalMaps(self.gains, _FLOATS)

    @cached_property
    def _pieces(self) -> Pieces:
        return pieces_of(self.gains)

    @cached_property
    def _steps(self) -> dict[Step, StepMap]:
        return self._maps.steps(self.pattern.cycle, lambda h: (self._fine,))

    def _reach(self, window: tuple[Step, ...], start: Matrix) -> Reach:
        return reach_of(window, self._steps, self._maps.C, start)

    def _iterated(self, count: int, radii: Matrix) -> Tube | None:
        tube = None
        for _ in range(_TURNS):
            mu = self._multipliers(count, radii)
            if mu is None:
                break
            rows = row_maps(self._maps, self.pattern, self._pieces, mu)
            after = _fixed_point(rows, radii)
            if after is None or (tube is not None and (after > 2 * tube.radii).any()):
                break
            change = np.abs(after - radii).max() / after.max()
            tube, radii = Tube(mu, after), after
            if change < _LEAST_CHANGE or not any(row.k.any() for row in rows):
                break
        return tube

    def _multipliers(self, count: int, radii: Matrix) -> Matrix | None:
        pattern, n = self.pattern, self.gains.n
        result = []
        for window in pattern.windows(count):
            starts = [
                radii[pattern.start(end, count)[0]]
                for end in pattern.ends
                if pattern.window(end, count) == window
            ]
            reach = self._reach(window, np.diag(np.max(starts, axis=0)))
            if not self._affords(n * reach.work) or not np.isfinite(reach.Z).all():
                return None
            own = [multipliers(reach, self._maps.V, count, i) for i in range(n)]
            if any(mu is None for mu in own):
                return None
            result.append(own)
        return np.array(result)


def _fixed_point(rows: list[RowMap], before: Matrix) -> Matrix | None:
    """Half widths (rows, n) that all maps lower a little; None where they do not contract.

    before: those that the maps were made for, by which a limit of zero is replaced.
    """
    n, count = len(rows[0].k), len(rows)
    whole = np.zeros((count * n, count * n))
    for j, row in enumerate(rows):
        whole[j * n : (j + 1) * n, row.start * n : (row.start + 1) * n] += row.M
    k = np.concatenate([row.k for row in rows])
    if not (np.isfinite(whole).all() and np.isfinite(k).all()):
        return None
    rate = np.abs(np.linalg.eigvals(whole)).max()
    if rate >= 1:
        return None
    grown = 1 + min(_ROOM, (1 - rate) / 2)
    k = np.where(k > 0, k, _LEAST * (k.max() or before.max()))
    try:
        radii = np.linalg.solve(np.eye(len(k)) - grown * whole, grown * k)
    except np.linalg.LinAlgError:  # a rate of 1 but for rounding
        return None
    for _ in range(_REFINED):  # entries that are small beside the largest one are rounded too
        radii = grown * (whole @ radii + k)
    is_kept = np.isfinite(radii).all() and (whole @ radii + k < radii).all()
    return radii.reshape(count, n) if is_kept else None
