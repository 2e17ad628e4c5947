"""Sensor strips: the states that one sample alone allows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.pages.plotting.estimate_record import Table
from obsdesign.problem.plant import Plant


@dataclass(frozen=True)
class Strip:
    """Ends of a state at the rows of a record, NaN without a sample, and its width."""

    t: Matrix
    lower: Matrix
    upper: Matrix
    width: float


def strips_of(plant: Plant, data: Table) -> Mapping[str, Strip]:
    """Strips by the names of states that an output measures alone; of several the narrowest.

    They rest on the declared bounds of the noise. InputError if the data lack an output.
    """
    strips: dict[str, Strip] = {}
    output, titles = plant.outputs, [x for sensor in plant.sensors for x in sensor.columns]
    radii, centre = output.noise_radius, output.noise_centre
    if any(mode.C is not None for mode in plant.modes):  # a sample's strip depends on the mode
        return strips
    if radii is None or not data.columns:
        return strips
    t, middles = data.numbers("t"), np.zeros(len(radii)) if centre is None else centre
    for j, (row, middle, radius) in enumerate(zip(output.C, middles, radii, strict=True)):
        (used,) = np.nonzero(row)
        if len(used) != 1:
            continue
        name, slope = f"x{used[0] + 1}", float(row[used[0]])
        x, half = (data.numbers(titles[j]) - middle) / slope, float(radius) / abs(slope)
        if name not in strips or 2 * half < strips[name].width:
            strips[name] = Strip(t, x - half, x + half, 2 * half)
    return strips
