"""Proofs for all dwell times: matrices P for a whole range of theta, in ball arithmetic.

Question: M(theta)' P M(theta) < P for every theta in [low, high], M(theta) = e^{F theta} H, with P
given. Independent methods: Taylor-Bernstein boxes (`lmi.prove.bernstein`, the default), log-norm
steps (`lmi.prove.march`) and chords (`lmi.prove.chords`). High = infinity is closed by a Lyapunov
matrix Q >= P of the flow: M' Q M decreases with theta, so Q in place of P at one theta* settles all
later ones; Q also proves that the flow is Hurwitz, which the stability of bounded inputs needs
there (docs/papers.md).

Floats only steer; every comparison is made in balls, on the rational numbers that the stored floats
are. No optimisation solver is imported here.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.balls import (
    PRECISIONS,
    ball,
    certify_positive_definite,
    cholesky,
    exact,
    identity,
    middle,
    precision,
)
from lmi.prove.bernstein import Boxes, Normalised, prove_range
from lmi.prove.chords import chords
from lmi.prove.condition import Condition, common
from lmi.prove.hurwitz import lyapunov_matrix, modal_matrix, prove_hurwitz
from lmi.prove.march import march
from lmi.verdict import Verdict, proved, undecided

METHODS = ("bernstein", "march", "chords")
STEP_LIMIT = 20_000


def prove_common(
    F: ArrayLike,
    H: ArrayLike,
    P: ArrayLike,
    low: float,
    high: float,
    *,
    method: str = "bernstein",
    form: str = "before_jump",
    gamma: float = 1.0,
    steps: int = STEP_LIMIT,
) -> Verdict:
    """P > 0 and M(theta)' P M(theta) < gamma^2 P for all theta in [low, high], or [low, infinity).

    F, H: (n, n) floats or exact rationals; P: (n, n) symmetric floats. form: "before_jump" for
    M = e^{F theta} H, "after_jump" for M = H e^{F theta}. Proved or undecided; then
    evidence["theta"], where there is one, is a float near which the inequality could not be shown.
    For high = infinity F must be Hurwitz. ValueError unless 0 <= low <= high.
    """
    condition = common(F, H, P, low, high, form, gamma)
    if isinstance(condition, str):
        return undecided(condition)
    return prove(condition, method=method, steps=steps)


def prove(condition: Condition, *, method: str = "bernstein", steps: int = STEP_LIMIT) -> Verdict:
    """One condition for all its theta, balanced; precision is raised before giving up."""
    if method not in METHODS:
        raise ValueError(f"method must be one of {', '.join(METHODS)}; got {method!r}")
    condition = condition.balanced()
    if method == "march" and math.isinf(condition.high):
        flow = prove_hurwitz(condition.F)
        if flow.outcome != "proved":
            return undecided("the flow is not proved to be Hurwitz", flow=dict(flow.evidence))
    verdict = undecided("no attempt was made")
    for bits in PRECISIONS:
        with precision(bits), np.errstate(all="ignore"):
            if method == "march":
                verdict = march(condition, steps, bits)
            elif method == "chords":
                verdict = chords(condition, steps)
            else:
                verdict = _boxes(condition, steps)
        if verdict.outcome == "proved":
            return Verdict("proved", {**verdict.evidence, "bits": bits})
        if max(verdict.evidence.get(key, 0) for key in ("boxes", "steps")) >= steps:
            break  # more bits do not make fewer steps
    return verdict


def _boxes(condition: Condition, limit: int) -> Verdict:
    family = _normalised(condition)
    if family is None:
        return undecided("P is not certainly positive definite")
    tails = _tails(family)
    if not tails and math.isinf(condition.high):
        return undecided("the flow is not proved to be Hurwitz")
    boxes = prove_range(family, condition.low, condition.high, limit, tails)
    if boxes.failed is None:
        return proved(**_account(boxes))
    reason = f"the inequality fails, or nearly fails, at theta = {boxes.failed!r}"
    if boxes.count >= limit:
        reason = f"{limit} boxes did not reach the end; they came to theta = {boxes.failed!r}"
    found = {"theta": boxes.failed, "boxes": boxes.count}
    return undecided(reason, **found, **({"which": boxes.which} if condition.others else {}))


def _account(boxes: Boxes) -> dict[str, Any]:
    found: dict[str, Any] = {"method": "Taylor-Bernstein boxes", "boxes": boxes.count}
    if boxes.count:
        found["smallest_box"] = boxes.smallest
    if boxes.tail_from is not None:
        found["tail_from"] = boxes.tail_from
    return found


def _normalised(condition: Condition) -> Normalised | None:
    """The family in coordinates where P_source and P_target are the identity."""
    lower_s, lower_t = (cholesky(ball(exact(P))) for P in (condition.P_source, condition.P_target))
    if lower_s is None or lower_t is None:
        return None
    source, target = lower_s.transpose(), lower_t.transpose()
    F, right = ball(condition.F), ball(condition.right)
    try:
        back = source.inv()
        if condition.left is None:
            flow = target
            left = ball(exact(np.eye(len(condition.P_source))))
        elif len(condition.P_source) == len(condition.F):
            flow = source
            left = target * ball(condition.left) * back
        else:  # P of another size than the flow: the flow keeps its own coordinates
            flow = identity(len(condition.F))
            left = target * ball(condition.left)
        turned = flow * F * flow.inv(), left, flow * right * back
        others = tuple(back.transpose() * ball(exact(P)) * back for P in condition.others)
        return Normalised(*turned, condition.gamma, others)
    except ZeroDivisionError:  # the balls are too wide to invert at this precision
        return None


def _tails(family: Normalised) -> list[Any]:
    """Certified Q >= left' left with F'Q + QF < 0 in the flow's coordinates.

    For each, right' e^{F't} Q e^{Ft} right falls with t and bounds N'N. Modal coordinates do not
    mind slow modes, a Lyapunov equation does not mind multiple ones.
    """
    bound = family.left.transpose() * family.left
    if _falling(family.F, bound):
        return [bound]
    approx, weight = middle(family.F), middle(bound)
    if not (np.isfinite(approx).all() and np.isfinite(weight).all()):
        return []
    unit = np.eye(len(approx))
    weight = weight + (1e-3 * np.trace(weight) / len(weight) + 1e-300) * unit
    tails = []
    for Q in (modal_matrix(approx), lyapunov_matrix(approx, weight)):
        if Q is None:
            continue
        try:
            scale = float(np.linalg.eigvals(np.linalg.solve(Q, weight)).real.max())
        except np.linalg.LinAlgError:
            continue
        if not 0 < scale < math.inf:
            continue
        Q_ball = ball(exact(Q * scale * (1 + 1e-6)))
        if certify_positive_definite(Q_ball - bound) and _falling(family.F, Q_ball):
            tails.append(Q_ball)
    return tails


def _falling(F: Any, Q: Any) -> bool:
    return certify_positive_definite(-(F.transpose() * Q + Q * F))
