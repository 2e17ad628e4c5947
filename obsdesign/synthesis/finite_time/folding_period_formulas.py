"""Smooth formulas of CasADi: condition (13), an exponential, an inverse, norms from above.

SX and MX alike.
"""

from __future__ import annotations

import math
from typing import Any

_TAYLOR_DEGREE, _SQUARINGS = 16, 6
_NORM_DOUBLINGS = 6  # p = 64


def casadi_package() -> Any:
    """The package without its type hints, which do not know that a formula takes SX and MX."""
    import casadi

    return casadi


def triangular_of(entries: Any, n: int) -> tuple[Any, Any]:
    """S upper triangular with exponentials on its diagonal, and its inverse."""
    ca = casadi_package()

    S, k = type(entries).zeros(n, n), 0
    for i in range(n):
        for j in range(i, n):
            S[i, j] = ca.exp(entries[k]) if i == j else entries[k]
            k += 1
    return S, inverse_of(S, n)


def inverse_of(X: Any, n: int) -> Any:
    """X^-1 for X (n, n)."""
    ca = casadi_package()

    unit = type(X).eye(n)
    return ca.solve(X, unit) if isinstance(X, ca.SX) else ca.solve(X, unit, "lapackqr")


def exponential_of(X: Any) -> Any:
    """e^X by a Taylor polynomial and squarings."""
    ca = casadi_package()

    scaled = X / 2**_SQUARINGS
    unit = type(X).eye(X.shape[0])
    result = unit
    for k in range(_TAYLOR_DEGREE, 0, -1):
        result = unit + ca.mtimes(scaled, result) / k
    for _ in range(_SQUARINGS):
        result = ca.mtimes(result, result)
    return result


def log_norm(X: Any) -> Any:
    """log (tr (X'X)^p)^(1/2p), p = 2^doublings, each power scaled by its trace."""
    ca = casadi_package()

    power = ca.mtimes(X.T, X)
    total, weight = 0, 1.0
    for _ in range(_NORM_DOUBLINGS):
        trace = ca.trace(power)
        total = total + weight * ca.log(trace)
        power = power / trace
        power = ca.mtimes(power, power)
        weight /= 2
    return (total + weight * ca.log(ca.trace(power))) / 2


def softplus(x: Any) -> Any:
    """log(1 + e^x), without overflow."""
    ca = casadi_package()

    return ca.fmax(x, 0) + ca.log1p(ca.exp(-ca.fabs(x)))


def condition_13(A: Any, C: Any, kind: Any, tighter: bool) -> tuple[Any, Any, Any, Any]:
    """(unknowns, log nu, what has to vanish, (|l|^2 - 1, log |L C|)); kind: SX or MX.

    unknowns: l (n p,), log of the size of L, log T, w = log u, the triangle of S.
    """
    ca = casadi_package()

    n, p = len(A), len(C)
    direction, size = kind.sym("l", n * p), kind.sym("size")
    log_T, w = kind.sym("T"), kind.sym("w")
    triangle = kind.sym("S", n * (n + 1) // 2)
    S, S_inverse = triangular_of(triangle, n)
    A_s = ca.mtimes([S, ca.DM(A), S_inverse])
    unit = ca.mtimes([S, ca.reshape(direction, n, p), ca.DM(C), S_inverse])
    T = ca.exp(log_T)
    F = A_s + ca.exp(size) * unit
    block = ca.blockcat([[-F, unit], [kind.zeros(n, n), -A_s]]) * T
    whole = exponential_of(block)
    log_a = log_norm(whole[:n, :n])
    log_m = log_norm(inverse_of(whole[:n, n:], n)) - size
    log_f, log_LC = log_norm(F), log_norm(unit) + size
    f = ca.exp(log_f)
    log_sigma = -log_a - softplus(log_m + log_a)
    if tighter:  # e^u - 1 = Sigma* e^{-f T}, which does not underflow
        u, log_g = ca.exp(w), log_T
        equality = u + ca.log(-ca.expm1(-u)) - log_sigma + f * T
    else:
        log_g = 2 * f * T + ca.log(-ca.expm1(-2 * f * T)) - math.log(2) - log_f
        equality = w + ca.exp(w) - log_sigma + f * T
    log_nu = ca.log(ca.log1p(ca.exp(w - log_g - log_LC))) - log_norm(A_s)
    unknowns = ca.vertcat(direction, size, log_T, w, triangle)
    return unknowns, log_nu, equality, (ca.dot(direction, direction) - 1, log_LC)
