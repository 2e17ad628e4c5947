"""Refusals of plants with several clocks, for what knows one jump and one output alone."""

from __future__ import annotations

from collections.abc import Sequence

from obsdesign.errors import DoesNotApply
from obsdesign.kinds import TAKING_CLOCKS

_KINDS = ", ".join(TAKING_CLOCKS)


def require_one(what: str, names: Sequence[str]) -> None:
    """DoesNotApply where there are several events or sensors."""
    if len(names) > 1:
        raise DoesNotApply(
            f"one {what} is required here; the plant has {len(names)} ({', '.join(names)}). "
            f"Observers for several: {_KINDS}.",
            what,
        )


def require_fixed(name: str, is_fixed: bool) -> None:
    """DoesNotApply where a sensor is read neither always, nor every period, nor at every jump."""
    if not is_fixed:
        raise DoesNotApply(
            f"sensor.{name} must be read at every row, every period without losses, or at jumps; "
            f"its times are irregular. Observers for these: {_KINDS}.",
            "sensor",
        )
