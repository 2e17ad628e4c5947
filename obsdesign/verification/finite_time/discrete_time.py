"""Finite-time estimation in discrete time: claims in rational arithmetic, and guarantees."""

from __future__ import annotations

from lmi.arithmetic.arrays import Entries, NewEntries
from lmi.arithmetic.balls import exact, row_echelon
from lmi.verdict import Verdict, proved, refuted, undecided
from obsdesign.analysis.finite_time.steps import (
    MOST_STEPS,
    ROUNDING,
    WindowError,
    reason_against_steps,
)
from obsdesign.analysis.hidden_modes import hidden_part
from obsdesign.document import Claim, Guarantee
from obsdesign.equations.finite_time.steps import StepWindowGains, observation_rows, window_entries
from obsdesign.problem.options import FiniteTimeOptions
from obsdesign.problem.problem import Problem
from obsdesign.verification.absent_signals import absent_signals
from obsdesign.verification.choices import mark_witness
from obsdesign.verification.consistency import consistent_gains

_SOURCE = "docs/discrete_time.md, finite time"


def step_window_claims(problem: Problem, stored: Entries) -> tuple[Claim, ...]:
    """All hypotheses of a design in discrete time, until one is not proved."""
    agreement, gains = consistent_gains(
        reason_against_steps(problem), stored, _expected(problem, stored),
        StepWindowGains.from_document,
    )  # fmt: skip
    if gains is None:
        return (agreement,)
    text = f"the {gains.samples} samples of a window determine the state"
    determined = Claim.from_verdict("observable", text, "observability", _observable(gains))
    if determined.verdict != "proved":
        return (agreement, mark_witness(determined) if _is_hidden(gains) else determined)
    error = WindowError.from_gains(gains)
    unbiased = Claim.from_verdict(
        "unbiased",
        "without disturbance and noise the estimate of a full window is the state: it is off by at "
        "most `bias` times |x| at the first sample of the window, rounding of the gains",
        _SOURCE,
        _unbiased(error),
    )
    if error.radius is None:
        return (agreement, determined, unbiased)
    radius = Claim.from_verdict(
        "error_radius",
        f"with disturbance and noise inside their bounds{_without_unknown(problem)} it is off by "
        "at most `largest_error` more",
        _SOURCE,
        proved(largest_error=error.radius.tolist()),
    )
    return (agreement, determined, unbiased, radius)


def _observable(gains: StepWindowGains) -> Verdict:
    """Full column rank of the window's rows, exact."""
    if gains.period_steps * gains.samples > MOST_STEPS:
        return undecided(f"the window has more than {MOST_STEPS} steps")
    rows = observation_rows(
        exact(gains.A), exact(gains.C), gains.period_steps, min(gains.samples, gains.n)
    )
    rank = row_echelon(rows)[1]
    if rank == gains.n:
        return proved(rank=rank)
    reason = f"its samples see {rank} of {gains.n} dimensions of the state"
    if _is_hidden(gains):
        reason += ": a part is unobservable"
    return refuted({"rank": rank, "reason": reason})


def _is_hidden(gains: StepWindowGains) -> bool:
    """Is a part of the state unobservable, whatever the window?"""
    return hidden_part([gains.A], gains.C) is not None


def _unbiased(error: WindowError) -> Verdict:
    if (error.bias <= ROUNDING * error.scale).all():
        return proved(bias=error.bias.tolist())
    return undecided("the gains do not give the state of the window", bias=error.bias.tolist())


def _without_unknown(problem: Problem) -> str:
    """What has no bounds and must be absent, as part of a sentence."""
    plant = problem.plant
    has_input = plant.flow.D is not None and plant.flow.d_bounds is None
    names = ["unknown input d"] if has_input else []
    names += ["unknown impulses"] if plant.jump is not None and plant.jump.H is not None else []
    return f" and without {' and '.join(names)}" if names else ""


def _expected(problem: Problem, stored: Entries) -> NewEntries:
    plant, options = problem.plant, problem.options_as(FiniteTimeOptions)
    period = plant.output.sample_period
    samples = stored.get("samples") if options.window is None else round(options.window / period)
    if type(samples) is not int or not 1 <= samples <= MOST_STEPS:
        samples = 1
    shape = (plant.n, samples * plant.p)
    return window_entries(plant) | {"samples": samples, "window_gain": shape}


def step_window_guarantees(problem: Problem, claims: tuple[Claim, ...]) -> tuple[Guarantee, ...]:
    """The sentences a user may rely on."""
    verdicts = {claim.id: claim.verdict for claim in claims}
    since = "" if problem.plant.jump is None else " since the last jump"
    when = f"At a sample of a full window{since}"
    text = f"{when} and without {absent_signals(problem.plant)} in it the estimate is the state, to"
    ids = ["consistent", "observable", "unbiased"]
    given = [Guarantee.from_verdicts(f"{text} rounding.", ids, verdicts)]
    evidence = next((claim.evidence for claim in claims if claim.id == "error_radius"), None)
    if evidence is None:
        text = "Bounds of the state around the estimate: output.noise_bound is not given."
        return (*given, Guarantee.not_proved(text))
    sizes = ", ".join(f"{x:.6g}" for x in evidence["largest_error"])
    text = (
        f"{when}, with disturbance and noise inside their bounds{_without_unknown(problem)}, the "
        f"state is at most this far from the estimate: {sizes}."
    )
    return (*given, Guarantee.from_verdicts(text, [*ids, "error_radius"], verdicts))
