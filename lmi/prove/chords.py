"""Proof for all dwell times by chords: a third way, for margins too narrow for `lmi.prove.march`.

In coordinates where both P are the identity the condition says N' N < gamma^2 I, for
N(theta) = left e^{F theta} right. Between a and b = a + h, N stays within h^2/8 max |N''| = rho of
its chord C, and C' C is convex along the chord: at most its larger end, as a quadratic form. So

    N(a)' N(a) + r I < gamma^2 I,   N(b)' N(b) + r I < gamma^2 I,   r = 2 max |C| rho + rho^2

prove [a, b]; h grows with the root of the margin, where the steps of the march grow with the margin
itself. Everything that decides is ball arithmetic; floats choose steps only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.balls import (
    ball,
    certify_positive_definite,
    cholesky,
    exact,
    exp_times,
    identity,
    middle,
    norm_bound,
    number,
)
from lmi.prove.condition import Condition
from lmi.prove.hurwitz import lyapunov_matrix
from lmi.verdict import Verdict, proved, undecided

Matrix = NDArray[np.float64]

# a step leaves this share of the margin to what lies between its ends
_SHARE = 0.5
_HALVINGS = 30


def chords(condition: Condition, steps: int) -> Verdict:
    """Proved by chords, or undecided with the theta where they ended, at the current precision."""
    if condition.others:
        return undecided("chords are for one source at a time")
    line = _Line.of(condition)
    if line is None:
        return undecided("P is not certainly positive definite")
    tail = _tail(condition, line.left) if math.isinf(condition.high) else None
    if tail is None and math.isinf(condition.high):
        return undecided("the flow is not proved to be Hurwitz")
    theta, flow, least, width = condition.low, line.flow(condition.low), math.inf, math.inf
    for step in range(1, steps + 1):
        margin = line.margin(flow)
        least = min(least, margin)
        done = {"method": "chords", "steps": step, "least_margin": least}
        if tail is not None and line.below(flow.transpose() * tail * flow):
            return proved(**done, tail_from=theta)
        if theta >= condition.high and line.below(line.gram(flow)):
            return proved(**done)
        following = line.advance(theta, flow, margin, 2 * width)
        if following is None:
            reason = f"the inequality fails, or nearly fails, at theta = {theta!r}"
            return undecided(reason, theta=theta)
        width, theta, flow = following[0] - theta, *following
    return undecided(f"{steps} steps did not reach the end", theta=theta, steps=steps)


@dataclass(frozen=True)
class _Line:
    """The condition in coordinates where both P are the identity; ball matrices."""

    condition: Condition
    left: Any
    right: Any
    curvature: Any  # above |left F^2|
    speed: Any  # above |F|
    square: Any  # gamma^2
    unit: Any

    @staticmethod
    def of(condition: Condition) -> _Line | None:
        both = (condition.P_source, condition.P_target)
        source, target = (cholesky(ball(exact(P))) for P in both)
        if source is None or target is None:
            return None
        try:
            right = ball(condition.right) * source.transpose().inv()
        except ZeroDivisionError:  # the balls are too wide to invert at this precision
            return None
        left = target.transpose()
        left = left if condition.left is None else left * ball(condition.left)
        F, gamma = ball(condition.F), number(condition.gamma)
        sizes = norm_bound(left * F * F), norm_bound(F)
        return _Line(condition, left, right, *sizes, gamma * gamma, identity(right.ncols()))

    def flow(self, theta: float) -> Any:
        return exp_times(self.condition.F, theta) * self.right

    def gram(self, flow: Any) -> Any:
        N = self.left * flow
        return N.transpose() * N

    def below(self, S: Any, room: Any = 0) -> bool:
        """True only if S + room I < gamma^2 I."""
        return certify_positive_definite((self.square - room) * self.unit - S)

    def margin(self, flow: Any) -> float:
        """gamma^2 - |N|^2 in floats."""
        approx = middle(self.left * flow)
        if not np.isfinite(approx).all():
            return math.nan
        return self.condition.gamma**2 - float(np.linalg.norm(approx, 2)) ** 2

    def advance(
        self, theta: float, flow: Any, margin: float, most: float
    ) -> tuple[float, Any] | None:
        """The next theta and its flow, all between them proved; None where nothing is."""
        if not margin > 0 or theta >= self.condition.high:
            return None
        bend = self.condition.gamma * float(self.curvature) * float(norm_bound(flow))
        width = min(most, math.sqrt(4 * _SHARE * margin / (bend + 1e-300)))
        for _ in range(_HALVINGS):
            following = min(math.nextafter(theta + width, -math.inf), self.condition.high)
            if not following > theta:
                return None
            there = self.flow(following)
            h = number(following) - number(theta)
            rho = h * h / 8 * self.curvature * norm_bound(flow) * (self.speed * h).exp()
            size = norm_bound(self.left * flow) + norm_bound(self.left * there)
            room = 2 * size * rho + rho * rho
            if all(self.below(self.gram(end), room) for end in (flow, there)):
                return following, there
            width /= 2
        return None


def _tail(condition: Condition, left: Any) -> Any:
    """Certified Q >= left' left that the flow never lets grow (F'Q + QF < 0), or None."""
    bound, F, n = left.transpose() * left, ball(condition.F), len(condition.F)
    weight = middle(bound) + 1e-3 * np.trace(middle(bound)) / n * np.eye(n)
    if not np.isfinite(weight).all():
        return None
    Q = lyapunov_matrix(middle(F), weight)
    if Q is None:
        return None
    scale = float(np.linalg.eigvals(np.linalg.solve(Q, weight)).real.max())
    Q_ball = ball(exact((Q + Q.T) / 2 * scale * (1 + 1e-6)))
    falling = -(F.transpose() * Q_ball + Q_ball * F)
    if certify_positive_definite(falling) and certify_positive_definite(Q_ball - bound):
        return Q_ball
    return None
