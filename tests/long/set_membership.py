"""Does the state ever leave the bounds of the multiplier observer? Random plants and disturbances.

    python -m tests.long.set_membership [PLANTS] [FIRST_SEED] [RESULTS]

Random plants (n = 1..5, stable or not, jumps, gaps, steps of very different length) with
disturbances at their extremes, switching, from the corner of the start box; some in units of very
different size, some with time stamps near 1.7e9, some without noise; samples that are missing, of
some outputs alone. Prints rows, violations and the largest one relative to the width;
exits with 1 on a violation or a false contradiction.

RESULTS: a file that gets a line for every hundred plants (seeds, rows, outside, contradictions,
largest); with it a run goes on behind the last line.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import UNIT
from obsdesign.runtime.base import Estimate, Sample
from obsdesign.runtime.set_membership.observer import SetMembershipObserver
from obsdesign.runtime.set_membership.state import SetMembershipState
from tests.systems.set_membership import Case, Record, observer_of, random_case

# the simulated truth is rounded, relative to the size of the state
_ROUNDING = 1e-11
# a record ends where y is rounded to more than that part of the noise, which is declared larger
_NOISE_ROUNDING = 1e-6
_CHUNK = 100


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
    window = int(rng.integers(4, 9)) if rng.random() < 0.7 else int(rng.integers(1, 17))
    steps = int(rng.integers(1, 6)) if rng.random() < 0.8 else 20  # few are as sound, and faster
    declared = replace(own, V=own.V * (1 + _NOISE_ROUNDING))
    observer = observer_of(declared, window, steps=steps)
    state = observer.init(start, lower=own.x0[0], upper=own.x0[1])
    samples = record.samples[: _exact_rows(own, record)]
    if start:  # the truth is about the stored time stamps
        stamps = [start + s.t for s in samples]
        own = replace(own, times=np.subtract(stamps[1:], start))
        record = own.record(extreme=True)
        rows = min(len(stamps), _exact_rows(own, record))
        samples = tuple(
            s._replace(t=t) for s, t in zip(record.samples[:rows], stamps, strict=False)
        )  # fmt: skip
    estimates = _run(observer, state, samples, rng)
    boxes = np.array([[e.lower, e.upper] for e in estimates])
    truth = record.truth[: len(boxes)]
    excess = np.maximum(boxes[:, 0] - truth, truth - boxes[:, 1])
    size = np.maximum.accumulate(np.abs(truth), axis=0)
    outside = (excess > _ROUNDING * size).any(axis=1)
    width: Matrix = boxes[:, 1] - boxes[:, 0]
    part = float(np.max(excess / np.where(width > 0, width, np.inf)))
    crossed = any("bounds crossed" in e.status for e in estimates)
    return len(samples), int(outside.sum()), part, crossed


def _exact_rows(own: Case, record: Record) -> int:
    """Rows up to the one whose measurement is rounded to a part of the noise that matters."""
    size = 8 * UNIT * (np.abs(record.truth) @ np.abs(own.C).T)
    is_rounded = ((own.V > 0) & (size > _NOISE_ROUNDING * own.V)).any(axis=1)
    return int(is_rounded.argmax()) if is_rounded.any() else len(record.truth)


def _run(
    observer: SetMembershipObserver, state: SetMembershipState, samples: tuple[Sample, ...],
    rng: np.random.Generator,
) -> list[Estimate]:  # fmt: skip
    """Estimates of all rows; some samples come in part, some not at all."""
    share = 0.2 * float(rng.random() < 0.5)
    estimates: list[Estimate] = []
    for sample in samples:
        y = None if sample.y is None else np.array(sample.y)
        if y is not None and rng.random() < share and not sample.jump:
            y = None
        elif y is not None and rng.random() < share:
            y[rng.integers(0, len(y))] = np.nan
        state, estimate = observer.step(state, sample._replace(y=y))
        estimates.append(estimate)
    return estimates


def main(plants: int = 200, first: int = 0, results: str | None = None) -> int:
    """Run that many plants; the exit code."""
    totals = [0, 0, 0, -np.inf]
    lines = Path(results).read_text().splitlines() if results and Path(results).exists() else []
    for line in lines:
        cells = line.split()
        first, plants = int(cells[1]), plants - (int(cells[1]) - int(cells[0]))
        _add(totals, [int(cells[2]), int(cells[3]), int(cells[4]), float(cells[5])])
    while plants > 0:
        count = min(plants, _CHUNK)
        chunk = _chunk(first, count)
        _add(totals, chunk)
        if results is not None:
            with Path(results).open("a") as file:
                print(first, first + count, *chunk, file=file)
        first, plants = first + count, plants - count
    rows, bad, contradictions, worst = totals
    print(f"{rows} rows, {bad} outside, {contradictions} contradictions, largest {worst:.1e}")
    return int(bad > 0 or contradictions > 0)


def _chunk(first: int, count: int) -> list[float]:
    """[rows, rows outside, contradictions, largest excess] of so many seeds."""
    totals = [0, 0, 0, -np.inf]
    for seed in range(first, first + count):
        own, start = case(seed)
        rows, outside, part, crossed = violations(own, start, seed)
        _add(totals, [rows, outside, int(crossed), part])
        if outside or crossed:
            print(f"seed {seed}: {outside} rows outside, contradiction: {crossed}", flush=True)
    return totals


def _add(totals: list[float], more: list[float]) -> None:
    for k in range(3):
        totals[k] += more[k]
    totals[3] = max(totals[3], more[3])


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:3]), *sys.argv[3:4]))
