"""Refusals of plants with several clocks, for what knows one jump and one output alone."""

from __future__ import annotations

from collections.abc import Sequence

from obsdesign.errors import DoesNotApply
from obsdesign.kinds import (
    TAKING_CLOCKS,
    TAKING_DISCRETE_TIME,
    TAKING_MODES,
    TAKING_TIME_ERRORS,
)

_KINDS = ", ".join(TAKING_CLOCKS)


def require_one(what: str, names: Sequence[str]) -> None:
    """DoesNotApply where there are several events or sensors."""
    if len(names) > 1:
        raise DoesNotApply(
            f"one {what} is required here; the plant has {len(names)} ({', '.join(names)}). "
            f"Observers for several: {_KINDS}.",
            what,
        )


def require_no_modes(modes: Sequence[str], kind: str) -> None:
    """DoesNotApply where there are modes and the kind does not take them."""
    if modes and kind not in TAKING_MODES:
        raise DoesNotApply(
            f"kind {kind!r} has no modes; the plant has {len(modes)} ({', '.join(modes)}). "
            f"Observers for modes: {', '.join(TAKING_MODES)}.",
            "mode",
        )


def require_continuous_time(dt: float | None, kind: str) -> None:
    """DoesNotApply for a plant in discrete time where the kind does not take it."""
    if dt is not None and kind not in TAKING_DISCRETE_TIME:
        raise DoesNotApply(
            f"kind {kind!r} is for plants in continuous time; flow.dt is {dt:g}. Observers for "
            f"discrete time: {', '.join(TAKING_DISCRETE_TIME)}.",
            "flow.dt",
        )


def require_known_times(names: Sequence[str], kind: str) -> None:
    """DoesNotApply where times of events are uncertain and the kind does not take such events."""
    if names and kind not in TAKING_TIME_ERRORS:
        raise DoesNotApply(
            f"event.{names[0]}.time_error: kind {kind!r} needs events at known times. Observers "
            f"for uncertain times: {', '.join(TAKING_TIME_ERRORS)}.",
            "event",
        )


def require_fixed(name: str, is_fixed: bool) -> None:
    """DoesNotApply where a sensor is read neither always, nor every period, nor at every jump."""
    if not is_fixed:
        raise DoesNotApply(
            f"sensor.{name} must be read at every row, every period without losses, or at jumps; "
            f"its times are irregular. Observers for these: {_KINDS}.",
            "sensor",
        )
