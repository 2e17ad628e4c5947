"""Unknown-input observers: the formulas.

    zeta' = F zeta + Gu [u; 1] + H y                        reduced state, zeta -> T x     (28)
    xhat  = X zeta + Xy y                                                                 (31)
    dhat  = Q zeta + R y + S [u; 1] + N y'                  y' is approximated      (32), (33)

Source: P. Ahn, Unknown inputs observer design via block pulse functions, Trans. Control,
Automation and Systems Engineering 4 (2002), (16)-(33); existence corrected (docs/papers.md). With
T1 = [Ta, D], (17), and T the first n - q rows of its inverse,

    N  = (C D)^+                      (19), the paper's -N3
    Z C D = 0                         (19), (20), its N1 = -E Z, rank p - q
    K  = N C Ta                       (21), its M2 + N4 A21
    X  = Ta - D K,  Xy = D N          (31)
    F  = (T A - L Z C) X              (28), where T A X = A0 of (22) and E Z C X = M1 + N2 A21
    H  = T A Xy + L Z,  Gu = T B      (28)
    Q  = -K F - A21 + A22 K           (33)
    R  = -(K H + A22 N)               (33)
    S  = -N C B                       (33)

The paper's z, its A21 row and half of its T2 cancel: M1 + N2 A21 = -N1 C Ta = E Z C Ta. The p
outputs of (22) are combinations of p - q ones: E is p x (p-q), of full column rank.

Notation
    [u; 1]   known inputs, and a constant for the middle of the bounds of b: B has m + 1 columns
    shapes   T1 (n, n), T (n-q, n), L (n-q, p-q), N (q, p), Z (p-q, p), F (n-q, n-q), H (n-q, p)
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lmi.arithmetic.arrays import Array

# C D counts as rank deficient if it shortens a direction below this part of |C| |D|
RANK_MARGIN = 1e-9
# Tustin steps of a pole f ring (their own pole is negative) beyond h |f| = 2
STEP_LIMIT = 2.0
# a direction of the reduced state counts as unobservable below this part of its terms
UNOBSERVABLE = 1e-10
# pole of the damped differentiator: -DAMPING instead of -1, late by h (1 - r)/(2 (1 + r)) = h / 6
DAMPING = 0.5
# largest part of the signals that the rounding of the stored matrices may cost the estimates
LARGEST_STEADY_STATE_ERROR = 1e-6


class PlantMatrices(NamedTuple):
    """x' = A x + B [u; 1] + D d, y = C x; floats or exact matrices."""

    A: Array
    B: Array
    C: Array
    D: Array


@dataclass(frozen=True)
class ObserverMatrices:
    """All matrices of the observer but `first`; floats or exact."""

    T1: Array
    T: Array
    N: Array
    Z: Array
    L: Array
    F: Array
    H: Array
    Gu: Array
    X: Array
    Xy: Array
    Q: Array
    R: Array
    S: Array


def scaled(C: Array, D: Array) -> tuple[Array, Array, Array]:
    """C with rows and D with columns of about unit length, so that units of y and d drop out.

    Exact: powers of two. The third value holds the exponents taken from D's columns, (q,).
    """
    of_C, of_D = exponents(C), exponents(D.T)
    return np.ldexp(C, -of_C[:, None]), np.ldexp(D, -of_D), of_D


def exponents(rows: Array) -> Array:
    """e with rows of about 2^e in length; 0 for rows of zeros. No overflow, no underflow."""
    _, largest = np.frexp(np.abs(rows).max(axis=1, initial=0.0))
    sizes = np.linalg.norm(np.ldexp(rows, -largest[:, None]), axis=1)
    return largest + np.where(sizes > 0, np.frexp(sizes)[1], 0)


def lengths(rows: Array) -> Array:
    """Return powers of two that bring rows to about unit length; 1 for rows of zeros."""
    return np.ldexp(1.0, -np.clip(exponents(rows), -1000, 1000))


def known_inputs(B: Array | None, lower: Array, upper: Array) -> Array:
    """[B, (lower + upper)/2], (n, m + 1): the input matrix of [u; 1]."""
    middle = ((lower + upper) / 2)[:, None]
    return middle if B is None else np.hstack([B, middle])


def observer_matrices(
    plant: PlantMatrices, T1: Array, T: Array, *, N: Array, Z: Array, L: Array
) -> ObserverMatrices:
    """Return the observer for coordinates T1, T, left inverse N, annihilator Z and gain L."""
    A, B, C, D = plant
    Ta = T1[:, : len(T1) - D.shape[1]]
    K = N @ C @ Ta  # (21)
    X = Ta - D @ K  # (31)
    Xy = D @ N  # (31)
    F = (T @ A - L @ Z @ C) @ X  # (28)
    H = T @ A @ Xy + L @ Z  # (28)
    # d = N (y' - C A x - C B u), and the correction -K L (Z y - Z C X zeta) that (33) carries along
    predicted_slope, innovation = N @ C @ A, K @ L @ Z
    return ObserverMatrices(
        T1=T1,
        T=T,
        N=N,
        Z=Z,
        L=L,
        F=F,
        H=H,
        Gu=T @ B,  # (28)
        X=X,
        Xy=Xy,
        Q=innovation @ C @ X - predicted_slope @ X,  # (33)
        R=-(predicted_slope @ Xy) - innovation,  # (33)
        S=-(N @ C @ B),  # (33)
    )


def conditions(plant: PlantMatrices, g: ObserverMatrices) -> dict[str, tuple[Array, Array]]:
    """Formulas by which the gains follow from the plant: name -> (residual, size).

    The residual is zero if the formula holds exactly; size, in its shape: the magnitudes of all
    that is multiplied, nothing cancelled. Works on exact matrices.
    """
    A, B, C, D = plant
    n, q = D.shape
    eye = np.eye(n, dtype=np.int64)
    terms: dict[str, list[tuple[Array, ...]]] = {
        "T T1 = [I, 0]": [(g.T, g.T1), (-eye[: n - q],)],  # (17)
        "T1 = [Ta, D]": [(g.T1[:, n - q :],), (-D,)],  # (17)
        "Z C D = 0": [(g.Z, C, D)],  # (19)
        "N C D = I": [(g.N, C, D), (-np.eye(q, dtype=np.int64),)],  # (19)
        "F = (T A - L Z C) X": [(g.F,), (-g.T, A, g.X), (g.L, g.Z, C, g.X)],  # (28)
        "T A = F T + H C": [(g.T, A), (-g.F, g.T), (-g.H, C)],  # (27), (28)
        "T D = 0": [(g.T, D)],  # (17)
        "Gu = T B": [(g.Gu,), (-g.T, B)],  # (28)
        "X T + Xy C = I": [(g.X, g.T), (g.Xy, C), (-eye,)],  # (31)
        "Q T + R C + N C A = 0": [(g.Q, g.T), (g.R, C), (g.N, C, A)],  # (33)
        "S = -N C B": [(g.S,), (g.N, C, B)],  # (33)
    }
    return {name: _residual(parts) for name, parts in terms.items()}


def _residual(parts: list[tuple[Array, ...]]) -> tuple[Array, Array]:
    """(sum of products, sum of the products of magnitudes)."""
    products = [_product(factors) for factors in parts]
    sizes = [_product(tuple(abs(X) for X in factors)) for factors in parts]
    largest = [math.prod(max(abs(X).flat, default=0) for X in factors) for factors in parts]
    # a sparse product may vanish but for rounding: its factors' largest entries are its size
    floor = max(largest) if len(parts) == 1 else 0
    return sum(products[1:], products[0]), sum(sizes[1:], sizes[0]) + floor


def _product(factors: tuple[Array, ...]) -> Array:
    result = factors[0]
    for factor in factors[1:]:
        result = result @ factor
    return result


class Drive(NamedTuple):
    """Matrices through which x, [u; 1] and d enter an equation of the error."""

    x: Array
    u: Array
    d: Array


class ErrorDrives(NamedTuple):
    """Drives of the error of zeta, and direct terms in the errors of xhat and dhat."""

    error: Drive
    state: Drive
    input: Drive


def error_drives(plant: PlantMatrices, g: ObserverMatrices) -> ErrorDrives:
    """Return what drives the errors of the stored matrices, all zero for an observer.

    e' = F e + error.x x + ...,  e = zeta - T x
    xhat - x = X e + state.x x + ...,   dhat - d = Q e + input.x x + ...
    """
    A, B, C, D = plant
    n, q = D.shape
    eye = np.eye(n, dtype=np.int64)
    slope = g.N @ C
    return ErrorDrives(
        error=Drive(x=g.F @ g.T + g.H @ C - g.T @ A, u=g.Gu - g.T @ B, d=-(g.T @ D)),
        state=Drive(x=g.X @ g.T + g.Xy @ C - eye, u=0 * B, d=0 * D),
        input=Drive(
            x=g.Q @ g.T + g.R @ C + slope @ A,
            u=g.S + slope @ B,
            d=slope @ D - np.eye(q, dtype=np.int64),
        ),
    )


# units of the rows and of the columns of every matrix: states x, reduced states w, outputs y,
# annihilated outputs z, unknown inputs d, known inputs u, and both [w, d]; time is in no unit
UNITS: Mapping[str, tuple[str, str]] = {
    "T1": ("x", "wd"), "T": ("w", "x"), "N": ("d", "y"), "Z": ("z", "y"), "L": ("w", "z"),
    "F": ("w", "w"), "H": ("w", "y"), "Gu": ("w", "u"), "X": ("x", "w"), "Xy": ("x", "y"),
    "Q": ("d", "w"), "R": ("d", "y"), "S": ("d", "u"),
    "A": ("x", "x"), "B": ("x", "u"), "C": ("y", "x"), "D": ("x", "d"),
}  # fmt: skip


def units(plant: PlantMatrices, sizes: Array, T: Array, Z: Array) -> dict[str, Array]:
    """Sizes of all signals, powers of two, where the states have the given `sizes` (n,)."""
    _, B, C, D = plant
    reduced, output = 1 / lengths(T * sizes), 1 / lengths(C * sizes)
    unknown = lengths((D / sizes[:, None]).T)
    return {
        "x": sizes,
        "w": reduced,
        "y": output,
        "d": unknown,
        "u": lengths((B / sizes[:, None]).T),
        "z": 1 / lengths(Z * output),
        "wd": np.concatenate([reduced, unknown]),
    }


def zero_dynamics(A: Array, C: Array, D: Array, N: Array) -> Array:
    """(I - D N C) A: the flow of the state while d keeps y' = 0; N a left inverse of C D.

    The invariant zeros of (A, D, C) are its unobservable modes; no gain moves them.
    """
    return A - D @ (N @ (C @ A))


def first_state(visible: Array, Z: Array, sizes: Array) -> Array:
    """The reduced state of least norm that agrees with the first y: (k, p), floats.

    visible (p - q, k): the matrix from it to Z y; sizes (p - q,): of the terms of each of its rows.
    """
    weights = 1 / np.where(sizes > 0, sizes, 1.0)
    rows = visible * weights[:, None]
    largest = float(np.linalg.norm(rows, 2)) if rows.size else 0.0
    if largest <= UNOBSERVABLE:
        return np.zeros((visible.shape[1], Z.shape[1]))
    inverse = np.linalg.pinv(rows, rcond=UNOBSERVABLE / largest)
    return np.asarray((inverse * weights) @ Z)
