"""Find, prove, refute: is x -> e^{F theta} H x stable for every sequence of theta in a range?

The three parts are separate programs; this file only lets them take turns.
"""

from __future__ import annotations

import math

from numpy.typing import ArrayLike

from lmi.balls import exact, to_float
from lmi.cutting_plane import propose
from lmi.hurwitz import prove_hurwitz
from lmi.proof import prove_common
from lmi.spectral import refute_spectral
from lmi.verdict import Verdict, undecided

_TURNS = 6


def decide(F: ArrayLike, H: ArrayLike, low: float, high: float) -> Verdict:
    """Proved by one P (evidence["P"]), refuted by a mode or a dwell time, or undecided.

    F, H: (n, n) floats or exact rationals; 0 <= low <= high <= infinity. With high infinite, F must
    be Hurwitz (otherwise refuted with the mode). Undecided evidence keeps the last P, if any.
    """
    F_exact, H_exact = exact(F), exact(H)
    if math.isinf(high):
        flow = prove_hurwitz(F_exact)
        if flow.outcome != "proved":
            return flow
    F_float, H_float = to_float(F_exact), to_float(H_exact)
    seeds: list[float] = []
    attempt = undecided("no matrix P was found")
    for _ in range(_TURNS):
        proposal = propose(F_float, H_float, low, high, seeds)
        if proposal.P is None:
            attempt = undecided(
                "no common P was found, which is not instability",
                theta=proposal.worst_theta,
                thetas=list(proposal.thetas),
            )
            break
        attempt = prove_common(F_exact, H_exact, proposal.P, low, high)
        if attempt.outcome == "proved":
            found = {"P": proposal.P.tolist(), "thetas_used": len(proposal.thetas)}
            return Verdict("proved", {**found, **attempt.evidence})
        theta = attempt.evidence.get("theta")
        if theta is None or theta in seeds:
            break
        seeds.append(float(theta))
    counter = refute_spectral(F_exact, H_exact, low, high)
    return counter if counter.outcome == "refuted" else attempt
