"""How fast a proved system decays: per jump and in time, in the norm of its certificate P.

    per jump   |M(theta) x|_P <= gamma |x|_P                          for all theta in the range
    in time    |M(theta) x|_P <= e^{-alpha theta} |x|_P               (the same for F + alpha I)

The numbers are estimated on a grid, relaxed a little, and proved with the same P.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lmi.balls import exact, to_float
from lmi.families import Edge, slack
from lmi.proof import prove_common
from lmi.verdict import Verdict, proved, undecided

Matrix = NDArray[np.float64]

_SMALLEST = 1e-6  # a map that vanishes (H = 0) still has to be given some rate
# estimates are relaxed by these shares in turn, until one is proved
_RELAXATIONS = (1e-4, 1e-2, 0.1, 0.5)


@dataclass(frozen=True)
class Rates:
    """per_jump: gamma in (0, 1); in_time: alpha >= 0, 1 / time unit."""

    per_jump: float
    in_time: float


def propose_rates(
    F: ArrayLike, H: ArrayLike, P: ArrayLike, low: float, high: float
) -> Rates | None:
    """The largest rates that P seems to allow and that could be proved; None if there are none.

    F, H: (n, n) floats or exact rationals; P the matrix of a proof over [low, high].
    """
    matrix = np.asarray(P, dtype=np.float64)
    edge = Edge(to_float(exact(F)), to_float(exact(H)), low, high)
    with np.errstate(all="ignore"):
        thetas, maps = edge.grid()
        norms = np.sqrt(np.clip(1.0 - slack(matrix, maps), _SMALLEST**2, None))
        if not np.isfinite(norms).all():
            return None
        later = thetas > 0
        in_time = float(np.min(-np.log(norms[later]) / thetas[later], initial=math.inf))
    if math.isinf(high):
        in_time = min(in_time, -float(np.linalg.eigvals(edge.F).real.max()))
    if not (math.isfinite(in_time) and in_time > 0):
        in_time = 0.0
    gamma = float(norms.max())
    for share in _RELAXATIONS:
        rates = Rates(gamma ** (1 - share), in_time * (1 - share))
        if prove_rates(F, H, matrix, low, high, rates).outcome == "proved":
            return rates
    return None


def prove_rates(
    F: ArrayLike, H: ArrayLike, P: ArrayLike, low: float, high: float, rates: Rates
) -> Verdict:
    """Both rates for all theta in [low, high], in balls; proved or undecided."""
    if not (0 < rates.per_jump < 1 and 0 <= rates.in_time < math.inf):
        return undecided("a rate per jump lies in (0, 1), a rate in time is >= 0")
    F_exact = exact(F)
    shifted = F_exact + exact(rates.in_time * np.eye(len(F_exact)))
    evidence: dict[str, Any] = {"per_jump": rates.per_jump, "in_time": rates.in_time}
    for name, verdict in (
        ("per jump", prove_common(F_exact, H, P, low, high, gamma=rates.per_jump)),
        ("in time", prove_common(shifted, H, P, low, high)),
    ):
        if verdict.outcome != "proved":
            return undecided(f"the rate {name} is not proved: {verdict.evidence['reason']}")
    return proved(**evidence)
