"""Positive systems: a vector in place of a matrix, proved for all dwell times.

F Metzler and H >= 0 make M(theta) >= 0. One vector v > 0 then shows stability for all sequences if

    left    v' M(theta) < v'            right    M(theta) v < v          for all theta in the range

with M = e^{F theta} H (before_jump) or H e^{F theta} (after_jump). All four read: a row
r(theta)' = r0' e^{K theta}, K = F or F', keeps r(theta)' B < v'. Where r' K <= mu r' holds at one
theta, it holds from there on (e^{K s} >= 0), so that r(theta + s) <= e^{mu s} r(theta): a step as
long as e^{mu s} leaves the inequality true, and all of the rest at once when mu <= 0. Ball
arithmetic, no solver.
Left vectors: C. Briat, Automatica 49 (2013), for positive impulsive systems.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balancing import Scaling
from lmi.arithmetic.balls import (
    PRECISIONS,
    Ball,
    Balls,
    Exact,
    Rational,
    ball,
    exact,
    exp_times,
    number,
    precision,
)
from lmi.verdict import Verdict, proved, undecided

SIDES = ("left", "right")
FORMS = ("before_jump", "after_jump")

STEP_LIMIT = 5000
# r is compared with e^{mu s} r entrywise: an entry that vanishes is lifted by this share of v
_LIFT = 1e-7


@dataclass(frozen=True)
class RowFlow:
    """r(theta)' = start' e^{K theta}, to be kept below v: r' B < v'. Exact entries."""

    K: Exact
    start: Exact
    B: Exact


def row_flow(F: Exact, H: Exact, v: Exact, side: str, form: str) -> RowFlow:
    """The row flow that a left or right condition, before or after the jump, is about."""
    identity = exact(np.eye(len(F)))
    K, jump = (F, H) if side == "left" else (F.T, H.T)
    if (side == "left") == (form == "before_jump"):
        return RowFlow(K, v, jump)
    return RowFlow(K, v @ jump, identity)


def prove_copositive(
    F: ArrayLike,
    H: ArrayLike,
    v: ArrayLike,
    low: float,
    high: float,
    *,
    side: str = "left",
    form: str = "before_jump",
) -> Verdict:
    """Prove the copositive inequality for all theta in [low, high]; high may be infinite.

    That includes F Metzler, H >= 0, v > 0; for high = infinity not that F is Hurwitz. F, H: (n, n)
    floats or exact rationals; v: (n,) floats. Proved or undecided.
    """
    if side not in SIDES or form not in FORMS:
        raise ValueError(f"side is one of {SIDES}, form one of {FORMS}; got {side!r}, {form!r}")
    flow, jump, vector = exact(F), exact(H), np.asarray(v, dtype=np.float64)
    if vector.shape != (len(flow),) or not np.isfinite(vector).all() or not (vector > 0).all():
        return undecided("the vector is not positive")
    entries: list[Rational] = [*flow[~np.eye(len(flow), dtype=bool)], *jump.flat]
    if any(entry < 0 for entry in entries):
        return undecided("the flow is not Metzler, or the jump not nonnegative")
    scaling = Scaling.from_pair(flow, jump, float(high))
    flow, jump = scaling.map(flow), scaling.map(jump)
    vector = scaling.undone.vector(vector, side)
    question = row_flow(flow, jump, exact(vector), side, form)
    verdict = undecided("no attempt was made")
    for bits in PRECISIONS:
        with precision(bits), np.errstate(all="ignore"):
            verdict = _stepped(question, vector, float(low), float(high))
        if verdict.outcome == "proved":
            return Verdict("proved", {"side": side, "form": form, **verdict.evidence})
        if verdict.evidence.get("steps", 0) >= STEP_LIMIT:
            break  # more bits do not make fewer steps
    return verdict


def _stepped(question: RowFlow, v: Matrix, low: float, high: float) -> Verdict:
    start, B = ball(question.start[None, :]), ball(question.B)
    K, bound = ball(question.K), [number(float(x)) for x in v]
    lift = [number(float(x) * _LIFT) for x in v]
    theta = low
    for step in range(1, STEP_LIMIT + 1):
        row = start * exp_times(question.K, theta)
        row = _lifted(row, lift)
        q = _largest([x / b for x, b in zip((row * B).entries(), bound, strict=True)])
        mu = _largest([x / r for x, r in zip((row * K).entries(), row.entries(), strict=True)])
        if q is None or mu is None or not q < 1:
            reason = f"the inequality fails, or nearly fails, at theta = {theta!r}"
            return undecided(reason, theta=theta)
        done = {"method": "row march", "steps": step}
        if mu <= 0 or theta >= high:
            return proved(**done, **({"tail_from": theta} if mu <= 0 else {}))
        following = math.nextafter(theta - math.log(q) / mu * (1 - 1e-6), -math.inf)
        grown = ((number(following) - number(theta)) * number(mu)).exp() * number(q)
        if not following > theta or not grown < 1:
            return undecided(f"no further step is possible at theta = {theta!r}", theta=theta)
        if following >= high:
            return proved(**done)
        theta = following
    return undecided(f"{STEP_LIMIT} steps did not reach the end", theta=theta, steps=STEP_LIMIT)


def _lifted(row: Balls, lift: list[Ball]) -> Balls:
    """The row plus a little of v: an upper bound without zeros."""
    entries = [x + more for x, more in zip(row.entries(), lift, strict=True)]
    return type(row)(1, len(entries), entries)


def _largest(values: list[Ball]) -> float | None:
    """A float that is certainly at least as large as every ball; None if there is none."""
    largest = -math.inf
    for value in values:
        top = math.nextafter(float(value.upper()), math.inf)
        if not math.isfinite(top):
            return None
        largest = max(largest, top)
    return largest if math.isfinite(largest) else None
