"""Certified bounds of l'z for any multipliers: the dual sum, rounded outward.

The stages of a window are walked backwards from p = l (z_T: the state after the last stage):

    sample      v += max over the strip of mu'(C z),     q = p - C'mu
    stage       v += q'drift + support of the disturbance along q,   p <- Phi'q
    start       v += max over the start box of p'z

Then l'z <= v for every mu (weak duality). Nothing is assumed of the rounding of p: the identity

    l'z_T = sum of the terms + (residuals)'z

holds for any floats p, q, with the residuals of both recursions, which are bounded and multiplied
by the certified boxes of the stages (Neumaier, Shcherbina, Safe bounds in linear and mixed-integer
linear programming, Math. Program. 99, 2004).
"""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import TINY, UNIT
from obsdesign.equations.set_membership.support import piece_bound
from obsdesign.runtime.set_membership.stages import Targets, Window


def upper_bounds(window: Window, targets: Targets, mu: Matrix) -> Matrix:
    """Upper bounds (B,) of the targets, certified; +inf where numbers overflow.

    mu (B, T, p): multipliers, zero where a stage has no sample.
    """
    p, q = _walk(window, targets, mu)
    value, size, error = _linear_terms(window, p, q, mu)
    added = support(window, q)
    T, n = window.drift.shape
    outputs, summands = mu.shape[2], window.columns[0, 0, 0].size
    error = error + _residuals(window, targets, p, q, mu)
    roundings = T * (2 * n + 2 * outputs + summands + 8) + 2 * n + 60
    total = value + added
    pad = (error + roundings * UNIT * (size + added)) * (1.0 + 2 * roundings * UNIT)
    result = np.nextafter(total + pad + TINY, np.inf)
    return np.where(np.isfinite(result), result, np.inf)


def _walk(window: Window, targets: Targets, mu: Matrix) -> tuple[Matrix, Matrix]:
    """p (T + 1, B, n): after stage k - 1, before its sample; q (T, B, n): behind that sample.

    p[T] is zero: a row enters after the stage that it is about.
    """
    T, n = window.drift.shape
    rows, places = targets
    p, q = np.zeros((T + 1, len(rows), n)), np.empty((T, len(rows), n))
    pull = mu.transpose(1, 0, 2) @ window.C
    last = int(places.min())
    for k in range(T - 1, -1, -1):
        following = p[k + 1]
        if k >= last:
            following = following + np.where((places == k)[:, None], rows, 0.0)
        np.subtract(following, pull[k], out=q[k])
        np.matmul(q[k], window.Phi[k], out=p[k])
    if last < 0:
        p[0] += np.where((places == -1)[:, None], rows, 0.0)
    return p, q


def _linear_terms(
    window: Window, p: Matrix, q: Matrix, mu: Matrix
) -> tuple[Matrix, Matrix, Matrix]:
    """(value, sum of sizes, errors of enclosed numbers) of strips, drifts and the start box."""
    by_stage = mu.transpose(1, 0, 2)
    low, high = by_stage * window.strips[:, None, 0], by_stage * window.strips[:, None, 1]
    value = np.maximum(low, high).sum(axis=(0, 2))
    size = np.maximum(np.abs(low), np.abs(high)).sum(axis=(0, 2))
    driven, q_size = q * window.drift[:, None], np.abs(q)
    value = value + driven.sum(axis=(0, 2))
    size = size + np.abs(driven).sum(axis=(0, 2))
    error = (q_size * window.drift_error[:, None]).sum(axis=(0, 2))
    low, high = p[0] * window.start[0], p[0] * window.start[1]
    value = value + np.maximum(low, high).sum(axis=1)
    return value, size + np.maximum(np.abs(low), np.abs(high)).sum(axis=1), error


def support(window: Window, q: Matrix) -> Matrix:
    """Upper bound (B,) of what the disturbances of all stages add along q (T, B, n)."""
    T, n = window.drift.shape
    _, _, parts, pieces, width = window.columns.shape
    q_size = np.abs(q)
    flat = (T, n, parts * pieces * width)
    shape = (T, q.shape[1], parts, pieces, width)
    exact = np.abs(q @ window.columns.reshape(flat)).reshape(shape)
    error = (q_size @ window.column_error.reshape(flat)).reshape(shape)
    sizes = q_size @ window.spread.reshape(T, n, 2 * pieces * width)
    sizes = sizes.reshape(*shape[:2], 2, *shape[3:])
    high = exact + error
    l0 = (exact[:, :, 1] - error[:, :, 1], high[:, :, 1])
    terms = piece_bound(high[:, :, 0], l0, high[:, :, 2], sizes[:, :, 0], window.length)
    # over long pieces the Taylor terms overflow, and the sizes of the flow do not
    terms = np.fmin(terms, sizes[:, :, 1] * (1.0 + 8 * n * UNIT))
    result: Matrix = (terms * window.radius).sum(axis=(0, 2, 3))
    return result


def _residuals(window: Window, targets: Targets, p: Matrix, q: Matrix, mu: Matrix) -> Matrix:
    """Bound (B,) of what the roundings of p and q contribute, with z in the stored boxes."""
    outputs = mu.shape[2]
    flows = (np.abs(q) @ window.phi_error) * window.sizes[:-1, None]
    entering = np.abs(p[1:]) + np.abs(mu).transpose(1, 0, 2) @ np.abs(window.C)
    # exact where there is neither a sample nor an l that enters an earlier p
    is_rounded = mu.any(axis=2).T
    places, size = targets.places, np.abs(targets.rows)
    is_entering = places[None, :] == np.arange(len(q))[:, None]
    inside = is_entering & (places != len(q) - 1)[None, :]
    entering = entering + np.where(is_entering[..., None], size, 0.0)
    active = (is_rounded | inside)[..., None]
    samples = np.where(active, (outputs + 4) * UNIT * entering, 0.0) * window.sizes[1:, None]
    at_start = np.where((places == -1)[:, None], 2 * UNIT * (np.abs(p[0]) + size), 0.0)
    result: Matrix = (flows + samples).sum(axis=(0, 2)) + at_start @ window.sizes[0]
    return np.asarray(result * (1.0 + 64 * UNIT * size.shape[1] * len(q)))
