"""Samples that guarantees let be missing or further ones, with sensors that send on change."""

from __future__ import annotations

from obsdesign.problem.plant import Plant


def missing_samples(plant: Plant) -> str:
    """Which samples may be missing: any, but those of sensors that send on change."""
    if not (names := _senders(plant)):
        return "missing ones included"
    listed = ", ".join(names)
    return (
        f"missing ones included, but for {listed} (sends_on_change), of which no sample may be lost"
    )


def further_sample(plant: Plant) -> str:
    """A sample that a record may have beside others."""
    which = " of a sensor without sends_on_change" if _senders(plant) else ", of whichever sensor,"
    return f"A further sample{which}"


def _senders(plant: Plant) -> list[str]:
    return [x.name for x in plant.sensors if x.sends_on_change is not None]
