"""Claims and reasons that widths with several clocks and in discrete time have in common."""

from __future__ import annotations

from lmi.verdict import Verdict
from obsdesign.analysis.interval.clock_widths import ClockSystem
from obsdesign.document import Claim
from obsdesign.entries import is_number

_SAMPLES = "for all times of samples that the clocks allow"
_EVENTS = (
    "for all times of events and samples that the clocks allow, where a sample stamped with the "
    "time of an event acts before it, or after it, as `sees` says"
)


def all_times(system: ClockSystem) -> str:
    """The times over which a claim holds."""
    return _EVENTS if system.gains.events else _SAMPLES


def stability_claim(system: ClockSystem, source: str, verdict: Verdict) -> Claim:
    """Claim `event_stability`, by a tube of the homogeneous width system."""
    return Claim.from_verdict(
        "event_stability",
        "without disturbance and noise the width of the bounds tends to zero "
        f"{all_times(system)}: a tube of the homogeneous width system on the graph of the clocks "
        "is mapped into its interior",
        source,
        verdict,
    )


def tube_from_evidence(values: object) -> list[list[float]] | None:
    """Rows of numbers, all equally long; None for anything else."""
    if not isinstance(values, list) or not values:
        return None
    rows = [row for row in values if isinstance(row, list) and all(map(is_number, row))]
    if len(rows) != len(values) or len({len(row) for row in rows}) != 1:
        return None
    return [[float(x) for x in row] for row in rows]


def reasons_without_tube(system: ClockSystem) -> list[str]:
    """Reasons why no width is proved, which hold with and without a flow."""
    return ["no tube was found on the graph of the clocks"] + [
        f"sensor {name} may be silent for any time, and is not counted on"
        for name in system.not_counted
    ]
