"""Random plants with stated poles: verdicts of the kinds that place them, and false refutations.

python -m tests.long.stated_poles [plants]: n of 2 to 6, one and two outputs, in wild units and as
chains of integrators too. All poles decay, so that no refutation is right. Prints every one.
"""

from __future__ import annotations

import sys
from collections import Counter
from typing import Any

import numpy as np

import obsdesign

KINDS = ("luenberger", "impulsive_input", "unknown_input")
FAMILIES = ("generic", "whole numbers", "chain", "wild units")


def draw(seed: int) -> tuple[str, dict[str, Any]]:
    """Family and problem of a seed."""
    rng = np.random.default_rng(seed)
    kind, family = KINDS[seed % 3], FAMILIES[seed // 3 % 4]
    n, p = int(rng.integers(2, 7)), int(rng.integers(1, 3))
    q = 1 if kind == "unknown_input" else 0
    A, C = rng.normal(size=(n, n)), rng.normal(size=(p, n))
    if family == "whole numbers":
        A, C = np.round(2 * A), np.round(2 * C)
    if family == "chain":
        A = np.diag(np.round(rng.uniform(-3, 3, n), 2)) + np.diag(np.ones(n - 1), 1)
        C = np.eye(p, n)
    if family == "wild units":
        sizes = 2.0 ** rng.integers(-12, 12, n)
        A, C = A * sizes / sizes[:, None], C * sizes * 10.0 ** rng.integers(-3, 3, (p, 1))
    pace = 10.0 ** rng.uniform(-2, 1)
    poles = [-pace * (1 + 0.3 * i) for i in range(n - q)]
    body: dict[str, Any] = {
        "flow": {"A": A.tolist()},
        "output": {"C": C.tolist()},
        "observer": {"kind": kind, "poles": poles},
    }
    if kind == "impulsive_input":
        body["jump"] = {"H": np.eye(n)[:, -1:].tolist(), "dwell_time": [2.0, "inf"]}
    if kind == "unknown_input":
        # y1 shows d at once; with two outputs the second one is left for the gain
        D = np.linalg.pinv(C)[:, :1] if family != "chain" else np.eye(n, 1)
        body["flow"]["D"] = D.tolist()
        body["output"] |= {"measured": "periodic", "period": 0.01}
        if p == 1:  # nothing is left to place: n - 1 zeros
            body["observer"].pop("poles")
    return family, body


def main() -> int:
    """Count the verdicts by kind, number of outputs and family."""
    plants = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    counts: Counter[tuple[str, int, str]] = Counter()
    wrong = 0
    for seed in range(plants):
        family, body = draw(seed)
        kind, p = body["observer"]["kind"], len(body["output"]["C"])
        try:
            outcome = obsdesign.investigate(obsdesign.Problem.from_dict(body), seconds=2)
            verdict = outcome.verdict
        except obsdesign.InputError:
            verdict = "refused"
        counts[kind, p, verdict] += 1
        if verdict == "refuted":
            claims = {claim.id: claim for claim in outcome.claims if claim.verdict == "refuted"}
            of_plant = {"observable", "rank", "zeros", "window", "samples", "uniqueness"} & set(
                claims
            )
            wrong += not of_plant
            if not of_plant:
                print("refuted:", seed, family, list(claims))
    for key, count in sorted(counts.items()):
        print(*key, count)
    print("refuted though every stated pole decays:", wrong)
    return int(wrong > 0)


if __name__ == "__main__":
    raise SystemExit(main())
