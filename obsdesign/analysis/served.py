"""Refusals of modes, discrete time, uncertain times and parameters by kinds without them."""

from __future__ import annotations

from obsdesign.errors import DoesNotApply
from obsdesign.kinds import (
    TAKING_DISCRETE_TIME,
    TAKING_MODES,
    TAKING_PARAMETERS,
    TAKING_TIME_ERRORS,
)
from obsdesign.problem.plant import Plant


def require_served(plant: Plant, kind: str) -> None:
    """DoesNotApply unless a kind takes all that a plant has.

    Modes, discrete time, events at uncertain times, parameters.
    """
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
    if plant.parameters and kind not in TAKING_PARAMETERS:
        raise DoesNotApply(
            f"{plant.parameters[0].entry} is uncertain: kind {kind!r} needs the plant exactly. "
            f"Observers for uncertain plants: {', '.join(TAKING_PARAMETERS) or 'none'}.",
            "parameter",
        )
