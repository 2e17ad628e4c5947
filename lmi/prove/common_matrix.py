"""Proofs for all dwell times: matrices P for a whole range of theta, in ball arithmetic.

Question: M(theta)' P M(theta) < P for every theta in [low, high], M(theta) = e^{F theta} H, with P
given. Independent methods: Taylor-Bernstein boxes (`lmi.prove.bernstein`, the default) and chords
(`lmi.prove.chords`). High = infinity is closed by a Lyapunov matrix Q >= P of the flow
(`lmi.prove.tails`): M' Q M decreases with theta, so Q in place of P at one theta* settles all later
ones; Q also proves that the flow is Hurwitz, which the stability of bounded inputs needs there
(docs/papers.md).

Floats only steer; every comparison is made in balls, on the rational numbers that the stored floats
are. No optimisation solver is imported here.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import NewEntries
from lmi.arithmetic.balls import PRECISIONS, ball, cholesky, exact, identity, precision
from lmi.prove.bernstein import Boxes, Normalised, prove_range
from lmi.prove.chords import chords
from lmi.prove.condition import Condition
from lmi.prove.tails import falling_forms
from lmi.time_budget import UNLIMITED, TimeBudget
from lmi.verdict import Verdict, proved, undecided

METHODS = ("bernstein", "chords")
BOX_LIMIT = 20_000


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
    steps: int = BOX_LIMIT,
    budget: TimeBudget = UNLIMITED,
) -> Verdict:
    """Prove P > 0 and M(theta)' P M(theta) < gamma^2 P for all theta in a range.

    The inequality of Briat, Automatica 49 (2013), Theorem 3, for gamma = 1.
    The range is [low, high], or [low, infinity). F, H: (n, n) floats or exact rationals; P: (n, n)
    symmetric floats. form: "before_jump" for M = e^{F theta} H, "after_jump" for M = H e^{F theta}.
    budget: ends the method "bernstein". Proved or undecided; then evidence["theta"], where there is
    one, is a float near which the inequality could not be shown. For high = infinity F must be
    Hurwitz. ValueError unless 0 <= low <= high.
    """
    if not 0 <= low <= high:
        raise ValueError(f"0 <= low <= high is required; got [{low}, {high}]")
    if form not in ("before_jump", "after_jump"):
        raise ValueError(f"form must be before_jump or after_jump; got {form!r}")
    flow, jump, P = exact(F), exact(H), np.asarray(P, dtype=np.float64)
    if P.shape != flow.shape or not np.isfinite(P).all() or not np.array_equal(P, P.T):
        return undecided("P is not a finite symmetric matrix")
    right, left = (jump, None) if form == "before_jump" else (exact(np.eye(len(P))), jump)
    condition = Condition(flow, right, P, P, float(low), float(high), left, gamma)
    return prove(condition, method=method, steps=steps, budget=budget)


def prove(
    condition: Condition,
    *,
    method: str = "bernstein",
    steps: int = BOX_LIMIT,
    budget: TimeBudget = UNLIMITED,
) -> Verdict:
    """One condition for all its theta, balanced; precision is raised before giving up."""
    if method not in METHODS:
        raise ValueError(f"method must be one of {', '.join(METHODS)}; got {method!r}")
    condition = condition.balanced()
    verdict = undecided("no attempt was made")
    for bits in PRECISIONS:
        with precision(bits), np.errstate(all="ignore"):
            if method == "chords":
                verdict = chords(condition, steps)
            else:
                verdict = _boxes(condition, steps, budget)
        if verdict.outcome == "proved":
            return Verdict("proved", {**verdict.evidence, "bits": bits})
        used = max(verdict.evidence.get(key, 0) for key in ("boxes", "steps"))
        if used >= steps or budget.remaining() < 0:
            break  # more bits do not make fewer steps
    return verdict


def _boxes(condition: Condition, limit: int, budget: TimeBudget) -> Verdict:
    family = _normalised(condition)
    if family is None:
        return undecided("P is not certainly positive definite")
    tails = falling_forms(family.F, family.left.transpose() * family.left)
    if not tails and math.isinf(condition.high):
        return undecided("the flow is not proved to be Hurwitz")
    boxes = prove_range(family, condition.low, condition.high, limit, tails, budget=budget)
    if boxes.failed is None:
        return proved(**_account(boxes))
    if ended := budget.ended():
        return undecided(f"the proof came to theta = {boxes.failed!r}", **ended)
    reason = f"the inequality fails, or nearly fails, at theta = {boxes.failed!r}"
    if boxes.count >= limit:
        reason = f"{limit} boxes did not reach the end; they came to theta = {boxes.failed!r}"
    place = {"theta": boxes.failed, "boxes": boxes.count}
    return undecided(reason, **place, **({"which": boxes.which} if condition.others else {}))


def _account(boxes: Boxes) -> NewEntries:
    evidence: NewEntries = {"method": "Taylor-Bernstein boxes", "boxes": boxes.count}
    if boxes.count:
        evidence |= {"smallest_box": boxes.smallest}
    if boxes.tail_from is not None:
        evidence |= {"tail_from": boxes.tail_from}
    return evidence


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
