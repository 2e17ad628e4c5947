"""Decay rates of a proved system, per jump and in time, in the norm of its certificate P.

    per jump   |M(theta) x|_P <= gamma |x|_P                          for all theta in the range
    in time    |M(theta) x|_P <= e^{-alpha theta} |x|_P               (the same for F + alpha I)

With windows of dwell times the norm is that of the P of the window, before and after. Rates that a
certificate of stability allows are read off a grid, relaxed a little, and proved with it;
`lmi.find.largest_rates` looks for better matrices.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Entries, Matrix
from lmi.arithmetic.balancing import Scaling
from lmi.arithmetic.balls import exact, rank_factors, to_float
from lmi.families import Edge, slack
from lmi.prove.common_matrix import BOX_LIMIT, prove_common
from lmi.prove.windows_proof import prove_windows
from lmi.verdict import Verdict, proved, undecided

# factor of a jump: a map that vanishes (H = 0) still has to be given some rate
LEAST_CONTRACTION = 1e-6
# most boxes for the proof of a rate that no claim rests on (stiff flows take more)
RATE_BOXES = 300
# estimates are relaxed by these shares in turn, until one is proved
_RELAXATIONS = (1e-4, 1e-2, 0.1, 0.5)


@dataclass(frozen=True)
class Rates:
    """per_jump: gamma in (0, 1); in_time: alpha >= 0, 1 / time unit."""

    per_jump: float
    in_time: float


def propose_rates(
    F: ArrayLike,
    H: ArrayLike,
    certificate: Entries,
    low: float,
    high: float,
    *,
    jitter: float = math.inf,
) -> Rates | None:
    """The largest rates that the certificate of a proved range allows in floats, proved with it.

    certificate: {"P": n x n}, or windows as `lmi.prove.windows_proof` reads them. jitter: largest
    change from one dwell time to the next. An infinite range cannot decay faster in time than the
    flow. None when nothing can be proved.
    """
    approx = approx_rates(F, H, certificate, low, high)
    if approx is None:
        return None
    for share in _RELAXATIONS:
        rates = Rates(approx.per_jump ** (1 - share), approx.in_time * (1 - share))
        done = prove_rates(
            F, H, certificate, low, high, rates=rates, jitter=jitter, steps=RATE_BOXES
        )
        if done.outcome == "proved":
            return rates
    return None


def approx_rates(
    F: ArrayLike, H: ArrayLike, certificate: Entries, low: float, high: float
) -> Rates | None:
    """The rates that a certificate allows on a grid; None where floats overflow."""
    flow, jump = exact(F), exact(H)
    scaling = Scaling.from_pair(flow, jump, high)
    F_float, H_float = to_float(scaling.map(flow)), to_float(scaling.map(jump))
    certificate = scaling.undone.restored(certificate, jump)
    with np.errstate(all="ignore"):
        try:
            pairs = [
                _edge_rates(*each) for each in _edges(F_float, H_float, certificate, low, high)
            ]
        except np.linalg.LinAlgError:
            return None
    gamma, in_time = max(pair[0] for pair in pairs), min(pair[1] for pair in pairs)
    if math.isinf(gamma):
        return None
    if math.isinf(high):
        in_time = min(in_time, -float(np.linalg.eigvals(F_float).real.max()))
    return Rates(gamma, in_time if math.isfinite(in_time) and in_time > 0 else 0.0)


def _edges(
    F: Matrix, H: Matrix, certificate: Entries, low: float, high: float
) -> Iterator[tuple[Edge, Matrix, Matrix]]:
    """Each family with the P of its source and of its target; floats."""
    if "windows" not in certificate:
        P = np.asarray(certificate["P"], dtype=np.float64)
        yield Edge(F, H, low, high), P, P
        return
    all_P = [np.asarray(window["P"], dtype=np.float64) for window in certificate["windows"]]
    left, right = (None, H)
    if len(all_P[0]) < len(H):
        U, V = rank_factors(exact(H))
        left, right = to_float(V).T, to_float(U)
    for source, target, start, end in certificate["edges"]:
        edge = Edge(F, right, float(start), float(end), left)
        yield edge, all_P[source], all_P[target]


def _edge_rates(edge: Edge, P_source: Matrix, P_target: Matrix) -> tuple[float, float]:
    """Largest norm on a grid, infinite where floats overflow, and the slowest decay in time."""
    thetas, maps = edge.grid()
    norms = np.sqrt(np.clip(1.0 - slack(P_source, maps, P_target), LEAST_CONTRACTION**2, None))
    later = thetas > 0
    in_time = np.min(-np.log(norms[later]) / thetas[later], initial=math.inf)
    return float(norms.max()), float(in_time)


def prove_rates(
    F: ArrayLike,
    H: ArrayLike,
    certificate: Entries,
    low: float,
    high: float,
    *,
    rates: Rates,
    jitter: float = math.inf,
    own: Entries | None = None,
    steps: int = BOX_LIMIT,
) -> Verdict:
    """Both rates for all theta in [low, high], in balls; proved or undecided.

    own: other matrices P for single rates, {"per_jump": n x n, "in_time": n x n}.
    """
    if not (0 < rates.per_jump < 1 and 0 <= rates.in_time < math.inf):
        return undecided("a rate per jump lies in (0, 1), a rate in time is >= 0")
    own, evidence = own or {}, {"per_jump": rates.per_jump, "in_time": rates.in_time}
    for name in ("per_jump", "in_time"):
        using = {"P": own[name]} if name in own else certificate
        verdict = prove_rate(
            F, H, using, low, high, rates=rates, name=name, jitter=jitter, steps=steps
        )
        if verdict.outcome != "proved":
            word = name.replace("_", " ")
            return undecided(f"the rate {word} is not proved: {verdict.reason}")
    return proved(**evidence, **{f"P_{name}": P for name, P in own.items()})


def prove_rate(
    F: ArrayLike,
    H: ArrayLike,
    certificate: Entries,
    low: float,
    high: float,
    *,
    rates: Rates,
    name: str,
    jitter: float = math.inf,
    steps: int = BOX_LIMIT,
) -> Verdict:
    """The rate `name` ("per_jump" or "in_time") alone, with a P or with windows."""
    flow, gamma = exact(F), 1.0
    if name == "per_jump":
        gamma = rates.per_jump
    else:
        flow = flow + exact(rates.in_time * np.eye(len(flow)))
    if "windows" in certificate:
        return prove_windows(
            flow, H, certificate, low, high, jitter=jitter, gamma=gamma, steps=steps
        )
    return prove_common(flow, H, certificate["P"], low, high, gamma=gamma, steps=steps)
