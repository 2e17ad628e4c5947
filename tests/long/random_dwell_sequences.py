"""Does any sequence of dwell times contradict a proof? 100 000 random ones, and the worst found.

    python tests/long/random_dwell_sequences.py [SEQUENCES] [FIRST_SEED]

Random systems (n = 1..6) near the limit of what can be proved, some with dwell times that change
slowly only: for each one that is proved, admissible sequences of 40 dwell times (uniform, at the
ends, alternating, and the worst that the search for destabilising ones finds) must never let the
proved norm x' P x, P that of the window the sequence is in, grow along x -> e^{F theta} H x. Exits
with 1 on a contradiction.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from lmi.arithmetic.balls import exact, rank_factors, to_float
from lmi.arithmetic.exponential import expm
from lmi.decide.stability import decide
from lmi.families import Edge
from lmi.find.worst_sequence import worst_word

LENGTH = 40
PER_SYSTEM = 500
# products of 40 maps in binary64, against a proof in exact arithmetic
ROUNDING = 1e-9


def system(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, float, float, float]:
    """F, H, low, high, jitter; H scaled to 85 to 102 % of the largest constant-dwell gain."""
    n = int(rng.integers(1, 7))
    F, H = rng.standard_normal((2, n, n))
    low = float(rng.uniform(0, 0.5))
    high = low + float(rng.uniform(0.1, 1.5))
    maps = expm(F * np.linspace(low, high, 200)[:, None, None]) @ H
    worst = np.abs(np.linalg.eigvals(maps)).max()
    jitter = float(rng.uniform(0.05, 0.5)) if rng.uniform() < 0.2 else math.inf
    if rng.uniform() < 0.3:  # singular, as jumps often are
        H[:, 0] = 0.0
    return F, H * rng.uniform(0.85, 1.02) / worst, low, high, jitter


def sequences(
    rng: np.random.Generator, F: np.ndarray, H: np.ndarray, low: float, high: float, jitter: float
) -> np.ndarray:
    """(PER_SYSTEM, LENGTH) admissible dwell times of several characters."""
    part = PER_SYSTEM // 4
    thetas = rng.uniform(low, high, (PER_SYSTEM, LENGTH))
    thetas[:part] = rng.choice([low, high], (part, LENGTH))
    pair = rng.uniform(low, high, (part, 2))
    thetas[part : 2 * part] = np.tile(pair, LENGTH // 2)
    word = np.array(
        worst_word(Edge(F, H, low, high), np.eye(len(F)), (), rng, jitter=jitter).thetas
    )
    shifts = [np.resize(np.roll(word, int(k)), LENGTH) for k in rng.integers(0, len(word), part)]
    adverse = np.array(shifts) + rng.choice([0.0, 1e-3, 0.1], (part, 1)) * rng.normal(
        size=(part, LENGTH)
    )
    thetas[2 * part : 3 * part] = np.clip(adverse, low, high)
    for k in range(1, LENGTH):  # what lies further away than allowed comes as close as it may
        before = thetas[:, k - 1]
        thetas[:, k] = np.clip(thetas[:, k], before - jitter, before + jitter)
    return thetas


def roots(evidence: Mapping[str, Any], H: np.ndarray, thetas: np.ndarray) -> np.ndarray:
    """R (sequences, LENGTH + 1, m, n), x' P x = |R x|^2, just before each jump and after all."""
    count, length = thetas.shape
    if "P" in evidence:
        R = np.linalg.cholesky(np.array(evidence["P"])).T
        return np.broadcast_to(R, (count, length + 1, *R.shape))
    all_P = np.array([window["P"] for window in evidence["windows"]])
    R = np.swapaxes(np.linalg.cholesky(all_P), 1, 2)
    if R.shape[1] < len(H):
        R = R @ to_float(rank_factors(exact(H))[1]).T
    windows = np.full((count, length + 1), -1)
    for w, window in enumerate(evidence["windows"]):
        inside = np.ones((count, length + 1), dtype=bool)
        for offset, (low, high) in window["dwell"].items():
            # dwell times before the first and after the last may be anything: those at the ends
            k = np.clip(np.arange(length + 1) + int(offset), 0, length - 1)
            closed = high == max(w["dwell"].get(offset, [0, high])[1] for w in evidence["windows"])
            inside &= (thetas[:, k] >= low) & ((thetas[:, k] < high) | closed)
        windows[inside] = w
    assert (windows >= 0).all(), "a sequence in no window"
    return R[windows]


def excess(seed: int) -> float | None:
    """Largest growth of the proved norm along random sequences; None when nothing was proved."""
    rng = np.random.default_rng(seed)
    F, H, low, high, jitter = system(rng)
    verdict = decide(F, H, low, high, jitter=jitter)
    if verdict.outcome != "proved":
        return None
    thetas = sequences(rng, F, H, low, high, jitter)
    R = roots(verdict.evidence, H, thetas)
    x = rng.standard_normal((PER_SYSTEM, len(F), 1))
    worst = -np.inf
    for k, theta in enumerate(thetas.T):
        size = np.linalg.norm(R[:, k] @ x, axis=(1, 2))
        x = expm(F * theta[:, None, None]) @ (H @ x)
        following = np.linalg.norm(R[:, k + 1] @ x, axis=(1, 2))
        seen = size > 0
        worst = max(worst, float(np.max(following[seen] / size[seen], initial=0.0)))
        x = x / np.maximum(np.linalg.norm(x, axis=(1, 2)), 1e-300)[:, None, None]
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
