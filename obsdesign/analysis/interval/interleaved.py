"""The width of an interval observer whose samples are events, as exact maps in turn."""

from __future__ import annotations

from lmi.arithmetic.balls import exact
from lmi.bounds.interleaved import Interleaved
from obsdesign.equations.interval.width import WidthSystem


def interleaved(
    system: WidthSystem, period: float, low: float, high: float, lost: bool = False
) -> Interleaved:
    """Samples every `period` and jumps after low to high; lost: no sample at a jump. Exact."""
    assert system.A is not None
    K, k = system.at_samples
    G, j = (None if X is None else exact(X) for X in (system.G, system.h))
    return Interleaved(
        exact(system.A), exact(system.f), exact(K), exact(k), G, j, period, low, high, lost
    )
