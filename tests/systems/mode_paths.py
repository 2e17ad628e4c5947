"""Paths of widths through modes and events, as unkind as the clocks allow."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.exponential import expm
from obsdesign.equations.boxes import image_box
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.equations.interval.width import WidthSystem
from obsdesign.equations.modes import SwitchedGains


def largest_widths(
    gains: SwitchedGains[IntervalGains], stays: int, rng: np.random.Generator
) -> Mapping[tuple[str, str], Matrix]:
    """The largest widths of a random path from zero, by ("entry" | "always", mode).

    Stays are mostly their longest or shortest, the same for a while; events come as soon as they
    may, or as late in the stay, or at random times.
    """
    systems = [WidthSystem.from_gains(own) for own in gains.gains]
    n = len(systems[0].f)
    largest: dict[tuple[str, str], Matrix] = defaultdict(lambda: np.zeros(n))
    w, mode, t, last = np.zeros(n), 0, 0.0, [-math.inf] * len(gains.events)
    for k in range(stays):
        if k % 10 == 0:
            is_long = rng.random(len(systems)) < 0.5
        name, own = gains.names[mode], systems[mode]
        low, high = gains.spans[mode].every.tolist()
        high = high if math.isfinite(high) else low + 20.0
        end = high if is_long[mode] else low
        stay = float(rng.choice([end, rng.uniform(low, high)], p=[0.9, 0.1]))
        times = []
        for e, own_event in enumerate(gains.events):
            if own_event.may_happen(name):
                ready = max(last[e] + own_event.dwell_range[0] - t, 0.0)
                times += [(s, e) for s in _times(ready, stay, own_event.dwell_range[0], rng)]
        now = 0.0
        for s, event in [*sorted(times), (stay, -1)]:
            w = _flowed(own, w, s - now)
            if event >= 0:
                lower, upper = image_box(*gains.events[event].disturbance)
                w, last[event] = np.abs(gains.events[event].G) @ w + (upper - lower), t + s
            largest["always", name] = np.maximum(largest["always", name], w)
            now = s
        t, mode = t + stay, int(rng.choice(gains.following[mode]))
        entered = systems[mode].N
        w = w if entered is None else np.asarray(entered @ w)
        for key in (("entry", gains.names[mode]), ("always", gains.names[mode])):
            largest[key] = np.maximum(largest[key], w)
    return largest


def _times(ready: float, stay: float, shortest: float, rng: np.random.Generator) -> list[float]:
    """Times of an event in a stay: early, late, or at random."""
    if ready > stay:
        return []
    first = float(rng.choice([ready, ready + (stay - ready) % shortest, rng.uniform(ready, stay)]))
    return np.arange(first, stay, shortest).tolist() or [min(first, stay)]


def _flowed(system: WidthSystem, w: Matrix, h: float) -> Matrix:
    n = len(w)
    Z = np.zeros((n + 1, n + 1))
    Z[:n, :n], Z[:n, n] = system.W, system.f
    return np.asarray(expm(Z * h)[:n] @ np.append(w, 1.0))
