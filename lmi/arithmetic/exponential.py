"""Matrix exponentials in floating point, numpy only: one matrix, stacks, grids, integrals.

Scaling and squaring of Pade approximants: N. J. Higham, The scaling and squaring method for the
matrix exponential revisited, SIAM J. Matrix Anal. Appl. 26 (2005), 1179-1193. The scaling looks at
norms of powers, as A. H. Al-Mohy and N. J. Higham, A new scaling and squaring algorithm for the
matrix exponential, ibid. 31 (2009), 970-989: large off-diagonal entries cost no digits.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lmi.arithmetic.arrays import Matrix
from lmi.memory import require_memory

# Degrees m and the 1-norms up to which the backward error of the [m/m] approximant stays below the
# unit roundoff (Higham, Table 2.3). Larger norms are scaled down to the last one.
_DEGREES = (
    (3, 1.495585217958292e-2), (5, 2.539398330063230e-1), (7, 9.504178996162932e-1),
    (9, 2.097847961257068e0), (13, 5.371920351148152e0),
)  # fmt: skip
# |c| in the backward error c X^27 + ... of the [13/13] approximant (Al-Mohy, Higham, section 3)
_ERROR_TERM = 1.0 / 113250775606021113483283660800000000.0
# Each squaring doubles the relative error: beyond this norm no digit of a result would be certain.
_LARGEST_NORM = 2.0**50
# of a step, in which `absolute_flow` bounds what enters on the way; a power of two
FLOW_PIECES = 16


def expm(A: ArrayLike) -> Matrix:
    """e^A for a square matrix or a stack of them, (..., n, n).

    Overflow gives infinities or NaN, and entries that are not finite or a 1-norm above 2**50 give
    NaN (for that matrix of the stack alone): never a finite wrong answer.
    """
    X = np.asarray(A, dtype=np.float64)
    if X.ndim < 2 or X.shape[-1] != X.shape[-2]:
        raise ValueError(f"square matrices are required; got an array of shape {X.shape}")
    if X.size == 0:
        return X.copy()
    with np.errstate(over="ignore", invalid="ignore"):
        norms = _norm(X)
        usable = norms <= _LARGEST_NORM  # False for NaN
        if usable.all():
            return _scaled_and_squared(X, norms)
        cleaned = np.where(usable[..., None, None], X, 0.0)
        result = _scaled_and_squared(cleaned, np.where(usable, norms, 0.0))
        return np.where(usable[..., None, None], result, np.nan)


def _scaled_and_squared(X: Matrix, norms: Matrix) -> Matrix:
    largest = float(norms.max())
    degree, reach = next((entry for entry in _DEGREES if largest <= entry[1]), _DEGREES[-1])
    if largest <= reach:
        return _pade(X, degree)
    squarings = _squarings(X, norms, reach)
    result = _pade(X * np.ldexp(1.0, -squarings)[..., None, None], degree)
    for k in range(int(squarings.max())):
        more = (squarings > k)[..., None, None]
        result = result @ result if more.all() else np.where(more, result @ result, result)
    return result


def _squarings(X: Matrix, norms: Matrix, reach: float) -> NDArray[np.int_]:
    """Halvings that bring each matrix within reach of the [13/13] approximant."""
    by_norm = _halvings(norms / reach)
    if by_norm.max() <= 3:
        return by_norm
    X4 = np.linalg.matrix_power(X, 4)
    X6 = X4 @ X @ X
    powers = ((X6, 6), (X4 @ X4, 8), (X4 @ X6, 10))
    sixth, eighth, tenth = (_norm(power) ** (1.0 / k) for power, k in powers)
    size = np.minimum(np.maximum(sixth, eighth), np.maximum(eighth, tenth))
    by_powers = _halvings(size / reach)
    # what cancels in the powers may not cancel in the error: its first term, without signs
    scaled = np.abs(X) * np.ldexp(1.0, -by_powers)[..., None, None]
    leading = _norm(np.linalg.matrix_power(scaled, 27)) / np.maximum(_norm(scaled), 1e-300)
    more = np.ceil(np.log2(np.maximum(leading * _ERROR_TERM * 2.0**53, 1.0)) / 26)
    wanted = by_powers + more
    good = np.isfinite(wanted) & (wanted < by_norm)
    squarings: NDArray[np.int_] = np.where(good, wanted, by_norm).astype(int)
    return squarings


def _halvings(ratio: Matrix) -> NDArray[np.int_]:
    finite = np.where(np.isfinite(ratio), np.maximum(ratio, 1.0), 2.0**60)
    halvings: NDArray[np.int_] = np.ceil(np.log2(finite)).astype(int)
    return halvings


def _norm(X: Matrix) -> Matrix:
    norm: Matrix = np.abs(X).sum(axis=-2).max(axis=-1)
    return norm


@cache
def _coefficients(degree: int) -> tuple[float, ...]:
    """Numerator coefficients of the [m/m] Pade approximant of exp, the last one scaled to 1."""
    m = degree
    return tuple(float(math.comb(m, k) * math.factorial(2 * m - k) // math.factorial(m))
                 for k in range(m + 1))  # fmt: skip


def _pade(X: Matrix, degree: int) -> Matrix:
    b = _coefficients(degree)
    X2 = X @ X
    powers = [np.eye(X.shape[-1]), X2]
    while len(powers) <= min(degree // 2, 3):
        powers.append(powers[-1] @ X2)
    even: Matrix = sum((b[2 * k] * powers[k] for k in range(1, len(powers))), b[0] * powers[0])
    odd: Matrix = sum((b[2 * k + 1] * powers[k] for k in range(1, len(powers))), b[1] * powers[0])
    if degree > 7:  # the rest in powers of X^6 times lower ones (Higham, (2.16))
        orders = range(4, degree // 2 + 1)
        even = even + powers[3] @ sum(b[2 * k] * powers[k - 3] for k in orders)
        odd = odd + powers[3] @ sum(b[2 * k + 1] * powers[k - 3] for k in orders)
    odd = X @ odd
    return np.asarray(np.linalg.solve(even - odd, even + odd))


def exponential_grid(
    F: ArrayLike, start: float, step: float, count: int, *, left: Matrix | None = None
) -> Matrix:
    """L e^{F (start + k step)}, k = 0..count-1, (count, r, n), L (r, n) or the identity.

    By doubling: log2(count) products.
    """
    F = np.asarray(F, dtype=np.float64)
    rows = len(F) if left is None else len(left)
    require_memory(
        f"{count} exponentials of {len(F)} states", count * rows * len(F),
        "a shorter window is required",
    )  # fmt: skip
    grid = np.empty((count, rows, len(F)))
    if count == 0:
        return grid
    with np.errstate(over="ignore", invalid="ignore"):
        ends = expm(np.stack([F * start, F * step]))
        grid[0], power, filled = ends[0] if left is None else left @ ends[0], ends[1], 1
        while filled < count:
            more = min(filled, count - filled)
            grid[filled : filled + more] = times(grid[:more], power)
            power, filled = power @ power, filled + more
    return grid


def times(stack: Matrix, A: Matrix) -> Matrix:
    """Each matrix of a stack (k, m, n) times the same A (n, p): one product instead of k."""
    k, m, n = stack.shape
    product: Matrix = (stack.reshape(k * m, n) @ A).reshape(k, m, A.shape[1])
    return product


def flow_integrals(A: ArrayLike, h: float) -> tuple[Matrix, Matrix]:
    """(e^{A h}, int_0^h e^{A s} ds) from one block exponential; A may be singular.

    C. F. Van Loan, Computing integrals involving the matrix exponential, IEEE TAC 23 (1978).
    """
    A = np.asarray(A, dtype=np.float64)
    n = len(A)
    block = np.zeros((2 * n, 2 * n))
    block[:n, :n], block[:n, n:] = A, np.eye(n)
    whole = expm(block * h)
    return whole[:n, :n], whole[:n, n:]


def absolute_flow(left: Matrix, A: Matrix, b: Matrix, times: Matrix) -> tuple[Matrix, Matrix]:
    """(|X e^{A t}|, bound of int_0^t |X e^{A s}| ds b) at each time: (k, q, n), (k, q).

    left: X (q, n); A (n, n); b (n,) >= 0; times (k,). With d = t / FLOW_PIECES the bound is

        sum_j |X e^{A j d}| f,    f = int_0^d e^{Mz(A) s} ds b

    where Mz keeps the diagonal and takes absolute values elsewhere: |e^{A s}| <= e^{Mz(A) s}. It is
    at most |X| int_0^t e^{Mz(A) s} ds b, and exact where A is Metzler and X >= 0.
    """
    n = len(A)
    piece = np.asarray(times, dtype=np.float64)[:, None, None] / FLOW_PIECES
    driven = np.zeros((n + 1, n + 1))
    driven[:n, :n], driven[:n, n] = np.where(np.eye(n, dtype=bool), A, np.abs(A)), b
    step, pushed = expm(A * piece), expm(driven * piece)[:, :n, n:]
    flow = np.broadcast_to(left, (len(step), *left.shape))
    total = np.zeros((len(step), len(left), 1))
    for _ in range(FLOW_PIECES):
        total = total + np.abs(flow) @ pushed
        flow = flow @ step
    return np.abs(flow), total[..., 0]
