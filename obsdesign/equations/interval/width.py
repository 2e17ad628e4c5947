"""The width of an interval observer's bounds: a positive system with inputs.

    w' = W w + f            between events
    w+ = N w- + h           at jumps

for the width w = upper - lower in the coordinates z of x = S z; that of x is at most |S| w. Where
samples are events (`measured = periodic`), the flow over a step and the sample at its end are one
map, of which the absolute value is taken (`lmi.arithmetic.exponential.absolute_flow`):

    w+ = |e^(A s)| w + what f adds            without a sample
    w+ = |K e^(A s)| w + what f adds + k      with one at the end, K = I - L C
    w+ = |G e^(A s)| w + what f adds + h      with a jump at the end

Source: Degue, Efimov, Richard, NOLCOS 2016, Theorems 5, 7, 8; the pair (W, N) is what (10) comes to
after adding and subtracting the two error vectors. Theorem 7 needs |S^-1 S2| T |S2^-1 S| for N: the
printed condition (8) has T alone, which bounds nothing (docs/papers.md).

`slope_scheme` has the absolute values that bound the slope scheme of a continuous y.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from lmi.arithmetic.arrays import Array
from lmi.arithmetic.exponential import expm
from lmi.arithmetic.spectrum import spectral_radius
from obsdesign.equations.estimation_error import jump_disturbance_matrix
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.equations.interval.splits import (
    absolute_metzler,
    completed_split,
    flow_and_jump,
    in_coordinates,
)

# maps that a claim about samples is of, as its evidence names them
SAMPLED_MAPS = "|(I - L C) e^(A s)|"


@dataclass(frozen=True)
class WidthSystem:
    """W (n, n), f (n,); N, h at jumps and K, k at samples, None where there are none.

    A, G: flow and jump that samples come between, None without samples; A, K and G have signs, all
    else has none. out: |S|, which bounds a width in x by one in z.
    """

    W: Array
    f: Array
    N: Array | None
    h: Array | None
    K: Array | None
    k: Array | None
    out: Array
    A: Array | None = None
    G: Array | None = None

    @staticmethod
    def from_gains(
        gains: IntervalGains,
        lift: Callable[[Array], Array] = np.asarray,
        inverse: Callable[[Array], Array | None] = np.linalg.inv,
    ) -> WidthSystem:
        """The width system of a design; `lift` and `inverse` choose the arithmetic.

        ValueError if S or S2 is singular.
        """
        frame = Coordinates.from_matrices(gains.S, gains.S2, inverse, lift)
        if name := frame.singular_matrix():
            raise ValueError(f"{name} is singular")
        F, H = error_matrices(gains, lift)
        F_z = frame.similar(F)  # with samples as events this is A
        D0, D1 = completed_split(F_z, lift(gains.D0), lift(gains.D1))
        L = lift(gains.L)
        noise = 2 * np.abs(frame.inward(L)) @ lift(gains.noise_bound)
        identity = np.eye(gains.n, dtype=np.int64)
        f = _disturbance_width(gains, frame, lift)
        out = identity if frame.S is None else np.abs(frame.S)
        N, h = (None, None) if H is None else _jump_width(gains, frame, H, lift)
        if not gains.is_periodic:
            return WidthSystem(W=D0 + D1, f=f + noise, N=N, h=h, K=None, k=None, out=out)
        K = frame.similar(identity - L @ lift(gains.C))
        G = None if H is None else frame.similar(H)
        return WidthSystem(W=D0 + D1, f=f, N=N, h=h, K=K, k=noise, out=out, A=F_z, G=G)

    def comparison(self) -> WidthSystem:
        """With |K| e^(W s) in place of |K e^(A s)|, and likewise at jumps: a wider system."""
        assert self.K is not None
        return replace(self, A=self.W, K=np.abs(self.K), G=self.N)

    @property
    def at_jumps(self) -> tuple[Array, Array]:
        """(N, h) of a plant with jumps."""
        assert self.N is not None
        assert self.h is not None
        return self.N, self.h

    @property
    def at_samples(self) -> tuple[Array, Array]:
        """(K, k) where samples are events."""
        assert self.K is not None
        assert self.k is not None
        return self.K, self.k


@dataclass(frozen=True)
class Coordinates:
    """x = S z and, at jumps, x = S2 z2; S None: the plant's own. Arrays exact or float."""

    S: Array | None
    S_inverse: Array | None
    S2: Array | None
    S2_inverse: Array | None

    @staticmethod
    def from_matrices(
        S: Array | None,
        S2: Array | None,
        inverse: Callable[[Array], Array | None],
        lift: Callable[[Array], Array] = np.asarray,
    ) -> Coordinates:
        """Coordinates of S and S2, None where there is none.

        inverse: may give None for a singular matrix; lift: chooses the arithmetic.
        """
        S, S2 = (None if X is None else lift(X) for X in (S, S2))
        S_inverse, S2_inverse = (None if X is None else inverse(X) for X in (S, S2))
        return Coordinates(S, S_inverse, S2, S2_inverse)

    def singular_matrix(self) -> str | None:
        """Name of a matrix without an inverse, None if both have one."""
        pairs = (("S", self.S, self.S_inverse), ("S2", self.S2, self.S2_inverse))
        return next((name for name, X, Y in pairs if X is not None and Y is None), None)

    def inward(self, X: Array) -> Array:
        """S^-1 X: an input of x as one of z."""
        return X if self.S is None else self.S_inverse @ X

    def similar(self, X: Array) -> Array:
        """S^-1 X S: a map of x as one of z."""
        return in_coordinates(X, self.S, self.S_inverse)


def error_matrices(
    gains: IntervalGains, lift: Callable[[Array], Array] = np.asarray
) -> tuple[Array, Array | None]:
    """(F, H) that the splits of a design are of, in x: `splits.flow_and_jump`."""
    return flow_and_jump(
        lift(gains.A), lift(gains.C), None if gains.G is None else lift(gains.G),
        L=lift(gains.L), M=lift(gains.M), jump_measurement=gains.jump_measurement,
        is_periodic=gains.is_periodic,
    )  # fmt: skip


def _jump_width(
    gains: IntervalGains, frame: Coordinates, H: Array, lift: Callable[[Array], Array]
) -> tuple[Array, Array]:
    """(N, h): by the splits of H, or by way of the second coordinates."""
    when = "none" if gains.is_periodic else gains.jump_measurement
    M, C, V = lift(gains.M), lift(gains.C), lift(gains.noise_bound)
    through = jump_disturbance_matrix(M, C, len(H), when)
    columns, c_lower, c_upper = gains.jump_disturbance
    through = through @ lift(columns)
    c_width = lift(c_upper) - lift(c_lower)
    M = M if when != "none" else 0 * M
    if frame.S2 is None:
        Gp, Gn = (lift(half) for half in gains.jump_split)
        Gp, Gn = completed_split(frame.similar(H), Gp, Gn)
        inward = frame.inward
        return Gp + Gn, np.abs(inward(through)) @ c_width + 2 * np.abs(inward(M)) @ V
    S2, S2_inverse, T = frame.S2, frame.S2_inverse, gains.T
    assert S2_inverse is not None
    assert T is not None
    H2, back = S2_inverse @ H @ S2, np.abs(frame.inward(S2))
    # (8) with |S^-1 S2| T |S2^-1 S| in place of T
    T = lift(T)
    N = back @ (T + np.abs(T - H2)) @ np.abs(S2_inverse @ frame.S)
    return N, back @ (np.abs(S2_inverse @ through) @ c_width + 2 * np.abs(S2_inverse @ M) @ V)


def _disturbance_width(
    gains: IntervalGains, frame: Coordinates, lift: Callable[[Array], Array]
) -> Array:
    """f = |S^-1 Bw| (w_upper - w_lower), Bw = I where the bounds are those of b."""
    columns, lower, upper = gains.declared_disturbance
    return np.asarray(np.abs(frame.inward(lift(columns))) @ (lift(upper) - lift(lower)))


def periodic_width(
    W: Array, N: Array, f: Array, h: Array, dwell: float
) -> tuple[Array, Array, Array]:
    """Width that constant dwell times lead to: just before a jump, just after it, on average.

    w' = W w + f between jumps, w+ = N w- + h at them; shapes (n,). Its limit exists when the
    spectral radius of e^{W dwell} N is below 1; ValueError otherwise.
    """
    n = len(W)
    identity, zero = np.eye(n), np.zeros((n, n))
    blocks = np.block([[W, identity, zero], [zero, zero, identity], [zero, zero, zero]])
    flow, once, twice = np.hsplit(expm(blocks * dwell)[:n], 3)
    cycle = flow @ N
    if not spectral_radius(cycle) < 1:
        raise ValueError(f"the width does not settle at dwell time {dwell:g}")
    before = np.linalg.solve(identity - cycle, flow @ h + once @ f)
    after = N @ before + h
    return before, after, (once @ after + twice @ f) / dwell


def slope_scheme(
    gains: IntervalGains, lift: Callable[[Array], Array], inverse: Callable[[Array], Array | None]
) -> tuple[Array, Array, Array, Array, Array]:
    """(|L|, |C A|, Mz(A), |C|, f) in the observer's coordinates.

    Between two samples (derivation in `runtime.interval.maps`) sig' = |C A| rho + |C| f and
    rho' = Mz(A) rho + f, and the width grows by |L| sig.
    """
    frame = Coordinates.from_matrices(gains.S, None, inverse, lift)
    A, C = frame.similar(lift(gains.A)), lift(gains.C)
    C = C if frame.S is None else C @ frame.S
    f = _disturbance_width(gains, frame, lift)
    L = np.abs(frame.inward(lift(gains.L)))
    return L, np.abs(C @ A), absolute_metzler(A), np.abs(C), f
