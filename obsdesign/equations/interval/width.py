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

Samples of an interval observer: the absolute values that its slope scheme is bounded by.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lmi.arithmetic.exponential import expm
from obsdesign.equations.estimation_error import jump_disturbance_matrix
from obsdesign.equations.interval.splits import (
    Array,
    absolute_metzler,
    completed_split,
    flow_and_jump,
    in_coordinates,
)

# the maps that a claim about samples is of, as its evidence names them
SAMPLED_MAPS = "|(I - L C) e^(A s)|"


@dataclass(frozen=True)
class WidthSystem:
    """W (n, n), f (n,); N, h at jumps and K, k at samples, None where there are none.

    A, G: flow and jump that samples come between, None without samples; A, K and G have signs, all
    else has none. out: |S|, what turns a width in z into one in x.
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

    def compared(self) -> WidthSystem:
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
    def of(gains: Mapping[str, Any], inverse: Callable[[Any], Any]) -> Coordinates:
        """Those of a design's `gains`; `inverse` may give None for a singular matrix."""
        S, S2 = gains.get("S"), gains.get("S2")
        return Coordinates(
            S, None if S is None else inverse(S), S2, None if S2 is None else inverse(S2)
        )

    def singular(self) -> str | None:
        """Which of the matrices has no inverse, if one has none."""
        pairs = (("S", self.S, self.S_inverse), ("S2", self.S2, self.S2_inverse))
        return next((name for name, X, Y in pairs if X is not None and Y is None), None)

    def inward(self, X: Array) -> Array:
        """S^-1 X: what enters x, as it enters z."""
        return X if self.S is None else self.S_inverse @ X


_ARRAYS = (
    "A", "C", "G", "L", "M", "D0", "D1", "Gp", "Gn", "S", "S2", "T", "noise_bound", "flow_lower",
    "flow_upper", "jump_lower", "jump_upper",
)  # fmt: skip


def width_system_of(
    gains: Mapping[str, Any],
    lift: Callable[[Any], Array] = np.asarray,
    inverse: Callable[[Any], Any] = np.linalg.inv,
) -> WidthSystem:
    """The width system of a design's `gains`; `lift` and `inverse` choose the arithmetic.

    ValueError if S or S2 is singular.
    """
    numbers = {name: lift(gains[name]) for name in _ARRAYS if name in gains}
    frame = Coordinates.of(numbers, inverse)
    if name := frame.singular():
        raise ValueError(f"{name} is singular")
    numbers |= {"jump_measurement": gains["jump_measurement"]}
    return width_system(numbers, frame, "period" in gains)


def width_system(
    numbers: Mapping[str, Any], coordinates: Coordinates, periodic: bool
) -> WidthSystem:
    """The width system of a design's `gains`, given as floats or exactly."""
    S, S_inverse = coordinates.S, coordinates.S_inverse
    n = len(numbers["A"])
    identity = np.eye(n, dtype=np.int64)
    F, H = flow_and_jump(numbers, numbers["jump_measurement"], periodic)
    F = in_coordinates(F, S, S_inverse)  # with samples as events this is A
    D0, D1 = completed_split(F, numbers["D0"], numbers["D1"])
    L, V = coordinates.inward(numbers["L"]), numbers["noise_bound"]
    noise = 2 * np.abs(L) @ V
    f = np.abs(coordinates.inward(identity)) @ (numbers["flow_upper"] - numbers["flow_lower"])
    out = identity if S is None else np.abs(S)
    N = h = None
    if H is not None:
        N, h = _jump(numbers, coordinates, H, periodic)
    if not periodic:
        return WidthSystem(D0 + D1, f + noise, N, h, None, None, out)
    K = in_coordinates(identity - numbers["L"] @ numbers["C"], S, S_inverse)
    G = None if H is None else in_coordinates(H, S, S_inverse)
    return WidthSystem(D0 + D1, f, N, h, K, noise, out, F, G)


def _jump(
    numbers: Mapping[str, Any], coordinates: Coordinates, H: Array, periodic: bool
) -> tuple[Array, Array]:
    """(N, h): by the splits of H, or by way of the second coordinates."""
    when = "none" if periodic else numbers["jump_measurement"]
    through = jump_disturbance_matrix(numbers["M"], numbers["C"], len(H), when)
    size, V = numbers["jump_upper"] - numbers["jump_lower"], numbers["noise_bound"]
    M = numbers["M"] if when != "none" else 0 * numbers["M"]
    if coordinates.S2 is None:
        H = in_coordinates(H, coordinates.S, coordinates.S_inverse)
        Gp, Gn = completed_split(H, numbers["Gp"], numbers["Gn"])
        inward = coordinates.inward
        return Gp + Gn, np.abs(inward(through)) @ size + 2 * np.abs(inward(M)) @ V
    S2, S2_inverse = coordinates.S2, coordinates.S2_inverse
    assert S2_inverse is not None
    H2, back = S2_inverse @ H @ S2, np.abs(coordinates.inward(S2))
    T = numbers["T"]
    N = back @ (T + np.abs(T - H2)) @ np.abs(S2_inverse @ coordinates.S)
    return N, back @ (np.abs(S2_inverse @ through) @ size + 2 * np.abs(S2_inverse @ M) @ V)


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
    if max(abs(np.linalg.eigvals(cycle))) >= 1:
        raise ValueError(f"the width does not settle at dwell time {dwell:g}")
    before = np.linalg.solve(identity - cycle, flow @ h + once @ f)
    after = N @ before + h
    return before, after, (once @ after + twice @ f) / dwell


def slope_scheme(
    gains: Mapping[str, Any], lift: Callable[[Any], Array], inverse: Callable[[Any], Any]
) -> tuple[Array, Array, Array, Array, Array]:
    """(|L|, |C A|, Mz(A), |C|, Delta b) in the observer's coordinates: see `runtime.interval`.

    Between two samples sig' = |C A| rho + |C| Delta b and rho' = Mz(A) rho + Delta b, and the width
    grows by |L| sig.
    """
    numbers = {name: lift(gains[name]) for name in ("A", "C", "L", "S") if name in gains}
    frame = Coordinates.of(numbers, inverse)
    A = in_coordinates(numbers["A"], frame.S, frame.S_inverse)
    C = numbers["C"] if frame.S is None else numbers["C"] @ frame.S
    size = lift(gains["flow_upper"]) - lift(gains["flow_lower"])
    inward = np.abs(frame.inward(np.eye(len(A), dtype=np.int64)))
    L = np.abs(frame.inward(numbers["L"]))
    return L, np.abs(C @ A), absolute_metzler(A), np.abs(C), inward @ size
