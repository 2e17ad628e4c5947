"""Linear systems with impulses of unknown times and weights: the formulas.

    x' = A x + B u + b_mid,  x(t_k+) = x(t_k) + H g_k,  y = C x                    (1)-(3)
    xhat' = A xhat + K (y - C xhat) + B u + b_mid,  xhat(t+) = xhat(t) + H g       (4)-(6)

The error of an observer without impulses obeys e' = D e, D = A - K C. Modulating kernels
e^{lambda_i (t - theta)} over a window of length tau turn its output into

    R(t_o) = V(tau) e(t_o) + V(age) H g,      age = t_o + tau - t_k                (Prop. 3.1)

Source: P. Mattsson, A. Medvedev, State estimation in linear time-invariant systems with unknown
impulsive inputs, ECC 2013 (impulse direction B there, jump.H here). Deviations: several outputs
(rows stacked output by output), several directions, known inputs; W and V are integrals, so that
an exponent may equal an eigenvalue of D; the missing direction in (15) is added.

Notation
    D, C, H      (n, n), (p, n), (n, q)
    exponents    Lambda, (m,); rows (output 1: lambda_1..lambda_m; output 2: ...)
    b(age)       V(age) H, (m p, q): what an impulse of weight 1 and this age leaves in R
    E(delta)     what an impulse delta after the start leaves out of W(tau) e(t_o + tau), (14)
"""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Array
from lmi.arithmetic.exponential import expm, exponential_grid
from lmi.arithmetic.units import balance


@dataclass(frozen=True)
class FeatureWindow:
    """Windows of length tau, their features, and the ages in [margin, tau] that are evaluated.

    D (n, n), C (p, n), H (n, q); exponents (m,) are floats; D, C, H floats or exact numbers.
    """

    D: Array
    C: Array
    H: Array
    _: KW_ONLY
    exponents: Array
    tau: float
    margin: float


def feature_scales(exponents: Array, tau: float) -> Array:
    """Factors of the features at run time, (m,): e^{-lambda tau} where lambda > 0, else 1.

    A kernel is then one at most. Unscaled, those of growing exponents drown all others.
    """
    return np.asarray(np.exp(-np.maximum(np.asarray(exponents, float), 0.0) * tau))


def filtered_system(D: Array, C: Array, exponents: Array, scales: Array | None = None) -> Array:
    """F of [v; b]' = F [v; b], v' = D v, b_i' = lambda_i b_i + C v; floats or exact numbers.

    scales (m,): of the features, b_i' = lambda_i b_i + scales_i C v; one by default.

    From [H; 0] it carries e^{D s} H and b(s), from [I; 0] e^{D s} and V(s): no cancellation, and
    nothing special where an exponent is an eigenvalue of D.
    """
    n, p, m = len(D), len(C), len(exponents)
    F = np.full((n + m * p, n + m * p), 0 * D[0, 0], dtype=np.asarray(D).dtype)
    F[:n, :n] = D
    for j in range(p):
        for i in range(m):
            row = n + j * m + i
            F[row, :n], F[row, row] = C[j] if scales is None else scales[i] * C[j], exponents[i]
    return F


def feature_units(F: Array, n: int, time: float) -> Array:
    """Powers of two, (len(F),): units of n states and their features, F in floats.

    States are balanced over the time. A feature's unit is about what states of size one leave in it
    in that time, 1 where that is nothing.
    """
    units = np.ones(len(F))
    if np.isfinite(F).all():
        units[:n] = 1.0 / balance(F[:n, :n] * time)
        shown = np.abs(F[n:, :n] * units[:n]).max(axis=1, initial=0.0) * time
        usable = (shown > 0) & np.isfinite(shown)
        units[n:][usable] = np.exp2(np.round(np.log2(shown[usable])))
    return units


def feature_flows(
    F: Array, n: int, start: float, step: float, count: int, *, units: Array | None = None
) -> Array:
    """First n columns of e^{F s} at s = start, start + step, ..., (count, len(F), n)."""
    if units is None:
        units = feature_units(F, n, abs(start) + abs(step) * count)
    return _flowing(F, np.eye(n), start, step, count, units=units)


def feature_flows_at(F: Array, n: int, times: Array) -> Array:
    """First n columns of e^{F s} at any times s >= 0, (k, len(F), n), in units of their own."""
    units = feature_units(F, n, float(np.max(times, initial=0.0)))
    flows = expm(F * units / units[:, None] * times[:, None, None])[:, :, :n]
    return np.asarray(flows * (units[:, None] / units[:n]))


def impulse_responses(
    F: Array, H: Array, step: float, count: int, *, units: Array | None = None
) -> Array:
    """[e^{D s} H; b(s)] at s = 0, step, ..., (count, n + m p, q); units: as `feature_flows`."""
    if units is None:
        units = feature_units(F, len(H), abs(step) * count)
    return _flowing(F, H, 0.0, step, count, units=units)


def _flowing(F: Array, H: Array, start: float, step: float, count: int, *, units: Array) -> Array:
    """e^{F s} [H; 0] at s = start, start + step, ..., (count, len(F), q).

    In units of their own meanwhile, `feature_units`: those of x, y and time cost no digits, and a
    record times a power of two leaves the same features times it, bit for bit.
    """
    n, columns = len(H), np.zeros((len(F), H.shape[1]))
    with np.errstate(over="ignore", invalid="ignore"):  # beyond floats: infinite, as in the grid
        columns[:n] = H / units[:n, None]
        scaled = F * units / units[:, None]
        flows = exponential_grid(scaled.T, start, step, count, left=columns.T)
        return np.asarray(flows.transpose(0, 2, 1) * units[:, None])


def window_matrix(
    D: Array, C: Array, exponents: Array, tau: float, scales: Array | None = None
) -> Array:
    """V(tau) = W(tau) e^{D tau}, (m p, n), rows times `scales`."""
    n = len(D)
    F = filtered_system(D, C, exponents, scales)
    return feature_flows(F, n, tau, 0.0, 1)[0, n:]


def neglected_ratio(window: FeatureWindow, count: int = 200) -> tuple[float, float]:
    """(max |E_i| / |b_i|, age) over ages in [margin, tau], rows and directions, on a grid.

    Row i of E(tau - age) = (W(tau) - W(age)) e^{D age} H, without the difference (App. I), is
    e^{lambda_i age} C int_0^{tau - age} e^{(lambda_i - D) u} du H.

    Floats: a number to choose by (Prop. 3.2); infinite where some b_i has a zero.
    """
    D, C, H, margin = window.D, window.C, window.H, window.margin
    n = len(D)
    F, step = filtered_system(D, C, window.exponents), (window.tau - margin) / (count - 1)
    ages = np.linspace(margin, window.tau, count)
    b = (feature_flows(F, n, margin, step, count) @ H)[:, n:]
    parts = []
    for lam in np.asarray(window.exponents, float).tolist():
        block = np.zeros((2 * n, 2 * n))
        block[:n, :n], block[:n, n:] = lam * np.eye(n) - D, np.eye(n)
        inner = exponential_grid(block, 0.0, step, count)[::-1, :n, n:] @ H  # up to tau - age
        parts.append(np.exp(lam * ages)[:, None, None] * (C @ inner))
    E = np.stack(parts, axis=2).reshape(count, -1, H.shape[1])
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.abs(E) / np.abs(b)
    ratio = np.where(np.isnan(ratio), math.inf, ratio)
    crossed = (np.sign(b[1:]) * np.sign(b[:-1]) < 0).any(axis=(1, 2))
    worst = ratio.max(axis=(1, 2))
    worst[1:][crossed] = math.inf
    k = int(np.argmax(worst))
    return float(worst[k]), float(ages[k])


def kernel_weights(exponents: Array, steps: ArrayLike) -> tuple[Array, Array]:
    """(newer, older): int_0^h e^{lambda (h - v)} e(v) dv for e linear from older to newer.

    steps: one h, or any array of them; each result has its shape, and (m,) behind it. With
    z = lambda h: newer = h phi_2(z), older = h (phi_1(z) - phi_2(z)).
    """
    h = np.asarray(steps, float)[..., None]
    z = np.asarray(exponents, float) * h
    with np.errstate(divide="ignore", invalid="ignore"):
        first = np.where(z == 0, 1.0, np.expm1(z) / z)
        second = (first - 1.0) / z
    series = sum(z**k / math.factorial(k + 2) for k in range(12))
    second = np.where(np.abs(z) < 0.3, series, second)
    return h * second, h * (first - second)


def window_taps(exponents: Array, times: Array) -> Array:
    """Psi, (N + 1, m): R_i = sum_k Psi_ki e(t_k) for e linear between the times of a window.

    Product integration: the kernel is exact, only e between two samples is interpolated.
    """
    steps = np.diff(times)
    lams = np.asarray(exponents, float)
    to_end = np.exp(lams * (times[-1] - times[1:])[:, None])  # from the newer end of each cell
    taps = np.zeros((len(times), len(lams)))
    newer, older = kernel_weights(lams, steps)
    taps[1:] += newer * to_end
    taps[:-1] += older * to_end
    return taps
