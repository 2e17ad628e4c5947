"""Do errors of point observers in discrete time decay where they are proved to?

    python -m tests.long.random_step_observers [PLANTS] [FIRST_SEED]

Random plants (n = 1..3) with events 1 to 8 steps apart and random gains near the border of stability.
Proved: products of the maps of random times between events decay. Refuted: the largest spectral
radius over all words of few times is at least 1. Prints counts of verdicts; exits with 1 on a
contradiction.
"""

from __future__ import annotations

import sys
from itertools import product
from typing import Any

import numpy as np

from obsdesign import workflow
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem

_LONGEST_WORD, _PRODUCTS = 4, 400


def random_body(rng: np.random.Generator) -> dict[str, Any]:
    """A plant and gains near the border of stability."""
    n, low = int(rng.integers(1, 4)), int(rng.integers(1, 5))
    A = rng.normal(size=(n, n))
    A *= rng.uniform(0.7, 1.1) / np.abs(np.linalg.eigvals(A)).max()
    G, C = np.eye(n) + 0.5 * rng.normal(size=(n, n)), rng.normal(size=(1, n))
    high = low + int(rng.integers(0, 4))
    gains = {name: 0.2 * rng.normal(size=(n, 1)) for name in "LM"}
    return {
        "flow": {"dt": 0.5, "A": A}, "jump": {"G": G, "dwell_time": [0.5 * low, 0.5 * high]},
        "output": {"C": C}, "observer": {"kind": "luenberger", "gains": gains},
    }  # fmt: skip


def largest_radius(maps: list[Any]) -> float:
    """Largest spectral radius over words, per letter."""
    best = 0.0
    for length in range(1, _LONGEST_WORD + 1):
        for word in product(maps, repeat=length):
            whole = word[0] if length == 1 else np.linalg.multi_dot(word)
            best = max(best, float(np.abs(np.linalg.eigvals(whole)).max()) ** (1 / length))
    return best


def tried(seed: int) -> tuple[str, bool]:
    """(verdict, is it contradicted?)"""
    rng = np.random.default_rng(seed)
    body = random_body(rng)
    try:
        outcome = workflow.investigate(Problem.from_dict(body))
    except InputError:
        return "refused", False
    verdict = {claim.id: claim.verdict for claim in outcome.claims}.get("step_stability", "none")
    A, C = (np.array(body[block][key]) for block, key in (("flow", "A"), ("output", "C")))
    L, M = (body["observer"]["gains"][name] for name in "LM")
    F, H = (np.eye(len(A)) - L @ C) @ A, (body["jump"]["G"] - M @ C) @ A
    low, high = (round(end / 0.5) for end in body["jump"]["dwell_time"])
    maps = [H @ np.linalg.matrix_power(F, k - 1) for k in range(low, high + 1)]
    radius = largest_radius(maps)
    if verdict == "proved":
        whole = np.eye(len(A))
        for k in rng.integers(0, len(maps), _PRODUCTS):
            whole = maps[k] @ whole
        return verdict, radius >= 1 or np.abs(whole).max() > 1
    return verdict, verdict == "refuted" and radius < 1 - 1e-9


def main(plants: int, first: int) -> int:
    """Try the plants; exit code."""
    counts: dict[str, int] = {}
    wrong = 0
    for seed in range(first, first + plants):
        verdict, is_contradicted = tried(seed)
        counts[verdict] = counts.get(verdict, 0) + 1
        wrong += is_contradicted
        if is_contradicted:
            print(f"seed {seed}: {verdict} is contradicted")
    print(counts, f"contradicted: {wrong}")
    return int(bool(wrong))


if __name__ == "__main__":
    arguments = [int(word) for word in sys.argv[1:]]
    sys.exit(main(*(arguments + [100, 0][len(arguments) :])))
