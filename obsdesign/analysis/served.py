"""Refusals of modes, discrete time and uncertain times by kinds that do not take them."""

from __future__ import annotations

from obsdesign.errors import DoesNotApply
from obsdesign.kinds import TAKING_DISCRETE_TIME, TAKING_MODES, TAKING_TIME_ERRORS
from obsdesign.problem.plant import Plant


def require_served(plant: Plant, kind: str) -> None:
    """DoesNotApply unless a kind takes the modes, discrete time, uncertain times of a plant."""
    names = [mode.name for mode in plant.modes]
    if names and kind not in TAKING_MODES:
        raise DoesNotApply(
            f"kind {kind!r} has no modes; the plant has {len(names)} ({', '.join(names)}). "
            f"Observers for modes: {', '.join(TAKING_MODES)}.",
            "mode",
        )
    dt, uncertain = plant.flow.dt, plant.uncertain_events
    if dt is not None and kind not in TAKING_DISCRETE_TIME:
        raise DoesNotApply(
            f"kind {kind!r} is for plants in continuous time; flow.dt is {dt:g}. Observers for "
            f"discrete time: {', '.join(TAKING_DISCRETE_TIME)}.",
            "flow.dt",
        )
    if uncertain and kind not in TAKING_TIME_ERRORS:
        raise DoesNotApply(
            f"event.{uncertain[0]}.time_error: kind {kind!r} needs events at known times. "
            f"Observers for uncertain times: {', '.join(TAKING_TIME_ERRORS)}.",
            "event",
        )
