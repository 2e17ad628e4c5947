"""Unknown-input observers in discrete time: left inverse and gain of a Kalman filter."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.analysis.balancing import BalancedPlant
from obsdesign.analysis.discrete_inputs import reason_against_inputs
from obsdesign.equations.unknown_input.steps import StepInputGains, input_entries
from obsdesign.errors import DoesNotApply
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate

# variances of the noise of y beside those of the state
_NOISES = (1.0, 1e-3, 1e-6)
# of the largest deviation of an output: one without noise has that much
_LEAST_NOISE = 1e-6


def step_inputs(problem: Problem) -> Iterator[Candidate]:
    """Yield candidates in order of preference, one without gains where none exists."""
    if reason := reason_against_inputs(problem):
        raise DoesNotApply(reason)
    A, C, D = problem.plant.flow.A, problem.plant.output.C, problem.plant.flow.D
    assert D is not None
    sizes = BalancedPlant.from_matrices(A, C).sizes
    A, C, D = A * sizes / sizes[:, None], C * sizes, D / sizes[:, None]
    noise = _noise(problem, C)
    C = C / noise[:, None]
    columns = np.abs(D).max(axis=0)
    columns[columns == 0] = 1.0
    slope = C @ (D / columns)
    if np.linalg.matrix_rank(slope) < slope.shape[1]:
        yield Candidate("none exists", None)
        return
    N = np.linalg.pinv(slope)
    for variance in _NOISES:
        K = _gain(A, C, D / columns, N, variance)
        M = D / columns @ N + K @ (np.eye(len(C)) - slope @ N)
        gains = StepInputGains(
            **input_entries(problem.plant), M=sizes[:, None] * M / noise,
            N=N / columns[:, None] / noise,
        )  # fmt: skip
        yield Candidate(f"Kalman gain, noise {variance:g}", gains, searched=len(C) > len(columns))


def _noise(problem: Problem, C: Matrix) -> Matrix:
    """Deviations of the outputs, or of their bounds; sizes of the rows of C where none is known."""
    output = problem.plant.output
    known = output.noise_std if output.noise_std.any() else output.noise_radius
    if known is None or not known.any():
        rows: Matrix = np.abs(C).max(axis=1)
        return np.where(rows > 0, rows, 1.0)
    return np.asarray(np.maximum(known, _LEAST_NOISE * known.max()))


def _gain(A: Matrix, C: Matrix, D: Matrix, N: Matrix, variance: float) -> Matrix:
    """K of (I - D N C) A - K (I - C D N) C A; zero where floats hold none."""
    free = np.eye(len(C)) - C @ D @ N
    F, H = A - D @ N @ C @ A, free @ C @ A
    R = variance * np.eye(len(C))
    from scipy.linalg import solve_discrete_are  # slow to import

    try:
        P = solve_discrete_are(F.T, H.T, np.eye(len(A)), R)
        K = np.linalg.solve(H @ P @ H.T + R, H @ P @ F.T).T
    except (np.linalg.LinAlgError, ValueError):
        return np.zeros((len(A), len(C)))
    return np.asarray(K) if np.isfinite(K).all() else np.zeros((len(A), len(C)))
