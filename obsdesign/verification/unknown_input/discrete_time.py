"""Unknown-input observers in discrete time: existence, decoupling and stability, proved.

An observer exists if and only if C D has full column rank and all invariant zeros of (A, D, C) lie
inside the unit disc: d shows in y one step later, and moves no state for ever without a trace.
"""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Entries, Matrix, NewEntries
from lmi.arithmetic.balls import Exact, exact, to_float
from lmi.verdict import Verdict, proved, refuted, undecided
from obsdesign.analysis.discrete_inputs import reason_against_inputs
from obsdesign.analysis.invariant_zeros import shows_every_input, zero_part
from obsdesign.document import Claim, Guarantee
from obsdesign.equations.unknown_input.steps import StepInputGains, input_entries
from obsdesign.problem.problem import Problem
from obsdesign.verification.choices import mark_witness
from obsdesign.verification.consistency import consistent_gains, inconsistent
from obsdesign.verification.dwell import step_stability

_SOURCE = "docs/discrete_time.md, unknown inputs"
# what the rounding of M and N leaves, in parts of the terms that cancel
_ROUNDING = 1e-9


def step_input_claims(problem: Problem, stored: Entries, paranoid: bool) -> tuple[Claim, ...]:
    """All hypotheses of a design in discrete time; of existence alone if there is none."""
    if reason := reason_against_inputs(problem):
        return (inconsistent(reason),)
    existence = _existence(problem)
    if any(claim.verdict != "proved" for claim in existence):
        return existence  # no gains to speak of
    agreement, gains = consistent_gains(
        None, stored, _expected(problem), StepInputGains.from_document
    )
    if gains is None:
        return (agreement, *existence)
    decoupled = Claim.from_verdict(
        "decoupled",
        "the unknown input drops out of the error, and shows in its estimate: M C D = D and "
        f"N C D = I, up to {_ROUNDING:g} of their terms",
        _SOURCE,
        _decoupled(gains),
    )
    unit, A, C = exact(np.eye(gains.n)), exact(gains.A), exact(gains.C)
    stable = Claim.from_verdict(
        "step_stability",
        "the error e+ = (I - M C) A e tends to zero",
        _SOURCE,
        _decays((unit - exact(gains.M) @ C) @ A, paranoid),
    )
    return (agreement, *existence, decoupled, stable)


def _existence(problem: Problem) -> tuple[Claim, ...]:
    """Claims about the plant alone, whose witnesses hold for all gains."""
    A, C, D = problem.plant.flow.A, problem.plant.output.C, problem.plant.flow.D
    assert D is not None
    rank = shows_every_input(C, D)
    if rank.outcome == "refuted":
        count = rank.witness.get("rank")
        reason = (
            f"rank(C D) = {count}, {D.shape[1]} is needed: some unknown input does not show in y "
            "one step later"
        )
        rank = refuted({**rank.witness, "reason": reason})
    shown = Claim.from_verdict(
        "rank", "every unknown input shows in y one step later: C D has full column rank",
        _SOURCE, rank,
    )  # fmt: skip
    if rank.outcome != "proved":
        return (mark_witness(shown),)
    text = "every invariant zero of (A, D, C) lies inside the unit disc"
    return (shown, mark_witness(Claim.from_verdict("zeros", text, _SOURCE, _zeros(A, C, D))))


def _zeros(A: Matrix, C: Matrix, D: Matrix) -> Verdict:
    hidden = zero_part(A, C, D)
    if hidden is None:
        return proved(zeros=[])
    flow = hidden.maps[0]
    values = np.asarray(np.linalg.eigvals(to_float(flow)), dtype=np.complex128).tolist()
    zeros = sorted([z.real, z.imag] for z in values)
    verdict = _decays(flow, paranoid=False)
    if verdict.outcome == "proved":
        return proved(zeros=zeros)
    if verdict.outcome == "undecided":
        return verdict
    largest = max(map(abs, values))
    reason = (
        f"an invariant zero of modulus {largest:.6g}: an unknown input and a state that last and "
        "never show in y; no gain changes that"
    )
    return refuted({"zeros": zeros, "reason": reason})


def _decays(step: Exact, paranoid: bool) -> Verdict:
    """Is the spectral radius of a map below one?"""
    verdict = step_stability(step, paranoid)
    if verdict.outcome != "refuted":
        return verdict
    radius = verdict.witness.get("spectral_radius", 1.0)
    return refuted({**verdict.witness, "reason": f"its map has spectral radius {radius:.6g}"})


def _decoupled(gains: StepInputGains) -> Verdict:
    C, D, M, N = (exact(X) for X in (gains.C, gains.D, gains.M, gains.N))
    unit = exact(np.eye(D.shape[1]))
    pairs = {
        "M C D - D": (abs(M @ C @ D - D), abs(M) @ abs(C) @ abs(D) + abs(D)),
        "N C D - I": (abs(N @ C @ D - unit), abs(N) @ abs(C) @ abs(D) + unit),
    }
    for name, (left, terms) in pairs.items():
        if (left > terms * exact(_ROUNDING)).any():
            return undecided(f"{name} is more than rounding leaves")
    return proved(rounding=to_float(pairs["M C D - D"][0]).max(axis=1).tolist())


def _expected(problem: Problem) -> NewEntries:
    plant, D = problem.plant, problem.plant.flow.D
    assert D is not None
    return input_entries(plant) | {"M": (plant.n, plant.p), "N": (D.shape[1], plant.p)}


def step_input_guarantees(
    problem: Problem, claims: tuple[Claim, ...]
) -> tuple[Guarantee, ...]:  # fmt: skip
    """The sentences a user may rely on."""
    del problem
    verdicts = {claim.id: claim.verdict for claim in claims}
    needed = ["rank", "zeros", "decoupled", "step_stability"]
    sentences = (
        "With a sample at every step and without disturbance and noise the estimate of the state "
        "tends to x, and that of the unknown input to its value in the step that ends at the row, "
        "whatever the input, up to rounding.",
        "Bounded disturbance and noise leave both errors bounded.",
    )
    return tuple(Guarantee.from_verdicts(text, needed, verdicts) for text in sentences)
