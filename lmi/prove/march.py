"""Proof for all dwell times by steps: the logarithmic norm carries an inequality forward.

With m the logarithmic norm of F in the norm of the target P (F'P + PF <= 2 m P), an inequality
M(theta)' P M(theta) <= q P_source, certified at one theta, holds on [theta, theta + s] with q e^{2
m s} in place of q. It shares neither coordinates nor polynomials with `lmi.prove.bernstein`: the
second opinion.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.balls import (
    PRECISIONS,
    ball,
    certify_negative,
    certify_positive_definite,
    exact,
    exp_times,
    middle,
    number,
    to_float,
)
from lmi.prove.condition import Condition
from lmi.prove.hurwitz import lyapunov_matrix
from lmi.verdict import Verdict, proved, undecided

Matrix = NDArray[np.float64]

# room given to float estimates before they are certified; less at each higher precision
_PADS = dict(zip(PRECISIONS, (1e-9, 1e-12, 1e-14), strict=True))


def march(condition: Condition, steps: int, bits: int) -> Verdict:
    """Proved by steps, or undecided with the theta where they ended, at the current precision."""
    pad = _PADS[bits]
    F = condition.F
    if condition.left is not None or condition.others:
        return undecided("the march is for maps e^{F theta} H, one source at a time")
    P_ball = ball(exact(condition.P_target))
    source = ball(exact(condition.P_source)) * (number(condition.gamma) * number(condition.gamma))
    if not certify_positive_definite(P_ball) or not certify_positive_definite(source):
        return undecided("P is not certainly positive definite")
    F_ball = ball(F)
    growth = F_ball.transpose() * P_ball + P_ball * F_ball
    m = _log_norm(condition, growth, P_ball, pad)
    if m is None:
        return undecided("the logarithmic norm of the flow could not be bounded")
    tail = _tail(condition, P_ball, F_ball) if math.isinf(condition.high) and m > 0 else None
    H_ball, theta, least = ball(condition.right), condition.low, math.inf
    for step in range(1, steps + 1):
        M = exp_times(F, theta) * H_ball
        q = _contraction(M, P_ball, source, pad)
        if q is None:
            return undecided(
                f"the inequality fails, or nearly fails, at theta = {theta!r}", theta=theta
            )
        least = min(least, 1 - q)
        done = {"method": "log-norm march", "steps": step, "least_margin": least}
        if m <= 0 or theta >= condition.high:
            return proved(**done)
        if tail is not None and certify_positive_definite(source - M.transpose() * tail * M):
            return proved(**done, tail_from=theta)
        following = _advance(theta, q, m)
        if following is None:
            return undecided(f"no further step is possible at theta = {theta!r}", theta=theta)
        if following >= condition.high:
            return proved(**done)
        theta = following
    return undecided(f"{steps} steps did not reach the end", theta=theta, steps=steps)


def _log_norm(condition: Condition, growth: Any, P_ball: Any, pad: float) -> float | None:
    """A certified m with F'P + PF <= 2 m P."""
    F, P = to_float(condition.F), middle(P_ball)
    m = _largest_relative(F.T @ P + P @ F, 2 * P)
    if m is None:
        return None
    m += pad * max(abs(m), 1e-3 * float(np.abs(F).max(initial=0.0)), 1e-12)
    if not math.isfinite(2 * m):
        return None
    certified = certify_positive_definite(number(2 * m) * P_ball - growth)
    return m if certified else None


def _contraction(M: Any, target: Any, source: Any, pad: float) -> float | None:
    """A certified q < 1 with M' target M <= q source."""
    moved = M.transpose() * target * M
    approx = middle(moved)
    if not np.isfinite(approx).all():
        return None
    q = _largest_relative(approx, middle(source))
    if q is None:
        return None
    q = max(q, 0.0) * (1 + pad) + 1e-4 * pad
    if q < 1 and certify_positive_definite(number(q) * source - moved):
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


def _tail(condition: Condition, P_ball: Any, F_ball: Any) -> Any:
    """Certified Q >= P with F'Q + QF < 0, or None."""
    Q = lyapunov_matrix(to_float(condition.F), middle(P_ball))
    if Q is None:
        return None
    scale = _largest_relative(middle(P_ball), Q)
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
