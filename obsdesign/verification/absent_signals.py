"""Signals without which the error of a point observer tends to zero, in words."""

from __future__ import annotations

from obsdesign.problem.plant import Plant


def absent_signals(plant: Plant) -> str:
    """Disturbance, noise and the unknown inputs that a plant has, as part of a sentence."""
    names = ["disturbance", "noise"]
    names += ["unknown input d"] if plant.flow.D is not None else []
    names += ["unknown impulses"] if any(event.H is not None for event in plant.events) else []
    return f"{', '.join(names[:-1])} and {names[-1]}"
