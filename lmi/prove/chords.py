"""Proof for all dwell times by chords and by growing forms: the second opinion.

In coordinates where both P are the identity the condition says |N(theta)| < gamma for N(theta) =
left E(theta), E(theta) = e^{F theta} right. From a to b = a + h it is carried in one of two ways,
both by forms Q >= left' left whose value grows along the flow at most with a rate r >= 0
(`lmi.prove.tails`):

    E(a)' Q E(a) e^{2rh} < gamma^2 I                                           (1)
    max(|N(a)|, |N(b)|) + rho < gamma,  rho = h^2/8 e^{rh} |Y'QY|^(1/2)         (2)

with Y = F^2 E(a). By (1), N' N <= E' Q E <= E(a)' Q E(a) e^{2r(theta - a)}; with r = 0 it holds for
all later theta, however stiff the flow. By (2), the curvature N''(a + s) = left e^{Fs} Y is at most
e^{rs} |Y'QY|^(1/2), so that N stays within rho of its chord, and the norm along a chord is at most
that of its larger end: h grows with the root of the margin, and fast modes that have decayed do not
shorten it.

With `lmi.prove.bernstein` it shares ball arithmetic and the search for falling forms, which are
certified here again; neither coordinates nor polynomials. Floats choose steps and forms only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import (
    Ball,
    Balls,
    ball,
    certify_positive_definite,
    cholesky,
    exact,
    exp_times,
    identity,
    middle,
    norm_bound,
    number,
    precision,
    working_bits,
)
from lmi.prove.condition import Condition
from lmi.prove.hurwitz import rightmost
from lmi.prove.tails import falling_forms
from lmi.verdict import Verdict, proved, undecided

# a step leaves this share of the margin to what lies between its ends
_SHARE = 0.5
_HALVINGS = 30
# a chord may lose so much of its length to the width of balls
_COARSEST = 1e-3
# room given to a growth rate in floats before it is certified
_PAD = 1e-9


def chords(condition: Condition, steps: int) -> Verdict:
    """Proved by chords, or undecided with the theta where they ended, at the current precision."""
    if condition.others:
        return undecided("chords are for one source at a time")
    line = _Line.from_condition(condition)
    if line is None:
        return undecided("P is not certainly positive definite")
    if math.isinf(condition.high) and not line.falling:
        return undecided("the flow is not proved to be Hurwitz")
    theta, flow, least, width = condition.low, line.flow(condition.low), math.inf, math.inf
    for step in range(1, steps + 1):
        gap, margin = line.margins(flow)
        least = min(least, margin)
        done = {"method": "chords", "steps": step, "least_margin": least}
        if any(line.is_below(form.value(flow)) for form in line.falling):
            return proved(**done, tail_from=theta)
        if theta >= condition.high and line.is_below(line.gram(flow)):
            return proved(**done)
        following = line.advance(theta, flow, gap, 2 * width)
        if following is None:
            reason = f"the inequality fails, or nearly fails, at theta = {theta!r}"
            return undecided(reason, theta=theta)
        width, theta, flow = following[0] - theta, *following
    return undecided(f"{steps} steps did not reach the end", theta=theta, steps=steps)


@dataclass(frozen=True)
class _Form:
    """Q >= left' left with F'Q + QF <= 2 rate Q, certified; see `lmi.prove.tails`."""

    Q: Balls
    rate: float

    def value(self, Y: Balls) -> Balls:
        """Y' Q Y."""
        return Y.transpose() * self.Q * Y

    def growth(self, h: Ball) -> Ball:
        """e^{rate h}."""
        return (number(self.rate) * h).exp()

    def reach(self, flow: Balls, gamma: float) -> float:
        """Length over which (1) carries a form that grows, in floats."""
        value = _norm(self.value(flow))
        if not 0 < value < gamma**2 or self.rate == 0:
            return 0.0
        return math.log(gamma**2 / value) / (2 * self.rate) * (1 - 1e-6)

    def chord(self, Y: Balls, gap: float) -> float:
        """Length of a chord for which rho in (2) takes its share of the gap, in floats."""
        width = _chord_length(gap, math.sqrt(_norm(self.value(Y))))
        return min(width, 1 / self.rate) if self.rate else width


@dataclass(frozen=True)
class _Line:
    """The condition in coordinates where both P are the identity; ball matrices."""

    condition: Condition
    F: Balls
    left: Balls
    right: Balls
    forms: tuple[_Form, ...]

    @staticmethod
    def from_condition(condition: Condition) -> _Line | None:
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
        F = ball(condition.F)
        return _Line(condition, F, left, right, _forms(F, left, condition.high - condition.low))

    @property
    def falling(self) -> list[_Form]:
        return [form for form in self.forms if form.rate == 0]

    def flow(self, theta: float) -> Balls:
        with precision(2 * working_bits()):  # F^2 E cancels where fast modes have decayed
            E = exp_times(self.condition.F, theta)
        return E * self.right

    def gram(self, flow: Balls) -> Balls:
        N = self.left * flow
        return N.transpose() * N

    def is_below(self, S: Balls, rho: Ball | int = 0) -> bool:
        """Certify S < (gamma - rho)^2 I and rho < gamma."""
        room = number(self.condition.gamma) - rho
        if not room > 0:
            return False
        return certify_positive_definite(room * room * identity(S.ncols()) - S)

    def margins(self, flow: Balls) -> tuple[float, float]:
        """(gamma - |N|, gamma^2 - |N|^2) in floats."""
        gamma, square = self.condition.gamma, _norm(self.gram(flow))
        return gamma - math.sqrt(square), gamma**2 - square

    def advance(
        self, theta: float, flow: Balls, gap: float, most: float
    ) -> tuple[float, Balls] | None:
        """The next theta and its flow, all between them proved; None where nothing is."""
        if not gap > 0 or theta >= self.condition.high:
            return None
        Y, gamma = self.F * self.F * flow, self.condition.gamma
        chord = max(self.forms, key=lambda form: form.chord(Y, gap))
        carrier = max(self.forms, key=lambda form: form.reach(flow, gamma))
        width, reach = chord.chord(Y, gap), carrier.reach(flow, gamma)
        following = self._end(theta, reach)
        if reach > width and following > theta:
            h = number(following) - number(theta)
            if self.is_below(carrier.value(flow) * carrier.growth(2 * h)):  # (1)
                return following, self.flow(following)
        bend = norm_bound(chord.value(Y)).sqrt()
        if _chord_length(gap, float(bend)) < _COARSEST * min(width, self.condition.high - theta):
            return None  # the balls are too wide at this precision
        return self._chord(theta, flow, chord, bend, min(width, most))

    def _chord(
        self, theta: float, flow: Balls, form: _Form, bend: Ball, width: float
    ) -> tuple[float, Balls] | None:
        """The end of a chord from theta that is proved, and its flow."""
        for _ in range(_HALVINGS):
            following = self._end(theta, width)
            if not following > theta:
                return None
            h, there = number(following) - number(theta), self.flow(following)
            rho = h * h / 8 * form.growth(h) * bend
            if all(self.is_below(self.gram(end), rho) for end in (flow, there)):  # (2)
                return following, there
            width /= 2
        return None

    def _end(self, theta: float, width: float) -> float:
        return min(math.nextafter(theta + width, -math.inf), self.condition.high)


def _forms(F: Balls, left: Balls, length: float) -> tuple[_Form, ...]:
    """Forms that fall, where the flow decays, and forms that grow slowly; one always.

    They are sought in coordinates where left' left is the identity, or near it if it is singular.
    """
    n, size = F.ncols(), math.nextafter(float(norm_bound(F).upper()), math.inf)
    forms = [_Form(norm_bound(left) ** 2 * identity(n), size)]  # |e^{Fs}| <= e^{|F|s}
    bound = left.transpose() * left
    try:
        T = ball(exact(_root(middle(bound), left.nrows() == n)))
        back = T.inv()
    except (np.linalg.LinAlgError, ValueError, ZeroDivisionError):  # not finite, or singular
        return tuple(forms)
    turned, bound = T * F * back, back.transpose() * bound * back
    approx = middle(turned)
    if not np.isfinite(approx).all():
        return tuple(forms)
    abscissa = rightmost(approx).real
    rates = [_log_norm(approx)]
    if abscissa < 0:
        rates.append(0.0)
    if 0 < length < math.inf:  # growth by e at most over the whole range, beside the flow's own
        rates.append(max(abscissa, 0.0) + 1 / length)
    for rate in rates:
        if 0 <= rate < math.inf:
            shifted = turned - number(rate) * identity(n)
            forms += [_Form(T.transpose() * Q * T, rate) for Q in falling_forms(shifted, bound)]
    return tuple(forms)


def _chord_length(gap: float, bend: float) -> float:
    """Length of a chord for which rho in (2) takes its share of the gap, but for e^{rh}."""
    return math.sqrt(8 * _SHARE * gap / (bend + 1e-300))


def _root(S: Matrix, regular: bool) -> Matrix:
    """Upper triangular T with T' T = S, or near S where S is singular; floats."""
    lift = 0.0 if regular else 1e-3 * float(np.trace(S)) / len(S)
    return np.asarray(np.linalg.cholesky(S + lift * np.eye(len(S))).T, dtype=np.float64)


def _log_norm(F: Matrix) -> float:
    """A little more than the largest rate of growth of |x| under x' = F x, in floats."""
    rate = float(np.linalg.eigvalsh((F + F.T) / 2)[-1])
    return rate + _PAD * max(abs(rate), 1e-3 * float(np.abs(F).max()), 1e-12)


def _norm(S: Balls) -> float:
    """Norm of a symmetric ball matrix in floats; infinite where it is not finite."""
    approx = middle(S)
    return float(np.linalg.norm(approx, 2)) if np.isfinite(approx).all() else math.inf
