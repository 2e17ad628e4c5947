"""Rows that map the state to the samples of a window, and their least-squares gains.

Rows are C A_d^(j-k) for x(t_i), or C A_d^j for x(t_i - T): one of them is well conditioned where
modes decay or grow by many digits over the window. Notation as in `formulas`.
"""

from __future__ import annotations

import math

import numpy as np

from lmi.arithmetic.arrays import Array, Matrix
from lmi.arithmetic.exponential import expm, exponential_grid

# reference state of biases and rows: x(t_i) or x(t_i - T)
END, START = "end", "start"
REFERENCES = (END, START)
# largest deviation of G O from I or A_d^k, states in units of `state_scales`: rounding of gains
# that amplify moderately
UNBIASED = 1e-8
# unobserved modes decay below this part of their size at the window's start
DECAYED = 1e-11
# a smallest singular value of scaled rows below this part of their norm counts as zero
SINGULAR = 1e-11
_ROUNDING = 1e-15


def sample_rows(A: Matrix, C: Matrix, period: float, k: int, reference: str = END) -> Matrix:
    """C A_d^(j-k), j = 0..k-1, (k, p, n): the samples as functions of x(t_i).

    With START C A_d^j: of x(t_i - T). Fast stable modes are large in the one, unstable ones in
    the other.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        if reference == START:
            return np.asarray(C @ exponential_grid(A, 0.0, period, k))
        return np.asarray(C @ exponential_grid(-A, period, period, k)[::-1])


def stacked_rows(C: Array, power: Array, k: int) -> Array:
    """C, C X, ..., C X^(k-1), (k, p, n), by products, for ball numbers."""
    rows = [C]
    for _ in range(k - 1):
        rows.append(rows[-1] @ power)
    return np.array(rows)


def state_scales(A: Matrix, C: Matrix, window: float) -> Matrix:
    """Powers of two (n,): units in which all states are about equally observable.

    1 / the column norms of C (A T)^j / j!, j < n, the Taylor terms of the output over the window.
    They scale with the units of the states.
    """
    n = len(A)
    terms = [np.asarray(C, dtype=np.float64)]
    with np.errstate(over="ignore", invalid="ignore"):
        for j in range(1, n):
            terms.append(terms[-1] @ A * (window / j))
        stack = np.vstack(terms)
        largest = np.abs(stack).max(axis=0)
        # squares would underflow
        sizes = largest * np.linalg.norm(stack / np.where(largest > 0, largest, 1.0), axis=0)
    usable = np.isfinite(sizes) & (sizes > 0)
    scales: Matrix = np.exp2(-np.round(np.log2(np.where(usable, sizes, 1.0))))
    return scales


def approx_determinacy(rows: Matrix, scales: Matrix) -> float:
    """Least singular value of scaled rows at unit length, relative to their Frobenius norm.

    rows: (m, n); in floats; 0 where they are fewer than n or not finite.
    """
    if not np.isfinite(rows).all() or len(rows) < len(scales):
        return 0.0
    with np.errstate(over="ignore"):
        scaled = rows * scales
        lengths = np.linalg.norm(scaled, axis=1)
    if not np.isfinite(scaled).all():
        return 0.0
    scaled = scaled / np.where(lengths > 0, lengths, 1.0)[:, None]
    values = np.linalg.svd(scaled, compute_uv=False)
    return float(values[-1] / math.sqrt(float((values**2).sum()) or 1.0))


def approx_window_determinacy(A: Matrix, C: Matrix, period: float, k: int) -> float:
    """Larger `approx_determinacy` of k samples for the state at the window's end or start."""
    scales = state_scales(A, C, k * period)
    stacks = (sample_rows(A, C, period, k, reference) for reference in REFERENCES)
    return max(approx_determinacy(rows.reshape(-1, len(A)), scales) for rows in stacks)


def approx_observability_index(A: Matrix, C: Matrix, period: float) -> int | None:
    """Fewest samples that determine the state in floats; None: n do not, and more add no rank."""
    for k in range(1, len(A) + 1):
        if approx_window_determinacy(A, C, period, k) >= SINGULAR:
            return k
    return None


def pathological_pairs(A: Matrix, period: float) -> list[tuple[complex, complex, float]]:
    """Eigenvalues of A that (almost) coincide after sampling: (first, second, turns).

    Kalman, Ho, Narendra: equal real parts and imaginary parts that differ by a multiple of
    2 pi / nu. A warning: several outputs may still see both.
    """
    values = np.linalg.eigvals(A)
    size = max(float(np.abs(values).max(initial=0.0)), 1e-300)
    pairs = []
    for i, first in enumerate(values):
        for second in values[i + 1 :]:
            turns = abs(first.imag - second.imag) * period / (2 * math.pi)
            same = abs(first.real - second.real) <= 1e-9 * size
            if same and round(turns) > 0 and abs(turns - round(turns)) <= 1e-6 * turns:
                pairs.append((complex(first), complex(second), float(turns)))
    return pairs


def least_squares_gain(rows: Matrix, deviations: Matrix, cut: float = 0.0) -> Matrix:
    """Gains (n, m) of the weighted least-squares estimate of the reference state, by QR.

    rows: (m, n), of `sample_rows`; deviations: (m,) relative sizes of the samples' errors; cut: of
    the scaled rows, singular values below that part of the largest count as zero (by SVD then).
    Rows that are singular to the last bit are cut at the rounding.
    """
    weights = 1.0 / deviations
    flat = rows * weights[:, None]
    scales = np.exp2(-np.round(np.log2(np.maximum(np.abs(flat).max(axis=0), 1e-300))))
    if not cut:
        Q, R = np.linalg.qr(flat * scales)
        try:
            return scales[:, None] * np.linalg.solve(R, Q.T) * weights
        except np.linalg.LinAlgError:
            cut = _ROUNDING
    return scales[:, None] * np.linalg.pinv(flat * scales, rcond=cut) * weights


def unbiased_gain(gain: Matrix, rows: Matrix, unbiased: Matrix, wanted: Matrix) -> Matrix:
    """The gain made unbiased, G + (X - G O) G_0, by a G_0 that is: G_0 O = I. rows: O, (m, n).

    wanted: X = G O, x(t_i) as a function of the reference state (`last_state`).
    """
    return gain + (wanted - gain @ rows) @ unbiased


def last_state(A: Matrix, window: float, reference: str) -> Matrix:
    """x(t_i) as a function of the reference state, (n, n): I, or A_d^k for START."""
    return np.asarray(expm(A * window)) if reference == START else np.eye(len(A))
