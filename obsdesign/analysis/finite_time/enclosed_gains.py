"""Finite-time estimation in ball arithmetic: the paper's matrices and gains, enclosed.

Used by synthesis, which rounds the enclosures to what a design stores, and by verification, which
compares. Inputs are the stored binary64 numbers, exactly; T is k nu. Results are object arrays of
balls at the current precision (`lmi.arithmetic.balls.precision`). Formulas:
`equations.finite_time`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np

from lmi.arithmetic.balls import (
    Exact,
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
from obsdesign.equations.finite_time import gains as equations

# eighths of a term of the series per bit: each is about a quarter of the one before
_TERMS_PER_BIT = 3
# ball multiplications (twice) of one `injection`: a few seconds
_MOST_WORK = 3e7


@dataclass(frozen=True)
class Sampled:
    """A, C (exact rationals) and one period: A_d, A_d^-1 as balls; k samples in the window.

    reference: does the window speak of x(t_i), or of x(t_i - T)? The balls have the precision in
    force at their first use.
    """

    A: Exact
    C: Exact
    period: float
    k: int
    reference: str = equations.END

    @staticmethod
    def of(A: Any, C: Any, period: float, k: int, reference: str = equations.END) -> Sampled:
        """From the numbers of a plant."""
        return Sampled(exact(A), exact(C), period, k, reference)

    @cached_property
    def forward(self) -> Exact:
        """A_d = e^{A nu}; one exponential of balls is most of the work on a large plant."""
        return entries(exp_times(self.A, self.period))

    @cached_property
    def back(self) -> Exact:
        """A_d^-1."""
        return entries(exp_times(-self.A, self.period))

    def rows(self) -> Exact:
        """C A_d^(j-k), or C A_d^j, j = 0..k-1, (k p, n)."""
        return self._rows

    def last(self) -> Exact:
        """What x(t_i) is of the reference: I, or A_d^k."""
        return self._last

    @cached_property
    def _rows(self) -> Exact:
        if self.reference == equations.START:
            unit = entries(identity(len(self.A)))
            stack = equations.stacked_rows(self.C @ unit, self.forward, self.k)
        else:
            stack = equations.stacked_rows(self.C @ self.back, self.back, self.k)[::-1]
        return stack.reshape(-1, len(self.A))

    @cached_property
    def _last(self) -> Exact:
        if self.reference == equations.START:
            return exponential(self.A, self.period, self.k)
        return entries(identity(len(self.A)))

    def units(self) -> Exact:
        """Units of the states for this window, exact powers of two (`state_scales`)."""
        A, C = to_float(self.A), to_float(self.C)
        return exact(equations.state_scales(A, C, self.k * self.period))


def exponential(A: Exact, period: float, k: int = 1) -> Exact:
    """e^{A k nu}, enclosed; k nu is the exact product."""
    return entries(exp_times(A * rational(float(k)), period))


def difference_matrix(sampled: Sampled, L: Any) -> tuple[Exact, Exact]:
    """(M_T / scale, e^{-F T}), enclosed; the scale is `gain_scale`."""
    n = len(sampled.A)
    LC = exact(L) @ sampled.C
    block = equations.difference_block(sampled.A, LC)
    block[:n, n:] = block[:n, n:] / gain_scale(sampled, L)
    whole = exponential(block, sampled.period, sampled.k)
    return whole[:n, n:], whole[:n, :n]


def approximate_gain(sampled: Sampled, L: Any) -> Exact | None:
    """Gains (n, k p) of (14) for samples of a plant without known inputs; None if M_T may be 0."""
    n = len(sampled.A)
    L_exact = exact(L)
    scale = gain_scale(sampled, L)
    M, _ = difference_matrix(sampled, L)
    F = sampled.A + L_exact @ sampled.C
    block = np.block([[-F, exact(np.eye(n))], [exact(np.zeros((n, 2 * n)))]])
    whole = exponential(block, sampled.period)  # [[e^{-F nu}, int_0^nu e^{-F s} ds], ...]
    weighted = whole[:n, n:] @ (L_exact / scale)
    terms = equations.approximate_terms(whole[:n, :n], weighted, sampled.k)
    return solve_entries(M, equations.side_by_side(terms))


def exact_matrix(sampled: Sampled, L: Any) -> tuple[Exact, Exact] | None:
    """(N, W) with N xhat = W y, of (9) with (16): see `equations.exact_terms`.

    N is P^k - A_d^k, times A_d^-k where the reference is the window's end, both over the size of
    L. None where enclosing them is beyond `_MOST_WORK`.
    """
    n = len(sampled.A)
    K = injection(sampled, L)
    if K is None:
        return None
    K_d = sampled.forward @ K
    P = sampled.forward + K_d @ sampled.C
    W = equations.side_by_side(equations.exact_terms(P, K_d / gain_scale(sampled, L), sampled.k))
    return (W @ sampled.rows()).reshape(n, n), W


def exact_gain(sampled: Sampled, L: Any) -> Exact | None:
    """Gains (n, k p) of (9) with (16); None if N may be singular, or is not known."""
    pair = exact_matrix(sampled, L)
    found = None if pair is None else solve_entries(*pair)
    return None if found is None else sampled.last() @ found


def half_period(sampled: Sampled) -> Any:
    """e^{A nu / 2}, enclosed."""
    return entries(exp_times(sampled.A * rational(0.5), sampled.period))


def injection(sampled: Sampled, L: Any) -> Exact | None:
    """K of one period; the rest of its series is in the balls. None if that is too much work.

    In units in which all states are seen about equally well: its steps depend on norms.
    """
    units = sampled.units()
    A, C = sampled.A * units / units[:, None], sampled.C * units
    K = _injection(
        *(_Key(X.shape, tuple(X.flat)) for X in (A, C, exact(L) / units[:, None])),
        sampled.period, working_bits(),
    )  # fmt: skip
    return None if K is None else K * units[:, None]


class _Key(NamedTuple):
    """An exact matrix that can be remembered."""

    shape: tuple[int, ...]
    values: tuple[Any, ...]

    def matrix(self) -> Exact:
        found = np.empty(len(self.values), dtype=object)
        found[:] = self.values
        return found.reshape(self.shape)


@lru_cache(maxsize=8)  # a design asks for the same one several times
def _injection(of_A: _Key, of_C: _Key, of_L: _Key, period: float, bits: int) -> Exact | None:
    A_exact, C_exact, L_exact = of_A.matrix(), of_C.matrix(), of_L.matrix()
    A, C, gain = (to_float(X) for X in (A_exact, C_exact, L_exact))
    m = equations.series_steps(A, C, gain, period)
    count = max(equations.SERIES_TERMS, _TERMS_PER_BIT * bits // 8)
    if m * L_exact.size * len(C) * count**2 > _MOST_WORK:
        return None
    h = rational(period) / m
    step = entries(exp_times(-A_exact / rational(float(m)), period))
    backs = [entries(identity(len(A)))]
    for _ in range(m - 1):
        backs.append(backs[-1] @ step)
    sizes = (_size(A_exact), _size(L_exact))
    reaches = [_size(C_exact @ back) for back in backs]
    rests = [equations.series_rest(*sizes, reach, scalar(h), count) for reach in reaches]
    steps = [(back, around_zero(rest)) for back, rest in zip(backs, rests, strict=True)]
    return equations.discrete_injection(A_exact, C_exact, L_exact, scalar(h), steps, count)


def _size(X: Exact) -> Any:
    """Ball of the Frobenius norm, which is above the spectral one."""
    values: list[Any] = list(X.flat)
    return scalar(sum(x * x for x in values)).sqrt()


def gain_scale(sampled: Sampled, L: Any) -> Any:
    """A power of two, exactly, about as large as L C; 1 if it is zero.

    Beside the plant's own entries those of a small L C would drown in the radius of a ball.
    """
    LC = exact(L) @ sampled.C
    largest = max(abs(x) for x in LC.flat)
    if largest == 0:
        return rational(1.0)
    return rational(2.0) ** (int(largest.p).bit_length() - int(largest.q).bit_length())
