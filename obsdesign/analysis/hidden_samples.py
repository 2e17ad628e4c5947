"""Samples of discrete time that an event hides: what is due then is never measured."""

from __future__ import annotations

from obsdesign.problem.plant import Plant


def reason_against_hidden_samples(plant: Plant) -> str | None:
    """Reason against a plant in discrete time whose events hide samples, or None.

    Events may fall on every step at which a sample is due: claims would count on none at all.
    """
    is_hidden = any(sensor.jump_measurement == "none" for sensor in plant.sensors)
    if plant.flow.dt is None or not plant.events or not is_hidden:
        return None
    return "output.jump_measurement must be before or after in discrete time; got 'none'."
