"""Gains L for the reduced system (A, C) of an unknown-input observer.

Its unseen modes, the invariant zeros of the plant, stay poles of A - L C whatever L is; L places
or optimises the others.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from obsdesign.analysis.units import own_units
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.placement import complex_text, placed_gain, with_conjugates
from obsdesign.synthesis.unknown_input.reduced_system import Reduced, output_variances

Matrix = NDArray[np.float64]


def reduced_gain(problem: Problem, system: Reduced, root: Matrix) -> tuple[str, Matrix]:
    """(how, L): given, placed, or the gain of a steady-state Kalman filter.

    root: R of `left_inverse`. InputError for poles that no gain can reach.
    """
    if "L" in problem.gains:
        return "given L", problem.gains["L"]
    if "poles" in problem.options:
        return "placed L", _placed(problem.options["poles"], system)
    for tried in (system, system.nearly()):
        if not tried.visible.shape[1]:
            return "no L: every pole is an invariant zero", np.zeros(system.C.T.shape)
        try:
            L = _riccati(problem, tried, root)
        except np.linalg.LinAlgError:  # something is all but unseen
            continue
        if np.linalg.eigvals(system.A - L @ system.C).real.max() < 0:
            return "Riccati L", L
    return "no finite Riccati L in floats, L = 0", np.zeros(system.C.T.shape)


def _riccati(problem: Problem, system: Reduced, root: Matrix) -> Matrix:
    flow, visible = problem.plant.flow, system.visible
    assert flow.D is not None
    weights = problem.options.get("weights", {})
    sizes, pace = own_units(flow.A, problem.plant.output.C, flow.D)
    state = np.asarray(weights["state"]) / sizes**2 if "state" in weights else np.ones(len(sizes))
    pace = 1.0 if "state" in weights else pace  # without a weight the plant's own unit of time
    driven = np.linalg.solve(root.T, system.coupling.T / pace)
    W = (system.T * state) @ system.T.T + driven.T @ driven
    noise = system.Z * np.sqrt(output_variances(problem))
    inner, seen = visible.T @ system.A @ visible, system.C @ visible
    return pace * visible @ _kalman(inner / pace, seen, visible.T @ W @ visible, noise)


def _placed(poles: Any, system: Reduced) -> Matrix:
    """L for the poles it can move: those besides the zeros, or besides what is nearly one."""
    try:
        tried, wanted = system, _free_poles(poles, system)
    except InputError:
        tried = system.nearly()
        if tried.hidden.shape == system.hidden.shape:
            raise
        try:
            wanted = _free_poles(poles, tried)
        except InputError:
            wanted = []
        if not wanted:
            raise
    visible = tried.visible
    inner, seen = visible.T @ tried.A @ visible, tried.C @ visible
    return visible @ placed_gain(inner, seen, wanted)


def _kalman(A: Matrix, C: Matrix, W: Matrix, noise: Matrix) -> Matrix:
    """S C' V^-1, V = noise noise', in outputs whose noise is white and of unit size."""
    from scipy.linalg import solve_continuous_are

    R = np.asarray(np.linalg.qr(noise.T)[1])
    white = np.linalg.solve(R.T, C)
    S = solve_continuous_are(A.T, white.T, W, np.eye(len(R)))
    return np.asarray(np.linalg.solve(R, white @ S).T)


def _free_poles(poles: Any, system: Reduced) -> list[Any]:
    """The poles that L can move: all k with the zeros among them, or those besides the zeros."""
    k, hidden = len(system.A), system.hidden
    zeros = np.linalg.eigvals(hidden.T @ system.A @ hidden)
    wanted = asked = with_conjugates(poles)
    if len(asked) == k:
        for zero in zeros:
            near = int(np.argmin(abs(wanted - zero)))
            if not np.isclose(wanted[near], zero, rtol=1e-6, atol=1e-9):
                break
            wanted = np.delete(wanted, near)
    free = k - len(zeros)
    if len(wanted) != free or free == 0:
        told = ", ".join(complex_text(z) for z in sorted(zeros, key=abs) if z.imag >= 0)
        stay = f" besides the invariant zeros {told}, which stay" if len(zeros) else ""
        raise InputError(
            f"observer.poles must give {free} poles{stay} (n - q = {k}; a pair [re, im] counts "
            f"with its conjugate); got {len(asked)}.{'' if free else ' Leave poles out.'}"
        )
    return [[v.real, v.imag] if v.imag else v.real for v in wanted.tolist()]
