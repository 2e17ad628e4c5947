"""Known inputs in observer (14) as it is printed: exact quadrature, also between samples.

    xhat = M_T^{-1} (e^{-A T} D - e^{-F T} T~),   D = sum_j A_d^(k-1-j) d_j,
    T~ = sum_j e^{F (k-1-j) nu} tau_j,   tau_j = Gam_F (-L y_j) + c_j

d_j and c_j are what the known input delta does in period j: with q' = e^{-A s} delta, q(0) = 0,

    d' = A d + delta,   c' = F c - L C q + delta                over one period, from zero.

(16) and the integrals of (14): F. Mazenc, S. Ahmed, MICNON 2018; the inner integral of (14) runs
backwards and is negative.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.exponential import expm, flow_integrals
from obsdesign.equations.finite_time.formulas import difference_block
from obsdesign.equations.finite_time.gains import FiniteTimeGains
from obsdesign.runtime.finite_time.flow_maps import FlowMaps
from obsdesign.runtime.finite_time.tape import Tape, extend
from obsdesign.runtime.state_marks import Axes, States
from obsdesign.runtime.step_cache import cached_step


@dataclass(frozen=True, slots=True)
class KnownInput:
    """Effect (d, c, q) of the known input in the open period, its age, and the closed periods.

    tape, end: where the closed periods may grow.
    """

    d: States
    c: States
    q: States
    age: float
    closed: Annotated[Matrix, Axes("2nk")]
    tape: Tape | None = None
    end: int = 0

    @classmethod
    def zero(cls, n: int, k: int) -> KnownInput:
        """No input in any period."""
        zero = np.zeros(n)
        return cls(zero, zero, zero, 0.0, np.zeros(2 * n * k))

    def opened(self) -> KnownInput:
        """At the start of a period."""
        zero = np.zeros(len(self.d))
        return replace(self, d=zero, c=zero, q=zero, age=0.0)


@dataclass(frozen=True)
class ApproximateInputs:
    """Weights (n, 2 n k) of the closed periods' (d_j, c_j), and the generator of a period.

    per_period (2 n, n): (d, c) of a period in which the input does not change.
    """

    weights: Matrix
    per_period: Matrix
    A: Matrix
    generator: Matrix
    _steps: OrderedDict[float, Matrix] = field(
        default_factory=OrderedDict, repr=False, compare=False
    )

    @classmethod
    def from_gains(cls, gains: FiniteTimeGains) -> ApproximateInputs:
        """From A, C, L, period and samples of a design."""
        A, n, period = gains.A, gains.n, gains.period
        LC = gains.injection @ gains.C
        zero, unit = np.zeros((n, n)), np.eye(n)
        generator = np.block([
            [A + LC, -LC, zero, unit], [zero, zero, unit, zero],
            [zero, zero, -A, zero], [zero, zero, zero, zero],
        ])  # fmt: skip
        over = expm(generator * period)
        once = flow_integrals(A, period)[1]
        per_period = np.vstack([once, over[:n, 2 * n : 3 * n] + over[:n, 3 * n :]])
        return cls(np.ascontiguousarray(_weights(gains, LC)), per_period, A, generator)

    def advanced(self, known: KnownInput, forced: Matrix, h: float, maps: FlowMaps) -> KnownInput:
        """The open period, h later, with the known input `forced` held."""
        if not (np.any(forced) or np.any(known.d) or np.any(known.c) or np.any(known.q)):
            return replace(known, age=known.age + h)
        n = len(forced)
        aged = expm(-self.A * known.age) @ forced if known.age else forced
        whole = cached_step(self._steps, h, lambda step: expm(self.generator * step))
        c_and_q = whole[: 2 * n] @ np.concatenate([known.c, known.q, aged, forced])
        d = maps.flow @ known.d + maps.once @ forced
        return replace(known, d=d, c=c_and_q[:n], q=c_and_q[n:], age=known.age + h)

    def closed(self, known: KnownInput) -> KnownInput:
        """At the end of a period: it takes its place among the closed ones."""
        n = len(known.d)
        closed = np.concatenate([known.closed[2 * n :], known.d, known.c])
        return replace(known, closed=closed, tape=None)

    def advanced_by_period(self, known: KnownInput, driven: Matrix) -> KnownInput:
        """From one instant to the next; driven: (d, c) of the whole period (`per_period`)."""
        closed, tape, end = extend(known.tape, known.end, known.closed, driven)
        return KnownInput(known.d, known.c, known.q, 0.0, closed, tape, end)

    def known_part(self, known: KnownInput) -> Matrix:
        """M_T^{-1} (e^{-A T} D - e^{-F T} sum_j e^{F (k-1-j) nu} c_j)."""
        return np.asarray(self.weights @ known.closed)


def _weights(gains: FiniteTimeGains, LC: Matrix) -> Matrix:
    """M_T^{-1} times (e^{-A (j+1) nu}, -e^{-F (j+1) nu}), j = 0..k-1, (n, 2 n k)."""
    A, n, period = gains.A, gains.n, gains.period
    scale = max(float(np.abs(LC).max()), 1e-300)
    block = difference_block(A, LC)
    block[:n, n:] /= scale
    whole = expm(block * gains.window)
    back_F, back_A = expm(-(A + LC) * period), expm(-A * period)
    terms = []
    power_F, power_A = back_F, back_A
    for _ in range(gains.samples):
        terms += [power_A, -power_F]
        power_F, power_A = power_F @ back_F, power_A @ back_A
    return np.asarray(np.linalg.solve(whole[:n, n:], np.hstack(terms)) / scale)
