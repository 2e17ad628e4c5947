"""A measurement that arrives after the rows behind it: one more stage in the tape."""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.runtime.set_membership.bounder import Bounder
from obsdesign.runtime.set_membership.stages import Stage
from obsdesign.runtime.set_membership.tables import Tables
from obsdesign.runtime.set_membership.tape import Contradiction, Tape


def with_late_strip(
    bounder: Bounder, tape: Tape, t: float, strip: Matrix, when: str
) -> Tape | Contradiction | None:
    """The tape with the strip (2, p) of C z at time t; None where the tape begins later.

    A step over t becomes two, with the inputs and bounds of disturbances that it had. At the time
    of a jump the measurement is that before or after it, as `when` says; ValueError where that is
    "none".
    """
    stages = tape.stages
    if not stages or t < stages[0].t:
        return None
    if when == "none" and any(stage.jump and stage.t == t for stage in stages):
        raise ValueError(f"y at the jump at {t!r} is not used: output.jump_measurement is none.")
    place = _place(stages, t, when == "after")
    if place is None:
        return None
    changed = stages[place]
    if changed.t == t:
        shared = strip if changed.strip is None else _shared(strip, changed.strip)
        if (shared[0] > shared[1]).any():
            return Contradiction((t,))
        parts: tuple[Stage, ...] = (changed._replace(strip=shared),)
    else:
        parts = _split(bounder.tables, stages[place - 1].t, changed, t, strip)
    before = tape.start if place == 0 else stages[place - 1].box
    return bounder.extended(
        Tape(tape.start, stages[:place], before), (*parts, *stages[place + 1 :])
    )  # fmt: skip


def _place(stages: tuple[Stage, ...], t: float, is_after: bool) -> int | None:
    """The stage that ends at t, or the step over it; None where it has left the tape."""
    at = [k for k, stage in enumerate(stages) if stage.t == t]
    if not at:
        return next(k for k, stage in enumerate(stages) if stage.t > t)
    if is_after or not stages[at[0]].jump:
        return at[-1] if is_after else at[0]
    return None


def _split(
    tables: Tables, start: float, stage: Stage, t: float, strip: Matrix
) -> tuple[Stage, Stage]:  # fmt: skip
    """The step from `start` over t as two, the strip after the first one."""
    h, rest = t - start, stage.t - t
    first = stage._replace(
        t=t, h=h, size=max(abs(start), abs(t)), strip=strip, ends_row=False
    )  # fmt: skip
    second = stage._replace(h=rest, size=max(abs(t), abs(stage.t)))
    return (
        first.driven(tables.for_step(h, first.size)),
        second.driven(tables.for_step(rest, second.size))._replace(box=stage.box),
    )


def _shared(first: Matrix, second: Matrix) -> Matrix:
    """Strips of one time for all outputs, NaN where there is none."""
    return np.stack([np.fmax(first[0], second[0]), np.fmin(first[1], second[1])])
