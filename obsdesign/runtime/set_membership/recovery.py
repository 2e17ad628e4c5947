"""Bounds of a state from the samples after it alone, whatever was known before.

With z before the first stage of a window, its samples are H z + what is known, up to their noise
and the disturbances: w in a box around m with half widths s. For any R, and zeta = z - R m,

    |zeta| <= c + E |zeta|,   c = |R| s + E |R m|,   E >= |I - R H|

so that |zeta| <= v for every v > 0 with c + E v <= v and c > 0: E contracts in units of v. Bounds
that a long gap has made useless in floats are replaced by these.
"""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import TINY, UNIT, Enclosure, raised
from obsdesign.runtime.set_membership.stages import Window

_ROOM = 1e-9  # of v, in parts of it
_SINGULAR = 1e-12  # a singular value, in parts of the largest one, that determines nothing


def bounds_from_samples(window: Window) -> Matrix | None:
    """(2, n): bounds of z before the first stage; None where the samples do not give them."""
    H, low, high = _strips(window)
    middle, s = 0.5 * low + 0.5 * high, 0.5 * high - 0.5 * low
    s = raised(s + 8 * UNIT * (np.abs(low) + np.abs(high)), 4)
    if len(s) < window.Phi.shape[1] or not _is_finite(H.mid, H.rad, middle, s):
        return None
    R = _left_inverse(H.mid, s)
    if R is None:
        return None
    n, m = R.shape
    unit = Enclosure.exactly(np.eye(n)) - Enclosure.exactly(R) @ H
    E, centre = unit.magnitude, R @ middle
    c = raised(np.abs(R) @ s + E @ np.abs(centre), 2 * m + 8)
    # R m, rounded
    c = c + (m + 4) * UNIT * (np.abs(R) @ np.abs(middle)) + TINY
    if np.abs(np.linalg.eigvals(E)).max() >= 0.5:
        return None
    v = np.linalg.solve(np.eye(n) - E, c) * (1.0 + _ROOM)
    if not (raised(c + E @ v, 2 * n + 8) <= v).all():
        return None
    box = np.stack([centre - v, centre + v])
    return np.stack([np.nextafter(box[0], -np.inf), np.nextafter(box[1], np.inf)])


def _strips(window: Window) -> tuple[Enclosure, Matrix, Matrix]:
    """(H (m, n), lower, upper (m,)): H z is between them, z before the first stage."""
    T, n = window.drift.shape
    C, M = Enclosure.exactly(window.C), Enclosure.exactly(np.eye(n))
    g = Enclosure.exactly(np.zeros((n, 1)))
    mids, rads, low, high = [], [], [], []
    for k in range(T):
        Phi = Enclosure(window.Phi[k], window.phi_error[k])
        added = (window.spread[k, :, 1] * window.radius[k]).sum(axis=(1, 2))
        error = raised(window.drift_error[k] + added, window.spread[k, 0, 1].size + 4)
        M = Phi @ M
        g = Phi @ g + Enclosure(window.drift[k][:, None], error[:, None])
        kept = window.sampled[k]
        if kept.any():
            rows, shift = C @ M, C @ g
            mids.append(rows.mid[kept])
            rads.append(rows.rad[kept])
            lower, upper = window.strips[k]
            middle, rad = shift.mid[kept, 0], shift.rad[kept, 0]
            low.append(lower[kept] - middle - rad)
            high.append(upper[kept] - middle + rad)
    if not mids:
        return Enclosure.exactly(np.zeros((0, n))), np.zeros(0), np.zeros(0)
    return (
        Enclosure(np.concatenate(mids), np.concatenate(rads)),
        np.concatenate(low),
        np.concatenate(high),
    )


def _left_inverse(H: Matrix, s: Matrix) -> Matrix | None:
    """R (n, m) of least |R s|_2, nearly, with R H = I; None where H has not rank n."""
    weight = 1.0 / np.maximum(s, TINY + UNIT * np.abs(H).max(initial=0.0))
    weighted = weight[:, None] * H
    scale = np.abs(weighted).max(axis=0)
    if not _is_finite(weighted) or not (scale > 0).all():
        return None
    U, sigma, Vt = np.linalg.svd(weighted / scale, full_matrices=False)
    if not sigma[-1] > _SINGULAR * sigma[0]:
        return None
    R = ((Vt.T / sigma) @ U.T) * weight / scale[:, None]
    return R if _is_finite(R) else None


def _is_finite(*arrays: Matrix) -> bool:
    return all(bool(np.isfinite(array).all()) for array in arrays)
