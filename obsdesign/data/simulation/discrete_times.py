"""Times of a simulation in discrete time: whole steps."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.equations.time_grid import steps_of
from obsdesign.errors import InputError


def require_steps(time: float, dt: float, name: str) -> None:
    """InputError unless a time is a whole number of steps, one or more."""
    if not steps_of(time, dt):
        raise InputError(f"{name} must be a multiple of flow.dt = {dt:g}; got {time:g}.")


def on_steps(times: Matrix, dt: float, until: float) -> Matrix:
    """The nearest steps up to a time, each once, as decimal times.

    Times a whole number of steps apart stay so.
    """
    counts = np.unique(np.floor(times / dt + 0.5))
    counts = counts[counts * dt <= until * (1 + 1e-12)]
    return np.array([float(f"{count * dt:.15g}") for count in counts.tolist()])


def whole_spacings(
    spacings: Iterable[float], ends: tuple[float, float, float], dt: float
) -> Iterator[float]:
    """Spacings as whole steps; ends: shortest, longest, largest change from one to the next."""
    low, high, jitter = (end / dt for end in ends)
    before = None
    for spacing in spacings:
        least, most = low, high
        if before is not None:
            least, most = max(low, before - jitter), min(high, before + jitter)
        count = np.floor(spacing / dt + 0.5)
        count = min(max(count, np.ceil(least - 1e-6)), np.floor(most + 1e-6))
        before = float(max(count, 1.0))
        yield before * dt
