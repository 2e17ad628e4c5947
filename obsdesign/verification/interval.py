"""Interval observers: every hypothesis of Theorems 5 and 8 about given gains, proved.

Source: Degue, Efimov, Richard, NOLCOS 2016. The claims speak about the stored binary64 numbers:
A - L C and G - M C are formed in exact rationals. A split that was stored rounded is completed
to an exact one (`equations.completed_split`), and stability is proved for the completed pair.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from lmi.balls import exact, to_float
from lmi.hurwitz import prove_hurwitz
from lmi.verdict import Verdict, proved, refuted
from obsdesign.document import Claim
from obsdesign.equations import interval as equations
from obsdesign.equations.estimation_error import (
    flow_error_matrix,
    idle_gains,
    jump_error_matrix,
    plant_data,
)
from obsdesign.problem import Problem
from obsdesign.verification.consistency import consistency
from obsdesign.verification.dwell import (
    Dwell,
    dwell_stability,
    rates_claim,
    rates_sentence,
    source_of,
    unusable,
)

PAPER = "Degue, Efimov, Richard, NOLCOS 2016"
_MATRICES = ("A", "C", "G", "L", "M", "D0", "D1", "Gp", "Gn")
THEOREMS = {"cooperative": "Theorem 5", "split": "Theorem 8"}
# Decimal entries and a product of a few terms are stored to within a few units of 2**-53; a
# split that misses A - L C by more was not meant as one.
SPLIT_ROUNDING = 2.0**-46


def claims(
    problem: Problem,
    gains: Mapping[str, Any],
    certificates: Mapping[str, Mapping[str, Any]],
    *,
    paranoid: bool = False,
) -> tuple[Claim, ...]:
    """All hypotheses of the design's theorem, each with its verdict.

    certificates: {"dwell_stability": {"P": n x n}} where one was found; it is checked, never
    believed.
    """
    agreement = consistency(_objection(problem), gains, expected_gains(problem))
    if agreement.verdict != "proved":
        return (agreement,)
    form = gains["form"]
    numbers = {name: exact(gains[name]) for name in _MATRICES if name in gains}
    F = flow_error_matrix(numbers["A"], numbers["L"], numbers["C"])
    found = [agreement, _split_claim("flow", form, F, numbers)]
    if "G" not in gains:
        W = sum(equations.completed_split(F, numbers["D0"], numbers["D1"]))
        return (*found, _hurwitz_claim(W, "there are no jumps"))
    H = jump_error_matrix(numbers["G"], numbers["M"], numbers["C"], gains["jump_measurement"])
    found.append(_split_claim("jump", form, H, numbers))
    W, N = dwell_pair(gains)
    dwell = Dwell.of(problem)
    if math.isinf(dwell.high):
        found.append(_hurwitz_claim(W, "there is no longest dwell time"))
    certificate = certificates.get("dwell_stability", {})
    found.append(_stability_claim(form, (W, N), dwell, certificate, paranoid))
    found += rates_claim(W, N, dwell, certificates, f"{PAPER}, {THEOREMS[form]}")
    return tuple(found)


def dwell_pair(gains: Mapping[str, Any]) -> tuple[Any, Any]:
    """(W, N), exact: the pair whose stability over a range of dwell times is claimed."""
    numbers = {name: exact(gains[name]) for name in _MATRICES}
    F = flow_error_matrix(numbers["A"], numbers["L"], numbers["C"])
    H = jump_error_matrix(numbers["G"], numbers["M"], numbers["C"], gains["jump_measurement"])
    return equations.width_pair(F, H, numbers)


def _objection(problem: Problem) -> str | None:
    return equations.objection(problem.plant, problem.gains, problem.options) or unusable(problem)


def expected_gains(problem: Problem) -> dict[str, Any]:
    """Entries of `gains` and what the problem says of them: a value, or the shape it must have."""
    n, p = problem.plant.flow.A.shape[0], problem.plant.output.C.shape[0]
    expected: dict[str, Any] = {"form": _forms(problem)} | plant_data(problem.plant)
    expected |= {"L": (n, p), "M": (n, p), "D0": (n, n), "D1": (n, n)}
    if problem.plant.jump is not None:
        expected |= {"Gp": (n, n), "Gn": (n, n)}
    zeros = {name: np.zeros((n, p)) for name in idle_gains(problem.plant)}
    return expected | dict(problem.gains) | zeros


def _forms(problem: Problem) -> set[str]:
    form = problem.options.get("form", "auto")
    return set(equations.FORMS) if form == "auto" else {form}


def guarantees(problem: Problem, found: tuple[Claim, ...]) -> tuple[dict[str, Any], ...]:
    """The sentences a user may rely on, and those that were asked for and not proved."""
    verdicts = {claim.id: claim.verdict for claim in found}
    enclosing: list[str] = [
        name for name in ("consistent", "flow_positive", "jump_positive") if name in verdicts
    ]
    bounded: list[str] = [name for name in ("hurwitz", "dwell_stability") if name in verdicts]
    jump = problem.plant.jump
    ends = "" if jump is None else str(Dwell.of(problem))
    when = f" for every sequence of dwell times in {ends}" if ends else ""
    enclosure = (
        "The bounds contain the state at every instant, if they contain it at the start, b, c and "
        "v stay inside their bounds and jumps are reported at their times; this holds for "
        "samples at any spacing, missing ones included, and for any dwell time."
    )
    at_jumps = problem.plant.output.measured == "at_jumps"
    measured = "With y measured at every jump" if at_jumps else "With y measured continuously"
    width = (
        f"{measured}, the width of the bounds stays bounded{when}, and without disturbance and "
        f"noise it tends to zero{'' if jump is None else ' as jumps go on'}."
    )
    told: list[tuple[str, bool, list[str]]] = [
        (enclosure, _all(verdicts, enclosing), enclosing),
        (width, _all(verdicts, enclosing + bounded), enclosing + bounded),
    ]
    for text, ids in rates_sentence(found, "the width"):
        told.append((f"{measured}: {text}", _all(verdicts, ids), ids))
    if not at_jumps:
        sampled = (
            "A bounded width for samples at a given spacing is not claimed: the spacing must be "
            "small against 1/(|L||CA|)."
        )
        told.append((sampled, False, []))
    return tuple({"statement": text, "given": given, "claims": ids} for text, given, ids in told)


def _all(verdicts: Mapping[str, str], names: list[str]) -> bool:
    return all(verdicts[name] == "proved" for name in names)


def _split_claim(part: str, form: str, X: Any, numbers: Mapping[str, Any]) -> Claim:
    """F Metzler and H >= 0 (Theorem 5), or exact splits of them (Theorem 8)."""
    flow = part == "flow"
    name = "A - L C" if flow else "the jump matrix of the error, H,"
    names = ("D0", "D1") if flow else ("Gp", "Gn")
    plus, minus = (numbers[key] for key in names)
    assumption = "Assumption 5"
    if form == "cooperative":
        property_ = "Metzler" if flow else "nonnegative"
        statement = f"{name} is {property_}; it is stored as {names[0]}, and {names[1]} is zero"
        assumption = "Assumption 2.ii" if flow else "Assumption 2.iii"
        verdict = _signs(X, flow, f"{name} is not {property_}")
        if verdict.outcome == "proved":
            verdict = _signs(-minus, False, f"{names[1]} is not zero")
    else:
        statement = (
            f"{name} equals {names[0]} - {names[1]} with {names[0]} "
            f"{'Metzler' if flow else '>= 0'} and {names[1]} >= 0"
        )
        verdict = proved()
    for half, metzler, key in ((plus, flow, names[0]), (minus, False, names[1])):
        if verdict.outcome == "proved":
            verdict = _signs(half, metzler, f"{key} has the wrong sign")
    if verdict.outcome == "proved":
        verdict = _same(X, plus, minus, names)
    source = f"{PAPER}, {THEOREMS[form]}, {assumption}"
    return Claim(f"{part}_positive", statement, source, verdict.outcome, verdict.evidence)


def _signs(X: Any, metzler: bool, complaint: str) -> Verdict:
    """Every entry (off the diagonal, for Metzler) is >= 0, exactly."""
    for (i, j), value in np.ndenumerate(X):
        if value < 0 and not (metzler and i == j):
            size = _number(value)
            hint = "; rounding of decimals, which form = split absorbs" if size > -1e-12 else ""
            reason = f"{complaint}: entry ({i + 1}, {j + 1}) is {size:.6g}{hint}"
            return refuted({"entry": [i + 1, j + 1], "value": size, "reason": reason})
    return proved(exact=True)


def _same(X: Any, plus: Any, minus: Any, names: tuple[str, str]) -> Verdict:
    """plus - minus = X up to the rounding of stored decimals."""
    remainder = plus - minus - X
    # a split that is many times larger than X itself would lose X in its own rounding
    limit = np.max(np.abs(X)) * exact(SPLIT_ROUNDING).item()
    largest = 0.0
    for (i, j), value in np.ndenumerate(remainder):
        if abs(value) > limit:
            reason = (
                f"{names[0]} - {names[1]} misses the matrix it splits at entry "
                f"({i + 1}, {j + 1}) by {_number(value):.6g}"
            )
            return refuted({"entry": [i + 1, j + 1], "value": _number(value), "reason": reason})
        largest = max(largest, abs(_number(value)))
    return proved(exact=largest == 0.0, largest_remainder=largest)


def _number(value: Any) -> float:
    return float(to_float(np.array([value], dtype=object))[0])


def _hurwitz_claim(W: Any, why: str) -> Claim:
    verdict = prove_hurwitz(W)
    return Claim(
        "hurwitz",
        f"the width between jumps decays by itself (W = D0 + D1 is Hurwitz), needed as {why}",
        f"{PAPER}, Corollary 4, with the hypothesis it needs when T_max is infinite",
        verdict.outcome,
        verdict.evidence,
    )


def _stability_claim(
    form: str,
    pair: tuple[Any, Any],
    dwell: Dwell,
    certificate: Mapping[str, Any],
    paranoid: bool,
) -> Claim:
    """Inequality (5), or (10) on the n-dimensional pair, for all dwell times in the range."""
    equation = "Assumption 2.i, (5)" if form == "cooperative" else "Assumption 5, (10)"
    verdict = dwell_stability(*pair, dwell, certificate, paranoid)
    return Claim(
        "dwell_stability",
        f"the width map w -> e^(W T) N w, W = D0 + D1, N = Gp + Gn, is stable for every sequence "
        f"of dwell times T in {dwell}: one P > 0 has N' e^(W' T) P e^(W T) N < P, or one P for "
        "each window of dwell times has, or one v > 0 has v' e^(W T) N < v' (or a like "
        "inequality), for all of them",
        source_of(verdict, f"{PAPER}, {THEOREMS[form]}, {equation}"),
        verdict.outcome,
        verdict.evidence,
    )
