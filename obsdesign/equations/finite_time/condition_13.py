"""Error bounds of observer (14): Theorem 1 as repaired, longest period of condition (13).

Source: F. Mazenc, S. Ahmed, MICNON 2018, (10)-(13), with the errata of docs/papers.md:

    |xhat - x| <= alpha |int e^{A (t_i - m - T)} delta| + beta |T~| + gamma Sigma T_Delta,
    t_i >= T,  if  max(a Sigma, m Gbar) < 1                                                (13)

Notation
    a, m, f      |e^{-F T}|, |M_T^{-1}|, |F|  (spectral norms);  size_A, size_LC: |A|, |L C|
    s            |L C| (e^{nu |A|} - 1), which bounds mu
Scalars are floats or balls: numpy's exp and expm1 ask a ball for its own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Array, Number
from lmi.arithmetic.exponential import expm
from obsdesign.equations.finite_time.formulas import difference_block


@dataclass(frozen=True)
class Constants:
    """Sigma, Gbar of (10), alpha, beta (11), gamma (12), and the two numbers of (13)."""

    sigma: Number
    gbar: Number
    alpha: Number
    beta: Number
    gamma: Number
    first: Number
    second: Number


def flow_growth(f: Number, T: Number) -> Number:
    """(e^{2 f T} - 1) / (2 f): the integral in Lemma 2; T, its limit, where F = 0."""
    if f == 0:
        return T
    return np.expm1(2 * f * T) / (2 * f)


def sigma(T: Number, f: Number, s: Number) -> Number:
    """Sigma(T, nu) = G(T, s) of (10)."""
    g = flow_growth(f, T)
    return s * np.exp(T * f) * g * np.exp(s * g)


def log_sigma(T: Number, f: Number, s: Number) -> Number:
    """log Sigma, which is finite where Sigma overflows. s > 0."""
    g = flow_growth(f, T)
    return np.log(s) + T * f + np.log(g) + s * g


def tighter_sigma(T: Number, f: Number, s: Number) -> Number:
    """Bound |phi - e^{F t}| for t <= T by e^{f T} (e^{s T} - 1), never above Sigma.

    The Dyson series bounds it directly; Lemma 2 bounds its square by Gronwall's inequality.
    """
    return np.exp(f * T) * np.expm1(s * T)


def log_tighter_sigma(T: Number, f: Number, s: Number) -> Number:
    """Logarithm of `tighter_sigma`. s > 0."""
    return f * T + np.log(np.expm1(s * T))


def constants(a: Number, m: Number, sigma_value: Number) -> Constants:
    """Constants of (10)-(12), defined where both numbers of (13) are below one."""
    first = a * sigma_value  # (13)
    gbar = a * first / (1 - first)  # (10)
    second = m * gbar  # (13)
    alpha = m * second / (1 - second)  # (11)
    beta = a * alpha + (m + alpha) * gbar  # (11)
    gamma = (m + alpha) * (a + gbar)  # (12)
    return Constants(sigma_value, gbar, alpha, beta, gamma, first, second)


def largest_sigma(a: Number, m: Number) -> Number:
    """Bound of Sigma below which both parts of (13) hold, and only there."""
    return 1 / (a * (1 + m * a))


def transformed_plant(S: Array, A: Array, C: Array, L: Array) -> tuple[Array, Array, Array]:
    """A, C, L for the states S x: S A S^-1, C S^-1, S L. LinAlgError if S is singular."""
    back = np.linalg.solve(S.T, np.vstack([S @ A, C]).T).T
    return back[: len(A)], back[len(A) :], S @ L


def approx_log_longest_period(
    A: Array, C: Array, L: Array, T: float, S: Array | None = None, *, tighter: bool = False
) -> float:
    """log of the period below which (13) holds, -inf where M_T is singular; inf if A = 0.

    nu_max = log(1 + u / (g |L C|)) / |A|, u e^u = Sigma* e^{-f T}: in logarithms, as e^{2 f T}
    overflows where the period is still a number. S: for the states S x; tighter: with
    `tighter_sigma` in place of Sigma. Floats, no proof.
    """
    if S is not None:
        try:
            A, C, L = transformed_plant(S, A, C, L)
        except np.linalg.LinAlgError:
            return -math.inf
    LC = L @ C
    if not (np.isfinite(A).all() and np.isfinite(LC).all()):
        return -math.inf
    size_A, size_LC, f = np.linalg.svd(np.array([A, LC, A + LC]), compute_uv=False)[:, 0]
    if size_A == 0.0:
        return math.inf
    if size_LC == 0.0 or not T > 0:
        return -math.inf
    block = difference_block(A, LC / size_LC)
    n = len(A)
    block[:n, :n] = -(A + LC)
    whole = expm(block * T)
    if not np.isfinite(whole).all():
        return -math.inf
    values_F, values_M = np.linalg.svd(np.array([whole[:n, :n], whole[:n, n:]]), compute_uv=False)
    if values_M[-1] <= 1e-300 or values_F[0] <= 1e-300:  # beyond what floats hold
        return -math.inf
    log_a = math.log(values_F[0])
    log_ma = log_a - math.log(values_M[-1]) - math.log(size_LC)
    log_sigma = -log_a - np.logaddexp(0.0, log_ma)
    if tighter:
        exponent = log_sigma - f * T
        inner = math.log(np.logaddexp(0.0, exponent)) if exponent > -700 else exponent
        return _log_of_period(inner - math.log(T) - math.log(size_LC), size_A)
    log_g = math.log(T) if f == 0.0 else 2 * f * T + math.log(-math.expm1(-2 * f * T) / (2 * f))
    return _log_of_period(log_lambert(log_sigma - f * T) - log_g - math.log(size_LC), size_A)


def _log_of_period(log_ratio: float, size_A: float) -> float:
    """log (log(1 + ratio) / |A|)."""
    if log_ratio < -36:  # log1p changes nothing any more
        return log_ratio - math.log(size_A)
    return math.log(np.logaddexp(0.0, log_ratio)) - math.log(size_A)


def log_lambert(log_z: float) -> float:
    """log u for u e^u = z: Newton's method on w + e^w = log z, from above its root."""
    w = log_z if log_z < 0 else math.log(max(log_z, 0.5))
    for _ in range(50):
        change = (w + math.exp(w) - log_z) / (1 + math.exp(w))
        w -= change
        if abs(change) <= 1e-15 * max(1.0, abs(w)):
            break
    return w


def enclosed_longest_period(
    a: Number, m: Number, f: Number, sizes: tuple[Number, Number], T: Number
) -> Number:
    """Longest period of (13) in balls, which do not overflow; sizes: (|A|, |L C|), positive."""
    u = (largest_sigma(a, m) * np.exp(-(f * T))).lambertw()
    return np.log1p(u / (flow_growth(f, T) * sizes[1])) / sizes[0]


def enclosed_tighter_period(
    a: Number, m: Number, f: Number, sizes: tuple[Number, Number], T: Number
) -> Number:
    """Longest period with `tighter_sigma`: log(1 + log(1 + Sigma* e^{-f T}) / (T |L C|)) / |A|."""
    inner = np.log1p(largest_sigma(a, m) * np.exp(-(f * T)))
    return np.log1p(inner / (T * sizes[1])) / sizes[0]
