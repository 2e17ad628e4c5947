"""Are bounds ever wider than `late_width` where an event at uncertain times has exact ones beside it?

    python -m tests.long.late_widths [PLANTS] [FIRST_SEED]

Random plants (n = 1..3, one event at uncertain times, one or two exact ones, a sensor), events as
often as they may be or at random times, exact ones in windows too, samples as seldom as they may be.
Prints plants, proved ones, rows and rows that are wider; exits with 1 on one of them.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

import obsdesign
from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.exponential import expm
from obsdesign.problem.problem import Problem
from obsdesign.runtime import from_design
from obsdesign.runtime.base import Sample

_CYCLES, _TRANSIENT = 25, 10  # shortest times between two events at uncertain times
_ROOM = 1e-9  # relative


def random_plant(rng: np.random.Generator) -> dict[str, Any]:
    """A flow that decays, "dose" at uncertain times and other events anywhere among them."""
    n, error = int(rng.integers(1, 4)), float(rng.choice([0.05, 0.1, 0.25]))
    A = rng.uniform(0, 0.4, (n, n)) * (1 if rng.random() < 0.5 else rng.choice([-1, 1], (n, n)))
    A[np.diag_indices(n)] = -rng.uniform(0.5, 2, n) - np.abs(A).sum(axis=1) * rng.uniform(0.3, 1)
    apart = round(float(rng.uniform(2.2, 16)) * error, 3)
    events: list[dict[str, Any]] = [{
        "name": "dose", "E": np.eye(n, 1).tolist(), "input_bound": [float(rng.choice([0, 1, 10]))],
        "every": [apart, apart * float(rng.choice([1, 1.5]))], "time_error": error,
        "disturbance": {"lower": [-0.5] * n, "upper": [0.5] * n},
    }]  # fmt: skip
    for k in range(int(rng.integers(1, 3))):
        shortest = round(2 * error * float(rng.uniform(1.05, 3)) + float(rng.choice([0, apart])), 3)
        added = {"lower": [0.0] * n, "upper": rng.uniform(0, 2, n).tolist()}
        longest = shortest * float(rng.choice([1, 2, np.inf]))
        events.append({"name": f"meal_{k}", "every": [shortest, longest], "disturbance": added})
    C, gap = np.eye(n)[rng.integers(n)], (apart - 2 * error) * float(rng.choice([0.2, 0.5, 0.95]))
    return {
        "flow": {"A": A, "disturbance": {"lower": [-0.2] * n, "upper": [0.3] * n}},
        "event": [events[k] for k in rng.permutation(len(events))],
        "sensor": [{"name": "y", "C": [C], "noise_bound": 0.05, "every": [0, gap]}],
        "observer": {"kind": "interval"},
    }


def _times(event: dict[str, Any], end: float, rng: np.random.Generator) -> Matrix:
    """Times of an event: as often as it may be, or at random."""
    low, high = event["every"]
    spacings = np.full(int(end / low) + 2, low)
    if rng.random() < 0.5:
        spacings = rng.uniform(low, min(high, 2 * low), len(spacings))
    times = rng.uniform(0, low) + np.cumsum(spacings)
    return np.asarray(times[times < end])


def rows_of_run(body: dict[str, Any], rng: np.random.Generator) -> tuple[list[Sample], Matrix]:
    """(rows, stamps): the middle of every disturbance, no noise, events at their stamps."""
    place = next(k for k, event in enumerate(body["event"]) if "time_error" in event)
    dose, n = body["event"][place], len(body["flow"]["A"])
    end = _CYCLES * dose["every"][0]
    times = [_times(event, end, rng) for event in body["event"]]
    stamps, gap = times[place], body["sensor"][0]["every"][1]
    sampled = gap * np.arange(1, int(end / gap))
    edges = [stamps + side * dose["time_error"] * (1 + 1e-6) for side in (-1, 1)]
    Z, x, now = np.zeros((n + 1, n + 1)), np.zeros(n), 0.0
    Z[:n, :n], Z[:n, n], rows = body["flow"]["A"], 0.05, [Sample(0.0)]
    for t in np.unique(np.concatenate([*times, sampled, *edges])).tolist():
        x, now = (expm(Z * (t - now)) @ np.append(x, 1.0))[:n], t
        happens = tuple(k for k, own in enumerate(times) if t in own)
        y = body["sensor"][0]["C"] @ x if t in sampled else None
        w = np.array(dose["input_bound"]) if place in happens else None
        rows.append(Sample(t, y=y, w=w, jump=bool(happens), events=happens))
        for event in (body["event"][k] for k in happens):
            x = x + (np.array(event["disturbance"]["lower"]) + event["disturbance"]["upper"]) / 2
            x = x + (np.array(event["E"]) @ w if "E" in event else 0.0)
    return rows, stamps


def wider_rows(body: dict[str, Any], rng: np.random.Generator) -> tuple[int, int] | None:
    """(rows, rows wider than what is proved) of three runs; None where nothing is proved."""
    design = obsdesign.design(Problem(**body), allow_undecided=True)
    claim = design.claims[-1]
    if claim.id != "late_width" or claim.verdict != "proved":
        return None
    observer: Any = from_design(design)
    dose = next(event for event in body["event"] if "time_error" in event)
    n, error, rows, wider = len(body["flow"]["A"]), dose["time_error"], 0, 0
    for _ in range(3):
        listed, stamps = rows_of_run(body, rng)
        state = observer.init(0.0, lower=np.zeros(n), upper=np.zeros(n))
        for each in observer.run(state, listed):
            offset = each.t - stamps[np.abs(stamps - each.t).argmin()]
            if each.t < _TRANSIENT * dose["every"][0] or abs(offset) <= error * (1 + 1e-7):
                continue
            is_edge = abs(offset) < error * (1 + 2e-6)
            name = ("before" if offset < 0 else "after") if is_edge else "always"
            allowed = np.array(claim.evidence[name]) * (1 + _ROOM)
            rows, wider = rows + 1, wider + int((each.upper - each.lower > allowed).any())
    return rows, wider


def main(plants: int = 20, first: int = 0) -> int:
    """Return 1 where a row is wider than what is proved."""
    proved = rows = wider = 0
    for seed in range(first, first + plants):
        rng = np.random.default_rng(seed)
        if (own := wider_rows(random_plant(rng), rng)) is None:
            continue
        proved, rows, wider = proved + 1, rows + own[0], wider + own[1]
        if own[1]:
            print(f"seed {seed}: {own[1]} rows are wider")
    print(f"{plants} plants, {proved} proved, {rows} rows, {wider} wider")
    return int(wider > 0)


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
