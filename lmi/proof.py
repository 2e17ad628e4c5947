"""Proofs for all dwell times: one P for a whole range, by log-norm steps in ball arithmetic.

Question: M(theta)' P M(theta) < P for every theta in [low, high], M(theta) = e^{F theta} H, with P
given. Method: with m the logarithmic norm of F in the P-norm (F'P + PF <= 2 m P, certified), an
inequality M(theta)' P M(theta) <= q P, q < 1, certified at one theta, carries over to
[theta, theta + s] while q e^{2 m s} < 1. High = infinity is closed by a Lyapunov matrix Q >= P of
the flow: M' Q M decreases with theta, so Q in place of P at one theta* settles all later ones.

Floats only steer (how far to step, which q to try); every comparison is made in balls, on the
rational numbers that the stored floats are. No optimisation solver is imported here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lmi.balls import (
    PRECISIONS,
    Exact,
    ball,
    certify_negative,
    certify_positive_definite,
    exact,
    exp_times,
    middle,
    number,
    precision,
    to_float,
)
from lmi.hurwitz import lyapunov_matrix, prove_hurwitz
from lmi.verdict import Verdict, proved, undecided

Matrix = NDArray[np.float64]

STEP_LIMIT = 20_000
# room given to float estimates before they are certified; less at each higher precision
_PADS = dict(zip(PRECISIONS, (1e-9, 1e-12, 1e-14), strict=True))


@dataclass(frozen=True)
class _Question:
    """Exact data and their floats."""

    F: Exact
    H: Exact
    P: Matrix
    low: float
    high: float

    @property
    def flow(self) -> Matrix:
        return to_float(self.F)


def prove_common(
    F: ArrayLike, H: ArrayLike, P: ArrayLike, low: float, high: float, *, steps: int = STEP_LIMIT
) -> Verdict:
    """P > 0 and M(theta)' P M(theta) < P for all theta in [low, high]; high may be infinity.

    F, H: (n, n) floats or exact rationals; P: (n, n) symmetric floats. Proved or undecided; then
    evidence["theta"] is a float where the inequality could not be shown. For high = infinity F must
    be Hurwitz (the inequality alone leaves bounded inputs unbounded: docs/papers.md).
    """
    if not 0 <= low <= high:
        raise ValueError(f"0 <= low <= high is required; got [{low}, {high}]")
    P = np.asarray(P, dtype=np.float64)
    if not np.isfinite(P).all() or not np.array_equal(P, P.T):
        return undecided("P is not a finite symmetric matrix")
    if math.isinf(high):
        flow = prove_hurwitz(F)
        if flow.outcome != "proved":
            return undecided("the flow is not proved to be Hurwitz", flow=dict(flow.evidence))
    question = _Question(exact(F), exact(H), P, float(low), float(high))
    verdict = undecided("no attempt was made")
    for bits in PRECISIONS:
        with precision(bits), np.errstate(all="ignore"):
            verdict = _march(question, steps, _PADS[bits])
        if verdict.outcome == "proved":
            return Verdict("proved", {**verdict.evidence, "bits": bits})
    return verdict


def _march(question: _Question, steps: int, pad: float) -> Verdict:
    F, P = question.F, question.P
    P_ball = ball(exact(P))
    if not certify_positive_definite(P_ball):
        return undecided("P is not certainly positive definite")
    F_ball = ball(F)
    growth = F_ball.transpose() * P_ball + P_ball * F_ball
    m = _log_norm(question, growth, P_ball, pad)
    if m is None:
        return undecided("the logarithmic norm of the flow could not be bounded")
    tail = _tail(question, P_ball, F_ball) if math.isinf(question.high) and m > 0 else None
    H_ball, theta, least = ball(question.H), question.low, math.inf
    for step in range(1, steps + 1):
        M = exp_times(F, theta) * H_ball
        q = _contraction(M, P, P_ball, pad)
        if q is None:
            return undecided(
                f"the inequality fails, or nearly fails, at theta = {theta!r}", theta=theta
            )
        least = min(least, 1 - q)
        done = {"method": "log-norm march", "steps": step, "least_margin": least}
        if m <= 0 or theta >= question.high:
            return proved(**done)
        if tail is not None and certify_positive_definite(P_ball - M.transpose() * tail * M):
            return proved(**done, tail_from=theta)
        following = _advance(theta, q, m)
        if following is None:
            return undecided(f"no further step is possible at theta = {theta!r}", theta=theta)
        if following >= question.high:
            return proved(**done)
        theta = following
    return undecided(f"{steps} steps did not reach the end", theta=theta, steps=steps)


def _log_norm(question: _Question, growth: Any, P_ball: Any, pad: float) -> float | None:
    """A certified m with F'P + PF <= 2 m P."""
    F, P = question.flow, question.P
    m = _largest_relative(F.T @ P + P @ F, 2 * P)
    if m is None:
        return None
    m += pad * max(abs(m), 1e-3 * float(np.abs(F).max(initial=0.0)), 1e-12)
    if not math.isfinite(2 * m):
        return None
    certified = certify_positive_definite(number(2 * m) * P_ball - growth)
    return m if certified else None


def _contraction(M: Any, P: Matrix, P_ball: Any, pad: float) -> float | None:
    """A certified q < 1 with M'PM <= q P."""
    approx = middle(M)
    if not np.isfinite(approx).all():
        return None
    q = _largest_relative(approx.T @ P @ approx, P)
    if q is None:
        return None
    q = max(q, 0.0) * (1 + pad) + 1e-4 * pad
    if q < 1 and certify_positive_definite(number(q) * P_ball - M.transpose() * P_ball * M):
        return q
    return None


def _advance(theta: float, q: float, m: float) -> float | None:
    """Largest safe next theta: q e^{2 m s} < 1, certified; rounded down."""
    s = -math.log(q) / (2 * m) * (1 - 1e-6)
    following = math.nextafter(theta + s, -math.inf)
    if not following > theta or not math.isfinite(following):
        return None
    # theta + s covers `following`, since the sum was rounded by at most half an ulp
    grown = (number(2 * m) * (number(following) - number(theta))).exp() * number(q)
    return following if certify_negative(grown - 1) else None


def _tail(question: _Question, P_ball: Any, F_ball: Any) -> Any:
    """Certified Q >= P with F'Q + QF < 0, or None."""
    Q = lyapunov_matrix(question.flow, question.P)
    if Q is None:
        return None
    scale = _largest_relative(question.P, Q)
    if scale is None:
        return None
    Q = Q * scale * (1 + 1e-6)
    Q_ball = ball(exact((Q + Q.T) / 2))
    falling = -(F_ball.transpose() * Q_ball + Q_ball * F_ball)
    if certify_positive_definite(falling) and certify_positive_definite(Q_ball - P_ball):
        return Q_ball
    return None


def _largest_relative(S: Matrix, P: Matrix) -> float | None:
    """Float estimate of the largest eigenvalue of S relative to P; None if P has no Cholesky."""
    try:
        L = np.linalg.cholesky(P)
        half = np.linalg.solve(L, np.linalg.solve(L, (S + S.T) / 2).T)
        largest = float(np.linalg.eigvalsh((half + half.T) / 2)[-1])
        return largest if math.isfinite(largest) else None
    except np.linalg.LinAlgError:
        return None
