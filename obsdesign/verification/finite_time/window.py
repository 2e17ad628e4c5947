"""Claims that a window of periodic samples determines the state, with a margin.

With rational A and period no eigenvalue pair coincides exactly after sampling (2 pi is
transcendental), so that the claims require a margin: the witness of a refutation is a state that is
nearly unobservable from the samples, with the pair of eigenvalues that makes it so, if any.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lmi.arithmetic.balls import Ball, exact, fixed_vector, scalar, to_float
from lmi.arithmetic.norms import well_ranked
from lmi.verdict import Verdict, proved, refuted
from obsdesign.analysis.finite_time.enclosed_gains import Sampled
from obsdesign.analysis.finite_time.error_radius import bias
from obsdesign.document import Claim
from obsdesign.equations.finite_time.gains import FREE, FiniteTimeGains
from obsdesign.equations.finite_time.rows import (
    DECAYED,
    REFERENCES,
    SINGULAR,
    START,
    approx_observability_index,
    approx_window_determinacy,
    pathological_pairs,
)

PAPER = "Mazenc, Ahmed, MICNON 2018"
_SOURCES = {
    "sampled_observable": f"{PAPER}, Assumption 1, sampled",
    "window_long_enough": "sampled observability index",
}
# windows up to that many samples are tried where another one might do
_MOST_TRIED = 2048
_WITH_MARGIN = 1e-6
_MOST_AMPLIFIED = 1e6


def observable(sampled: Sampled) -> Claim:
    """Claim of Kalman's rank condition, decided exactly; the witness is an unobservable state."""
    A, C = sampled.A, sampled.C
    blocks = [C]
    for _ in range(len(A) - 1):
        blocks.append(blocks[-1] @ A)
    vector = fixed_vector(blocks)
    verdict = proved(exact=True)
    if vector is not None:
        state = ", ".join(f"{x:.6g}" for x in vector)
        reason = f"the state ({state}) is unobservable: C A^k x = 0 for all k"
        verdict = refuted({"vector": vector, "reason": reason})
    source = f"{PAPER}, Assumption 1"
    return Claim.from_verdict("observable", "(A, C) is observable", source, verdict)


def unobserved_modes_decay(sampled: Sampled, gains: FiniteTimeGains) -> bool:
    """Do the stored gains show that the unobserved modes decay within the window?"""
    if sampled.reference != START or gains.method not in FREE:
        return False
    if not bias(sampled, gains.window_gain)[1] <= scalar(exact(DECAYED).item()):
        return False
    # large gains could recover a state from the rounding of its samples
    amplification = sampled.in_units(np.abs(exact(gains.window_gain)) @ np.abs(sampled.rows))
    return bool((amplification <= scalar(exact(_MOST_AMPLIFIED).item())).all())


def _rank_or_decayed(verdict: Verdict, name: str, statement: str, decayed: bool) -> Claim:
    """Claim of full rank, or that the unobserved modes decay below DECAYED within the window."""
    if verdict.outcome != "proved" and decayed:
        statement = (
            f"{statement}; or, as here, what they do not tell apart at the window's start is at "
            f"its end at most {DECAYED:g} of what it was: sum_j G_j C A_d^j = A_d^k to "
            "within that for the stored gains, and no entry of sum_j |G_j| |C A_d^j| is above "
            f"{_MOST_AMPLIFIED:g} (scaled)"
        )
        verdict = proved(died_out=True)
    return Claim.from_verdict(name, statement, _SOURCES[name], verdict)


def sampled_observable(sampled: Sampled, decayed: bool = False) -> Claim:
    """Claim of the rank of max(k, n) samples, which their spacing decides and not their number.

    decayed: see `unobserved_modes_decay`.
    """
    n = len(sampled.A)
    verdict = _row_rank(sampled, max(sampled.k, n))
    if verdict.outcome == "refuted" and not decayed:
        verdict = with_reason(verdict, _reason_against_period(sampled))
    statement = (
        f"samples {sampled.period!r} apart see every state: the smallest singular value of the "
        f"scaled C A_d^-l, l = 1..{max(sampled.k, n)}, or of the scaled C A_d^l, l = 0.., is at "
        f"least {SINGULAR:g} of their norm"
    )
    return _rank_or_decayed(verdict, "sampled_observable", statement, decayed)


def _reason_against_period(sampled: Sampled) -> str:
    pairs = pathological_pairs(to_float(sampled.A), sampled.period)
    if pairs:
        first, second, turns = pairs[0]
        return (
            f"pathological sampling: the eigenvalues {first:.6g} and {second:.6g} of A differ by "
            f"{turns:.9g} times 2 pi i / period, so that samples {sampled.period!r} apart cannot "
            "tell them apart; choose another period"
        )
    reason = (
        f"samples {sampled.period!r} apart, {max(sampled.k, len(sampled.A))} of them, hardly see a "
        "state; "
    )
    k = _enough_samples(sampled)
    if k is None:
        return reason + "change the period or the window"
    return reason + f"{k} of them, a window of {k * sampled.period:.9g}, see every state"


def _enough_samples(sampled: Sampled) -> int | None:
    """2, 1/2, 4, 1/4, ... times as many samples: the first with a margin, else the best one.

    Only if the claim is proved for it.
    """
    A, C, n = to_float(sampled.A), to_float(sampled.C), len(sampled.A)
    first = max(sampled.k, n)
    powers = range(1, _MOST_TRIED.bit_length())
    counts = [k for i in powers for k in (first << i, first >> i) if n <= k <= _MOST_TRIED]

    def determinacy(k: int) -> float:
        return min(approx_window_determinacy(A, C, sampled.period, k), _WITH_MARGIN)

    best = max(counts, key=determinacy, default=None)
    if best is None or determinacy(best) < SINGULAR or _row_rank(sampled, best).outcome != "proved":
        return None
    return best


def long_enough(sampled: Sampled, decayed: bool = False) -> Claim:
    """Claim of the rank of the window's own samples; decayed: see `unobserved_modes_decay`."""
    verdict = _row_rank(sampled, sampled.k)
    if verdict.outcome == "refuted" and not decayed:
        least = sampled_index(sampled)
        reason = f"the window holds {sampled.k} samples; at least {least} are needed"
        verdict = with_reason(verdict, reason)
    statement = (
        f"the window's {sampled.k} samples determine the state: the same for l = 1..{sampled.k}"
    )
    return _rank_or_decayed(verdict, "window_long_enough", statement, decayed)


def sampled_index(sampled: Sampled) -> int:
    """Fewest samples whose rows have full rank in floats; more than n add no rank."""
    A, C = to_float(sampled.A), to_float(sampled.C)
    return approx_observability_index(A, C, sampled.period) or len(A)


def _row_rank(sampled: Sampled, k: int) -> Verdict:
    """Decide the rank of C A_d^-l, l = 1..k, in units of `state_scales`, rows at unit length.

    Or of C A_d^l: fast stable modes dominate the rows of the first, unstable ones those of the
    second; a state that is nearly unobservable from the samples is so in both.
    """
    first: Verdict | None = None
    for reference in REFERENCES:
        window = replace(sampled, k=k, reference=reference)
        scaled = window.rows * window.units
        units = [_power_of_two(sum(x * x for x in row)) for row in scaled]
        verdict = well_ranked(scaled * np.array(units, dtype=object)[:, None], SINGULAR)
        if verdict.outcome == "proved":
            return verdict
        if first is None or verdict.outcome == "undecided":
            first = verdict
    assert first is not None
    return first


def _power_of_two(square: Ball) -> Ball:
    """Power of two near 1 / sqrt(square); 1 for zero. Balls may be beyond binary64."""
    if not square > 0:
        return scalar(1)
    return scalar(2) ** -round(float((square.mid().log() / scalar(4).log()).mid()))


def with_reason(verdict: Verdict, reason: str) -> Verdict:
    """The refutation with a reason in its witness."""
    evidence = dict(verdict.evidence)
    witness = evidence.pop("witness")
    return refuted({**witness, "reason": reason}, **evidence)
