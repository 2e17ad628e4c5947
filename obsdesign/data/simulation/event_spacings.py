"""Times between events in a simulation: given dwell times, the shortest one, or random ones."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.data.simulation.discrete_times import require_steps, whole_spacings
from obsdesign.entries import positive
from obsdesign.errors import InputError
from obsdesign.problem.plant import Jump

_MOST_JUMPS = 1e5


def jump_times(
    event: Jump, dwell: str | float | Sequence[float], until: float, rng: np.random.Generator,
    dt: float | None = None,
) -> Matrix:  # fmt: skip
    """Instants of a jump in (0, until]; the first one a dwell time after 0.

    dt: step of a plant in discrete time. InputError for dwell times between its steps.
    """
    times, t = [], 0.0
    for theta in spacings_of(event, dwell, until, rng, dt):
        t += theta
        if t > until * (1 + 1e-12):
            break
        times.append(t)
    return np.array(times)


def spacings_of(
    event: Jump, dwell: str | float | Sequence[float], until: float, rng: np.random.Generator,
    dt: float | None = None,
) -> Iterable[float]:  # fmt: skip
    """Times between jumps, as for `jump_times`."""
    spacing = _spacings(event, dwell, until, rng)
    if dt is not None:
        for theta in [dwell] if isinstance(dwell, int | float) else dwell:
            if not isinstance(theta, str):
                require_steps(theta, dt, "dwell")
        low, high = event.dwell_time or (0.0, math.inf)
        ends = (low, high, event.dwell_jitter)
        if isinstance(dwell, str):
            spacing = whole_spacings(spacing, ends, dt)
    return spacing


def _spacings(
    event: Jump, dwell: str | float | Sequence[float], until: float, rng: np.random.Generator
) -> Iterable[float]:
    entry = "jump.dwell_time" if event.entry == "jump" else f"{event.entry}.every"
    if event.dwell_time is None:
        if isinstance(dwell, str):
            raise InputError(
                f"{entry} is required to simulate jumps; it is missing. Write it, or give "
                "the times: simulate --dwell T."
            )
        low, high, jitter = 0.0, math.inf, math.inf
    else:
        (low, high), jitter = event.dwell_time, event.dwell_jitter
    if dwell == "random":
        return random_spacings(low, high, jitter, until, rng)
    if dwell == "shortest":
        if low == 0.0:
            raise InputError(f"dwell = shortest needs {entry}[0] > 0; it is 0. Give a number.")
        return _repeat(low, until)
    if isinstance(dwell, str):
        raise InputError(f"dwell must be shortest, random or a positive number; got {dwell!r}.")
    if isinstance(dwell, int | float):
        return _repeat(positive(float(dwell), "dwell"), until)
    return _cycle([positive(float(theta), "dwell") for theta in dwell], until)


def _repeat(theta: float, until: float) -> Iterable[float]:
    if until / theta > _MOST_JUMPS:
        raise InputError(
            f"dwell = {theta:g} makes {until / theta:.4g} jumps until {until:g}; "
            f"{_MOST_JUMPS:g} is the limit."
        )
    count = int(until / theta) + 2
    return np.diff(np.round(theta * np.arange(count), 12))


def _cycle(thetas: list[float], until: float) -> Iterable[float]:
    """The sequence, repeated in turn."""
    if not thetas or until * len(thetas) / sum(thetas) > _MOST_JUMPS:
        raise InputError(
            f"dwell: the sequence of {len(thetas)} dwell times must make at least one jump, and "
            f"at most {_MOST_JUMPS:g} until {until:g}."
        )
    return itertools.cycle(thetas)


def random_spacings(
    low: float, high: float, jitter: float, until: float, rng: np.random.Generator
) -> Iterator[float]:
    """Uniform in the range; a mean of two shortest dwell times where it has no end."""
    top = high if math.isfinite(high) else (3 * low if low > 0 else until / 5)
    floor = max(low, 1e-3 * min(top, until))  # a range that starts at 0 must not pile up jumps
    if until / ((floor + top) / 2) > _MOST_JUMPS:
        raise InputError(f"until = {until:g} makes more than {_MOST_JUMPS:g} jumps; shorten it.")
    theta, elapsed = None, 0.0
    while elapsed <= until:
        near = (
            (floor, top)
            if theta is None
            else (max(floor, theta - jitter), min(top, theta + jitter))
        )
        theta = float(np.clip(rng.uniform(*near), low, high))
        elapsed += theta
        yield theta
