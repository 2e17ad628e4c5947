"""Coordinates for samples as events: bases of flow, jump and the step with its sample."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.exponential import expm
from obsdesign.errors import InputError
from obsdesign.problem.plant import Plant
from obsdesign.synthesis.interval.coordinates import bases, eigenbasis
from obsdesign.synthesis.interval.task import GainSearch
from obsdesign.synthesis.placement import placed_gain

# radii of the poles that coordinates are made for, from sample to sample
_RADII = (0.9, 0.6, 0.3)


def sampled_bases(search: GainSearch) -> Iterator[Matrix]:
    """Coordinates to try: those of flow and jump, then of the step with its sample."""
    plant, given, units = search.problem.plant, search.given, search.units
    zero = np.zeros((plant.n, plant.p))
    yield from bases(plant, zero, zero, units)
    h = float(search.problem.require("output.period"))
    flow = expm(plant.flow.A * h)
    if not np.isfinite(flow).all():
        return
    gains = [given["L"]] if "L" in given else _placed(plant, flow)
    for L in gains:
        S = eigenbasis(units.map(flow - L @ plant.output.C @ flow))
        if S is not None:
            yield units.sizes[:, None] * S


def _placed(plant: Plant, flow: Matrix) -> Iterator[Matrix]:
    """Gains with real poles from sample to sample, apart from each other: of one sign, of both."""
    n = plant.n
    for radius in _RADII:
        for lowest in (0.3, -1.0) if n > 1 else (1.0,):
            poles = radius * np.linspace(1.0, lowest, n)
            try:
                yield placed_gain(flow, plant.output.C @ flow, poles.tolist())
            except (InputError, np.linalg.LinAlgError):
                return
