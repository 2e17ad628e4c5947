"""How fast an impulsive observer converges, with its constant; all bounds in balls.

A `Bound` says ||e(after N more impulses)|| <= constant factor^N ||e|| for the error just before
an impulse, whatever the impulses and whatever the window held before.

Source: proof of Theorem 3.1 and Lemma 3.2 (whose proof is left out in the paper). Just before
impulse j, e = X zeta with zeta the error where the window starts; the correction takes X K C e
away, K = R^-1 Q_last', and V = zeta+' M zeta+ falls by alpha^-2 at each impulse. An error that
comes from nowhere is of this form only once the window has started after it: until then, at most
l corrections each add ||X_i K|| ||C|| to a bound of 1; where the moves of a window can be undone
it is of this form at once. ||X_i K|| and ||X_i zeta||/sqrt(V) are at most spread_i alpha^(l-1)
(`lmi.rank.full_rank`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lmi.arithmetic.balls import Exact, inverse, number, precision, rational, scalar
from lmi.arithmetic.norms import nonnegative_inverse
from lmi.bounds.largest_norm import identity_like, inverse_norm_over, norm_of, norm_over
from lmi.verdict import Verdict, proved, undecided
from obsdesign.equations.impulsive.gains import Core

_BITS = 128
# numbers that are promised are rounded up to so many digits, with this much to spare
_DIGITS, _SPARE = 3, 1.01
# a cascade of two equal factors m is bounded by m to this power
_CASCADE = 0.875


@dataclass(frozen=True)
class Bound:
    """constant and factor of exponential convergence per impulse; balls."""

    constant: Any
    factor: Any

    def perturbed(self, size: Any) -> Bound:
        """What is left when each step is off by a matrix of at most this norm."""
        return Bound(self.constant, self.factor + self.constant * size)

    def scaled(self, by: Any) -> Bound:
        """The same with the constant multiplied."""
        return Bound(self.constant * by, self.factor)


def together(parts: Sequence[Bound], weights: list[list[Any]], goal: Any) -> Bound:
    """Blocks that influence each other, weights[i][j] the norm of what j brings to i per step.

    x_i <= k_i f_i^N x_i(0) + sum of k_i f_i^(N-1-n) w_ij x_j(n), so that X_i = sup x_i(n)/L^n obeys
    X <= k x(0) + M X with M_ij = k_i w_ij/(L - f_i), for L above all f_i. If I - M has a
    nonnegative inverse, X is at most that inverse times k x(0). A factor of 1 says that it has not.
    goal: an L that is wanted, or None.
    """
    m = parts[0].factor
    for part in parts[1:]:
        m = m.max(part.factor)
    tried = [goal] if goal is not None and goal > m and goal < 1 else []
    for L in (*tried, (m.log() * rational(_CASCADE)).exp(), (1 + m) / 2):
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
    gain: Any


def window_reach(
    core: Core, low: float, high: float, window: int, alpha: float, evidence: Mapping[str, Any]
) -> Reach:
    """Bound of the error and of the gain's norm for a window; core: exact.

    evidence: of the proof that a window matrix of "blocks" impulses, unweighted, has full rank, in
    coordinates in which the core is given: "spread", "largest", "recalled". In a longer window
    its newest measurements bound the present state, and its oldest the state where it starts.
    """
    unit, a, seen = identity_like(core.A), number(alpha), norm_of(core.C)
    spread, blocks = [number(value) for value in evidence["spread"]], int(evidence["blocks"])
    present = spread[-1] * a ** (blocks - 1)
    move = norm_over(unit, core.A, core.J, low, high)
    step = move * (1 + present * seen)  # of an error that no window knows
    # in a compressed window an error is known after one impulse at the earliest
    late, out, entered, into = 0, scalar(1), scalar(1), scalar(1)
    if core.U is not None and core.S is not None:
        late, out, into = 1, norm_over(unit, core.A, core.U, low, high), norm_of(core.S)
        entered = into * (1 + present * seen)
    ages = range(blocks, window)
    back = _undone(core, low, high) if ages else scalar(1)
    if math.isfinite(evidence["recalled"]) and back is not None:
        known = 1 + late
        older = sum(((seen * (back / a) ** age) ** 2 for age in ages), scalar(0))
        outputs = out * (number(evidence["recalled"]) ** 2 + older).sqrt()
    else:
        known = window + late
        older = sum(((seen * out * move**age) ** 2 for age in ages), scalar(0))
        outputs = (number(evidence["largest"]) ** 2 + older).sqrt()
        for j in range(1 + late, window + late):
            state = spread[min(window - j, blocks - 1)] * a ** (window - 1)
            entered = entered + into * state * seen * step ** (j - 1)
    settled = move * present * outputs * entered * a**known
    constant = settled.max((step * a) ** (known - 1)).max(scalar(1))
    return Reach(Bound(constant, 1 / a), norm_of(core.J) * present)


def _undone(core: Core, low: float, high: float) -> Any:
    """Ball above the inverse of one spacing's move in the window; None if it may be singular."""
    if core.U is None or core.S is None:
        back = inverse(core.J)
        return None if back is None else norm_over(back, -core.A, identity_like(back), low, high)
    return inverse_norm_over(core.S, core.A, core.U, low, high)


def quadratic_bound(P: Any, factor: float) -> Bound:
    """From x'Px that falls by factor^2 per impulse; P symmetric positive definite floats."""
    values = np.linalg.eigvalsh(P)
    spread = float(values[-1] / values[0]) if values[0] > 0 else math.inf
    return Bound(number(1.0 + 1e-9) * number(spread).sqrt(), number(factor))


def flow_change(A: Exact, nominal: Exact, high: float) -> tuple[Any, Any, Any]:
    """(sup of e^{A t} - e^{nominal t}, sup of e^{A t}, of e^{nominal t}) over [0, high]."""
    unit = identity_like(A)
    actual, other = (norm_over(unit, X, unit, 0.0, high) for X in (A, nominal))
    return norm_of(A - nominal) * number(high) * actual * other, actual, other


def promised(bound: Bound, high: float, stored: Mapping[str, Any]) -> dict[str, float] | None:
    """The numbers that stand in a design: those stored if they are true, else rounded up anew.

    None when the bound says nothing (no finite constant, or no decay).
    """
    # the ball's upper end, as a float that is above it
    factor, constant = (float(x.abs_upper()) * (1 + 1e-12) for x in (bound.factor, bound.constant))
    if not (factor < 1 and math.isfinite(constant)):
        return None
    old = [stored.get(name) for name in ("per_impulse", "constant", "in_time")]
    if all(isinstance(x, float) for x in old):
        kept = dict(
            zip(("per_impulse", "constant", "in_time"), [float(x or 0.0) for x in old], strict=True)
        )
        if _true(kept, factor, constant, high):
            return kept
    per_impulse = min(factor * (1 + 1e-9), (1 + factor) / 2)
    return {
        "per_impulse": per_impulse,
        "constant": _rounded_up(constant * _SPARE),
        "in_time": -math.log(per_impulse) / high * (1 - 1e-9),
    }


def _true(kept: Mapping[str, float], factor: float, constant: float, high: float) -> bool:
    per_impulse = kept["per_impulse"]
    if not (factor <= per_impulse < 1 and constant <= kept["constant"] < math.inf):
        return False
    return 0 < kept["in_time"] <= -math.log(per_impulse) / high * (1 - 1e-12)


def _rounded_up(value: float) -> float:
    unit = 10.0 ** (math.floor(math.log10(value)) - _DIGITS + 1)
    return math.ceil(value / unit) * unit


def absorbed(bound: Bound, size: Any) -> Verdict:
    """Is convergence proved although every step is off by so much, which the bound includes?"""
    told = {"largest_change": float(size.abs_upper()), "exact": False}
    if bound.factor < 1:
        return proved(**told)
    reason = (
        f"rounding moves each step by {told['largest_change']:.3g}, more than the proved "
        "convergence absorbs"
    )
    return undecided(reason, **told)


def in_balls() -> Any:
    """The precision that all bounds here are worked out at: a context."""
    return precision(_BITS)
