"""Linear programs: the one place that calls HiGHS. A proposal, never a proof."""

from __future__ import annotations

import math

import highspy
import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Indices, Matrix
from lmi.memory import require_memory

_MOST_ITERATIONS = 2**31 - 1  # an int of the solver
# entries from which on the interior point method goes first: as fast, and the simplex method has
# been seen to spend minutes on few iterations of such programs
_LARGE = 50_000


def minimise(
    cost: Matrix,
    rows: Matrix | tuple[Indices, Indices, Matrix],
    sides: tuple[Matrix, Matrix],
    bounds: tuple[Matrix, Matrix],
    *,
    seconds: float = math.inf,
    iterations: int | None = None,
) -> Matrix | None:
    """x of least cost'x with lower <= A x <= upper and low <= x <= high; None if none is found.

    cost: (n,); rows: A (m, n), or (row, column, value) of its entries, repeated ones added up;
    sides: lower, upper (m,); bounds: low, high (n,), with infinities; seconds: on the wall;
    iterations: of the simplex method.
    """
    n, m = len(cost), len(sides[0])
    # triplets, their sorted copies, and the solver's matrix with its factors
    require_memory(
        f"a linear program in {n} unknown numbers with {m} inequalities",
        40.0 * (int(np.count_nonzero(rows)) if isinstance(rows, np.ndarray) else len(rows[0])),
        "fewer states are required",
    )
    row, column, value = _entries(rows) if isinstance(rows, np.ndarray) else rows
    finite = np.isfinite(value).all() and np.isfinite(cost).all()
    if not finite or np.isnan(np.concatenate([*sides, *bounds])).any():
        return None  # beyond binary64 there is nothing to propose
    program = highspy.HighsLp()
    program.num_col_, program.num_row_ = n, m
    program.col_cost_ = np.asarray(cost, dtype=np.float64)
    program.col_lower_, program.col_upper_ = (_ends(end) for end in bounds)
    program.row_lower_, program.row_upper_ = (_ends(end) for end in sides)
    start, index, entries = _compressed(
        np.asarray(row), np.asarray(column), np.asarray(value), (m, n)
    )
    program.a_matrix_.format_ = highspy.MatrixFormat.kRowwise
    program.a_matrix_.start_, program.a_matrix_.index_ = start, index
    program.a_matrix_.value_ = entries
    return _solution(program, seconds, iterations)


class SilentSolver(highspy.Highs):  # type: ignore[misc]  # untyped
    """A solver that writes nothing: from 1.16 on HiGHS does so as callbacks are enabled."""

    def __init__(self) -> None:
        super().__init__()
        self.setOptionValue("output_flag", False)

    def enableCallbacks(self) -> None:
        """As the solver has it, silently; called as it is made."""
        self.setOptionValue("output_flag", False)
        super().enableCallbacks()


def _solution(program: highspy.HighsLp, seconds: float, iterations: int | None) -> Matrix | None:
    solver = SilentSolver()
    solver.setOptionValue("threads", 1)
    if len(program.a_matrix_.value_) >= _LARGE:
        solver.setOptionValue("solver", "ipm")
    if math.isfinite(seconds):
        solver.setOptionValue("time_limit", max(seconds, 1e-3))
    if iterations is not None:
        solver.setOptionValue("simplex_iteration_limit", min(iterations, _MOST_ITERATIONS))
    if solver.passModel(program) == highspy.HighsStatus.kError:
        return None
    solver.run()
    if solver.getModelStatus() != highspy.HighsModelStatus.kOptimal:
        return None
    x = np.array(solver.getSolution().col_value)
    return x if np.isfinite(x).all() else None


def _entries(A: Matrix) -> tuple[Indices, Indices, Matrix]:
    row, column = np.nonzero(A)
    return row, column, A[row, column]


def _ends(values: Matrix) -> Matrix:
    """With infinity as HiGHS writes it."""
    return np.clip(np.asarray(values, dtype=np.float64), -highspy.kHighsInf, highspy.kHighsInf)


def _compressed(
    row: Indices, column: Indices, value: Matrix, shape: tuple[int, int]
) -> tuple[NDArray[np.int32], NDArray[np.int32], Matrix]:
    """Entries row by row, repeated ones added, zeros left out."""
    flat = row.astype(np.int64) * shape[1] + column
    places, which = np.unique(flat, return_inverse=True)
    entries = np.zeros(len(places))
    np.add.at(entries, which, value)
    kept = entries != 0
    places, entries = places[kept], entries[kept]
    counts = np.bincount(places // shape[1], minlength=shape[0])
    start = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    return start, (places % shape[1]).astype(np.int32), entries
