"""The state after a fixed time from periodic samples: gains of the four methods.

    x'(t) = A x + B u + b,     y_j = C x(t_j) + v_j,   t_j = t_0 + j nu
    xhat(t_i) = sum_j G_j y_{i-k+j},   j = 0..k-1,     T = k nu           (known inputs taken off)

G is unbiased, and the estimate exact, when sum_j G_j C A_d^(j-k) = I. Every method but
`approximate` is unbiased. Source: F. Mazenc, S. Ahmed, Finite Time Estimation via Piecewise
Constant Measurements, MICNON 2018. Deviations, with reasons in docs/papers.md: the right-hand side
of (9) holds the unknown x(t - T) and becomes an observer only together with (16); Phi over one
period is a constant matrix and is computed.

Notation
    nu, k, T    period, samples in the window, window k nu;  A_d = e^{A nu}
    F           A + L C (this paper's sign)
    M_T         e^{-A T} - e^{-F T}, (2)
    P, K_d      Phi^{-1} over one period and its discrete gain: P = A_d + K_d C
    W           sum_j P^(k-1-j) K_d y_j is what (9) makes of the samples
Matrices are float arrays, or object arrays of ball numbers where a proof needs them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from lmi.arithmetic.arrays import Array, Number
from lmi.arithmetic.exponential import exponential_grid

# the norm of the generator times a step of the series below, and the terms it is summed to
_SERIES_STEP, SERIES_TERMS = 0.5, 36
_MOST_STEPS = 500
# least |L C| relative to |A| that a search may use: smaller ones gain nothing and lose digits
SMALLEST_GAIN = 1e-6


# --- gains ----------------------------------------------------------------------------------------


def discrete_injection(
    A: Array,
    C: Array,
    L: Array,
    h: Number,
    steps: Sequence[tuple[Array, Number]],
    *,
    count: int = SERIES_TERMS,
) -> Array:
    """K, (n, p), of one period: P = A_d (I + K C) is Phi^{-1} over it, K_d = A_d K.

    X' = e^{-A s} L (I + C X), X(0) = 0, K = X(nu), by Taylor series over equal steps h:
    x_{m+1} = h / (m + 1) sum_j b_j z_{m-j}, b_j = (-A h)^j L / j!, z_0 = I, z_m = C x_m.
    (In the paper's terms I + C X(s) = Z(s), which for one output is exp(C W(s) L).)

    steps: for each of them e^{-A s} at its start s, and what the series leaves out, a ball around
    zero (`series_remainder`) or 0; count: terms of the series.
    """
    p = L.shape[1]
    unit = np.eye(p, dtype=np.int64)
    b = [L]
    for j in range(1, count):
        b.append(-(A @ b[-1]) * h / j)
    all_b = np.hstack(b)
    total = 0 * L
    for back, remainder in steps:
        output = C @ back
        z = unit  # z_m over z_{m-1} over ... over z_0
        change = 0 * L + remainder
        for m in range(count):
            term = all_b[:, : p * (m + 1)] @ z * h / (m + 1)
            change = change + term
            z = np.vstack([output @ term, z])
        total = total + back @ (change @ (unit + C @ total))
    return total


def series_steps(A: Array, C: Array, L: Array, period: float) -> int:
    """Number of steps of `discrete_injection` for which its series converges quickly."""
    output = C @ exponential_grid(-A, 0.0, period / 16, 17)
    largest = float(np.linalg.norm(output, axis=(1, 2)).max())
    size = float(np.linalg.norm(A, 2) + np.linalg.norm(L, 2) * largest) * period
    if not size <= _MOST_STEPS * _SERIES_STEP:
        return _MOST_STEPS
    return max(1, math.ceil(size / _SERIES_STEP))


def series_remainder(
    size_A: Number, size_L: Number, size_C: Number, h: Number, count: int
) -> Number:
    """Bound the remainder of the series of one step.

    size_A, size_L: norms; size_C: bound of |C e^{-A s}|.

    Cauchy's estimate on |s| <= 4 h: a coefficient times h^m is below X(4 h) 4^-m, where
    X(s) = a e^{size_C a}, a = s |L| e^{s |A|}, solves the scalar majorant.
    """
    a = 4 * h * size_L * np.exp(4 * h * size_A)
    return a * np.exp(size_C * a) / 4**count


def exact_terms(P: Array, K_d: Array, k: int) -> Array:
    """Weights W_j = P^(k-1-j) K_d, j = 0..k-1, (k, n, p), of the samples in (9).

    With N = sum_j W_j C A_d^(j-k), which is (P^k - A_d^k) A_d^-k, (9) and (16) together are
    N x(t_i) = sum_j W_j y_j: no unknown is left, and no condition (13) is needed.
    """
    return _powers_times(P, K_d, k)[::-1]


def approximate_terms(back: Array, weighted: Array, k: int) -> Array:
    """e^{-F (j+1) nu} Gam_F L, j = 0..k-1, (k, n, p): M_T xhat = sum_j of them y_j, (14).

    back = e^{-F nu}; weighted = e^{-F nu} Gam_F L with Gam_F = int_0^nu e^{F s} ds.
    """
    return _powers_times(back, weighted, k)


def _powers_times(X: Array, Y: Array, k: int) -> Array:
    terms = [Y]
    for _ in range(k - 1):
        terms.append(X @ terms[-1])
    return np.array(terms)


def window_matrix(terms: Array) -> Array:
    """(k, n, p) -> (n, k p): gains as one matrix that multiplies the window, oldest first."""
    k, n, p = terms.shape
    return terms.transpose(1, 0, 2).reshape(n, k * p)


def difference_block(A: Array, LC: Array) -> Array:
    """B with e^{B T} = [[e^{-F T}, M_T], [0, e^{-A T}]]: M_T without a difference.

    M_T = e^{-A T} - e^{-F T} = int_0^T e^{-F (T - s)} L C e^{-A s} ds; the difference itself loses
    all digits when L C is small.
    """
    zero = 0 * A
    return np.block([[-(A + LC), LC], [zero, -A]])
