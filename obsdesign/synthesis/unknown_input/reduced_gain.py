"""Gains L for the reduced system (A, C) of an unknown-input observer.

Its unobservable modes, the invariant zeros of the plant, stay poles of A - L C whatever L is; L
places or optimises the others.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.analysis.balancing import balancing_units
from obsdesign.analysis.stated_poles import complex_text, with_conjugates
from obsdesign.errors import InputError
from obsdesign.problem.options import Pole, UnknownInputOptions
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.placement import placed_gain
from obsdesign.synthesis.unknown_input.reduced_system import Reduced, output_variances


def reduced_gain(problem: Problem, system: Reduced, root: Matrix) -> tuple[str, Matrix]:
    """(how, L): given, placed, or the gain of a steady-state Kalman filter.

    root: R of `left_inverse`. InputError for poles that no gain can reach.
    """
    if "L" in problem.gains:
        return "given L", problem.gains["L"]
    poles = problem.options_as(UnknownInputOptions).poles
    if poles is not None:
        return "placed L", _placed(poles, system)
    for reduced in (system, system.with_nearly_hidden()):
        if not reduced.visible.shape[1]:
            return "no L: every pole is an invariant zero", np.zeros(system.C.T.shape)
        try:
            L = _riccati(problem, reduced, root)
        except np.linalg.LinAlgError:  # a mode is nearly unobservable
            continue
        if np.linalg.eigvals(system.A - L @ system.C).real.max() < 0:
            return "Riccati L", L
    return "no finite Riccati L in floats, L = 0", np.zeros(system.C.T.shape)


def _riccati(problem: Problem, system: Reduced, root: Matrix) -> Matrix:
    flow, visible = problem.plant.flow, system.visible
    assert flow.D is not None
    weights = problem.options_as(UnknownInputOptions).weights or {}
    sizes, pace = balancing_units(flow.A, problem.plant.output.C, flow.D)
    state = np.asarray(weights["state"]) / sizes**2 if "state" in weights else np.ones(len(sizes))
    pace = 1.0 if "state" in weights else pace  # without a weight the plant's own unit of time
    driven = np.linalg.solve(root.T, system.coupling.T / pace)
    W = (system.T * state) @ system.T.T + driven.T @ driven
    noise = system.Z * np.sqrt(output_variances(problem))
    inner, output = visible.T @ system.A @ visible, system.C @ visible
    return pace * visible @ _kalman(inner / pace, output, visible.T @ W @ visible, noise)


def _placed(poles: Sequence[Pole], system: Reduced) -> Matrix:
    """L for the poles it can move: those besides the zeros, or besides what is nearly one."""
    try:
        reduced, movable = system, _free_poles(poles, system)
    except InputError:
        reduced = system.with_nearly_hidden()
        if reduced.hidden.shape == system.hidden.shape:
            raise
        try:
            movable = _free_poles(poles, reduced)
        except InputError:
            movable = []
        if not movable:
            raise
    visible = reduced.visible
    inner, output = visible.T @ reduced.A @ visible, reduced.C @ visible
    return visible @ placed_gain(inner, output, movable)


def _kalman(A: Matrix, C: Matrix, W: Matrix, noise: Matrix) -> Matrix:
    """S C' V^-1, V = noise noise', in outputs whose noise is white and of unit size."""
    from scipy.linalg import solve_continuous_are

    R = np.asarray(np.linalg.qr(noise.T)[1])
    white = np.linalg.solve(R.T, C)
    S = solve_continuous_are(A.T, white.T, W, np.eye(len(R)))
    return np.asarray(np.linalg.solve(R, white @ S).T)


def _free_poles(poles: Sequence[Pole], system: Reduced) -> list[Pole]:
    """The poles that L can move: all k with the zeros among them, or those besides the zeros."""
    k, hidden = len(system.A), system.hidden
    zeros = np.linalg.eigvals(hidden.T @ system.A @ hidden)
    movable = given = with_conjugates(poles)
    near_zero = 1e-9 * float(np.abs(given).max())
    if len(given) == k:
        for zero in zeros:
            near = int(np.argmin(abs(movable - zero)))
            if not np.isclose(movable[near], zero, rtol=1e-6, atol=near_zero):
                break
            movable = np.delete(movable, near)
    free = k - len(zeros)
    if len(movable) != free or free == 0:
        listed = ", ".join(complex_text(z) for z in sorted(zeros, key=abs) if z.imag >= 0)
        stay = f" besides the invariant zeros {listed}, which stay" if len(zeros) else ""
        raise InputError(
            f"observer.poles must give {free} poles{stay} (n - q = {k}; a pair [re, im] counts "
            f"with its conjugate); got {len(given)}.{'' if free else ' Leave poles out.'}"
        )
    return [(v.real, v.imag) if v.imag else v.real for v in movable.tolist()]
