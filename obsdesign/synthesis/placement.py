"""Gains L for e' = (A - L C) e: by Riccati equation, or with poles at given places."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import (
    Exact,
    ball,
    entries,
    exact,
    number,
    precision,
    solve_entries,
    to_float,
)
from obsdesign.analysis.balancing import balancing_units
from obsdesign.analysis.hidden_modes import approx_unobservable_modes
from obsdesign.analysis.riccati import riccati_shift
from obsdesign.analysis.stated_poles import complex_text, gap, real_factors, with_conjugates
from obsdesign.entries import LARGEST
from obsdesign.errors import InputError
from obsdesign.problem.options import Pole

# bits that an ill-conditioned plant may need, raised in turn
_PRECISIONS = (256, 1024, 4096, 16384)
# widths of an entry of L: relative to itself, and to the largest entry
_NARROW, _ZERO = 2.0**-60, 2.0**-110
# a relative error of the poles' polynomial that needs no correction
_ACCURATE = 1e-12


def riccati_gain(
    A: Matrix, C: Matrix, weights: Mapping[str, Sequence[float]] | None = None, rate: float = 0.0
) -> Matrix:
    """Steady-state Kalman gain, (n, p), of A + rate I.

    weights: {"state": n, "output": p} positive variances of process and measurement noise; by
    default ones, in the plant's own unit of time and of each output. Unobservable modes
    that do not decay at `rate` are left as they are; all others of A - L C then decay faster than
    `rate`. numpy.linalg.LinAlgError if the equation has no finite solution in floats.
    """
    from scipy.linalg import solve_continuous_are

    n, p = len(A), len(C)
    if not weights:
        pace, size = float(np.abs(A).max()) + rate or 1.0, np.linalg.norm(C, axis=1)
        size = np.where(size > 0, size, 1.0)
        one = {"state": [1.0] * n, "output": [1.0] * p}
        if pace != 1.0 or np.any(size != 1.0):
            L = riccati_gain(A / pace, C / size[:, None], one, rate / pace)
            return np.asarray(pace * L / size, dtype=np.float64)
    given = weights or {}
    Q, R = np.diag(given.get("state", np.ones(n))), np.diag(given.get("output", np.ones(p)))
    shifted = A + riccati_shift(A, C, rate) * np.eye(n)
    with np.errstate(all="ignore"):  # overflow in there shows in the result
        S = solve_continuous_are(shifted.T, C.T, Q, R)
        L = np.asarray(np.linalg.solve(R, C @ S).T, dtype=np.float64)
    if not np.isfinite(L).all():
        raise np.linalg.LinAlgError("the Riccati equation has no finite solution in floats")
    return L


def placed_gain(A: Matrix, C: Matrix, poles: Sequence[Pole]) -> Matrix:
    """L, (n, p), with the eigenvalues of A - L C at `poles`: numbers or pairs [real, imaginary].

    With one output there is one such L, computed in balls and rounded once. With several a robust
    one is chosen in floats, in units that balance the plant, and then corrected likewise.
    InputError when their number is wrong, a complex one lacks its conjugate, or a mode is
    unobservable (no gain moves its eigenvalue).
    """
    wanted = _poles(poles, len(A))
    sizes, pace = balancing_units(A, C, np.zeros((len(A), 0)))
    shown = C * sizes
    rows = np.linalg.norm(shown, axis=1)
    rows = np.where(rows > 0, rows, 1.0)
    balanced, C_unit = A * sizes / sizes[:, None] / pace, shown / rows[:, None]
    hidden = approx_unobservable_modes(balanced, C_unit)
    L = None
    if len(C) > 1 and not hidden:
        L = _robust_gain(balanced, C_unit, wanted / pace)
    if L is not None:
        L = L * sizes[:, None] * pace / rows
        return _admissible(_corrected_gain(A, C, poles, L, sizes=sizes, rows=rows))
    w = _mixture(rows)
    column = _unique_gain(exact(A), exact(w[None]) @ exact(C), poles, sizes)
    if column is not None:
        return _admissible(column * w)
    if hidden:
        mode = complex_text(hidden[0].eigenvalue * pace)
        raise InputError(
            f"observer.poles: the mode {mode} of flow.A cannot be moved, since output.C does not "
            "see it; leave poles out."
        )
    raise InputError(
        "observer.poles cannot be placed: floats do not resolve how output.C sees the plant; are "
        "the units right?"
    )


def _admissible(L: Matrix) -> Matrix:
    """L, which may be given too; InputError where its entries exceed those of a problem."""
    if not np.abs(L).max() <= LARGEST:
        raise InputError(
            f"observer.poles need a gain with an entry of {np.abs(L).max():.3g}, and at most "
            f"{LARGEST:g} is admissible: poles nearer to those of flow.A, or another unit of time."
        )
    return L


def _unique_gain(A: Exact, c: Exact, poles: Sequence[Pole], sizes: Matrix) -> Matrix | None:
    """L (n, 1) for one output c (1, n), by Ackermann's formula p(A) O^-1 e_n.

    p: the polynomial of the poles, O: the observability matrix. In balls, until every entry is
    known beyond binary64, against the others in the sizes of the states; None where no precision
    shows that (A, c) is observable.
    """
    n, factors = len(A), real_factors(poles)
    usual = _usual_gain(to_float(A), to_float(c), sizes)
    for bits in _PRECISIONS:
        with precision(bits):
            flow, rows = entries(ball(A)), [entries(ball(c))[0]]
            for _ in range(n - 1):
                rows.append(rows[-1] @ flow)
            last = exact(np.eye(n)[:, -1:])
            column = solve_entries(np.array(rows), last)
            if column is None:
                continue
            for factor in factors:
                powers = [column]
                for _ in factor[1:]:
                    powers.append(flow @ powers[-1])
                column = sum(k * power for k, power in zip(factor, powers, strict=True))
            L = _rounded(column, sizes, usual)
        if L is not None:
            return L if np.isfinite(L).all() else None
    return None


def _usual_gain(A: Matrix, c: Matrix, sizes: Matrix) -> float:
    """What changes A (n, n) by its own size, in the sizes of the states; 0 without an output."""
    output = float(np.abs(c * sizes).max())
    return float(np.abs(A * sizes / sizes[:, None]).max()) / output if output else 0.0


def _rounded(column: Exact, sizes: Matrix, usual: float) -> Matrix | None:
    """Nearest floats of balls (n, 1); None unless all are narrow, against zero in the sizes.

    usual: size of a gain in the sizes of the states.
    """
    balls = column[:, 0].tolist()
    largest = max(abs(x.mid()) / number(size) for x, size in zip(balls, sizes, strict=True))
    largest = max(largest, number(usual))
    for x, size in zip(balls, sizes.tolist(), strict=True):
        if not x.rad() <= max(abs(x.mid()) * _NARROW, largest * number(size) * _ZERO):
            return None
    middles = [float(x.mid()) if abs(x.mid()) > x.rad() else 0.0 for x in balls]
    return np.array(middles, dtype=np.float64)[:, None]


def _corrected_gain(
    A: Matrix, C: Matrix, poles: Sequence[Pole], L: Matrix, *, sizes: Matrix, rows: Matrix
) -> Matrix:
    """L (n, p), or L + l w' with the poles exactly but for rounding, whichever comes nearer."""
    flow, outputs = exact(A), exact(C)
    error = flow - exact(L) @ outputs
    before = gap(error, poles).relative
    if before <= _ACCURATE:
        return L
    w = _mixture(rows)
    column = _unique_gain(error, exact(w[None]) @ outputs, poles, sizes)
    if column is None:
        return L
    corrected = L + column * w
    after = gap(flow - exact(corrected) @ outputs, poles).relative
    return corrected if after < before else L


def _mixture(rows: Matrix) -> Matrix:
    """Weights (p,) of the outputs, of sizes `rows`, in one output that sees what they see."""
    return np.asarray(np.exp2(-np.arange(len(rows)) / 2) / rows if len(rows) > 1 else [1.0])


def _robust_gain(A: Matrix, C: Matrix, poles: NDArray[np.complex128]) -> Matrix | None:
    """Gain of a method that wants independent outputs, and no pole more often; None elsewhere."""
    from scipy.signal import place_poles

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # less robust than hoped for: the claim `poles` decides
            placed = place_poles(A.T, C.T, poles)
    except ValueError:
        return None
    return np.asarray(placed.gain_matrix.T, dtype=np.float64)


def _poles(poles: Sequence[Pole], n: int) -> NDArray[np.complex128]:
    values = with_conjugates(poles)
    if len(values) != n:
        raise InputError(
            f"observer.poles must give {n} poles, one per state (a pair [re, im] counts with its "
            f"conjugate); got {len(values)}."
        )
    return values
