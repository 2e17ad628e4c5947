"""Does any sequence of dwell times contradict a proof? 100 000 random ones, and the worst found.

    python scripts/random_dwell_sequences.py [SEQUENCES] [FIRST_SEED]

Random systems (n = 1..6) near the limit of what can be proved: for each one that is proved,
random admissible sequences of 40 dwell times (uniform, at the ends, alternating) must never let
the proved norm x' P x grow along x -> e^{F theta} H x. Exits with 1 on a contradiction.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))

from lmi.decide import decide
from lmi.exponential import expm

LENGTH = 40
PER_SYSTEM = 500
# products of 40 maps in binary64, against a proof in exact arithmetic
ROUNDING = 1e-9


def system(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, float, float]:
    """F, H, low, high; H scaled to between 70 and 105 % of the largest constant-dwell gain."""
    n = int(rng.integers(1, 7))
    F, H = rng.standard_normal((2, n, n))
    low = float(rng.uniform(0, 0.5))
    high = low + float(rng.uniform(0.1, 1.5))
    maps = expm(F * np.linspace(low, high, 200)[:, None, None]) @ H
    worst = np.abs(np.linalg.eigvals(maps)).max()
    return F, H * rng.uniform(0.7, 1.05) / worst, low, high


def sequences(rng: np.random.Generator, low: float, high: float) -> np.ndarray:
    """(PER_SYSTEM, LENGTH) admissible dwell times of several characters."""
    thetas = rng.uniform(low, high, (PER_SYSTEM, LENGTH))
    thetas[: PER_SYSTEM // 3] = rng.choice([low, high], (PER_SYSTEM // 3, LENGTH))
    pair = rng.uniform(low, high, (PER_SYSTEM // 3, 2))
    thetas[-(PER_SYSTEM // 3) :] = np.tile(pair, LENGTH // 2)
    return thetas


def excess(seed: int) -> float | None:
    """Largest growth of the proved norm along random sequences; None when nothing was proved."""
    rng = np.random.default_rng(seed)
    F, H, low, high = system(rng)
    verdict = decide(F, H, low, high)
    if verdict.outcome != "proved":
        return None
    L = np.linalg.cholesky(np.array(verdict.evidence["P"]))
    x = rng.standard_normal((PER_SYSTEM, len(F), 1))
    size, worst = np.linalg.norm(L.T @ x, axis=(1, 2)), -np.inf
    for thetas in sequences(rng, low, high).T:
        x = expm(F * thetas[:, None, None]) @ (H @ x)
        following = np.linalg.norm(L.T @ x, axis=(1, 2))
        worst = max(worst, float(np.max(following / size)))
        x, size = x / following[:, None, None], np.ones(PER_SYSTEM)
    return worst - 1


def main() -> int:
    """Run until the number of sequences is reached."""
    wanted = int(sys.argv[1]) if len(sys.argv) > 1 else 100_000
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    tried = proved = bad = 0
    worst = -np.inf
    while proved * PER_SYSTEM < wanted:
        found = excess(seed)
        tried, seed = tried + 1, seed + 1
        if found is not None:
            proved += 1
            bad += found > ROUNDING
            worst = max(worst, found)
    print(f"{proved * PER_SYSTEM} sequences, {proved} of {tried} systems proved, "
          f"{bad} contradicted; largest growth of a proved norm {1 + worst:.9f}")  # fmt: skip
    return 1 if bad else 0


if __name__ == "__main__":
    raise SystemExit(main())
