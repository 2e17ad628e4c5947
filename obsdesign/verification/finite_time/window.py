"""Does a window of periodic samples determine the state? Exactly, and well enough.

With rational A and period no eigenvalue pair coincides exactly after sampling (2 pi is
transcendental), so that the claims ask for a margin: what is refuted has a state that the samples
hardly see, and the pair of eigenvalues that makes it so where there is one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from lmi.arithmetic.balls import exact, fixed_vector, scalar, to_float
from lmi.arithmetic.norms import well_ranked
from lmi.verdict import Verdict, proved, refuted
from obsdesign.analysis.finite_time.enclosed_gains import Sampled
from obsdesign.analysis.finite_time.error_radius import bias
from obsdesign.document import Claim
from obsdesign.equations.finite_time import gains as equations

PAPER = "Mazenc, Ahmed, MICNON 2018"
_SOURCES = {
    "sampled_observable": f"{PAPER}, Assumption 1, sampled",
    "window_long_enough": "sampled observability index",
}
# a smallest singular value below this part of the norm counts as zero
SINGULAR = 1e-11
# windows up to that many samples are tried where another one might do
_MOST_TRIED = 2048
_WITH_MARGIN = 1e-6
_MOST_AMPLIFIED = 1e6


def observable(sampled: Sampled) -> Claim:
    """Kalman's rank condition, decided exactly; the witness is a state that is never seen."""
    A, C = sampled.A, sampled.C
    blocks = [C]
    for _ in range(len(A) - 1):
        blocks.append(blocks[-1] @ A)
    vector = fixed_vector(blocks)
    verdict = proved(exact=True)
    if vector is not None:
        told = ", ".join(f"{x:.6g}" for x in vector)
        reason = f"the state ({told}) and what becomes of it is never seen in y"
        verdict = refuted({"vector": vector, "reason": reason})
    return make_claim("observable", "(A, C) is observable", f"{PAPER}, Assumption 1", verdict)


def dead_otherwise(sampled: Sampled, gains: Mapping[str, Any]) -> bool:
    """Do the stored gains show that what the samples do not see has died within the window?"""
    if sampled.reference != equations.START or gains["method"] not in equations.FREE:
        return False
    if not bias(sampled, gains["window_gain"])[1] <= scalar(exact(equations.DEAD).item()):
        return False
    # gains that pick a state out of what rounding leaves of it are no such gains
    units = sampled.units()
    seen = np.abs(exact(gains["window_gain"])) @ np.abs(sampled.rows())
    amplified: list[Any] = list((seen * units / units[:, None]).flat)
    return all(bool(x <= scalar(exact(_MOST_AMPLIFIED).item())) for x in amplified)


def _but_for_the_dead(verdict: Verdict, name: str, statement: str, dead: bool) -> Claim:
    """A rank that is needed only of what lasts."""
    if verdict.outcome != "proved" and dead:
        statement = (
            f"{statement}; or, as here, what they do not tell apart at the window's start is at "
            f"its end at most {equations.DEAD:g} of what it was: sum_j G_j C A_d^j = A_d^k to "
            "within that for the stored gains, and no entry of sum_j |G_j| |C A_d^j| is above "
            f"{_MOST_AMPLIFIED:g} (scaled)"
        )
        verdict = proved(died_out=True)
    return make_claim(name, statement, _SOURCES[name], verdict)


def sampled_observable(sampled: Sampled, dead: bool = False) -> Claim:
    """The rank of max(k, n) samples: their spacing, not their number, is in question.

    dead: is what they do not see dead at the window's end (`dead_otherwise`)?
    """
    n = len(sampled.A)
    verdict = _row_rank(sampled, max(sampled.k, n))
    if verdict.outcome == "refuted" and not dead:
        verdict = with_reason(verdict, _why_badly_sampled(sampled))
    statement = (
        f"samples {sampled.period!r} apart see every state: the smallest singular value of the "
        f"scaled C A_d^-l, l = 1..{max(sampled.k, n)}, or of the scaled C A_d^l, l = 0.., is at "
        f"least {SINGULAR:g} of their norm"
    )
    return _but_for_the_dead(verdict, "sampled_observable", statement, dead)


def _why_badly_sampled(sampled: Sampled) -> str:
    pairs = equations.pathological_pairs(to_float(sampled.A), sampled.period)
    if pairs:
        one, other, turns = pairs[0]
        return (
            f"pathological sampling: the eigenvalues {one:.6g} and {other:.6g} of A differ by "
            f"{turns:.9g} times 2 pi i / period, so that samples {sampled.period!r} apart cannot "
            "tell them apart; choose another period"
        )
    told = (
        f"samples {sampled.period!r} apart, {max(sampled.k, len(sampled.A))} of them, hardly see a "
        "state; "
    )
    k = _enough_samples(sampled)
    if k is None:
        return told + "change the period or the window"
    return told + f"{k} of them, a window of {k * sampled.period:.9g}, see every state"


def _enough_samples(sampled: Sampled) -> int | None:
    """2, 1/2, 4, 1/4, ... times as many samples: the first with a margin, else the best one.

    Only if the claim is proved for it.
    """
    A, C, n = to_float(sampled.A), to_float(sampled.C), len(sampled.A)
    first = max(sampled.k, n)
    powers = range(1, _MOST_TRIED.bit_length())
    counts = [k for i in powers for k in (first << i, first >> i) if n <= k <= _MOST_TRIED]

    def seen(k: int) -> float:
        return min(equations.approx_reach(A, C, sampled.period, k), _WITH_MARGIN)

    best = max(counts, key=seen, default=None)
    if best is None or seen(best) < SINGULAR or _row_rank(sampled, best).outcome != "proved":
        return None
    return best


def long_enough(sampled: Sampled, dead: bool = False) -> Claim:
    """The rank of the window's own samples; dead: as for `sampled_observable`."""
    verdict = _row_rank(sampled, sampled.k)
    if verdict.outcome == "refuted" and not dead:
        least = sampled_index(sampled)
        reason = f"the window holds {sampled.k} samples; at least {least} are needed"
        verdict = with_reason(verdict, reason)
    statement = (
        f"the window's {sampled.k} samples determine the state: the same for l = 1..{sampled.k}"
    )
    return _but_for_the_dead(verdict, "window_long_enough", statement, dead)


def sampled_index(sampled: Sampled) -> int:
    """Fewest samples whose rows have full rank (in floats; a rank at l = n is a rank for ever)."""
    A, C = to_float(sampled.A), to_float(sampled.C)
    for k in range(1, len(A) + 1):
        if equations.approx_reach(A, C, sampled.period, k) >= SINGULAR:
            return k
    return len(A)


def _row_rank(sampled: Sampled, k: int) -> Verdict:
    """The rank of C A_d^-l, l = 1..k, in units of `state_scales`, rows at unit length.

    Or of C A_d^l: fast stable modes dwarf all others in the rows of the first, unstable ones in
    those of the second; what the samples hardly see, neither sees.
    """
    first: Verdict | None = None
    for reference in equations.REFERENCES:
        window = replace(sampled, k=k, reference=reference)
        scaled = window.rows() * window.units()
        units = [_power_of_two(sum(x * x for x in row)) for row in scaled]
        verdict = well_ranked(scaled * np.array(units, dtype=object)[:, None], SINGULAR)
        if verdict.outcome == "proved":
            return verdict
        if first is None or verdict.outcome == "undecided":
            first = verdict
    assert first is not None
    return first


def _power_of_two(square: Any) -> Any:
    """About 1 / sqrt(square), exactly a power of two; 1 for zero. Balls may be beyond binary64."""
    if not square > 0:
        return scalar(1)
    return scalar(2) ** -round(float((square.mid().log() / scalar(4).log()).mid()))


def with_reason(verdict: Verdict, reason: str) -> Verdict:
    """A refutation told in words."""
    rest = {name: value for name, value in verdict.evidence.items() if name != "witness"}
    return refuted({**verdict.evidence["witness"], "reason": reason}, **rest)


def make_claim(name: str, statement: str, source: str, verdict: Verdict) -> Claim:
    """A claim with the outcome and evidence of a verdict."""
    return Claim(name, statement, source, verdict.outcome, verdict.evidence)
