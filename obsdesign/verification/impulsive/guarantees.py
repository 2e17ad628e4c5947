"""What the proved claims of an impulsive observer promise, in sentences."""

from __future__ import annotations

from decimal import ROUND_CEILING, ROUND_FLOOR
from typing import Any

from obsdesign.document import Claim
from obsdesign.problem.problem import Problem
from obsdesign.verification.dwell import Dwell
from obsdesign.verification.rates import six_digits


def guarantees(problem: Problem, found: tuple[Claim, ...]) -> tuple[dict[str, Any], ...]:
    """The sentences a user may rely on, and those that were asked for and not proved."""
    plant = problem.plant
    verdicts = {claim.id: claim.verdict for claim in found}
    needed = [name for name in verdicts if name not in ("decay_rate", "rate")]
    when = f"for every sequence of spacings in {Dwell.of(problem)}"
    without = ["disturbance", "noise"]
    without += ["unknown input d"] if plant.flow.D is not None else []
    without += ["unknown impulses"] if plant.jump is not None and plant.jump.H is not None else []
    free = f"{', '.join(without[:-1])} and {without[-1]}"
    told = [
        (f"Without {free}, the estimation error tends to zero exponentially, uniformly {when}, "
         "if every impulse is reported and measured.", needed),
        (f"Bounded {free} leave the estimation error bounded {when}.", needed),
    ]  # fmt: skip
    for claim in found:
        if claim.id == "rate" and claim.verdict == "proved":
            each, in_time, constant = (
                claim.evidence[name] for name in ("per_impulse", "in_time", "constant")
            )
            told.append((
                f"Without {free}, the error just before an impulse is, N impulses later, at most "
                f"{six_digits(constant, ROUND_CEILING)} * {six_digits(each, ROUND_CEILING)}^N of "
                f"what it was; it decays like e^(-{six_digits(in_time, ROUND_FLOOR)} t). Actual "
                "errors are far smaller.", [*needed, "rate"],
            ))  # fmt: skip
    if "decay_rate" in verdicts:
        rate = float(problem.options["decay_rate"])
        told.append((f"The error decays like e^(-{rate!r} t) {when}.", [*needed, "decay_rate"]))
    result = [
        {"statement": text, "given": all(verdicts[i] == "proved" for i in ids), "claims": ids}
        for text, ids in told
    ]
    if "noise_target" in problem.options:
        target = ", ".join(repr(float(value)) for value in problem.options["noise_target"])
        text = (
            f"Noise leaves the states errors with standard deviations of at most {target}: "
            "estimated by simulation, not proved."
        )
        result.append({"statement": text, "given": False, "claims": []})
    return tuple(result)
