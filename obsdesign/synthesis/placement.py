"""Gains L for e' = (A - L C) e: by Riccati equation, or with poles at given places."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Matrix
from obsdesign.analysis.balancing import balancing_units
from obsdesign.analysis.hidden_modes import approx_unobservable_modes
from obsdesign.errors import InputError
from obsdesign.problem.options import Pole


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
    hidden = [mode.eigenvalue.real for mode in approx_unobservable_modes(A, C)]
    # an unobservable mode that does not decay leaves no solution: shift A below it
    below = max([0.0, *(value + rate + 1e-3 * (1 + abs(value)) for value in hidden)])
    shifted = A + (rate - below) * np.eye(n)
    with np.errstate(all="ignore"):  # overflow in there shows in the result
        S = solve_continuous_are(shifted.T, C.T, Q, R)
        L = np.asarray(np.linalg.solve(R, C @ S).T, dtype=np.float64)
    if not np.isfinite(L).all():
        raise np.linalg.LinAlgError("the Riccati equation has no finite solution in floats")
    return L


def placed_gain(A: Matrix, C: Matrix, poles: Sequence[Pole]) -> Matrix:
    """L, (n, p), with the eigenvalues of A - L C at `poles`: numbers or pairs [real, imaginary].

    Placed in units that balance the plant, so that those of states, outputs and time do not matter.
    InputError when their number is wrong, a complex one lacks its conjugate, or a mode is
    unobservable (no gain moves its eigenvalue).
    """
    wanted = _poles(poles, len(A))
    if hidden := approx_unobservable_modes(A, C):
        raise InputError(
            f"observer.poles: the mode {complex_text(hidden[0].eigenvalue)} of flow.A cannot be "
            "moved, since output.C does not see it; leave poles out."
        )
    sizes, pace = balancing_units(A, C, np.zeros((len(A), 0)))
    shown = C * sizes
    rows = np.linalg.norm(shown, axis=1)
    rows = np.where(rows > 0, rows, 1.0)
    balanced, C_unit = A * sizes / sizes[:, None] / pace, shown / rows[:, None]
    once = len(set(wanted.tolist())) == len(wanted)
    if once and len(C) == 1:
        placed = _unique_gain(balanced, C_unit, wanted / pace)
    else:
        placed = _robust_gain(balanced, C_unit, wanted / pace)
    return np.asarray(placed * sizes[:, None] * pace / rows, dtype=np.float64)


def _unique_gain(A: Matrix, C: Matrix, poles: NDArray[np.complex128]) -> Matrix:
    """With one output and distinct poles there is no choice: A' v - C' g = pole v and L' v = g.

    Does without scipy.signal, which takes longer to load than everything else.
    """
    eye = np.eye(len(A))
    pairs = [np.linalg.svd(np.hstack([A.T - pole * eye, -C.T]))[2][-1].conj() for pole in poles]
    v, g = np.split(np.array(pairs), [len(A)], axis=1)
    try:
        L: Matrix = np.linalg.solve(v, g).real
    except np.linalg.LinAlgError:
        L = np.full_like(C.T, np.nan)
    if not np.isfinite(L).all():
        raise _unresolved()
    return L


def _robust_gain(A: Matrix, C: Matrix, poles: NDArray[np.complex128]) -> Matrix:
    from scipy.signal import place_poles

    try:
        placed = place_poles(A.T, C.T, poles)
    except ValueError as error:
        if "repeated" in str(error):
            most = np.linalg.matrix_rank(C)
            raise InputError(
                f"observer.poles cannot be placed: a pole may stand at most {most} times, once per "
                "output."
            ) from None
        raise _unresolved() from None
    return np.asarray(placed.gain_matrix.T, dtype=np.float64)


def _unresolved() -> InputError:
    return InputError(
        "observer.poles cannot be placed: floats do not resolve how output.C sees the plant; are "
        "the units right?"
    )


def _poles(poles: Sequence[Pole], n: int) -> NDArray[np.complex128]:
    values = with_conjugates(poles)
    if len(values) != n:
        raise InputError(
            f"observer.poles must give {n} poles, one per state (a pair [re, im] counts with its "
            f"conjugate); got {len(values)}."
        )
    return values


def with_conjugates(poles: Sequence[Pole]) -> NDArray[np.complex128]:
    """Numbers or pairs [real, imaginary] as complex numbers; one of a pair stands for both."""
    values = np.array([complex(*p) if isinstance(p, Sequence) else complex(p) for p in poles])
    lonely = [v for v in values if v.imag and not np.any(np.isclose(values, v.conjugate()))]
    return np.concatenate([values, np.conjugate(lonely)])


def complex_text(value: complex) -> str:
    """Text of a mode, with its conjugate."""
    return f"{value.real:.6g}" + (f" +- {abs(value.imag):.6g}i" if value.imag else "")
