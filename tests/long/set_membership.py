"""Does the state ever leave the bounds of the multiplier observer? Random plants and disturbances.

    python -m tests.long.set_membership [PLANTS] [FIRST_SEED]

Random plants (n = 1..5, stable or not, jumps, gaps, steps of very different length) with
disturbances at their extremes, switching, from the corner of the start box; some in units of very
different size, some with time stamps near 1.7e9, some without noise. Prints rows, violations and
the largest one relative to the width; exits with 1 on a violation or a false contradiction.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from lmi.arithmetic.arrays import Matrix
from tests.systems.set_membership import Case, observer_of, random_case

# the simulated truth is rounded, relative to the size of the state
_ROUNDING = 1e-11
_USUAL = {"ok", "missing sample"}


def case(seed: int) -> tuple[Case, float]:
    """A random plant and the time at which its record begins."""
    rng = np.random.default_rng(seed)
    n, p = int(rng.integers(1, 6)), int(rng.integers(1, 3))
    own = random_case(n, seed, p, float(rng.uniform(-0.5, 0.5)), 60)
    low = 10.0 ** rng.uniform(-2.5, 0)
    units = 10.0 ** (rng.uniform(-6, 6, n) if rng.random() < 0.3 else np.zeros(n))
    column = units[:, None]
    own = replace(
        own, A=own.A * column / units, G=own.G * column / units, C=own.C / units,
        b=own.b * units * 10.0 ** rng.uniform(-3, 1), c=own.c * units, x0=own.x0 * units,
        V=own.V * (0.0 if rng.random() < 0.1 else 10.0 ** rng.uniform(-3, 1)),
        times=(low, low * rng.uniform(1, 10), 60), missing=float(rng.uniform(0, 0.4)),
    )  # fmt: skip
    return own, 1.7e9 if rng.random() < 0.3 else 0.0


def violations(own: Case, start: float, seed: int) -> tuple[int, int, float, bool]:
    """(rows, rows outside, largest excess relative to the width, contradiction?)"""
    rng = np.random.default_rng(seed)
    record = own.record(extreme=bool(rng.random() < 0.7))
    observer = observer_of(own, int(rng.integers(1, 17)), steps=int(rng.integers(1, 11)))
    state = observer.init(start, lower=own.x0[0], upper=own.x0[1])
    samples = record.samples
    if start:  # the truth is about the stored time stamps
        stamps = [start + s.t for s in samples]
        own = replace(own, times=np.subtract(stamps[1:], start))
        record = own.record(extreme=True)
        samples = tuple(
            s._replace(t=t) for s, t in zip(record.samples, stamps, strict=True)
        )  # fmt: skip
    estimates = list(observer.run(state, samples))
    boxes = np.array([[e.lower, e.upper] for e in estimates])
    excess = np.maximum(boxes[:, 0] - record.truth, record.truth - boxes[:, 1])
    size = np.maximum.accumulate(np.abs(record.truth), axis=0)
    outside = (excess > _ROUNDING * size).any(axis=1)
    width: Matrix = boxes[:, 1] - boxes[:, 0]
    part = float(np.max(excess / np.where(width > 0, width, np.inf)))
    crossed = any(e.status not in _USUAL for e in estimates)
    return len(samples), int(outside.sum()), part, crossed


def main(plants: int = 200, first: int = 0) -> int:
    """Run that many plants; the exit code."""
    rows = bad = contradictions = 0
    worst = -np.inf
    for seed in range(first, first + plants):
        own, start = case(seed)
        count, outside, part, crossed = violations(own, start, seed)
        rows, bad, worst = rows + count, bad + outside, max(worst, part)
        contradictions += crossed
        if outside or crossed:
            print(f"seed {seed}: {outside} rows outside, contradiction: {crossed}", flush=True)
    print(f"{rows} rows, {bad} outside, {contradictions} contradictions, largest {worst:.1e}")
    return int(bad > 0 or contradictions > 0)


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
