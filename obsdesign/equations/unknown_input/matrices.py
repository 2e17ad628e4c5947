"""Unknown-input observers: the formulas.

    zeta' = F zeta + Gu [u; 1] + H y                        reduced state, zeta -> T x
    xhat  = X zeta + Xy y
    dhat  = Q zeta + R y + S [u; 1] + N y'                  y': see `equations.block_pulse`

Source: P. Ahn, Unknown inputs observer design via block pulse functions, Trans. Control,
Automation and Systems Engineering 4 (2002), (16)-(33); existence corrected (docs/papers.md). With
T1 = [Ta, D] and T the first n - q rows of its inverse,

    N = (C D)^+ (the paper's -N3),  Z C D = 0 (its N1),  K = N C Ta (its M2 + N4 A21)
    X = Ta - D K,  Xy = D N,  F = (T A - L Z C) X,  H = T A Xy + L Z,  Gu = T B
    Q = -K F - A21 + A22 K,  R = -(K H + A22 N),  S = -N C B

The paper's z, its A21 row and half of its T2 cancel: M1 + N2 A21 = Z C Ta.

Notation
    [u; 1]   known inputs, and a constant for the middle of the bounds of b: B has m + 1 columns
    shapes   T1 (n, n), T (n-q, n), L (n-q, p-q), N (q, p), Z (p-q, p), F (n-q, n-q), H (n-q, p)
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]  # float64, or object arrays of exact rationals

# C D counts as rank deficient when it shortens a direction to less than this part of |C| |D|
RANK_MARGIN = 1e-9
# Tustin steps of a pole f ring (their own pole is negative) beyond h |f| = 2
STEP_LIMIT = 2.0
# a direction of the reduced state counts as unseen when it shows by less than this part
UNSEEN = 1e-10
# pole of the damped differentiator: -DAMPING instead of -1, late by h (1 - r)/(2 (1 + r)) = h / 6
DAMPING = 0.5
DIFFERENTIATORS = ("cell", "damped", "batch", "fixed_lag")
# they smooth to the noise, so that its deviation is required
SMOOTHING = ("batch", "fixed_lag")
# samples that `fixed_lag` waits for: with windows of three lags about as good as `batch`
LAG = 10


def objection(plant: Any) -> str | None:
    """Why the observer cannot serve a plant at all, or None; one sentence."""
    if plant.jump is not None:
        return (
            "[jump] must be absent for kind 'unknown_input': its equations hold between jumps "
            "only. Drop [jump], or choose kind luenberger and bound d as flow.disturbance."
        )
    return None


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
    """Powers of two that bring rows to about unit length; 1 for rows of zeros."""
    return np.ldexp(1.0, -np.clip(exponents(rows), -1000, 1000))


def inputs(B: Array | None, lower: Array, upper: Array) -> Array:
    """[B, (lower + upper)/2], (n, m + 1): what is known to drive the state."""
    middle = ((lower + upper) / 2)[:, None]
    return middle if B is None else np.hstack([B, middle])


def matrices(
    plant: tuple[Array, Array, Array, Array], T1: Array, T: Array, N: Array, Z: Array, L: Array
) -> dict[str, Array]:
    """F, H, Gu, X, Xy, Q, R, S of (A, B, C, D) by the formulas above, B as from `inputs`."""
    A, B, C, D = plant
    Ta = T1[:, : len(T1) - D.shape[1]]
    K = N @ C @ Ta
    X, Xy = Ta - D @ K, D @ N
    F, H = (T @ A - L @ Z @ C) @ X, T @ A @ Xy + L @ Z
    # d = N (y' - C A x - C B u), and the correction -K L (Z y - Z C X zeta) that (33) carries along
    seen, innovation = N @ C @ A, K @ L @ Z
    return {
        "F": F, "H": H, "Gu": T @ B, "X": X, "Xy": Xy,
        "Q": innovation @ C @ X - seen @ X, "R": -(seen @ Xy) - innovation, "S": -(N @ C @ B),
    }  # fmt: skip


def conditions(plant: tuple[Array, Array, Array, Array], g: Mapping[str, Array]) -> dict[str, Any]:
    """By what the gains follow from the plant: name -> (residual, size).

    The residual is zero if the formula holds exactly; size, in its shape: the magnitudes of all
    that is multiplied, nothing cancelled. Works on exact matrices.
    """
    A, B, C, D = plant
    n, q = D.shape
    eye = np.eye(n, dtype=np.int64)
    T, X, Z, N, L = (g[name] for name in ("T", "X", "Z", "N", "L"))
    terms: dict[str, list[tuple[Array, ...]]] = {
        "T T1 = [I, 0]": [(T, g["T1"]), (-eye[: n - q],)],
        "T1 = [Ta, D]": [(g["T1"][:, n - q :],), (-D,)],
        "Z C D = 0": [(Z, C, D)],
        "N C D = I": [(N, C, D), (-np.eye(q, dtype=np.int64),)],
        "F = (T A - L Z C) X": [(g["F"],), (-T, A, X), (L, Z, C, X)],
        "T A = F T + H C": [(T, A), (-g["F"], T), (-g["H"], C)],
        "T D = 0": [(T, D)],
        "Gu = T B": [(g["Gu"],), (-T, B)],
        "X T + Xy C = I": [(X, T), (g["Xy"], C), (-eye,)],
        "Q T + R C + N C A = 0": [(g["Q"], T), (g["R"], C), (N, C, A)],
        "S = -N C B": [(g["S"],), (N, C, B)],
    }
    found = {}
    for name, parts in terms.items():
        products = [_product(factors) for factors in parts]
        sizes = [_product(tuple(abs(X) for X in factors)) for factors in parts]
        largest = [math.prod(max(abs(X).flat, default=0) for X in factors) for factors in parts]
        # a sparse product may vanish but for rounding: its factors' largest entries are its size
        floor = max(largest) if len(parts) == 1 else 0
        found[name] = sum(products[1:], products[0]), sum(sizes[1:], sizes[0]) + floor
    return found


def _product(factors: tuple[Array, ...]) -> Array:
    result = factors[0]
    for factor in factors[1:]:
        result = result @ factor
    return result


def leftovers(
    plant: tuple[Array, Array, Array, Array], g: Mapping[str, Array]
) -> dict[str, dict[str, Array]]:
    """What drives the errors of the stored matrices, all zero for an observer: by signal x, u, d.

        e' = F e + error x + ...,  e = zeta - T x
        xhat - x = X e + state x + ...,   dhat - d = Q e + input x + ...

    Returns {"error": {"x": ..., "u": ..., "d": ...}, "state": ..., "input": ...}.
    """
    A, B, C, D = plant
    n, q = D.shape
    eye = np.eye(n, dtype=np.int64)
    shows = g["N"] @ C
    return {
        "error": {
            "x": g["F"] @ g["T"] + g["H"] @ C - g["T"] @ A,
            "u": g["Gu"] - g["T"] @ B,
            "d": -(g["T"] @ D),
        },
        "state": {
            "x": g["X"] @ g["T"] + g["Xy"] @ C - eye,
            "u": 0 * B,
            "d": 0 * D,
        },
        "input": {
            "x": g["Q"] @ g["T"] + g["R"] @ C + shows @ A,
            "u": g["S"] + shows @ B,
            "d": shows @ D - np.eye(q, dtype=np.int64),
        },
    }


# of every matrix, in which units its rows and its columns are: states x, reduced states w, outputs
# y, annihilated outputs z, unknown inputs d, known inputs u, and both [w, d]; time is in no unit
UNITS: Mapping[str, tuple[str, str]] = {
    "T1": ("x", "wd"), "T": ("w", "x"), "N": ("d", "y"), "Z": ("z", "y"), "L": ("w", "z"),
    "F": ("w", "w"), "H": ("w", "y"), "Gu": ("w", "u"), "X": ("x", "w"), "Xy": ("x", "y"),
    "Q": ("d", "w"), "R": ("d", "y"), "S": ("d", "u"), "first": ("w", "y"),
    "A": ("x", "x"), "B": ("x", "u"), "C": ("y", "x"), "D": ("x", "d"),
}  # fmt: skip


def units(
    plant: tuple[Array, Array, Array, Array], sizes: Array, T: Array, Z: Array
) -> dict[str, Array]:
    """Sizes of all signals, powers of two, where the states have the given `sizes` (n,)."""
    _, B, C, D = plant
    found = {"x": sizes, "w": 1 / lengths(T * sizes), "y": 1 / lengths(C * sizes)}
    found |= {"d": lengths((D / sizes[:, None]).T), "u": lengths((B / sizes[:, None]).T)}
    found["z"] = 1 / lengths(Z * found["y"])
    return found | {"wd": np.concatenate([found["w"], found["d"]])}


def zero_dynamics(A: Array, C: Array, D: Array, N: Array) -> Array:
    """(I - D N C) A: how the state moves while d keeps y' = 0; N a left inverse of C D.

    The invariant zeros of (A, D, C) are its modes that C does not see; no gain moves them.
    """
    return A - D @ (N @ (C @ A))


# what the rounding of the stored matrices may leave of the estimates for ever, of the signals
LASTING = 1e-6


def first_state(seen: Array, Z: Array, sizes: Array) -> Array:
    """The reduced state of least norm that agrees with the first y: (k, p), floats.

    seen (p - q, k): how it shows in Z y; sizes (p - q,): of the terms of each of its rows.
    """
    weights = 1 / np.where(sizes > 0, sizes, 1.0)
    rows = seen * weights[:, None]
    largest = float(np.linalg.norm(rows, 2)) if rows.size else 0.0
    if largest <= UNSEEN:
        return np.zeros((seen.shape[1], Z.shape[1]))
    inverse = np.linalg.pinv(rows, rcond=UNSEEN / largest)
    return np.asarray((inverse * weights) @ Z)


def without_empty(gains: Mapping[str, Any]) -> dict[str, Any]:
    """Gains that have entries: JSON cannot tell a 0 x 3 matrix from a 0 x 2 one."""
    return {name: value for name, value in gains.items() if np.size(value)}


def differentiator(problem: Any) -> str:
    """The differentiator of a problem: `fixed_lag` where all outputs have noise, else `cell`."""
    noisy = bool(np.all(problem.plant.output.noise_std > 0))
    return str(problem.options.get("differentiator", "fixed_lag" if noisy else "cell"))


def differentiation(problem: Any, chosen: str) -> dict[str, Any]:
    """A differentiator as a design stores it: its name, what it knows of the noise, its lag."""
    stored: dict[str, Any] = {"differentiator": chosen}
    if chosen in SMOOTHING:
        stored["noise_std"] = problem.plant.output.noise_std
    if problem.plant.output.noise_centre is not None:
        stored["noise_centre"] = problem.plant.output.noise_centre
    if chosen == "fixed_lag":
        stored["lag"] = problem.options.get("lag", LAG)
    return stored


def shapes(n: int, p: int, q: int, m: int) -> dict[str, tuple[int, int]]:
    """Shape of every gain that is computed, empty ones included; m known inputs."""
    k = n - q
    return {
        "T1": (n, n), "T": (k, n), "N": (q, p), "Z": (p - q, p), "L": (k, p - q), "F": (k, k),
        "H": (k, p), "Gu": (k, m + 1), "X": (n, k), "Xy": (n, p), "Q": (q, k), "R": (q, p),
        "S": (q, m + 1), "first": (k, p),
    }  # fmt: skip
