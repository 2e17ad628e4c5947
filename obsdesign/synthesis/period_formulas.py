"""Smooth formulas of CasADi: an exponential, an inverse, norms from above. SX and MX alike."""

from __future__ import annotations

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
