"""Point observers in discrete time: the error tends to zero, whatever the clocks allow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lmi.arithmetic.arrays import Entries, EntriesByClaim
from lmi.modes import Modes
from lmi.verdict import Verdict, undecided
from obsdesign.analysis.discrete_error import error_maps, reason_against_steps
from obsdesign.analysis.hidden_modes import hidden_part
from obsdesign.document import Claim, Guarantee
from obsdesign.equations.estimation_error import idle_gains
from obsdesign.equations.luenberger.gains import StepGains, step_entries
from obsdesign.problem.options import LuenbergerOptions
from obsdesign.problem.problem import Problem
from obsdesign.verification.absent_signals import absent_signals
from obsdesign.verification.choices import mark_witness
from obsdesign.verification.consistency import consistent_gains
from obsdesign.verification.dwell import step_stability
from obsdesign.verification.modes import mode_stability

STABILITY = "step_stability"
_SOURCE = "docs/discrete_time.md, point observers"


def step_claims(
    problem: Problem, stored: Entries, certificates: EntriesByClaim, paranoid: bool
) -> tuple[Claim, ...]:
    """All hypotheses of a design in discrete time, each with its verdict.

    certificates: {"step_stability": ..., "decay_rate": ...}, a P for each age of the event.
    """
    objection = reason_against_steps(problem)
    agreement, gains = consistent_gains(
        objection, stored, _expected(problem), StepGains.from_document
    )
    if gains is None:
        return (agreement,)
    rate = problem.options_as(LuenbergerOptions).decay_rate
    claims = [agreement, _claim(problem, gains, 0.0, certificates, paranoid)]
    if rate > 0:
        claims.append(_claim(problem, gains, rate, certificates, paranoid))
    if _is_hidden_for_all_gains(problem, gains):
        claims = [mark_witness(claim) for claim in claims]
    return tuple(claims)


def _claim(
    problem: Problem, gains: StepGains, rate: float, certificates: EntriesByClaim, paranoid: bool
) -> Claim:
    name = "decay_rate" if rate else STABILITY
    maps = error_maps(problem, gains, rate)
    verdict = _decided(maps, certificates.get(name, {}), paranoid)
    if rate and verdict.outcome == "refuted":  # e^(rate dt) was rounded up
        verdict = undecided(f"not proved: {verdict.reason}")
    what = f"the error times e^({rate!r} t)" if rate else "the error"
    return Claim.from_verdict(name, f"{what} tends to zero {when(problem)}", _SOURCE, verdict)


def _decided(maps: object, certificate: Entries, paranoid: bool) -> Verdict:
    if isinstance(maps, Modes):
        return mode_stability(maps, certificate, paranoid)
    cycle = np.asarray(maps)
    verdict = step_stability(cycle, paranoid)
    if verdict.outcome != "refuted":
        return verdict
    radius = verdict.witness.get("spectral_radius", 1.0)
    reason = f"the map of the error has spectral radius {radius:.6g}"
    return replace(verdict, evidence={"witness": {**verdict.witness, "reason": reason}})


def _is_hidden_for_all_gains(problem: Problem, gains: StepGains) -> bool:
    """Is there a part of the state that no output sees, and that lasts from step to step?"""
    hidden = hidden_part([gains.A], gains.C)
    if hidden is None or problem.plant.jump is not None:
        return False
    step = hidden.maps[0]
    return step_stability(step, False).outcome == "refuted"


def when(problem: Problem) -> str:
    """For which samples and events the error decays, in words."""
    plant = problem.plant
    if plant.jump is None:
        return f"with a sample every {plant.output.period!r}"
    low, high = problem.require_dwell_time()
    sampled = "" if plant.output.measured == "at_jumps" else "with a sample in every step and "
    end = "inf)" if np.isinf(high) else f"{high!r}]"
    return f"{sampled}for every sequence of events [{low!r}, {end} apart"


def _expected(problem: Problem) -> Entries:
    n, p = problem.plant.n, problem.plant.p
    zeros = {name: np.zeros((n, p)) for name in idle_gains(problem.plant)}
    return step_entries(problem.plant) | {"L": (n, p), "M": (n, p)} | dict(problem.gains) | zeros


def step_guarantees(problem: Problem, claims: tuple[Claim, ...]) -> tuple[Guarantee, ...]:
    """The sentences a user may rely on, and those of the problem that are not proved."""
    verdicts = {claim.id: claim.verdict for claim in claims}
    text, free = when(problem), absent_signals(problem.plant)
    needed = ["consistent", STABILITY]
    sentences = [
        (f"Without {free}, the estimation error tends to zero {text}.", needed),
        (f"Bounded {free} leave the estimation error bounded {text}.", needed),
    ]
    if "decay_rate" in verdicts:
        rate = problem.options_as(LuenbergerOptions).decay_rate
        sentences.append(
            (f"The error decays like e^(-{rate!r} t) {text}.", [*needed, "decay_rate"])
        )
    return tuple(Guarantee.from_verdicts(text, ids, verdicts) for text, ids in sentences)
