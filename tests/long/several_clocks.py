"""Does the state ever leave its bounds where several events and sensors run on their own clocks?

    python -m tests.long.several_clocks [PLANTS] [FIRST_SEED] [KIND]

Kind set_membership (default) or interval, of which every other plant has random gains. Random plants (n = 1..4, one to three events, one to three sensors: ranges of times, periods with
jitter and losses, at an event; before and after it), disturbances and noise at their ends, row by
row or held, dropouts beyond the stated ones, rows of one time apart or together, times from 0 or
from 1.7e9 on. Prints rows, rows outside and contradictions; exits with 1 on one of either.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

import obsdesign
from lmi.arithmetic.arrays import Matrix
from obsdesign.data.simulation import simulate
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem
from obsdesign.runtime import from_design
from obsdesign.runtime.base import Sample, rows_of

# the simulated truth is rounded, relative to the size of the state
_ROUNDING = 1e-11
# seconds of the year 2023
_LATE = 1.7e9


class _Ends:
    """A source of chance whose uniform numbers are ends: corners of boxes, ends of ranges."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng

    def uniform(self, low: float, high: float, size: Any = None) -> Any:
        """Low or high."""
        return self._rng.choice([low, high], size)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._rng, name)


def random_body(rng: np.random.Generator, kind: str) -> dict[str, Any]:
    """A random plant with several clocks."""
    n = int(rng.integers(1, 5))
    names = [f"event_{k}" for k in range(rng.integers(1, 4))]
    A = rng.normal(size=(n, n)) - np.eye(n) * rng.uniform(0, 2.5)
    body: dict[str, Any] = {"flow": {"A": A, "disturbance": _box(rng, n)}}
    body["event"] = [_event(rng, n, name) for name in names]
    body["sensor"] = [_sensor(rng, n, k, names) for k in range(rng.integers(1, 4))]
    if kind == "interval":
        return body | {"observer": {"kind": kind, "gains": _gains(rng, body)}}
    # long enough for its samples to determine the state
    window = 2 * n + 2 + int(rng.integers(6))
    return body | {"observer": {"kind": "set_membership", "window": window, "steps": 4}}


def _gains(rng: np.random.Generator, body: dict[str, Any]) -> dict[str, Any]:
    """Gains of any size, or none; those at events use what sees the state before."""
    if rng.random() < 0.5 or len(body["event"]) == len(body["sensor"]) == 1:
        return {}
    n = len(body["flow"]["A"])
    sees = [sensor["sees"] == "before" for sensor in body["sensor"] for _ in sensor["C"]]
    L = {x["name"]: {"L": 0.5 * rng.normal(size=(n, len(x["C"])))} for x in body["sensor"]}
    M = {x["name"]: {"M": 0.5 * rng.normal(size=(n, len(sees))) * sees} for x in body["event"]}
    return {**L, **M}


def _box(rng: np.random.Generator, n: int) -> dict[str, Matrix]:
    middle, radius = rng.normal(size=n), rng.uniform(0, 0.5, n) * (rng.random(n) < 0.7)
    return {"lower": middle - radius, "upper": middle + radius}


def _event(rng: np.random.Generator, n: int, name: str) -> dict[str, Any]:
    G = np.eye(n) + 0.3 * rng.normal(size=(n, n)) * (rng.random() < 0.5)
    low = float(rng.uniform(0.2, 1.5))
    event = {"name": name, "G": G, "disturbance": _box(rng, n), "every": [low, low * 3]}
    return event | ({"E": rng.normal(size=(n, rng.integers(1, 3)))} if rng.random() < 0.5 else {})


def _sensor(rng: np.random.Generator, n: int, k: int, events: list[str]) -> dict[str, Any]:
    p, every = int(rng.integers(1, 3)), float(rng.uniform(0.05, 0.6))
    noise = [[-float(a), float(b)] for a, b in rng.uniform(0, 0.1, (p, 2))]
    own = {"name": f"sensor_{k}", "C": rng.normal(size=(p, n)), "noise_bound": noise}
    own |= {"sees": ("before", "after")[rng.integers(2)]}
    clocks: list[dict[str, Any]] = [
        {"every": [0.3 * every, 2 * every]},
        {"every": every, "jitter": 0.3 * every, "losses": int(rng.integers(3))},
        {"every": every},
        {"at": events[rng.integers(len(events))]},
    ]
    return own | clocks[rng.integers(len(clocks))]


def apart(rows: list[Sample], p: int, rng: np.random.Generator) -> list[Sample]:
    """The rows without some of their samples, and some that hold several as rows of one time."""
    changed = []
    for row in rows:
        y = np.array(row.y)
        y[rng.random(p) < 0.1] = np.nan
        row = row._replace(y=y if np.isfinite(y).any() else None)
        if row.jump or row.y is None or rng.random() < 0.5:
            changed.append(row)
            continue
        for i in np.flatnonzero(np.isfinite(y)):
            changed.append(row._replace(y=np.where(np.arange(p) == i, y, np.nan)))
    return changed


def violations(seed: int, kind: str = "set_membership") -> tuple[int, int, bool]:
    """(rows, rows outside, contradiction?) of one random plant."""
    rng = np.random.default_rng(seed)
    problem = Problem(**random_body(rng, kind))
    observer = from_design(obsdesign.design(problem, allow_undecided=True))
    disturbance = ("extreme", "random", "sine")[rng.integers(3)]
    x = rng.normal(size=problem.plant.n)
    source: Any = _Ends(rng) if rng.random() < 0.7 else rng
    try:
        run = simulate(problem.plant, until=12.0, initial=x, disturbance=disturbance, rng=source)
    except InputError:  # an unstable plant
        return 0, 0, False
    rows = list(rows_of(run.t, run.block("y"), w=run.block("w"), jump=run.happened))
    if len(problem.plant.events) == 1:
        rows = [row._replace(events=()) for row in rows]
    if not problem.plant.has_one_clock:
        rows = apart(rows, problem.plant.p, rng)
    since = 0.0 if problem.plant.has_one_clock else _LATE * rng.integers(2)
    rows = [row._replace(t=since + row.t) for row in rows]
    truth = dict(zip((since + run.t).tolist(), run.block("x"), strict=True))
    # the start is that of the first row, before its events
    reach = 10.0 * (1 + np.abs(run.block("x")[0]).max() + np.abs(x).max())
    state = observer.init(
        since + run.t[0], lower=-reach * np.ones(len(x)), upper=reach * np.ones(len(x))
    )
    outside, crossed, size = 0, False, np.abs(x)
    for row, estimate in zip(rows, observer.run(state, rows), strict=True):
        size = np.maximum(size, np.abs(truth[row.t]))
        slack = _ROUNDING * size.max()
        assert estimate.lower is not None
        assert estimate.upper is not None
        inside = (estimate.lower <= truth[row.t] + slack) & (truth[row.t] <= estimate.upper + slack)
        outside += not inside.all()
        crossed = crossed or "crossed" in estimate.status
    return len(rows), outside, crossed


def main(plants: int = 200, first: int = 0, kind: str = "set_membership") -> int:
    """Run that many plants; the exit code."""
    rows, outside, contradictions = 0, 0, 0
    for seed in range(first, first + plants):
        count, bad, crossed = violations(seed, kind)
        rows, outside, contradictions = rows + count, outside + bad, contradictions + crossed
        if bad or crossed:
            print(
                f"seed {seed}: {bad} of {count} rows outside, contradiction: {crossed}", flush=True
            )
    print(f"{plants} plants, {rows} rows, {outside} outside, {contradictions} contradictions")
    return int(outside > 0 or contradictions > 0)


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:3]), *sys.argv[3:4]))
