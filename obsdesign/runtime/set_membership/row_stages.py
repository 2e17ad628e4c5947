"""Stages of a row: the flow up to it, its events, and the strips of its measurements."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.equations.set_membership.gains import SetMembershipGains
from obsdesign.runtime.base import Sample
from obsdesign.runtime.bounds import DeclaredBounds
from obsdesign.runtime.boxes import midpoint
from obsdesign.runtime.clocks.time_grid import steps_to_row
from obsdesign.runtime.set_membership.clocks import ClockedRow, Clocks
from obsdesign.runtime.set_membership.model import Disturbance, Model
from obsdesign.runtime.set_membership.stages import Stage, sampled_strip
from obsdesign.runtime.set_membership.state import SetMembershipState
from obsdesign.runtime.set_membership.tables import Tables


@dataclass(frozen=True)
class RowStages:
    """What makes stages of the rows of a design."""

    gains: SetMembershipGains
    model: Model
    tables: Tables
    clocks: Clocks
    declared_bounds: DeclaredBounds

    def of_row(self, state: SetMembershipState, sample: Sample, row: ClockedRow) -> list[Stage]:
        """The stages from a state to the end of a row, in their order."""
        t, y, events = row
        used = self.clocks.part(y, "before") if events else y
        stages = [self._flow_stage(state, sample, t, used)]
        readings = self.clocks.silence_strip(state.sent, state.sampled, row)
        # a later row of one time may hold the sample of a sensor on change
        if readings is not None and t > state.t:
            stages[0] = self._with_silence_strip(stages[0], *readings)
        stages += [self._jump_stage(sample, t, event) for event in events]
        if events:
            strip = self._strip(sample, self.clocks.part(y, "after"))
            stages[-1] = stages[-1]._replace(strip=strip)
        stages[-1] = stages[-1]._replace(ends_row=True)
        return stages

    def _flow_stage(
        self, state: SetMembershipState, sample: Sample, t: float, y: Matrix | None
    ) -> Stage:
        h, size = t - state.t, max(abs(t), abs(state.t))
        if self.gains.dt is not None:
            # refuses a time between two steps
            steps_to_row(state.t, t, self.gains.dt, started=state.started)
        table = self.tables.for_step(h, size)
        known, radius = self._disturbed(self.model.flow, state.u, state.held)
        return Stage(
            t, h, size, False, known, known, known, radius, self._strip(sample, y), state.box,
            False,
        ).driven(table)  # fmt: skip

    def _with_silence_strip(self, stage: Stage, known: Matrix, change: Matrix) -> Stage:
        """The stage before events, with strips of readings that are known to within a change."""
        bounds = self.declared_bounds.v
        lower = np.nextafter(bounds.lower - change, -np.inf)
        strip = sampled_strip(known, lower, np.nextafter(bounds.upper + change, np.inf))
        if stage.strip is not None:
            strip = np.where(np.isnan(stage.strip), strip, stage.strip)
        return stage._replace(strip=None if np.isnan(strip).all() else strip)

    def _jump_stage(self, sample: Sample, t: float, event: int) -> Stage:
        """The stage of an event, without a measurement after it."""
        table, jump = self.tables.jumps[event], self.model.jumps[event]
        w, declared = self.clocks.named.inputs(sample, event), self.declared_bounds.c
        pair = None if sample.bounds is None else sample.bounds.c
        held = np.stack([jump.c.lower, jump.c.upper])
        if declared is not None:  # behind them effects of parameters
            held[:, : len(declared.lower)] = declared.completed(pair)
        elif pair is not None:
            raise ValueError("bounds of c are not used with several events.")
        known, radius = self._disturbed(jump.c, w, held)
        return Stage(
            t, 0.0, abs(t), True, known, known, known, radius, None, held, False, event=event
        ).driven(table)  # fmt: skip

    def _disturbed(self, b: Disturbance, known: Matrix, held: Matrix) -> tuple[Matrix, Matrix]:
        """(inputs and middles of the disturbance, radii of its columns) of a stage."""
        middle, radius = midpoint(held[0], held[1])
        radii = np.zeros(self.model.width)
        radii[: len(b.active)] = radius[b.active]
        return np.concatenate([known, middle]), radii

    def _strip(self, sample: Sample, y: Matrix | None) -> Matrix | None:
        if y is None:
            return None
        pair = None if sample.bounds is None else sample.bounds.v
        return sampled_strip(y, *self.declared_bounds.v.completed(pair))
