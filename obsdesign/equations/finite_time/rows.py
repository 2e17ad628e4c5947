"""What the samples of a window say of the state, and the gains that least squares make of it.

Rows are C A_d^(j-k), of x(t_i), or C A_d^j, of x(t_i - T): one of them is good where modes decay or
grow by many digits over the window. Notation as in `finite_time`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.exponential import expm, exponential_grid

Array = NDArray[Any]

# which state a bias is measured against, and rows are written in: x(t_i) or x(t_i - T)
END, START = "end", "start"
REFERENCES = (END, START)
# largest deviation of G O from what it should be, states in units of `state_scales`: what rounding
# leaves of gains that do not amplify beyond reason
UNBIASED = 1e-8
# what the samples do not see of the window's start is that much of it at its end, at most
DEAD = 1e-11
_ROUNDING = 1e-15


def sample_rows(A: Array, C: Array, period: float, k: int, reference: str = END) -> Array:
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


def state_scales(A: Array, C: Array, window: float) -> Array:
    """Powers of two (n,): states in units in which they are seen about equally well.

    1 / the column norms of C (A T)^j / j!, j < n: what the flow could tell of a state in the
    window. Other units of the states scale along; samples that see less than that are noticed.
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
    scales: Array = np.exp2(-np.round(np.log2(np.where(usable, sizes, 1.0))))
    return scales


def approx_determinacy(rows: Array, scales: Array) -> float:
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


def approx_reach(A: Array, C: Array, period: float, k: int) -> float:
    """How well k samples determine the state: at the window's end or at its start, in floats."""
    scales = state_scales(A, C, k * period)
    stacks = (sample_rows(A, C, period, k, reference) for reference in REFERENCES)
    return max(approx_determinacy(rows.reshape(-1, len(A)), scales) for rows in stacks)


def pathological_pairs(A: Array, period: float) -> list[tuple[complex, complex, float]]:
    """Eigenvalues of A that (almost) coincide after sampling: (one, other, turns between them).

    Kalman, Ho, Narendra: equal real parts and imaginary parts that differ by a multiple of
    2 pi / nu. A warning: several outputs may still see both.
    """
    values = np.linalg.eigvals(A)
    size = max(float(np.abs(values).max(initial=0.0)), 1e-300)
    found = []
    for i, one in enumerate(values):
        for other in values[i + 1 :]:
            turns = abs(one.imag - other.imag) * period / (2 * math.pi)
            same = abs(one.real - other.real) <= 1e-9 * size
            if same and round(turns) > 0 and abs(turns - round(turns)) <= 1e-6 * turns:
                found.append((complex(one), complex(other), float(turns)))
    return found


def least_squares_gain(rows: Array, deviations: Array, cut: float = 0.0) -> Array:
    """Gains (n, m) of the weighted least-squares estimate of the state that rows speak of, by QR.

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


def made_unbiased(gain: Array, rows: Array, unbiased: Array, wanted: Array) -> Array:
    """The gain made unbiased, G + (X - G O) G_0, by a G_0 that is: G_0 O = I. rows: O, (m, n).

    wanted: X = G O, what x(t_i) is of the state that rows speak of (`last_state`).
    """
    return gain + (wanted - gain @ rows) @ unbiased


def last_state(A: Array, window: float, reference: str) -> Array:
    """x(t_i) as a function of x(t_i), or with START of x(t_i - T): I or A_d^k, (n, n)."""
    return np.asarray(expm(A * window)) if reference == START else np.eye(len(A))
