"""Samples and jumps in turns: bounds are proved just above brute force, never below it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lmi.arithmetic.balls import exact
from lmi.bounds.interleaved import Bounds, Interleaved, prove_interleaved

ROOM = 2e-3
TIMES = np.linspace(0, 1, 201)


def scalar_system(high: float, lost: bool = False, jumps: bool = True) -> Interleaved:
    """x' = -0.7 x + u with |u| <= 0.4, period 1; x+ = 0.3 x + 0.2 at samples, 1.4 x + 0.1 at jumps."""
    parts = [exact(X) for X in ([[-0.7]], [0.4], [[0.3]], [0.2])]
    after = [exact([[1.4]]), exact([0.1])] if jumps else [None, None]
    return Interleaved(*parts, *after, 1.0, 1.4, high, lost)


def flow(r: Any, s: Any) -> Any:
    return r * np.exp(-0.7 * s) + 0.4 * (1 - np.exp(-0.7 * s)) / 0.7


def sampled(r: Any) -> Any:
    return 0.3 * r + 0.2


def brute_force(system: Interleaved) -> tuple[float, dict[str, float]]:
    """(p, largest values after samples, after jumps, always) of the worst sequences."""
    fewest, most = (0, 60) if system.G is None else system.periods
    p = 0.0
    for _ in range(60):  # the least fixed point from below: the worst of all m and offsets
        u, following, after_samples, after_jumps = p, p, p, 0.0
        for count in range(int(min(most, 60)) + 1):
            after_samples = max(after_samples, u)
            if system.G is not None and count >= fewest:
                jumped = 1.4 * flow(u, TIMES) + 0.1
                late = flow(jumped, 1 - TIMES)
                if system.lost:
                    late = np.append(late, flow(jumped[-1], 1.0))
                following = max(following, sampled(late).max())
                after_jumps = max(after_jumps, jumped.max())
            u = sampled(flow(u, 1.0))
        p = max(following, u if system.G is None else 0.0)
    always = max(flow(r, TIMES).max() for r in (after_samples, after_jumps))
    return p, {"sampled": after_samples, "jumped": after_jumps, "always": always}


def outcome(system: Interleaved, p: float, sizes: dict[str, float]) -> str:
    jumped = None if system.G is None else exact([sizes["jumped"]])
    bounds = Bounds(exact([p]), exact([sizes["sampled"]]), jumped, exact([sizes["always"]]))
    return prove_interleaved(system, exact([[1.0]]), bounds).outcome


def with_room(sizes: dict[str, float]) -> dict[str, float]:
    """Sizes above what follows from a tube with ROOM; each larger than those it rests on."""
    rooms = {"sampled": 1.5, "jumped": 2.0, "always": 2.5}
    return {name: v * (1 + rooms[name] * ROOM) for name, v in sizes.items()}


SYSTEMS = {
    "no jumps": scalar_system(1.4, jumps=False),
    "a range": scalar_system(3.2),
    "for ever": scalar_system(math.inf),
    "a sample lost": scalar_system(2.5, lost=True),
}


@pytest.mark.parametrize("name", SYSTEMS)
def test_bounds_are_proved_just_above_brute_force_and_not_below_it(name: str) -> None:
    system = SYSTEMS[name]
    p, sizes = brute_force(system)
    wide = with_room(sizes)
    assert outcome(system, p * (1 + ROOM), wide) == "proved"
    assert outcome(system, p * (1 - ROOM), wide) == "undecided"
    for part in ("sampled", "jumped", "always") if system.G is not None else ("sampled", "always"):
        assert (
            outcome(system, p * (1 + ROOM), wide | {part: sizes[part] * (1 - ROOM)}) == "undecided"
        )


def test_signs_and_spacings_that_are_not_covered() -> None:
    system = SYSTEMS["a range"]
    p, wide = 2.0, {"sampled": 3.0, "jumped": 6.0, "always": 7.0}
    assert outcome(system, p, wide) == "proved"
    assert outcome(replace(system, low=1.0), p, wide) == "proved"
    assert outcome(replace(system, low=0.99), p, wide) == "undecided"
    lost = replace(system, lost=True)
    assert outcome(lost, p, wide) == "proved"
    assert outcome(replace(lost, low=1.0), p, wide) == "undecided"
    for name in ("b", "k", "j"):
        assert outcome(replace(system, **{name: exact([-1e-9])}), p, wide) == "undecided"
        assert outcome(replace(system, **{name: exact([0.0])}), p, wide) == "proved"
    assert outcome(system, 0.0, wide) == "undecided"


@pytest.mark.parametrize(
    ("low", "high", "lost", "periods"),
    [
        (1.0, 1.0, False, (0, 0)),
        (1.4, 3.2, False, (0, 3)),
        (2.0, 3.0, False, (1, 2)),
        (2.9, math.inf, False, (1, math.inf)),
        (1.4, 2.5, True, (0, 2)),
        (2.0, 3.0, True, (0, 2)),
        (3.1, 3.1, True, (2, 3)),
    ],
)
def test_periods_between_two_that_hold_a_jump(
    low: float, high: float, lost: bool, periods: tuple[int, float]
) -> None:
    assert replace(SYSTEMS["a range"], low=low, high=high, lost=lost).periods == periods
