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
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.exponential import expm, exponential_grid, flow_integrals

Array = NDArray[Any]

# |mu| h of the modes of A - K C, and |lambda| h, up to which integrals of samples show an impulse:
# measured over random plants, where impulses were missed from 0.56 on in windows longer than LONG
# time constants of the slowest mode, from 1.28 on in others
_FASTEST, _FASTEST_LONG, LONG, STEEPEST = 0.7, 0.4, 7.0, 12.0
# rule "position": age from which an impulse is evaluated, of the window
OLD = 0.7
# rule "peak": where the peak of |b| must lie, of the window, and how far |b| must fall to its end
_LATEST_PEAK, _FALLEN = 0.9, 0.98
# what is measured and its noise are squared, and multiplied by gains
LARGEST, SMALLEST = 1e100, 1e-100
# squares of what an impulse makes of y are multiplied with each other
_FAINTEST = 1e-70
OPERATORS = ("integral", "samples")
WEIGHTINGS = ("plain", "gls")
RULES = ("peak", "position", "threshold")


def objection(plant: Any) -> str | None:
    """What forbids an observer of this kind for a plant, or None; one sentence."""
    if plant.jump is None or plant.jump.H is None:
        return None  # a missing block: the caller asks for it
    return plant_objection(plant) or size_objection(plant)


def plant_objection(plant: Any) -> str | None:
    """What else than impulses happens at jumps, or None; one sentence. plant: with jumps."""
    if not np.array_equal(plant.jump.G, np.eye(len(plant.flow.A))):
        return (
            "jump.G must be the identity for kind 'impulsive_input': impulses add to the state at "
            "unknown times, and nothing else may happen then. Leave jump.G out."
        )
    if plant.jump.E is not None:
        return (
            "jump.E is refused by kind 'impulsive_input': jump times are unknown, so that no known "
            "input can act at them."
        )
    return None


def size_objection(plant: Any) -> str | None:
    """Which number of a plant floats cannot square, or None; one sentence."""
    output = plant.output
    entries = {
        "flow.A": plant.flow.A, "jump.H": plant.jump.H, "output.C": output.C,
        "output.noise_std": output.noise_std, "output.noise_cv": output.noise_cv,
    }  # fmt: skip
    for name, values in entries.items():
        sizes = np.abs(values[values != 0])
        least = SMALLEST if "noise" in name else 0.0
        wrong = sizes[(sizes > LARGEST) | (sizes < least)]
        if len(wrong):
            allowed = (
                f"0, or between {least:g} and {LARGEST:g}" if least else f"at most {LARGEST:g}"
            )
            return (
                f"{name} must be {allowed} in size for kind 'impulsive_input', which squares it; "
                f"got {wrong[0]:g}. Are the units what they should be?"
            )
        if name in ("output.C", "jump.H") and 0 < sizes.max(initial=0.0) < _FAINTEST:
            return (
                f"{name} must be 0, or at least {_FAINTEST:g} in size for kind 'impulsive_input', "
                f"which squares it; got {sizes.max():g}. Are the units what they should be?"
            )
    return None


def feature_scales(exponents: Array, tau: float) -> Array:
    """What features are multiplied by at run time, (m,): e^{-lambda tau} where lambda > 0, else 1.

    A kernel is then one at most. Unscaled, those of growing exponents drown all others.
    """
    return np.asarray(np.exp(-np.maximum(np.asarray(exponents, float), 0.0) * tau))


def is_positive(value: Any) -> bool:
    """A positive, finite number."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return number and value > 0 and math.isfinite(value)


def are_exponents(value: Any) -> bool:
    """A list of one or more distinct, finite numbers."""
    try:
        found = np.asarray(value)
    except ValueError:
        return False
    if found.ndim != 1 or found.dtype.kind not in "fi" or len(found) == 0:
        return False
    return bool(np.isfinite(found).all()) and len(set(found.tolist())) == len(found)


def samples_objection(plant: Any, gains: Any) -> str | None:
    """What forbids gains of operator `samples`, or None; one sentence."""
    period, window = plant.output.period, gains["window"]
    if plant.output.measured != "periodic" or not is_positive(period):
        return "output.measured must be 'periodic' for operator 'samples'"
    count = float(window) / float(period)
    if abs(count - round(count)) > 1e-6 or round(count) < 1:
        return f"gains.window must be a multiple of output.period = {period!r}; got {window!r}"
    if gains.get("weighting") != "gls":
        return "gains.weighting must be 'gls' for operator 'samples'"
    if plant.jump.H.shape[1] != 1:
        return "jump.H must have one column for operator 'samples'"
    return None


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


def impulse_responses(F: Array, H: Array, step: float, count: int) -> Array:
    """[e^{D s} H; b(s)] at s = 0, step, ..., (count, n + m p, q)."""
    return exponential_grid(F, 0.0, step, count)[:, :, : len(H)] @ H


def has_peak(F: Array, H: Array, tau: float, margin: float, count: int = 400) -> bool:
    """Does |b(age)| rise to one maximum at an age in (margin, tau) and fall from there? On a grid.

    Then the maximum of |R| tells when to evaluate an impulse, whatever its weight (Section IV). It
    must have come and gone before the impulse leaves the window, when |R| may rise again.
    """
    if H.shape[1] > 1:
        return False  # where the maximum is depends on the weights
    size = np.linalg.norm(impulse_responses(F, H, tau / count, count + 1)[:, len(H) :, 0], axis=1)
    top = int(np.argmax(size))
    rising, falling = np.diff(size[: top + 1]), np.diff(size[top:])
    inside = margin < top * tau / count <= _LATEST_PEAK * tau and size[-1] < _FALLEN * size[top]
    return bool(inside and (rising > 0).all() and (falling < 0).all())


def operator_matrix(D: Array, C: Array, exponents: Array, tau: float) -> Array:
    """W(tau), (m p, n): row (j, i) is C_j p(lambda_i, tau, D).

    p(lambda, tau, D) = int_0^tau e^{(lambda - D) u} du, after (11); finite for every lambda.
    """
    parts = [
        C @ flow_integrals(lam * np.eye(len(D)) - D, tau)[1] for lam in np.asarray(exponents, float)
    ]
    stacked = np.stack(parts, axis=1)  # (p, m, n)
    return stacked.reshape(-1, len(D))


def window_matrix(
    D: Array, C: Array, exponents: Array, tau: float, scales: Array | None = None
) -> Array:
    """V(tau) = W(tau) e^{D tau}, (m p, n), rows times `scales`."""
    n = len(D)
    return expm(filtered_system(D, C, exponents, scales) * tau)[n:, :n]


def neglected_part(D: Array, C: Array, H: Array, exponents: Array, tau: float, age: float) -> Array:
    """E(tau - age) = (W(tau) - W(age)) e^{D age} H, (m p, q), without the difference (App. I).

    Row i: e^{lambda_i age} C int_0^{tau - age} e^{(lambda_i - D) u} du H.
    """
    inner = operator_matrix(D, C, exponents, tau - age) @ H
    return np.exp(np.tile(np.asarray(exponents, float), len(C)) * age)[:, None] * inner


def neglected_ratio(
    D: Array, C: Array, H: Array, exponents: Array, tau: float, margin: float, count: int = 200
) -> tuple[float, float]:
    """(max |E_i| / |b_i|, age) over ages in [margin, tau] and all rows and directions, on a grid.

    Floats: a number to choose by (Prop. 3.2); infinite where some b_i has a zero.
    """
    n = len(D)
    F, step = filtered_system(D, C, exponents), (tau - margin) / (count - 1)
    ages = np.linspace(margin, tau, count)
    b = (exponential_grid(F, margin, step, count)[:, :, :n] @ H)[:, n:]
    parts = []
    for lam in np.asarray(exponents, float).tolist():
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


def kernel_weights(exponents: Array, steps: Any) -> tuple[Array, Array]:
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


def fastest_limit(long: bool) -> float:
    """What the fastest mode of A - K C times the period may be for an integral operator.

    long: the window is longer than LONG time constants of its slowest mode.
    """
    return _FASTEST_LONG if long else _FASTEST


def longest_period(D: Array, exponents: Array | None, window: float) -> float:
    """The longest period at which integrals of samples show an impulse; floats.

    Beyond it an impulse is not recognised at its age, and missed: what the residual does between
    two samples differs too much from a line.
    """
    modes = np.linalg.eigvals(D)
    long = float(-modes.real.max()) * window > LONG
    fastest = float(np.abs(modes).max(initial=0.0))
    found = fastest_limit(long) / fastest if fastest > 0 else math.inf
    steepest = 0.0 if exponents is None else float(np.abs(exponents).max())
    return min(found, STEEPEST / steepest) if steepest > 0 else found


def rounded_down(value: float) -> float:
    """Three digits of a positive number, never more than it."""
    digits = 10.0 ** (2 - math.floor(math.log10(value)))
    return float(f"{math.floor(value * digits * (1 - 1e-12)) / digits:.3g}")


def jump_share(A: Array, C: Array, H: Array, window: float, count: int = 200) -> float:
    """How much of its largest output within a window an impulse shows at once, 0 to 1; floats.

    The least over the directions, for the output that jumps most.
    """
    shown = np.abs(C @ exponential_grid(A, 0.0, window / count, count + 1) @ H)  # (k, p, q)
    largest = shown.max(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(largest > 0, shown[0] / largest, 0.0)
    return float(share.max(axis=0).min())
