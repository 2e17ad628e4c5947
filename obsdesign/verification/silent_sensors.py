"""Guarantees of plants with sensors that send on change, whose silence bounds the reading."""

from __future__ import annotations

from obsdesign.problem.plant import Plant


def with_every_sample(sentence: str, plant: Plant) -> str:
    """A guarantee for all samples or any missing ones, restricted where sensors send on change."""
    names = [x.name for x in plant.sensors if x.sends_on_change is not None]
    if not names:
        return sentence
    sentence = sentence.replace(", of whichever sensor,", " of a sensor without sends_on_change")
    condition = f"missing ones included, but for {', '.join(names)} (sends_on_change), of which "
    return sentence.replace("missing ones included", condition + "no sample may be lost")
