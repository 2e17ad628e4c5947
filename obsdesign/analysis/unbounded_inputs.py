"""Inputs without bounds, which leave no bounds on the state."""

from __future__ import annotations

from obsdesign.problem.plant import Plant


def reason_against_unbounded(plant: Plant, kind: str) -> str | None:
    """Reason against a plant with unbounded inputs, one sentence, or None; kind: for the text."""
    if plant.flow.D is not None and plant.flow.d_bounds is None:
        return (
            f"flow.D is refused by kind {kind!r}: an unknown input without bounds leaves no "
            "bounds on the state. Give bounds as flow.d_bounds."
        )
    for event in plant.events:
        if event.H is not None:
            return (
                f"{event.entry}.H is refused by kind {kind!r}: impulses of unknown weight leave no "
                f"bounds on the state. Give bounds as {event.entry}.disturbance."
            )
    return None
