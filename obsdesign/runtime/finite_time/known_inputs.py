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
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from lmi.arithmetic.exponential import expm, flow_integrals
from obsdesign.equations.finite_time import gains as equations
from obsdesign.runtime.base import Vector
from obsdesign.runtime.finite_time.tape import Tape
from obsdesign.runtime.step_cache import cached_step


@dataclass(frozen=True, slots=True)
class Known:
    """What the known input did: (d, c, q) of the open period, its age, and closed periods.

    tape, end: where the closed periods may grow.
    """

    d: Vector
    c: Vector
    q: Vector
    age: float
    closed: Vector
    tape: Tape | None = None
    end: int = 0

    @staticmethod
    def zero(n: int, k: int) -> Known:
        """No period yet."""
        zero = np.zeros(n)
        return Known(zero, zero, zero, 0.0, np.zeros(2 * n * k))

    def opened(self) -> Known:
        """At the start of a period."""
        zero = np.zeros(len(self.d))
        return replace(self, d=zero, c=zero, q=zero, age=0.0)


@dataclass(frozen=True)
class ApproximateInputs:
    """Weights (n, 2 n k) of the closed periods' (d_j, c_j), and the generator of a period.

    of_period (2 n, n): (d, c) of a period in which the input does not change.
    """

    weights: Vector
    of_period: Vector
    A: Vector
    generator: Vector
    _steps: OrderedDict[float, Any] = field(default_factory=OrderedDict, repr=False, compare=False)

    @classmethod
    def of(cls, gains: Mapping[str, Any]) -> ApproximateInputs:
        """From A, C, L, period and samples of a design."""
        A, C, L = gains["A"], gains["C"], gains["L"]
        n, k, period = len(A), int(gains["samples"]), float(gains["period"])
        LC = L @ C
        scale = max(float(np.abs(LC).max()), 1e-300)
        block = equations.difference_block(A, LC)
        block[:n, n:] /= scale
        whole = expm(block * (k * period))
        back_F, back_A = expm(-(A + LC) * period), expm(-A * period)
        terms = []
        power_F, power_A = back_F, back_A
        for _ in range(k):
            terms += [power_A, -power_F]
            power_F, power_A = power_F @ back_F, power_A @ back_A
        weights = np.linalg.solve(whole[:n, n:], np.hstack(terms)) / scale
        zero, unit = np.zeros((n, n)), np.eye(n)
        generator = np.block([
            [A + LC, -LC, zero, unit], [zero, zero, unit, zero],
            [zero, zero, -A, zero], [zero, zero, zero, zero],
        ])  # fmt: skip
        over = expm(generator * period)
        once = flow_integrals(A, period)[1]
        of_period = np.vstack([once, over[:n, 2 * n : 3 * n] + over[:n, 3 * n :]])
        return cls(np.ascontiguousarray(weights), of_period, A, generator)

    def moved(self, known: Known, forced: Vector, h: float, maps: Any) -> Known:
        """The open period, h later, with the known input `forced` held."""
        if not (np.any(forced) or np.any(known.d) or np.any(known.c) or np.any(known.q)):
            return replace(known, age=known.age + h)
        n = len(forced)
        aged = expm(-self.A * known.age) @ forced if known.age else forced
        whole = cached_step(self._steps, h, lambda step: expm(self.generator * step))
        moved = whole[: 2 * n] @ np.concatenate([known.c, known.q, aged, forced])
        d = maps.flow @ known.d + maps.once @ forced
        return replace(known, d=d, c=moved[:n], q=moved[n:], age=known.age + h)

    def closed(self, known: Known) -> Known:
        """At the end of a period: it takes its place among the closed ones."""
        n = len(known.d)
        closed = np.concatenate([known.closed[2 * n :], known.d, known.c])
        return replace(known, closed=closed, tape=None)

    def passed(self, known: Known, driven: Vector) -> Known:
        """From one instant to the next: `driven` is (d, c) of the whole period (`of_period`)."""
        size, tape, end = len(known.closed), known.tape, known.end
        closed = None if tape is None else tape.after(end, driven, size)
        if closed is None:
            tape, end = Tape(known.closed, len(driven)), size
            closed = tape.after(size, driven, size)
        assert closed is not None
        return Known(known.d, known.c, known.q, 0.0, closed, tape, end + len(driven))

    def known_part(self, known: Known) -> Vector:
        """M_T^{-1} (e^{-A T} D - e^{-F T} sum_j e^{F (k-1-j) nu} c_j)."""
        return np.asarray(self.weights @ known.closed)
