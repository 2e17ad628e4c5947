"""Random plants, random admissible impulses, no noise: are times and weights found to 1e-4?

n = 2..5, real and complex spectra, one or two outputs and directions, weights of both signs, one or
two known inputs in every third plant, the state known at first. A plant is looked at where its
design is proved. python -m tests.long.random_impulses [PLANTS] [FIRST SEED]
"""

from __future__ import annotations

import sys
from collections import Counter
from typing import Any

import numpy as np

import obsdesign
from lmi.arithmetic.exponential import expm
from obsdesign.runtime import from_design

DWELL, PERIOD, ROWS, TOLERANCE = 6.0, 0.02, 1500, 1e-4

# samples show only between which two of them an impulse came where A H g stays in the span of H
NEARLY, HIDDEN = 0.02, "onset between samples not unique"


def plant(rng: np.random.Generator, seed: int) -> dict[str, Any]:
    n, p = int(rng.integers(2, 6)), int(rng.integers(1, 3))
    modes = np.diag(-rng.uniform(0.1, 1.2, n))
    if seed % 2:
        turning = rng.uniform(0.2, 1.2)
        modes[:2, :2] = [[-0.25, turning], [-turning, -0.25]]
    T = np.linalg.qr(rng.standard_normal((n, n)))[0] @ np.diag(rng.uniform(0.5, 2, n))
    A, C = T @ modes @ np.linalg.inv(T), rng.standard_normal((p, n))
    H = rng.standard_normal((n, 1 if seed % 5 else min(2, p)))
    flow = {"A": A.tolist()}
    if seed % 3 == 0:
        flow["B"] = rng.standard_normal((n, 1 + seed % 2)).tolist()
    return {
        "flow": flow, "jump": {"H": H.tolist(), "dwell_time": [DWELL, "inf"]},
        "output": {"C": C.tolist(), "measured": "periodic", "period": PERIOD},
        "observer": {"kind": "impulsive_input"},
    }  # fmt: skip


def train(rng: np.random.Generator, directions: int) -> list[tuple[float, Any]]:
    found, moment = [], float(rng.uniform(1, 9))
    while moment < 22:
        weights = rng.choice([-1, 1], directions) * rng.uniform(0.5, 3, directions)
        found.append((moment, weights))
        moment += DWELL * float(rng.uniform(1.02, 1.8))
    return found


def record(body: dict[str, Any], impulses: list[tuple[float, Any]], t: Any, u: Any, x0: Any) -> Any:
    """States at the rows; inputs are held between them."""
    A, H = np.array(body["flow"]["A"]), np.array(body["jump"]["H"])
    n, B = len(A), np.array(body["flow"].get("B", np.zeros((len(A), u.shape[1]))))
    block = np.zeros((n + u.shape[1],) * 2)
    block[:n] = np.hstack([A, B])
    step = expm(block * (t[1] - t[0]))[:n]
    x = [x0]
    for k in range(len(t) - 1):
        state = step @ np.concatenate([x[-1], u[k]])
        for moment, g in impulses:
            if t[k] < moment <= t[k + 1]:
                state = state + expm(A * (t[k + 1] - moment)) @ H @ g
        x.append(state)
    return np.array(x)


def outcome(seed: int) -> tuple[str, str]:
    """(word, what happened) for one plant."""
    rng = np.random.default_rng(seed)
    body = plant(rng, seed)
    found = obsdesign.investigate(obsdesign.Problem.from_dict(body))
    if found.verdict != "proved":
        short = [f"{c.id} {c.verdict}" for c in found.claims if c.verdict != "proved"]
        return "not proved", ", ".join(short)
    t = np.round(PERIOD * np.arange(ROWS), 10)
    inputs = np.array(body["flow"].get("B", np.zeros((len(body["flow"]["A"]), 0)))).shape[1]
    u = np.sin(t[:, None] * (1 + np.arange(inputs)))
    x0 = rng.standard_normal(len(body["flow"]["A"]))
    impulses = train(rng, len(body["jump"]["H"][0]))
    x = record(body, impulses, t, u, x0)
    observer: Any = from_design(found.design)
    y = x @ np.array(body["output"]["C"]).T
    events = observer.run_batch(t, y, u if inputs else None, x=x0).events
    told = f"{observer.gains['rule']}, {found.result['form']}"
    if len(events) == len(impulses):
        off = max(max(abs(e.t - s), np.abs(e.weights - g).max())
                  for e, (s, g) in zip(events, impulses, strict=True))  # fmt: skip
        if off <= TOLERANCE:
            return "found", told
        told = f"off by {off:.1e}: {told}"
    else:
        told = f"{len(events)} of {len(impulses)}: {told}"
    A, H = np.array(body["flow"]["A"]), np.array(body["jump"]["H"])
    sides = np.hstack([H, A @ H])
    turned = np.linalg.svd(sides / np.linalg.norm(sides, axis=0), compute_uv=False)
    hidden = len(turned) < 2 * H.shape[1] or turned[-1] < NEARLY
    return (HIDDEN if hidden else "missed"), told


def main() -> None:
    plants = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    first = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    words: Counter[str] = Counter()
    for seed in range(first, first + plants):
        word, told = outcome(seed)
        words[word] += 1
        if word not in ("found", HIDDEN):
            print(f"seed {seed}: {word}, {told}", flush=True)
    print(", ".join(f"{word} {count}" for word, count in words.most_common()))


if __name__ == "__main__":
    main()
