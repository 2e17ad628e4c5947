"""Adding stages to a tape: prediction, strip, and the bounds of all stages together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Indices, Matrix
from lmi.arithmetic.enclosure import TINY, UNIT
from obsdesign.equations.set_membership.gains import SetMembershipGains
from obsdesign.runtime.set_membership.condensed import Condensed, condensed
from obsdesign.runtime.set_membership.contradictions import (
    excluding_samples,
    samples_with_multipliers,
    without_negligible,
)
from obsdesign.runtime.set_membership.evaluation import upper_bounds
from obsdesign.runtime.set_membership.model import Model
from obsdesign.runtime.set_membership.proposals import propose
from obsdesign.runtime.set_membership.recovery import bounds_from_samples
from obsdesign.runtime.set_membership.stages import Stage, Targets, Window, magnitude, window_of
from obsdesign.runtime.set_membership.tables import Tables
from obsdesign.runtime.set_membership.tape import Contradiction, Tape, intersection, strip_cut

_NARROWER = 0.1  # what the box of a new beginning must come to, in parts of what was predicted


class Result(NamedTuple):
    """The bounds after a row.

    directions (2, r): of the further directions; lagged (2, n): of the state some rows ago, NaN
    where there are not so many rows.
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
        box = intersection(stage.box, self._after(stage, tape.box))
        spread = float(np.max(box[1] - box[0]))
        stages = (*tape.stages, stage._replace(box=box, spread=spread))
        return self.shortened(Tape(tape.start, stages, box))

    def shortened(self, tape: Tape) -> Tape:
        """The tape, its oldest stage left out where it has one too many."""
        if len(tape.stages) <= self.gains.window:
            return tape
        return Tape(tape.stages[0].box, tape.stages[1:], tape.box)

    def extended(self, tape: Tape, stages: Sequence[Stage]) -> Tape | Contradiction:
        """The tape with more stages, each predicted and cut by its measurement."""
        for stage in stages:
            longer = self.predicted(tape, stage)
            cut = self.cut(longer)
            if cut is None:
                return Contradiction(longer.sampled)
            tape = cut
        return tape

    def recovered(self, tape: Tape) -> Tape | Contradiction:
        """The tape, begun anew where its samples alone give bounds that are not uselessly wide."""
        widest = tape.widest_place()
        if widest is None:
            return tape
        place, spread = widest
        if self._is_nominal(tape) and (place >= 0 or len(tape.stages) == self.gains.window):
            return tape
        before, stages = tape.start, tape.stages
        if place >= 0:
            first = stages[place]
            own = () if first.strip is None else (first.standing_still(),)
            before, stages = first.box, (*own, *stages[place + 1 :])
        window = window_of(self.model, self.tables, before, stages, None)
        box = bounds_from_samples(window)
        start = before if box is None else intersection(before, box)
        if (start[0] > start[1]).any():
            return Contradiction(tape.sampled)
        if not np.max(start[1] - start[0]) < _NARROWER * spread:
            return tape
        return self.extended(Tape.beginning(start), stages)

    def _is_nominal(self, tape: Tape) -> bool:
        """Is a width proved for such a tape, by multipliers that need every stage of a window?"""
        return self.gains.multipliers is not None and all(stage.in_time for stage in tape.stages)

    def _after(self, stage: Stage, box: Matrix) -> Matrix:
        """Bounds after a stage from bounds before it."""
        if stage.is_still:
            return box
        window = window_of(self.model, self.tables, box, [stage], None)
        none = np.zeros((2 * self.model.n, 1, len(self.model.C)))
        return _box(upper_bounds(window, self._state_targets(0), none))

    def cut(self, tape: Tape) -> Tape | None:
        """The tape, its last box cut by the strip of the measurement; None if that is empty."""
        stage = tape.stages[-1]
        if stage.strip is None:
            return None if (tape.box[0] > tape.box[1]).any() else tape
        box = strip_cut(tape.box, self.model.C, stage.strip)
        if box is None:
            return None
        return Tape(tape.start, (*tape.stages[:-1], stage._replace(box=box)), box)

    def kept(self, recent: tuple[Matrix, ...]) -> tuple[Matrix, ...]:
        """Those of the boxes after the last rows that bounds of earlier states are cut with."""
        lag = self.gains.fixed_lag
        return () if lag is None else recent[-lag - 1 :]

    def bounded(
        self, tape: Tape, recent: Sequence[Matrix] = ()
    ) -> tuple[Tape, Result] | Contradiction:
        """The tape with the bounds of all its stages together, or why they are empty.

        recent: boxes after the rows before this one, also where the tape began behind them.
        """
        recovered = self.recovered(tape)
        if isinstance(recovered, Contradiction):
            return recovered
        tape = recovered
        n, last = self.model.n, len(tape.stages) - 1
        window = window_of(
            self.model, self.tables, tape.start, tape.stages, magnitude(tape.box)
        )  # fmt: skip
        targets, lag = self._targets(tape)
        program = condensed(window, targets)
        own = self._proposed(program)
        mu, fixed = program.by_stage(own, window), self._fixed(window)
        phases = self._state_targets(last, len(fixed) // (2 * n))
        upper, ends = np.split(
            upper_bounds(window, targets.with_more(phases), np.concatenate([mu, fixed])), [len(mu)]
        )
        box = intersection(tape.box, _box(upper[: 2 * n]))
        if len(fixed):
            box = intersection(box, _box(ends.reshape(-1, 2 * n).min(axis=0)))
        earlier = self._reported(recent)
        if lag is not None:
            now = box if lag == last else _box(upper[-2 * n :])
            earlier += [tape.stages[lag].box, now]
        lagged = reduce(intersection, earlier) if earlier else np.full((2, n), np.nan)
        if (box[0] > box[1]).any() or (lagged[0] > lagged[1]).any():
            return self._crossed(window, targets, mu, tape)
        excluded = self._excluded(window, program, own)
        if excluded is not None:
            return excluded
        stage = tape.stages[-1]._replace(box=box)
        along = intersection(_box(upper[2 * n : 2 * n + 2 * self._further]), self._interval(box))
        tape = Tape(tape.start, (*tape.stages[:-1], stage), box)
        return tape, Result(box, along, lagged)

    def contradiction(self, tape: Tape) -> Contradiction:
        """The samples that exclude each other, where the last one does not meet its prediction."""
        bounded = self.bounded(tape)
        if isinstance(bounded, Contradiction):
            return bounded
        return Contradiction((tape.stages[-1].t,))

    def _proposed(self, program: Condensed) -> Matrix:
        """Multipliers (B, M) of the strips of a program."""
        strips = (program.H, program.residual, program.V)
        opposite = self._opposite[: len(program.objective)]
        return propose(strips, program.objective, opposite, self.gains.steps)

    def _excluded(self, window: Window, program: Condensed, own: Matrix) -> Contradiction | None:
        """The samples that leave no state although bounds do not cross; None where none do."""
        if not program.is_nearly_empty(own, self._opposite[: len(own)]):
            return None
        return excluding_samples(window, program, self.gains.steps)

    def _fixed(self, window: Window) -> Matrix:
        """(B, stages, p): multipliers of the phases whose samples the window has, 2 n for each."""
        stored, used = self._stored
        if len(window) != self.gains.window:
            return np.zeros((0, len(window), stored.shape[3]))
        serving = (used <= window.sampled).all(axis=(1, 2))
        return stored[serving].reshape(-1, *stored.shape[2:])

    @cached_property
    def _stored(self) -> tuple[Matrix, NDArray[np.bool_]]:
        """Multipliers of -z, then of z, (phases, 2 n, stages, p), and the samples that they use."""
        mu = self.gains.multipliers
        if mu is None:
            mu = np.zeros((0, self.model.n, self.gains.window, len(self.model.C)))
        own = mu * self.model.scales[:, None, None]
        return np.concatenate([-own, own], axis=1), np.asarray(mu.any(axis=1))

    def _crossed(self, window: Window, targets: Targets, mu: Matrix, tape: Tape) -> Contradiction:
        """The samples with multipliers that carry crossed bounds, negligible ones left out."""
        n = self.model.n
        state = Targets(targets.rows[: 2 * n], targets.places[: 2 * n])
        own = mu[: 2 * n]
        for chosen in (without_negligible(window, own), own):
            box = intersection(tape.box, _box(upper_bounds(window, state, chosen)))
            crossed = np.flatnonzero(box[0] > box[1])
            if crossed.size:
                return samples_with_multipliers(window, chosen[[crossed[0], crossed[0] + n]])
        return Contradiction(tape.sampled)

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

    @cached_property
    def _opposite(self) -> Indices:
        """Index of -l for each row l: those of the states, of further directions, lagged ones."""
        halves, first = [self.model.n, self._further, self.model.n], 0
        listed = []
        for half in halves:
            listed += [np.arange(half) + first + half, np.arange(half) + first]
            first += 2 * half
        return np.concatenate(listed)

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

    def _reported(self, recent: Sequence[Matrix]) -> list[Matrix]:
        """The box that the row `fixed_lag` rows ago had then, where there was one before this."""
        lag = self.gains.fixed_lag
        return [recent[-lag]] if lag and lag <= len(recent) else []

    def _lagged_stage(self, tape: Tape) -> int | None:
        """The stage that ends the row `fixed_lag` rows ago; None if it is gone."""
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


def _products(rows: Matrix, box: Matrix) -> Matrix:
    """Upper bounds of rows @ z over a box, rounded up."""
    terms = np.maximum(rows * box[0], rows * box[1])
    pad = (2 * rows.shape[1] + 8) * UNIT * np.abs(terms).sum(axis=1) + TINY
    upper = np.nextafter(terms.sum(axis=1) + pad, np.inf)
    return np.where(np.isfinite(upper), upper, np.inf)
