"""Point observers with jumps: stability of the error for all dwell times, proved.

Source: C. Briat, Automatica 49 (2013), Theorem 3, applied to (A - L C, G - M C); with an infinite
longest dwell time the flow must be Hurwitz as well (docs/papers.md, Corollary 4 of Degue et al.).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from lmi.arithmetic.balls import exact
from lmi.prove.hurwitz import prove_hurwitz
from lmi.verdict import overall
from obsdesign.document import Claim
from obsdesign.equations.estimation_error import (
    flow_error_matrix,
    idle_gains,
    jump_error_matrix,
    plant_data,
)
from obsdesign.problem.problem import Problem
from obsdesign.verification.consistency import consistency
from obsdesign.verification.dwell import (
    Dwell,
    dwell_stability,
    source_of,
    unusable,
)
from obsdesign.verification.luenberger.schedule import borders_objection, scheduled_stability
from obsdesign.verification.rates import rates_claim, rates_sentence

PAPER = "Briat, Automatica 49 (2013), Theorem 3"
_MATRICES = ("A", "C", "G", "L", "M")


def claims(
    problem: Problem,
    gains: Mapping[str, Any],
    certificates: Mapping[str, Mapping[str, Any]],
    *,
    paranoid: bool = False,
) -> tuple[Claim, ...]:
    """All hypotheses of the design, each with its verdict.

    certificates: {"dwell_stability": {"P": n x n}, "decay_rate": {"P": n x n}} where one was found,
    or windows in place of P; they are checked, never believed.
    """
    agreement = consistency(_objection(problem, gains), gains, _expected(problem))
    if agreement.verdict != "proved":
        return (agreement,)
    numbers = {name: exact(gains[name]) for name in _MATRICES if name in gains}
    F = flow_error_matrix(numbers["A"], numbers["L"], numbers["C"])
    rate = float(problem.options.get("decay_rate", 0.0))
    shifted = F + exact(rate * np.eye(problem.plant.n))
    found = [agreement]
    if problem.plant.jump is None:
        found.append(_hurwitz(F, "hurwitz", "there are no jumps"))
        if rate > 0:
            found.append(_hurwitz(shifted, "decay_rate", f"the rate {rate!r} was asked for", rate))
        return tuple(found)
    dwell = Dwell.of(problem)
    if math.isinf(dwell.high):
        found.append(_hurwitz(F, "hurwitz", "there is no longest dwell time"))
    if "schedule" in problem.options:
        return (*found, *_scheduled(problem, gains, F, rate, certificates, paranoid))
    H = dwell_pair(gains)[1]
    found.append(_stability(F, H, dwell, certificates, paranoid))
    found += rates_claim(F, H, dwell, certificates, PAPER)
    if rate > 0:
        found.append(_decay(shifted, H, dwell, rate, certificates, paranoid))
    return tuple(found)


def dwell_pair(gains: Mapping[str, Any]) -> tuple[Any, Any]:
    """(F, H), exact: the pair whose stability over a range of dwell times is claimed."""
    A, C, G, L, M = (exact(gains[name]) for name in _MATRICES)
    when = gains["jump_measurement"]
    return flow_error_matrix(A, L, C), jump_error_matrix(G, M, C, when)


def _objection(problem: Problem, gains: Mapping[str, Any]) -> str | None:
    return unusable(problem) or borders_objection(problem, gains)


def _expected(problem: Problem) -> dict[str, Any]:
    n, p = problem.plant.n, problem.plant.p
    zeros = {name: np.zeros((n, p)) for name in idle_gains(problem.plant)}
    expected = plant_data(problem.plant) | {"L": (n, p), "M": (n, p)} | dict(problem.gains) | zeros
    asked = problem.options.get("schedule")
    if asked is not None:
        cells = asked if isinstance(asked, int) else len(asked) + 1
        borders = (cells - 1,) if isinstance(asked, int) else np.array(asked)
        expected |= {"M_cells": (cells, n, p), "dwell_borders": borders}
    return expected


def _hurwitz(F: Any, name: str, why: str, rate: float = 0.0) -> Claim:
    verdict = prove_hurwitz(F)
    shift = f" + {rate!r} I" if rate else ""
    return Claim(
        name,
        f"the error between jumps decays by itself (A - L C{shift} is Hurwitz), needed as {why}",
        "Lyapunov's theorem",
        verdict.outcome,
        verdict.evidence,
    )


def _stability(
    F: Any, H: Any, dwell: Dwell, certificates: Mapping[str, Any], paranoid: bool
) -> Claim:
    verdict = dwell_stability(F, H, dwell, certificates.get("dwell_stability", {}), paranoid)
    return Claim(
        "dwell_stability",
        f"the error e -> e^(F T) H e, F = A - L C, H its matrix at jumps, is stable for every "
        f"sequence of dwell times T in {dwell}",
        source_of(verdict, PAPER),
        verdict.outcome,
        verdict.evidence,
    )


def _scheduled(
    problem: Problem,
    gains: Mapping[str, Any],
    F: Any,
    rate: float,
    certificates: Mapping[str, Any],
    paranoid: bool,
) -> list[Claim]:
    """Stability, and the rate that is asked for, with gains by cells of the last dwell time."""
    dwell, found = Dwell.of(problem), []
    asked = [("dwell_stability", 0.0, "is stable")]
    asked += [("decay_rate", rate, f"decays like e^(-{rate!r} t)")] if rate > 0 else []
    for name, shift, what in asked:
        shifted = F + exact(shift * np.eye(problem.plant.n))
        certificate = certificates.get(name, {})
        verdict = scheduled_stability(problem, gains, shifted, certificate, paranoid)
        statement = (
            "the error, corrected at a jump by the gain for the dwell time that ends there, "
            f"{what} for every sequence of dwell times T in {dwell}"
        )
        found.append(Claim(name, statement, PAPER, verdict.outcome, verdict.evidence))
    return found


def _decay(
    shifted: Any,
    H: Any,
    dwell: Dwell,
    rate: float,
    certificates: Mapping[str, Any],
    paranoid: bool,
) -> Claim:
    flow = prove_hurwitz(shifted) if math.isinf(dwell.high) else None
    verdict = dwell_stability(shifted, H, dwell, certificates.get("decay_rate", {}), paranoid)
    if flow is not None and overall([flow.outcome, verdict.outcome]) == flow.outcome != "proved":
        verdict = flow
    return Claim(
        "decay_rate",
        f"the error decays like e^(-{rate!r} t) for every sequence of dwell times in {dwell}",
        source_of(verdict, f"{PAPER}, for A - L C + {rate!r} I"),
        verdict.outcome,
        verdict.evidence,
    )


def guarantees(problem: Problem, found: tuple[Claim, ...]) -> tuple[dict[str, Any], ...]:
    """The sentences a user may rely on, and those that were asked for and not proved."""
    plant = problem.plant
    verdicts = {claim.id: claim.verdict for claim in found}
    needed = [name for name in verdicts if name not in ("decay_rate", "rates")]
    ends = "" if plant.jump is None else str(Dwell.of(problem))
    when = f" for every sequence of dwell times in {ends}" if ends else ""
    at_jumps = plant.output.measured == "at_jumps"
    measured = "With y measured at every jump" if at_jumps else "With y measured continuously"
    without = ["disturbance", "noise"]
    without += ["unknown input d"] if plant.flow.D is not None else []
    without += ["unknown impulses"] if plant.jump is not None and plant.jump.H is not None else []
    free = f"{', '.join(without[:-1])} and {without[-1]}"
    told = [
        (f"{measured} and without {free}, the estimation error tends to zero{when}.", needed),
        (f"{measured}, bounded {free} leave the estimation error bounded{when}.", needed),
    ]
    if "decay_rate" in verdicts:
        rate = float(problem.options["decay_rate"])
        told.append((f"The error decays like e^(-{rate!r} t){when}.", [*needed, "decay_rate"]))
    told += [(f"{measured}: {text}", ids) for text, ids in rates_sentence(found, "the error")]
    result = [
        {"statement": text, "given": all(verdicts[i] == "proved" for i in ids), "claims": ids}
        for text, ids in told
    ]
    if not at_jumps:
        sampled = "Convergence for samples at a given spacing is not claimed."
        result.append({"statement": sampled, "given": False, "claims": []})
    return tuple(result)
