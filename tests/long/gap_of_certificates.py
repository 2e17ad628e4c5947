"""How much do certificates give away? The gap between what is proved and what is refuted.

    python tests/long/gap_of_certificates.py [SYSTEMS] [FIRST_SEED]

Random systems, n = 2..6. The growth per jump of the worst sequence found, proved for a gain just
above it, is a lower bound of the joint spectral radius; the smallest growth that a certificate
still proves is an upper bound. Printed: how far the upper bound is above the lower one, relative
to it, for one common P and for windows of dwell times.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from lmi.arithmetic.balls import exact
from lmi.arithmetic.exponential import expm
from lmi.decide.stability import find_and_prove
from lmi.families import Edge
from lmi.find.window_search import find_windows
from lmi.find.worst_sequence import worst_word
from lmi.refute.spectral import refute_word

SYSTEMS = 60
SIZES = (2, 3, 4, 5, 6)
# shares of the refuted gain that are tried in turn, from close to it on
TRIED = (3e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.3)
# a common P that comes this close has no gap worth closing
CLOSED = 1e-4


def system(seed: int) -> tuple[np.ndarray, np.ndarray, float, float]:
    """F, H, low, high: entries normal, ranges of a few tenths to a few time units."""
    rng = np.random.default_rng(seed)
    n = SIZES[seed % len(SIZES)]
    F, H = rng.standard_normal((2, n, n))
    low = float(rng.uniform(0.05, 0.5))
    return F, H, low, low + float(rng.uniform(0.2, 2.0))


def refuted_gain(F: np.ndarray, H: np.ndarray, low: float, high: float, seed: int) -> float:
    """Smallest gain of H seen to be destabilised, proved just above."""
    maps = expm(F * np.linspace(low, high, 100)[:, None, None]) @ H
    H = H / np.abs(np.linalg.eigvals(maps)).max()
    rng = np.random.default_rng(seed)
    word = worst_word(Edge(F, H, low, high), np.eye(len(F)), (), rng, enough=np.inf)
    gain = (1 + 1e-7) / word.growth
    if refute_word(F, gain * H, word.thetas).outcome != "refuted":
        raise RuntimeError(f"seed {seed}: the witness is not proved")
    return float(gain / np.abs(np.linalg.eigvals(maps)).max())


def gaps(seed: int) -> tuple[float, float, int]:
    """(gap of common P, gap of windows, number of windows)."""
    F, H, low, high = system(seed)
    gain = refuted_gain(F, H, low, high, seed)
    flow = exact(F)

    def proved(share: float, windows: bool) -> int:
        jump = exact((1 - share) * gain * H)
        if not windows:
            return int(find_and_prove(flow, jump, low, high)[0].outcome == "proved")
        verdict = find_windows(flow, jump, low, high).verdict
        return len(verdict.evidence["windows"]) if verdict.outcome == "proved" else 0

    common = next((share for share in TRIED if proved(share, False)), 1.0)
    if common <= CLOSED:
        return common, common, 1
    for share in TRIED:
        if share >= common:
            break
        if count := proved(share, True):
            return common, share, count
    return common, common, 1


def main() -> int:
    """Print one line for each system with a gap, and the distribution."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else SYSTEMS
    first = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    found = []
    for seed in range(first, first + count):
        started = time.perf_counter()
        common, windows, number = gaps(seed)
        found.append((common, windows))
        if common > CLOSED:
            print(f"seed {seed:3d}, n = {SIZES[seed % len(SIZES)]}: common P {common:.0e}, "
                  f"windows {windows:.0e} with {number}, "
                  f"{time.perf_counter() - started:.1f} s", flush=True)  # fmt: skip
    open_gaps = np.array([pair for pair in found if pair[0] > CLOSED])
    print(f"{len(found)} systems, {len(open_gaps)} with a gap above {CLOSED:g} for a common P")
    if not len(open_gaps):
        return 0
    for name, values in zip(("common P", "windows"), open_gaps.T, strict=True):
        shares = ", ".join(f"{q:.0%} <= {np.quantile(values, q):.0e}" for q in (0.25, 0.5, 0.75, 1))
        print(f"{name:8s}: {shares}")
    return int(np.median(open_gaps[:, 1]) > 1e-3)


if __name__ == "__main__":
    raise SystemExit(main())
