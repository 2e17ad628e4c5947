"""Change of the features where A is off: structured uncertainty, Section III-F.

With A + dA(t), |dA| <= U entry by entry, the residual obeys e' = D e + dA x, x' = (A + dA) x, so
that an impulse, or a state x(t_o), changes the features by

    dR = int_0^s V(s - u) dA x(u) du,   x(v) = e^{A v} x_0 + int_0^v e^{A (v - u)} dA x(u) du.

Both are bounded on cells of the window, entry by entry, by the largest |V| and |e^{A v}| of a
cell, which are those of balls. dA may change in time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import (
    PRECISIONS,
    Exact,
    Rational,
    ball,
    ball_matrix,
    entries,
    exact,
    exp_around,
    exp_times,
    identity,
    middle,
    precision,
    rational,
    solve,
    upper_ends,
)
from lmi.verdict import proved, undecided
from obsdesign.document import Claim
from obsdesign.equations.impulsive_input.features import (
    FeatureWindow,
    feature_scales,
    filtered_system,
)
from obsdesign.verification.impulsive_input.directions import orthonormal_weights, weight_bounds
from obsdesign.verification.impulsive_input.window import PAPER

_CELLS = 256
_MOST_PARTS = 64  # of a cell, where larger ones prove nothing


@dataclass(frozen=True)
class FeatureChange:
    """Bounds of |dR|: (mp, q) per unit of weight for any age, (mp, n) per unit of x(t_o).

    Features are scaled as at run time. relative: of |dR g| / |b(age) g| for all weights g and ages
    in [margin, tau].
    """

    impulse: Matrix
    state: Matrix
    relative: float


def robustness(window: FeatureWindow, A: Exact, uncertainty: Matrix) -> Claim:
    """The bounds of `feature_change`; undecided where there are none, or |b| may be zero."""
    bounds = feature_change(window, A, uncertainty)
    text, verdict = (
        "a bounded part of their norm",
        undecided("flow.A may change too much for this window"),
    )
    if bounds is not None:
        evidence = {
            "impulse": _rounded_up(bounds.impulse).tolist(),
            "state": _rounded_up(bounds.state).tolist(),
        }
        verdict = undecided("the features of an impulse may vanish at some age", **evidence)
        if math.isfinite(bounds.relative):
            relative = _rounded_up(np.array([bounds.relative])).tolist()
            text = f"{relative[0]!r} of their Euclidean norm"
            verdict = proved(**evidence, relative=relative)
    statement = (
        "where entries of flow.A are off by at most observer.uncertainty, at any instant of a "
        f"window, the features of an impulse of any age in [{window.margin!r}, {window.tau!r}] "
        f"change within it by at most {text}"
    )
    return Claim.from_verdict("robustness", statement, f"{PAPER}, Section III-F", verdict)


def _rounded_up(values: Matrix) -> Matrix:
    """Three digits of numbers, never less than them: other machines come to the same."""
    shown = [
        short if (short := float(f"{value:.3g}")) >= value else float(f"{value * 1.005:.3g}")
        for value in values.ravel().tolist()
    ]
    return np.array(shown).reshape(values.shape)


def feature_change(window: FeatureWindow, A: Exact, uncertainty: Matrix) -> FeatureChange | None:
    """Bounds of how the features change for |dA| <= uncertainty (n, n); None where none holds.

    window: D, C, H exact, D = A - K C.
    """
    n, q = len(A), window.H.shape[1]
    width = rational(window.tau) / _CELLS
    h = math.nextafter(float(width), math.inf)
    with precision(PRECISIONS[0]):
        scales = exact(feature_scales(window.exponents, window.tau))
        F = filtered_system(window.D, window.C, exact(window.exponents), scales)
        flows = [_cell(A, width, k) for k in range(_CELLS)]
        whole = [_cell(F, width, k)[:, :n] for k in range(_CELLS)]
        first = min(int(window.margin / h * (1 - 1e-12)), _CELLS - 1)
        b = np.vstack([middle(ball_matrix(X[n:] @ window.H)) for X in whole[first:]])
        T = orthonormal_weights(b)
        turned = window.H if T is None else window.H @ T
        start = np.hstack([window.H, turned, exact(np.eye(n))])
        free = np.array([_largest(flow @ start) for flow in flows])
        P, V = np.array([_largest(X) for X in flows]), np.array([_largest(X[n:]) for X in whole])
        weights = np.array([_weights(F, (width, k), turned) for k in range(first, _CELLS)])
    # |x| <= free + h P_0 U |x| within a cell: an M-matrix where the norm is below one
    step = h * P[0] @ uncertainty * (1 + 1e-12)
    if not step.sum(axis=1).max() < 0.5:
        return None
    inner = solve(identity(n) - ball(exact(step)), identity(n))
    if inner is None:
        return None
    # sums and products of nonnegative floats, at most so many one after the other
    rounding = 1 + 8 * _CELLS**2 * (n + 4) * np.finfo(np.float64).eps
    x = _states(free, P, upper_ends(inner), h * uncertainty) * rounding
    driven = h * uncertainty @ x
    V_pairs = np.maximum(V, np.concatenate([V[:1], V[:-1]]))
    change = rounding * np.array(
        [np.einsum("kij,kjr->ir", V_pairs[k::-1], driven[: k + 1]) for k in range(_CELLS)]
    )
    at_end = rounding * np.einsum("kij,kjr->ir", V[::-1], driven[:, :, 2 * q :])
    with np.errstate(invalid="ignore"):
        parts = np.einsum("kiq,kq->ki", change[first:, :, q : 2 * q], weights)
        largest = float(np.linalg.norm(parts, axis=1).max() * rounding)
    if not (np.isfinite(change).all() and np.isfinite(at_end).all()):
        return None
    relative = math.inf if math.isnan(largest) else largest
    return FeatureChange(change[:, :, :q].max(axis=0), at_end, relative)


def _cell(F: Exact, width: Rational, k: int) -> Exact:
    """Balls of e^{F v} for v in [k, k + 1] width."""
    half = math.nextafter(float(width) / 2, math.inf)
    return entries(exp_times(F, width * (2 * k + 1) / 2) * exp_around(F, half))


def _largest(X: Exact) -> Matrix:
    """Floats that are at least the absolute entries of balls."""
    tops = [[value.abs_upper() for value in row] for row in X.tolist()]
    return np.array([[math.nextafter(float(top), math.inf) for top in row] for row in tops])


def _weights(F: Exact, cell: tuple[Rational, int], columns: Exact, parts: int = 1) -> Matrix:
    """Bounds of `weight_bounds` for a cell (width, k) of a window, in parts where needed.

    F: of states and features; columns (n, q) of states.
    """
    width, k = cell
    bounds = weight_bounds(_cell(F, width, k)[len(columns) :, : len(columns)], columns)
    for half in (2 * k, 2 * k + 1) if parts < _MOST_PARTS and np.isinf(bounds).any() else ():
        part = _weights(F, (width / 2, half), columns, 2 * parts)
        bounds = part if half == 2 * k else np.maximum(bounds, part)
        if np.isinf(bounds).any():
            break
    return bounds


def _states(free: Matrix, P: Matrix, inner: Matrix, driving: Matrix) -> Matrix:
    """Bounds of |x| on each cell, (cells, n, r); P (cells, n, n) of |e^{A v}|."""
    pairs = np.maximum(P[1:], P[:-1])
    x = np.empty_like(free)
    for k in range(len(free)):
        past = np.einsum("kij,kjr->ir", pairs[k - 1 :: -1] if k else pairs[:0], driving @ x[:k])
        x[k] = inner @ (free[k] + past)
    return x
