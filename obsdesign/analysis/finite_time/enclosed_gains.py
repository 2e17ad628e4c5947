"""Finite-time estimation in ball arithmetic: the paper's matrices and gains, enclosed.

Used by synthesis, which rounds the enclosures to what a design stores, and by verification, which
compares. Inputs are the stored binary64 numbers, exactly; T is k nu. Results are object arrays of
balls at the current precision (`lmi.arithmetic.balls.precision`). Formulas:
`equations.finite_time`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from lmi.arithmetic.arrays import Array
from lmi.arithmetic.balls import (
    Ball,
    Exact,
    Rational,
    around_zero,
    entries,
    exact,
    exp_times,
    identity,
    rational,
    scalar,
    solve_entries,
    to_float,
    working_bits,
)
from obsdesign.equations.finite_time.formulas import (
    SERIES_TERMS,
    approximate_terms,
    difference_block,
    discrete_injection,
    exact_terms,
    series_remainder,
    series_steps,
    window_matrix,
)
from obsdesign.equations.finite_time.gains import CORRECTED
from obsdesign.equations.finite_time.rows import END, START, stacked_rows, state_scales

# eighths of a term of the series per bit: each is about a quarter of the one before
_TERMS_PER_BIT = 3
# ball multiplications (twice) of one `injection`: a few seconds
_MOST_WORK = 3e7


@dataclass(frozen=True)
class Sampled:
    """A, C (exact rationals) and one period: A_d, A_d^-1 as balls; k samples in the window.

    reference: the rows of the samples are functions of x(t_i) (END) or of x(t_i - T) (START). The
    balls have the precision in force at their first use.
    """

    A: Exact
    C: Exact
    period: float
    k: int
    reference: str = END

    @classmethod
    def from_plant(cls, A: Array, C: Array, period: float, k: int, reference: str = END) -> Sampled:
        """The samples of a plant's output, k of them."""
        return cls(exact(A), exact(C), period, k, reference)

    @cached_property
    def forward(self) -> Exact:
        """A_d = e^{A nu}; one exponential of balls is most of the work on a large plant."""
        return entries(exp_times(self.A, self.period))

    @cached_property
    def back(self) -> Exact:
        """A_d^-1."""
        return entries(exp_times(-self.A, self.period))

    @cached_property
    def rows(self) -> Exact:
        """C A_d^(j-k), or C A_d^j, j = 0..k-1, (k p, n)."""
        if self.reference == START:
            unit = entries(identity(len(self.A)))
            stack = stacked_rows(self.C @ unit, self.forward, self.k)
        else:
            stack = stacked_rows(self.C @ self.back, self.back, self.k)[::-1]
        return stack.reshape(-1, len(self.A))

    @cached_property
    def last(self) -> Exact:
        """x(t_i) as a function of the reference: I, or A_d^k."""
        if self.reference == START:
            return exponential(self.A, self.period, self.k)
        return entries(identity(len(self.A)))

    @cached_property
    def units(self) -> Exact:
        """Units of the states for this window, exact powers of two (`state_scales`)."""
        A, C = to_float(self.A), to_float(self.C)
        return exact(state_scales(A, C, self.k * self.period))

    def in_units(self, X: Exact) -> Exact:
        """A map of the states, (n, n), in these units."""
        scaled: Exact = X * self.units / self.units[:, None]
        return scaled


def exponential(A: Exact, period: float, k: int = 1) -> Exact:
    """e^{A k nu}, enclosed; k nu is the exact product."""
    return entries(exp_times(A * rational(float(k)), period))


def difference_matrix(sampled: Sampled, L: Array) -> tuple[Exact, Exact]:
    """(M_T / scale, e^{-F T}), enclosed; the scale is `gain_scale`."""
    n = len(sampled.A)
    LC = exact(L) @ sampled.C
    block = difference_block(sampled.A, LC)
    block[:n, n:] = block[:n, n:] / gain_scale(sampled, L)
    whole = exponential(block, sampled.period, sampled.k)
    return whole[:n, n:], whole[:n, :n]


def approximate_gain(sampled: Sampled, L: Array) -> Exact | None:
    """Gains (n, k p) of (14) for samples of a plant without known inputs; None if M_T may be 0."""
    n = len(sampled.A)
    L_exact = exact(L)
    scale = gain_scale(sampled, L)
    M, _ = difference_matrix(sampled, L)
    F = sampled.A + L_exact @ sampled.C
    block = np.block([[-F, exact(np.eye(n))], [exact(np.zeros((n, 2 * n)))]])
    whole = exponential(block, sampled.period)  # [[e^{-F nu}, int_0^nu e^{-F s} ds], ...]
    weighted = whole[:n, n:] @ (L_exact / scale)
    terms = approximate_terms(whole[:n, :n], weighted, sampled.k)
    return solve_entries(M, window_matrix(terms))


def exact_matrix(sampled: Sampled, L: Array) -> tuple[Exact, Exact] | None:
    """(N, W) with N xhat = W y, of (9) with (16): see `exact_terms`.

    N is P^k - A_d^k, times A_d^-k where the reference is the window's end, both over the size of
    L. None where enclosing them is beyond `_MOST_WORK`.
    """
    n = len(sampled.A)
    K = injection(sampled, L)
    if K is None:
        return None
    K_d = sampled.forward @ K
    P = sampled.forward + K_d @ sampled.C
    W = window_matrix(exact_terms(P, K_d / gain_scale(sampled, L), sampled.k))
    return (W @ sampled.rows).reshape(n, n), W


def exact_gain(sampled: Sampled, L: Array) -> Exact | None:
    """Gains (n, k p) of (9) with (16); None if N may be singular, or is not known."""
    pair = exact_matrix(sampled, L)
    gain = None if pair is None else solve_entries(*pair)
    return None if gain is None else sampled.last @ gain


def method_gain(sampled: Sampled, L: Array, half_sample: str | None) -> Exact | None:
    """Gains (n, k p) of (14), with its half-sample delay taken off where CORRECTED; else of (9).

    half_sample: that of the design, None for (9) with (16). None where no matrix is invertible.
    """
    if half_sample is None:
        return exact_gain(sampled, L)
    gain = approximate_gain(sampled, L)
    if gain is None or half_sample != CORRECTED:
        return gain
    half_period: Exact = entries(exp_times(sampled.A * rational(0.5), sampled.period))
    corrected: Exact = half_period @ gain
    return corrected


def injection(sampled: Sampled, L: Array) -> Exact | None:
    """K of one period with the remainder of its series; None beyond `_MOST_WORK`.

    In units in which all states are about equally observable: its steps depend on norms.
    """
    units = sampled.units
    A, C = sampled.in_units(sampled.A), sampled.C * units
    K = _injection(
        *(_Key(X.shape, tuple(X.ravel().tolist())) for X in (A, C, exact(L) / units[:, None])),
        sampled.period, working_bits(),
    )  # fmt: skip
    return None if K is None else K * units[:, None]


class _Key(NamedTuple):
    """An exact matrix as a key of the cache."""

    shape: tuple[int, ...]
    values: tuple[Rational, ...]

    def matrix(self) -> Exact:
        flat = np.empty(len(self.values), dtype=object)
        flat[:] = self.values
        return flat.reshape(self.shape)


@lru_cache(maxsize=8)  # a design needs the same one several times
def _injection(A_key: _Key, C_key: _Key, L_key: _Key, period: float, bits: int) -> Exact | None:
    A_exact, C_exact, L_exact = A_key.matrix(), C_key.matrix(), L_key.matrix()
    A, C, gain = (to_float(X) for X in (A_exact, C_exact, L_exact))
    m = series_steps(A, C, gain, period)
    count = max(SERIES_TERMS, _TERMS_PER_BIT * bits // 8)
    if m * L_exact.size * len(C) * count**2 > _MOST_WORK:
        return None
    h = rational(period) / m
    step = entries(exp_times(-A_exact / rational(float(m)), period))
    backs = [entries(identity(len(A)))]
    for _ in range(m - 1):
        backs.append(backs[-1] @ step)
    sizes = (frobenius(A_exact), frobenius(L_exact))
    sizes_C = [frobenius(C_exact @ back) for back in backs]
    remainders = [series_remainder(*sizes, size_C, scalar(h), count) for size_C in sizes_C]
    steps = [(back, around_zero(x)) for back, x in zip(backs, remainders, strict=True)]
    return discrete_injection(A_exact, C_exact, L_exact, scalar(h), steps, count=count)


def frobenius(X: Exact) -> Ball:
    """Ball of the Frobenius norm, which is above the spectral one."""
    return scalar(sum(x * x for x in X.ravel().tolist())).sqrt()


def gain_scale(sampled: Sampled, L: Array) -> Rational:
    """A power of two, exactly, about as large as L C; 1 if it is zero.

    Without it the entries of a small L C would be below the radius of a ball.
    """
    LC = exact(L) @ sampled.C
    largest = max(abs(x) for x in LC.flat)
    if largest == 0:
        return rational(1.0)
    return rational(2.0) ** (int(largest.p).bit_length() - int(largest.q).bit_length())
