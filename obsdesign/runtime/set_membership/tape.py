"""Adding stages to a tape: prediction, strip, and the bounds of all stages together."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import TINY, UNIT
from obsdesign.equations.set_membership.gains import SetMembershipGains
from obsdesign.runtime.set_membership.condensed import condensed
from obsdesign.runtime.set_membership.evaluation import upper_bounds
from obsdesign.runtime.set_membership.model import Model
from obsdesign.runtime.set_membership.proposals import propose
from obsdesign.runtime.set_membership.stages import (
    Stage,
    Targets,
    Window,
    magnitude,
    window_of,
)
from obsdesign.runtime.set_membership.tables import Tables

# part of the largest multiplier below which a sample is not named in a contradiction
_NEGLIGIBLE_MULTIPLIER = 1e-3


class Tape(NamedTuple):
    """Stages, oldest first; start and box (2, n): bounds before the first and after the last."""

    start: Matrix
    stages: tuple[Stage, ...]
    box: Matrix

    @staticmethod
    def beginning(box: Matrix) -> Tape:
        """A tape without stages."""
        return Tape(box, (), box)


class Contradiction(NamedTuple):
    """Samples, the times of which are listed, that model, bounds and start box exclude together."""

    times: tuple[float, ...]


class Result(NamedTuple):
    """The bounds after a row.

    directions (2, r): of the further directions; lagged (2, n): of the state some rows ago, NaN
    where the tape does not go back that far.
    """

    box: Matrix
    directions: Matrix
    lagged: Matrix


@dataclass(frozen=True)
class Bounder:
    """Bounds from a tape: for a model, its tables and the options of a design."""

    gains: SetMembershipGains
    model: Model
    tables: Tables

    def predicted(self, tape: Tape, stage: Stage) -> Tape:
        """The tape with one more stage, its box without the measurement; the oldest one may go."""
        box = tape.box if stage.is_still else self._after(stage, tape.box)
        stages, start = (*tape.stages, stage._replace(box=box)), tape.start
        if len(stages) > self.gains.window:
            start, stages = stages[0].box, stages[1:]
        return Tape(start, stages, box)

    def _after(self, stage: Stage, box: Matrix) -> Matrix:
        """Bounds after a stage from bounds before it."""
        window = window_of(self.model, self.tables, box, [stage], None)
        none = np.zeros((2 * self.model.n, 1, len(self.model.C)))
        return _box(upper_bounds(window, self._state_targets(0), none))

    def cut(self, tape: Tape) -> Tape | None:
        """The tape, its last box cut by the strip of the measurement; None if that is empty."""
        stage = tape.stages[-1]
        if stage.strip is None:
            return tape
        box = strip_cut(tape.box, self.model.C, stage.strip)
        if box is None:
            return None
        return Tape(tape.start, (*tape.stages[:-1], stage._replace(box=box)), box)

    def bounded(self, tape: Tape) -> tuple[Tape, Result] | Contradiction:
        """The tape with the bounds of all its stages together, or why they are empty."""
        n, last = self.model.n, len(tape.stages) - 1
        window = window_of(
            self.model, self.tables, tape.start, tape.stages, magnitude(tape.box)
        )  # fmt: skip
        targets, lag = self._targets(tape)
        mu = self._proposed(window, targets)
        upper = upper_bounds(window, targets, mu)
        box = _shared(tape.box, _box(upper[: 2 * n]))
        fixed = self._fixed(window)
        if len(fixed):
            phases = self._state_targets(last, len(fixed) // (2 * n))
            ends = upper_bounds(window, phases, fixed)
            box = _shared(box, _box(ends.reshape(-1, 2 * n).min(axis=0)))
        if (box[0] > box[1]).any():
            return self._contradiction(window, targets, mu, tape)
        stage = tape.stages[-1]._replace(box=box)
        along = _shared(_box(upper[2 * n : 2 * n + 2 * self._further]), self._interval(box))
        lagged = np.full((2, n), np.nan)
        if lag is not None:
            stored = tape.start if lag < 0 else tape.stages[lag].box
            lagged = box if lag == last else _shared(stored, _box(upper[-2 * n :]))
        tape = Tape(tape.start, (*tape.stages[:-1], stage), box)
        return tape, Result(box, along, lagged)

    def contradiction(self, tape: Tape) -> Contradiction:
        """The samples that exclude each other, where the last one does not meet its prediction."""
        bounded = self.bounded(tape)
        if isinstance(bounded, Contradiction):
            return bounded
        return Contradiction((tape.stages[-1].t,))

    def _proposed(self, window: Window, targets: Targets) -> Matrix:
        program = condensed(window, targets)
        mu = np.zeros((len(targets.rows), len(window), len(self.model.C)))
        mu[:, program.rows[:, 0], program.rows[:, 1]] = propose(
            program.H, program.residual, program.V, program.objective, self.gains.steps
        )
        return mu

    def _fixed(self, window: Window) -> Matrix:
        """(B, stages, p): multipliers of the phases whose samples the window has, 2 n for each."""
        stored, used = self._stored
        if len(window) != self.gains.window:
            return stored[:0].reshape(0, *stored.shape[2:])
        return stored[(used <= window.sampled).all(axis=1)].reshape(-1, *stored.shape[2:])

    @cached_property
    def _stored(self) -> tuple[Matrix, NDArray[np.bool_]]:
        """Multipliers of -z, then of z, (phases, 2 n, stages, p), and the samples that they use."""
        mu = self.gains.multipliers
        if mu is None:
            mu = np.zeros((0, self.model.n, self.gains.window, len(self.model.C)))
        own = mu * self.model.scales[:, None, None]
        return np.concatenate([-own, own], axis=1), np.asarray(mu.any(axis=(1, 3)))

    def _contradiction(
        self, window: Window, targets: Targets, mu: Matrix, tape: Tape
    ) -> Contradiction:
        """The samples with multipliers that carry the contradiction, negligible ones left out."""
        n, strips = self.model.n, window.strips
        V = (strips[:, 1] - strips[:, 0]) / 2
        state = Targets(targets.rows[: 2 * n], targets.places[: 2 * n])
        own = mu[: 2 * n]
        weight = (np.abs(own) * (V + TINY)).sum(axis=2)
        largest = weight.max(axis=1, initial=0.0)[:, None]
        kept = np.where((weight > _NEGLIGIBLE_MULTIPLIER * largest)[..., None], own, 0.0)
        for chosen in (kept, own):
            box = _shared(tape.box, _box(upper_bounds(window, state, chosen)))
            crossed = np.flatnonzero(box[0] > box[1])
            if crossed.size:
                used = chosen[[crossed[0], crossed[0] + n]].any(axis=(0, 2))
                named = np.flatnonzero(used & window.sampled)
                return Contradiction(tuple(tape.stages[k].t for k in named))
        return Contradiction(tuple(s.t for s in tape.stages if s.strip is not None))

    @cached_property
    def _further(self) -> int:
        """Number of further directions."""
        return 0 if self.gains.directions is None else len(self.gains.directions)

    @cached_property
    def _rows(self) -> Matrix:
        """Rows l of l'z whose upper bounds are sought: -z, z, and the further directions so."""
        unit = np.eye(self.model.n)
        if self.gains.directions is None:
            return np.vstack([-unit, unit])
        own = self.gains.directions / self.model.scales
        return np.vstack([-unit, unit, -own, own])

    def _state_targets(self, place: int, times: int = 1) -> Targets:
        rows = np.tile(self._rows[: 2 * self.model.n], (times, 1))
        return Targets(rows, np.full(len(rows), place))

    def _targets(self, tape: Tape) -> tuple[Targets, int | None]:
        """All that is bounded, and the stage that the lagged bounds are about, if there is one."""
        rows, last = self._rows, len(tape.stages) - 1
        places = np.full(len(rows), last)
        lag = self._lagged_stage(tape)
        if lag is None or lag == last:
            return Targets(rows, places), lag
        n = self.model.n
        rows = np.vstack([rows, rows[: 2 * n]])
        return Targets(rows, np.concatenate([places, np.full(2 * n, lag)])), lag

    def _lagged_stage(self, tape: Tape) -> int | None:
        """The stage that ends the row `fixed_lag` rows ago, -1 the start; None if it is gone."""
        if self.gains.fixed_lag is None:
            return None
        ends = [k for k, stage in enumerate(tape.stages) if stage.ends_row]
        if self.gains.fixed_lag < len(ends):
            return ends[-1 - self.gains.fixed_lag]
        return None

    def _interval(self, box: Matrix) -> Matrix:
        """Bounds (2, r) of the further directions from a box alone."""
        upper = _products(self._rows[2 * self.model.n :], box)
        return _box(upper)


def _box(upper: Matrix) -> Matrix:
    """(2, k) from upper bounds of -l'z, then of l'z."""
    half = len(upper) // 2
    return np.stack([-upper[:half], upper[half:]])


def _shared(first: Matrix, second: Matrix) -> Matrix:
    """The intersection of two boxes, possibly crossed."""
    return np.stack([np.maximum(first[0], second[0]), np.minimum(first[1], second[1])])


def _products(rows: Matrix, box: Matrix) -> Matrix:
    """Upper bounds of rows @ z over a box, rounded up."""
    terms = np.maximum(rows * box[0], rows * box[1])
    pad = (2 * rows.shape[1] + 8) * UNIT * np.abs(terms).sum(axis=1) + TINY
    upper = np.nextafter(terms.sum(axis=1) + pad, np.inf)
    return np.where(np.isfinite(upper), upper, np.inf)


def strip_cut(box: Matrix, C: Matrix, strip: Matrix) -> Matrix | None:
    """The box around the part of a box with C z in the strip (2, p); None if it is empty."""
    n = C.shape[1]
    with np.errstate(divide="ignore", invalid="ignore"):
        # C_ri z_i <= high_r - sum over j != i of the least C_rj z_j
        ends = np.where(C == 0, 0.0, C * box[:, None, :])
        low, high = ends.min(axis=0), ends.max(axis=0)
        own = np.eye(n, dtype=bool)

        def others(values: Matrix) -> Matrix:
            """Sums over j != i, (p, n); an unbounded z_i leaves the bounds of z_i itself."""
            return np.asarray(np.where(own, 0.0, values[:, None, :]).sum(axis=2))

        size = others(np.maximum(np.abs(low), np.abs(high))) + np.abs(strip).max(axis=0)[:, None]
        pad = (2 * n + 12) * UNIT * size + TINY
        top = strip[1][:, None] - others(low) + pad
        bottom = strip[0][:, None] - others(high) - pad
        lower = np.where(C > 0, bottom, top) / C
        upper = np.where(C > 0, top, bottom) / C
    # no bound where C is zero, or from a box that is not finite
    lower = np.where((C == 0) | np.isnan(lower), -np.inf, np.nextafter(lower, -np.inf))
    upper = np.where((C == 0) | np.isnan(upper), np.inf, np.nextafter(upper, np.inf))
    strips = np.stack([lower.max(axis=0), upper.min(axis=0)])
    result = _shared(box, strips)
    return None if (result[0] > result[1]).any() else result
