"""Guarantees of an impulsive observer: the sentences that follow from its claims."""

from __future__ import annotations

from decimal import ROUND_CEILING, ROUND_FLOOR

from obsdesign.document import Claim, Guarantee
from obsdesign.problem.options import ImpulsiveOptions
from obsdesign.problem.problem import Problem
from obsdesign.verification.absent_signals import absent_signals
from obsdesign.verification.dwell import Dwell
from obsdesign.verification.impulsive.rate import Rate
from obsdesign.verification.rates import six_digits


def guarantees(problem: Problem, claims: tuple[Claim, ...]) -> tuple[Guarantee, ...]:
    """The sentences a user may rely on, and those of the problem that are not proved."""
    plant, options = problem.plant, problem.options_as(ImpulsiveOptions)
    verdicts = {claim.id: claim.verdict for claim in claims}
    needed = [name for name in verdicts if name not in ("decay_rate", "rate")]
    when = f"for every sequence of spacings in {Dwell.from_problem(problem)}"
    free = absent_signals(plant)
    sentences = [
        (f"Without {free}, the estimation error tends to zero exponentially, uniformly {when}, "
         "if every impulse is reported and measured.", needed),
        (f"Bounded {free} leave the estimation error bounded {when}.", needed),
    ]  # fmt: skip
    for claim in claims:
        if claim.id == "rate" and claim.verdict == "proved":
            rate = Rate.from_evidence(claim.evidence)
            sentences.append((_rate_sentence(rate, free), [*needed, "rate"]))
    if "decay_rate" in verdicts:
        text = f"The error decays like e^(-{options.decay_rate!r} t) {when}."
        sentences.append((text, [*needed, "decay_rate"]))
    result = [Guarantee.from_verdicts(text, ids, verdicts) for text, ids in sentences]
    if options.noise_target is not None:
        target = ", ".join(map(repr, options.noise_target))
        text = (
            f"Noise leaves the states errors with standard deviations of at most {target}: "
            "estimated by simulation, not proved."
        )
        result.append(Guarantee.not_proved(text))
    return tuple(result)


def _rate_sentence(rate: Rate, free: str) -> str:
    """The proved rate in a sentence; free: signals that must be absent."""
    constant, each = (
        six_digits(value, ROUND_CEILING) for value in (rate.constant, rate.per_impulse)
    )
    in_time = six_digits(rate.in_time, ROUND_FLOOR)
    return (
        f"Without {free}, the error just before an impulse is, N impulses later, at most "
        f"{constant} * {each}^N of what it was; it decays like e^(-{in_time} t). Actual "
        "errors are far smaller."
    )
