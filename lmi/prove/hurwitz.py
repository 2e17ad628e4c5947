"""Exact decisions on the spectrum of a matrix: Hurwitz, Schur, real.

Hurwitz (every mode decays) is refuted with the mode; a real spectrum is decided by Sturm's
sequence.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import (
    Balls,
    Exact,
    Number,
    Rational,
    ball,
    certify_positive_definite,
    characteristic_polynomial,
    exact,
    precision,
    to_float,
)
from lmi.memory import require_memory
from lmi.verdict import Verdict, proved, refuted


def real_spectrum(F: Exact) -> bool | None:
    """Decide by Sturm's sequence whether all eigenvalues of the exact matrix F are real.

    None for more than 40 rows, whose sequence would take more than a few seconds.
    """
    if len(F) > _MOST_ROWS:
        return None
    chain = [characteristic_polynomial(F)]
    chain.append([k * c for k, c in enumerate(chain[0])][1:])
    while True:
        remainder = _remainder(chain[-2], chain[-1])
        if not remainder:
            break
        size = abs(remainder[-1])  # without it the digits of the coefficients double in each step
        chain.append([-c / size for c in remainder])
    distinct = (len(chain[0]) - 1) - (len(chain[-1]) - 1)
    at_ends = []
    for end in (-1, 1):
        leading = [p[-1] * end ** (len(p) - 1) for p in chain]
        at_ends.append(sum(a * b < 0 for a, b in itertools.pairwise(leading)))
    return bool(at_ends[0] - at_ends[1] == distinct)


def _remainder(p: list[Rational], q: list[Rational]) -> list[Rational]:
    remainder = list(p)
    while len(remainder) >= len(q):
        factor, shift = remainder[-1] / q[-1], len(remainder) - len(q)
        for i, c in enumerate(q):
            remainder[i + shift] = remainder[i + shift] - factor * c
        remainder.pop()
    while remainder and remainder[-1] == 0:
        remainder.pop()
    return remainder


_MOST_ROWS = 40
# bound on the ratio of modal weights
_LARGEST_WEIGHT_RATIO = 30.0


def prove_hurwitz(F: ArrayLike) -> Verdict:
    """Every eigenvalue of F has a negative real part; F (n, n) floats or exact rationals.

    A Lyapunov matrix checked in balls proves it. Otherwise Routh's test on the exact characteristic
    polynomial decides, so that eigenvalues on the imaginary axis are refuted, not undecided.
    """
    numbers = exact(F)
    approx = to_float(numbers)
    worst = rightmost(approx)
    Q = lyapunov_matrix(approx, np.eye(len(approx)))
    if Q is not None:
        with precision(128):
            Q_ball, F_ball = ball(exact(Q)), ball(numbers)
            falling = -(F_ball.transpose() * Q_ball + Q_ball * F_ball)
            if certify_positive_definite(Q_ball) and certify_positive_definite(falling):
                return proved(method="Lyapunov matrix", approx_abscissa=worst.real)
    if _routh(characteristic_polynomial(numbers)):
        return proved(method="Routh's test, exact", approx_abscissa=worst.real)
    if not (math.isfinite(worst.real) and math.isfinite(worst.imag)):
        reason = "the flow has a mode that does not decay; floats overflow where it is"
        mode = {"real": math.nan, "imag": math.nan}
        return refuted({"eigenvalue": mode, "method": "Routh's test, exact", "reason": reason})
    real = worst.real if worst.real > 0 else 0.0  # floats may put a mode of the axis to its left
    reason = (
        f"the flow has a mode that does not decay: eigenvalue {real:.6g}"
        f"{f' +- {abs(worst.imag):.6g}i' if worst.imag else ''}"
    )
    mode = {"real": real, "imag": abs(worst.imag)}
    return refuted({"eigenvalue": mode, "method": "Routh's test, exact", "reason": reason})


def exactly_schur(H: Exact) -> bool:
    """Every eigenvalue of the exact matrix H lies strictly inside the unit circle; a decision."""
    return bool(_schur(characteristic_polynomial(H)))


def schur(M: Balls) -> bool | None:
    """Every eigenvalue of a ball matrix lies strictly inside the unit circle.

    None where the balls are too wide to tell: at a higher precision for every matrix that has no
    eigenvalue on the circle.
    """
    return _schur(list(M.charpoly().coeffs()))


def _schur(p: Sequence[Number]) -> bool | None:
    """All roots of a monic polynomial, constant term first, are inside the unit circle.

    s = (z - 1)/(z + 1) carries the unit disc to the left half-plane, p(z) to
    (1 - s)^n p((1 + s)/(1 - s)); Routh's test decides there. p(-1) = 0 lowers the degree.
    """
    n = len(p) - 1
    image = [0 * p[0]] * (n + 1)
    for k, coefficient in enumerate(p):  # (1 + s)^k (1 - s)^(n - k)
        for j in range(n + 1):
            binomial = sum((-1) ** (j - i) * math.comb(k, i) * math.comb(n - k, j - i)
                           for i in range(max(0, j - n + k), min(k, j) + 1))  # fmt: skip
            image[j] = image[j] + binomial * coefficient
    if image[-1] == 0:
        return False
    if not (image[-1] > 0 or image[-1] < 0):
        return None
    return _routh([c / image[-1] for c in image])


def rightmost(F: Matrix) -> complex:
    """Approximate eigenvalue with the largest real part; NaN if F is not finite."""
    if not np.isfinite(F).all():
        return complex(math.nan, math.nan)
    with np.errstate(all="ignore"):
        eigenvalues = np.linalg.eigvals(F)
    return complex(eigenvalues[np.argmax(eigenvalues.real)])


def lyapunov_matrix(F: Matrix, P: Matrix) -> Matrix | None:
    """Q of (F + a I)'Q + Q(F + a I) = -P with a half the decay rate of F; floats, n^2 unknowns.

    None when F does not look Hurwitz or the equation cannot be solved. OversizeError where its
    n^4 coefficients exceed the budget of memory.
    """
    n = len(F)
    abscissa = rightmost(F).real
    if not abscissa < 0:
        return None
    shifted = F - 0.5 * abscissa * np.eye(n)
    # the operator, the terms of its sum and its factors
    require_memory(f"a Lyapunov equation of {n} states", 4 * n**4, "fewer states are required")
    operator = np.kron(np.eye(n), shifted.T) + np.kron(shifted.T, np.eye(n))
    try:
        with np.errstate(all="ignore"):
            Q = np.linalg.solve(operator, -P.reshape(-1)).reshape(n, n)
    except np.linalg.LinAlgError:
        return None
    return (Q + Q.T) / 2 if np.isfinite(Q).all() else None


def modal_matrix(F: Matrix) -> Matrix | None:
    """Q >= I that falls along every decaying mode by itself: V^-* D V^-1, V the eigenvectors.

    D >= V*V makes Q >= I; it is chosen by diagonal dominance, so that the slow modes, which have to
    be waited for, get little more weight than they must. Floats; None when F does not look Hurwitz
    or the eigenvectors are close to dependent.
    """
    if not rightmost(F).real < 0:
        return None
    with np.errstate(all="ignore"):
        modes, V = np.linalg.eig(F)
        gram = np.abs(V.conj().T @ V)
        ratio = np.sqrt(modes.real.max() / modes.real)  # 1 for the slowest, less for the others
        share = np.maximum(ratio, 1 / _LARGEST_WEIGHT_RATIO)
        weights = (gram * share / share[:, None]).sum(axis=1)
        try:
            back = np.linalg.inv(V)
        except np.linalg.LinAlgError:
            return None
        Q: Matrix = (back.conj().T @ (weights[:, None] * back)).real
    return (Q + Q.T) / 2 if np.isfinite(Q).all() else None


def _routh(coefficients: Sequence[Number]) -> bool | None:
    """Decide whether all roots are in the open left half-plane.

    coefficients: exact rationals or balls, constant term first. All entries of the first column are
    positive if they are: one that is certainly not refutes it. None where the sign of a ball is
    uncertain.
    """
    falling = coefficients[::-1]
    upper, lower = falling[0::2], falling[1::2]
    while lower:
        if lower[0] <= 0:
            return False
        if not lower[0] > 0:
            return None
        ratio = upper[0] / lower[0]
        padded = [*lower, *[0] * (len(upper) - len(lower))]
        following = [u - ratio * v for u, v in zip(upper[1:], padded[1:], strict=False)]
        upper, lower = lower, following
    return True
