"""Advice for a kind that does not fit a plant, and what holds for one that does."""

from __future__ import annotations

from collections.abc import Sequence

from obsdesign.document import Claim
from obsdesign.verification.impulsive.lyapunov import LyapunovFunction

# claim that is not proved -> what may help
_CLAIMS = {
    "dwell_stability": "`obsdesign search` with --for shortest_dwell or longest_dwell finds the "
    "dwell times that can be proved; leave observer.gains out to have gains synthesised.",
    "decay_rate": "Ask for a smaller observer.decay_rate.",
    "sampled_stability": "Try a shorter output.period.",
    "hurwitz": "Leave observer.gains out to have them synthesised; with an infinite longest dwell "
    "time, try a finite jump.dwell_time[1].",
    "flow_positive": 'Try observer.form = "auto", which looks for coordinates too.',
    "jump_positive": 'Try observer.form = "auto", which looks for coordinates too.',
    "attainable": "Measure another state (a row more in output.C).",
    "detectable": "Measure what the hidden mode moves (a row more in output.C).",
    "observable": "Measure what stays hidden (a row more in output.C).",
    "sampled_observable": "Try another output.period.",
    "window_long_enough": "Try a longer observer.window.",
    "difference_invertible": "Try another observer.window, or leave observer.gains out.",
    "bounded_spacing": "Give a finite jump.dwell_time[1].",
    "shortest_spacing": "Give a positive jump.dwell_time[0].",
    "strongly_observable": "Measure more (a row more in output.C), or try a narrower range "
    "jump.dwell_time or a longer observer.window.",
    "noise_target": "Ask for a larger observer.noise_target.",
    "window": "Try observer.window below the shortest dwell time jump.dwell_time[0].",
    "exponents": "Leave observer.exponents out.",
    "ratio": "Leave observer.exponents out, or ask for a larger observer.ratio.",
    "uniqueness": "Measure another state as well, or try another observer.window.",
    "rank": "Measure what the unknown input moves first: output.C flow.D needs full column rank.",
    "zeros": "Measure another combination of states: the zeros belong to output.C and flow.D.",
}
# entry that the kind needs and the problem has not -> what may help
_MISSING = {
    "output.measured": "If y can be taken that way, say so in output.measured.",
    "jump.H": "If impulses come at unknown times, give their direction jump.H, in a file with "
    "[output] in place of named sensors.",
    "flow.D": "If an unknown input acts, give its matrix flow.D.",
    "jump.dwell_time": "Give jump.dwell_time = [shortest, longest].",
}
# kinds that do not take samples at a period
_PERIODIC = {
    "luenberger": 'Samples a period T apart are measured = "at_jumps" with jump.dwell_time = '
    "[T, T]; kinds finite_time and interval take them as they are.",
}


def next_step(kind: str, verdict: str, *, claim: str = "", missing: str = "") -> str:
    """One sentence, or nothing where there is no advice.

    claim: the first claim that is not proved; missing: the entry that the kind needs.
    """
    if verdict == "proved":
        return f"`obsdesign design PROBLEM --kind {kind}`"
    if claim:
        return _CLAIMS.get(claim, f"`obsdesign design PROBLEM --kind {kind}` shows every claim.")
    if missing == "output.measured" and kind in _PERIODIC:
        return _PERIODIC[kind]
    return _MISSING.get(missing, "")


def theorem_sentences(claims: Sequence[Claim]) -> list[str]:
    """The conditions of Theorem 2.2 of Medina and Lawrence, where a claim `rate` names them."""
    functions = (
        LyapunovFunction.from_evidence(claim.evidence)
        for claim in claims
        if claim.id == "rate" and claim.verdict == "proved"
    )
    return [function.sentence for function in functions if function is not None]
