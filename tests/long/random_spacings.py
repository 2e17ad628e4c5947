"""Does any sequence of spacings contradict a certified window, or its rate? Random plants.

    python tests/long/random_spacings.py [PLANTS] [FIRST_SEED]

Random plants (n = 1..4, windows of up to three, jumps regular, singular or of rank one) are
designed by any strategy. For those that are proved, random sequences of spacings (uniform, at the
ends, constant) must keep the smallest singular value of the window matrix above its bound, and the
error below constant * per_impulse^N. Exits with 1 on a contradiction.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

import obsdesign
from lmi.arithmetic.exponential import expm
from obsdesign.equations.impulsive.gains import core_of, window_gains, window_matrix

WINDOWS, SEQUENCES, IMPULSES = 2000, 40, 25
# singular values and products in binary64, against proofs in exact arithmetic
ROUNDING = 1e-9


def plant(rng: np.random.Generator) -> dict[str, Any]:
    """A problem: matrices of unit size, spacings that move the fastest mode by up to a turn."""
    n = int(rng.integers(1, 5))
    p = int(rng.integers(1, 3)) if n < 4 else 2
    A, G, C = rng.standard_normal((n, n)), rng.standard_normal((n, n)), rng.standard_normal((p, n))
    shape = rng.random()
    if shape < 0.25:
        G = np.eye(n)
    elif shape < 0.5:
        G[:, : max(1, n // 2)] = 0
    elif shape < 0.6:
        G = np.outer(G[:, 0], G[0])
    low = float(rng.uniform(0.1, 0.4))
    dwell = [low, low + float(rng.uniform(0.05, 0.3))]
    return {
        "flow": {"A": A.tolist()},
        "jump": {"G": G.tolist(), "dwell_time": dwell},
        "output": {"C": C.tolist(), "measured": "at_jumps"},
        "observer": {"kind": "impulsive", "alpha": float(rng.uniform(1.05, 2.0))},
    }


def spacings(rng: np.random.Generator, low: float, high: float, shape: tuple[int, int]) -> Any:
    """Uniform, at the ends, or constant along each row."""
    kinds = rng.integers(0, 3, shape[0])[:, None]
    ends = np.where(rng.random(shape) < 0.5, low, high)
    constant = np.repeat(rng.uniform(low, high, (shape[0], 1)), shape[1], axis=1)
    return np.choose(kinds, [rng.uniform(low, high, shape), ends, constant])


def contradiction(seed: int) -> tuple[str, str | None]:
    """(verdict, what contradicts it) for one random plant."""
    rng = np.random.default_rng(seed)
    outcome = obsdesign.investigate(obsdesign.Problem.from_dict(plant(rng)))
    if outcome.verdict != "proved" or outcome.design is None:
        return outcome.verdict, None
    gains = outcome.design.gains
    evidence = {claim.id: claim.evidence for claim in outcome.claims}
    core, (low, high) = core_of(gains), gains["dwell_time"]
    blocks = evidence["strongly_observable"]["blocks"]
    sample = spacings(rng, low, high, (WINDOWS, core.spacings(blocks)))
    rows, _ = window_matrix(core, expm(core.A * sample[..., None, None]))
    least = float(np.linalg.svd(rows, compute_uv=False)[:, -1].min())
    if least < evidence["strongly_observable"]["sigma_min"] * (1 - ROUNDING):
        return "proved", f"sigma_min {least!r} below its bound"
    return "proved", _too_slow(gains, core, evidence.get("rate"), rng)


def _too_slow(gains: Any, core: Any, rate: Any, rng: np.random.Generator) -> str | None:
    if rate is None:
        return None
    (low, high), window = gains["dwell_time"], int(gains["window"])
    m = core.spacings(window)
    sample = spacings(rng, low, high, (SEQUENCES, IMPULSES + m))
    flows = expm(gains["A"] * sample[..., None, None])
    inner = expm(core.A * sample[..., None, None])
    product = np.broadcast_to(np.eye(len(gains["A"])), flows[:, 0].shape)
    for k in range(IMPULSES):
        L = window_gains(core, inner[:, k : k + m], gains["alpha"])
        L = L if core.lift is None else core.lift @ L
        product = flows[:, k + m] @ ((gains["G"] + L @ gains["C"]) @ product)
        growth = float(np.linalg.norm(product, 2, axis=(1, 2)).max())
        if growth > rate["constant"] * rate["per_impulse"] ** (k + 1) * (1 + ROUNDING):
            return f"growth {growth!r} after {k + 1} impulses above its bound"
    return None


def main() -> int:
    """Counts of verdicts; 1 if anything contradicts."""
    plants = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    start = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    counts: dict[str, int] = {}
    for seed in range(start, start + plants):
        verdict, what = contradiction(seed)
        counts[verdict] = counts.get(verdict, 0) + 1
        if what is not None:
            print(f"seed {seed}: {what}")
            return 1
    print(", ".join(f"{count} {verdict}" for verdict, count in sorted(counts.items())))
    return 0


if __name__ == "__main__":
    sys.exit(main())
