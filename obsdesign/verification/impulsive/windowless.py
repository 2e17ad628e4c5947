"""What no window is needed for: blocks that decay by themselves, and the quadratic strategy."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from lmi.arithmetic.balls import Exact, exact, number, rational
from lmi.bounds.largest_norm import identity_like, norm_of, norm_over
from lmi.prove.common_matrix import prove_common
from lmi.rank.hidden_mode import check_hiding
from lmi.rank.witness import MARGIN
from lmi.verdict import Verdict, proved, refuted, undecided
from obsdesign.analysis.hidden_modes import hidden_pair
from obsdesign.document import Claim
from obsdesign.equations.estimation_error import seen_before_jump
from obsdesign.equations.impulsive.gains import factor_left_alone
from obsdesign.problem.problem import Problem
from obsdesign.verification.dwell import Dwell, dwell_stability
from obsdesign.verification.impulsive.rate import Bound, in_balls, quadratic_bound

_SOURCES = {
    "hidden": "linear time-varying cascade: what C does not see follows what it sees",
    "rest": "Medina, Lawrence, section IV: the part that nothing drives",
}


def alone(
    name: str,
    pair: tuple[Exact, Exact],
    dwell: Dwell,
    certificates: Mapping[str, Mapping[str, Any]],
    paranoid: bool,
    rate: float,
) -> Claim:
    """The block "hidden" or "rest" decays for all spacings, with a margin."""
    F, H = pair
    factor = factor_left_alone(rate, dwell.high)
    identity = f"{name}_decays"
    certificate = certificates.get(identity, {})
    smaller = certificate.get("factor")
    if isinstance(smaller, float) and 0 < smaller < factor:
        factor = smaller
    verdict = dwell_stability(F, H / rational(factor), dwell, certificate, paranoid)
    if verdict.outcome == "refuted":
        verdict = _without_margin(verdict, F, H, dwell)
    verdict = Verdict(verdict.outcome, {**verdict.evidence, "factor": factor})
    what = "that no measurement sees" if name == "hidden" else "that nothing corrects"
    return Claim(
        identity,
        f"the part of the error {what} ({len(F)} of the coordinates of basis) shrinks to "
        f"{factor:.9g} or less per impulse, in the norm of one P, for all spacings in "
        f"{dwell}",
        _SOURCES[name],
        verdict.outcome,
        verdict.evidence,
    )


def _without_margin(verdict: Verdict, F: Exact, H: Exact, dwell: Dwell) -> Verdict:
    """A witness against the margin; only one against decay itself refutes."""
    plain = dwell_stability(F, H, dwell, {}, False)
    if plain.outcome == "refuted":
        witness = dict(plain.evidence.get("witness", {}))
        modes = np.linalg.eigvals(_float(F))
        worst = modes[np.argmax(modes.real)]
        told = f"{witness.get('reason', '')}; its flow has the mode {worst:.6g}"
        return refuted({**witness, "reason": f"it does not decay by itself: {told}"})
    return undecided("it decays too slowly, if at all", **verdict.evidence)


def _float(X: Exact) -> Any:
    return np.array([[float(int(v.p) / int(v.q)) for v in row] for row in X])


def quadratic_claims(
    problem: Problem, numbers: Mapping[str, Any], certificates: Any, paranoid: bool
) -> tuple[list[Claim], Bound | None]:
    """One P for all spacings, gains by cells of the last spacing; and the bound that follows."""
    dwell, ends = Dwell.of(problem), problem.require_dwell_time()
    C = seen_before_jump(numbers["G"], numbers["C"], numbers["jump_measurement"])
    certificate = certificates.get("contracting", {})
    P, gamma = _matrix(certificate.get("P"), problem.plant.n), certificate.get("gamma")
    if P is None or not isinstance(gamma, float) or not 0 < gamma < 1:
        verdict = undecided("no P was found for which a gain contracts at every spacing")
    else:
        verdict = _contracting(numbers, C, P, gamma, ends)
    found = [Claim(
        "contracting",
        "in the norm of one P the error after an impulse is at most gamma of that after the "
        f"impulse before, for all spacings in {dwell}, with the gain of table for "
        "the cell that the spacing is in",
        "quadratic detectability: P and one gain for each cell of spacings",
        verdict.outcome, verdict.evidence,
    )]  # fmt: skip
    if verdict.outcome == "proved" and P is not None and gamma is not None:
        return found, _bound(numbers, C, P, float(gamma), ends)
    # no gain at all helps against these
    return [*_hopeless(numbers, C, dwell, certificates, paranoid), *found], None


def _hopeless(
    numbers: Mapping[str, Any],
    C: Exact,
    dwell: Dwell,
    certificates: Any,
    paranoid: bool,
) -> list[Claim]:
    """What would refute every observer: claims about what no measurement sees."""
    found = []
    pair = hidden_pair(numbers["A"], numbers["G"], C)
    if pair is not None:
        verdict = dwell_stability(*pair, dwell, certificates.get("hidden_decays", {}), paranoid)
        if verdict.outcome == "refuted":
            verdict = _without_margin(verdict, *pair, dwell)
        found.append(Claim(
            "hidden_decays",
            f"what no measurement ever sees of the state (dimension {len(pair[0])}) decays",
            _SOURCES["hidden"], verdict.outcome, verdict.evidence,
        ))  # fmt: skip
    hiding = certificates.get("detectable", {}).get("witness", {}).get("thetas")
    if (
        isinstance(hiding, list)
        and len(hiding) == 1
        and dwell.low <= float(hiding[0]) <= dwell.high
    ):
        verdict = check_hiding(numbers["A"], numbers["G"], C, float(hiding[0]))
        found.append(Claim(
            "detectable",
            "at no constant spacing does C miss a mode of the impulses and the flow between them "
            f"that has modulus 1 or more (residuals below {MARGIN:g} of their terms)",
            _SOURCES["hidden"], verdict.outcome, verdict.evidence,
        ))  # fmt: skip
    return found


def _contracting(
    numbers: Mapping[str, Any], C: Exact, P: Any, gamma: float, ends: tuple[float, float]
) -> Verdict:
    cells, table = numbers["cells"], numbers["table"]
    one = len(cells) == 2 and cells[0] == cells[1] == ends[0] == ends[1]
    rising = bool(np.all(np.diff(cells) > 0))
    if not one and not (rising and cells[0] <= ends[0] and cells[-1] >= ends[1]):
        return refuted({"entry": "gains.cells", "reason": "the cells do not cover the range"})
    boxes = 0
    for (start, end), L in zip(itertools.pairwise(cells.tolist()), table, strict=True):
        H = numbers["G"] + exact(L) @ C
        sides = max(start, ends[0]), min(end, ends[1])
        verdict = prove_common(numbers["A"], H, P, *sides, form="after_jump", gamma=gamma)
        if verdict.outcome != "proved":
            return verdict
        boxes += int(verdict.evidence.get("boxes", 0))
    return proved(P=P.tolist(), gamma=gamma, cells=len(table), boxes=boxes)


def _bound(
    numbers: Mapping[str, Any], C: Exact, P: Any, gamma: float, ends: tuple[float, float]
) -> Bound:
    """From the error after an impulse to the one before the next, and back."""
    unit = identity_like(numbers["A"])
    with in_balls():
        flow = norm_over(unit, numbers["A"], unit, *ends)
        gain = norm_of(numbers["G"])
        for L in numbers["table"]:
            gain = gain.max(norm_of(numbers["G"] + exact(L) @ C))
        bound = quadratic_bound(P, gamma).scaled(flow * gain / number(gamma))
        return Bound(bound.constant.max(number(1.0)), bound.factor)


def _matrix(values: Any, n: int) -> Any:
    try:
        P = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        return None
    good = P.shape == (n, n) and bool(np.isfinite(P).all()) and np.array_equal(P, P.T)
    return P if good and not math.isinf(float(np.abs(P).max())) else None
