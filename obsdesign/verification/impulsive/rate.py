"""Rate of convergence of an impulsive observer, with its constant; all bounds in balls.

A `Bound` says ||e(after N more impulses)|| <= constant factor^N ||e|| for the error just before
an impulse, whatever the impulses and whatever the window held before.

Source: proof of Theorem 3.1 and Lemma 3.2 (whose proof is left out in the paper). Just before
impulse j, e = X zeta with zeta the error where the window starts; the correction takes X K C e
away, K = R^-1 Q_last', and V = zeta+' M zeta+ falls by alpha^-2 at each impulse. An error that
enters from outside is of this form only once the window has started after it: until then, at most
l corrections each add ||X_i K|| ||C|| to a bound of 1; where the moves of a window can be undone
it is of this form at once. ||X_i K|| and ||X_i zeta||/sqrt(V) are at most spread_i alpha^(l-1)
(`lmi.rank.full_rank`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass, fields

import numpy as np

from lmi.arithmetic.arrays import Entries, Matrix
from lmi.arithmetic.balls import Ball, Exact, inverse, number, precision, rational, scalar
from lmi.arithmetic.norms import nonnegative_inverse
from lmi.bounds.largest_norm import identity_like, inverse_norm_over, norm_of, norm_over
from lmi.verdict import Verdict, proved, undecided
from obsdesign.equations.impulsive.formulas import Core

_BITS = 128
# proved constants are rounded up to so many digits, with this much to spare
_DIGITS, _SPARE = 3, 1.01
# a cascade of two equal factors m is bounded by m to this power
_CASCADE = 0.875


@dataclass(frozen=True)
class Bound:
    """constant and factor of exponential convergence per impulse; balls."""

    constant: Ball
    factor: Ball

    def perturbed(self, size: Ball) -> Bound:
        """The bound when each step is off by a matrix of at most this norm."""
        return Bound(self.constant, self.factor + self.constant * size)

    def scaled(self, by: Ball) -> Bound:
        """The same with the constant multiplied."""
        return Bound(self.constant * by, self.factor)


def coupled_bound(parts: Sequence[Bound], weights: list[list[Ball]], goal: Ball | None) -> Bound:
    """Convergence bound of coupled blocks, weights[i][j] the norm of the coupling from j to i.

    x_i <= k_i f_i^N x_i(0) + sum of k_i f_i^(N-1-n) w_ij x_j(n), so that X_i = sup x_i(n)/L^n obeys
    X <= k x(0) + M X with M_ij = k_i w_ij/(L - f_i), for L above all f_i. If I - M has a
    nonnegative inverse, X is at most that inverse times k x(0). The factor is 1 if it has none.
    goal: the L to be reached, or None.
    """
    m = parts[0].factor
    for part in parts[1:]:
        m = m.max(part.factor)
    goals = [goal] if goal is not None and goal > m and goal < 1 else []
    for L in (*goals, (m.log() * rational(_CASCADE)).exp(), (1 + m) / 2):
        M = [[p.constant * w / (L - p.factor) for w in row]
             for p, row in zip(parts, weights, strict=True)]  # fmt: skip
        back = nonnegative_inverse(M)
        if back is not None:
            pairs = (pair for row in back for pair in zip(row, parts, strict=True))
            total = sum(((x * part.constant) ** 2 for x, part in pairs), scalar(0))
            return Bound(total.sqrt(), L)
    return Bound(m, scalar(1))


@dataclass(frozen=True)
class Reach:
    """Bounds over all spacings that a window's convergence is made of; balls."""

    bound: Bound
    gain: Ball


@dataclass(frozen=True)
class RankProof:
    """Numbers of the proof that the unweighted window matrix of `blocks` impulses has full rank.

    In the coordinates in which the core is given: spread, by age; largest; recalled; sigma_min, of
    the window matrix.
    """

    blocks: int
    spread: Sequence[float]
    largest: float
    recalled: float
    sigma_min: float

    @classmethod
    def from_evidence(cls, evidence: Entries) -> RankProof:
        """From the evidence of a proved claim `strongly_observable`."""
        return cls(**{one.name: evidence[one.name] for one in fields(cls)})


def window_reach(
    core: Core, ends: tuple[float, float], window: int, alpha: float, rank: RankProof
) -> Reach:
    """Bound the error and the gain's norm for a window; core: exact.

    In a window longer than that of the proof, its newest measurements bound the present state, and
    its oldest the state where it starts.
    """
    (low, high), blocks = ends, rank.blocks
    unit, a, output_norm = identity_like(core.A), number(alpha), norm_of(core.C)
    spread = [number(value) for value in rank.spread]
    present = spread[-1] * a ** (blocks - 1)
    move = norm_over(unit, core.A, core.J, low, high)
    step = move * (1 + present * output_norm)  # of an error that no window has measured
    # in a compressed window an error is measured after one impulse at the earliest
    late, out, entered, into = 0, scalar(1), scalar(1), scalar(1)
    if core.U is not None and core.S is not None:
        late, out, into = 1, norm_over(unit, core.A, core.U, low, high), norm_of(core.S)
        entered = into * (1 + present * output_norm)
    ages = range(blocks, window)
    back = _undone(core, low, high) if ages else scalar(1)
    if math.isfinite(rank.recalled) and back is not None:
        known = 1 + late
        older = sum(((output_norm * (back / a) ** age) ** 2 for age in ages), scalar(0))
        outputs = out * (number(rank.recalled) ** 2 + older).sqrt()
    else:
        known = window + late
        older = sum(((output_norm * out * move**age) ** 2 for age in ages), scalar(0))
        outputs = (number(rank.largest) ** 2 + older).sqrt()
        for j in range(1 + late, window + late):
            state = spread[min(window - j, blocks - 1)] * a ** (window - 1)
            entered = entered + into * state * output_norm * step ** (j - 1)
    settled = move * present * outputs * entered * a**known
    constant = settled.max((step * a) ** (known - 1)).max(scalar(1))
    return Reach(Bound(constant, 1 / a), norm_of(core.J) * present)


def _undone(core: Core, low: float, high: float) -> Ball | None:
    """Ball above the inverse of one spacing's move in the window; None if it may be singular."""
    if core.U is None or core.S is None:
        back = inverse(core.J)
        return None if back is None else norm_over(back, -core.A, identity_like(back), low, high)
    return inverse_norm_over(core.S, core.A, core.U, low, high)


def quadratic_bound(P: Matrix, factor: float) -> Bound:
    """From x'Px that falls by factor^2 per impulse; P symmetric positive definite floats."""
    values = np.linalg.eigvalsh(P)
    spread = float(values[-1] / values[0]) if values[0] > 0 else math.inf
    return Bound(number(1.0 + 1e-9) * number(spread).sqrt(), number(factor))


def flow_change(A: Exact, nominal: Exact, high: float) -> tuple[Ball, Ball]:
    """(sup of e^{A t} - e^{nominal t}, sup of e^{nominal t}) over [0, high]."""
    unit = identity_like(A)
    actual, other = (norm_over(unit, X, unit, 0.0, high) for X in (A, nominal))
    return norm_of(A - nominal) * number(high) * actual * other, other


@dataclass(frozen=True)
class Rate:
    """constant * per_impulse^N bounds the error N impulses later; e^(-in_time t) its decay."""

    per_impulse: float
    constant: float
    in_time: float

    @classmethod
    def from_evidence(cls, evidence: Entries) -> Rate:
        """From the evidence of a claim `rate`, or from a certificate of that form."""
        return cls(*(evidence[entry.name] for entry in fields(cls)))

    def to_evidence(self) -> dict[str, float]:
        """As it stands in the evidence of a claim."""
        return asdict(self)

    def follows_from(self, factor: float, constant: float, high: float) -> bool:
        """Whether a bound with this factor and constant shows the rate; high: longest spacing."""
        if not (factor <= self.per_impulse < 1 and constant <= self.constant < math.inf):
            return False
        return 0 < self.in_time <= -math.log(self.per_impulse) / high * (1 - 1e-12)


def certified_rate(bound: Bound, high: float, stored: Entries) -> Rate | None:
    """Return the stored rate if the bound shows it, else the bound's own, rounded up.

    None if the bound has no finite constant or no decay.
    """
    # the ball's upper end, as a float that is above it
    factor, constant = (float(x.abs_upper()) * (1 + 1e-12) for x in (bound.factor, bound.constant))
    if not (factor < 1 and math.isfinite(constant)):
        return None
    if all(isinstance(stored.get(entry.name), float) for entry in fields(Rate)):
        rate = Rate.from_evidence(stored)
        if rate.follows_from(factor, constant, high):
            return rate
    per_impulse = min(factor * (1 + 1e-9), (1 + factor) / 2)
    return Rate(
        per_impulse=per_impulse,
        constant=_rounded_up(constant * _SPARE),
        in_time=-math.log(per_impulse) / high * (1 - 1e-9),
    )


def _rounded_up(value: float) -> float:
    unit = 10.0 ** (math.floor(math.log10(value)) - _DIGITS + 1)
    return math.ceil(value / unit) * unit


def robust_to_rounding(bound: Bound, size: Ball) -> Verdict:
    """Decide whether the bound, with a perturbation of this size per step, still contracts."""
    largest = float(size.abs_upper())
    if bound.factor < 1:
        return proved(largest_change=largest, exact=False)
    reason = f"rounding moves each step by {largest:.3g}, more than the proved convergence absorbs"
    return undecided(reason, largest_change=largest, exact=False)


def in_balls() -> AbstractContextManager[None]:
    """The precision of all bounds here: a context."""
    return precision(_BITS)
