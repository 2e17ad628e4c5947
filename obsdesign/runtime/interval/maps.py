"""The maps of one step, of one sample and of one jump of the interval observer: enclosed.

Derivation in `obsdesign.runtime.interval.observer`. A `BoxMap` takes a box (centre m, radius r) to

    centre+ = X [m; y at the start; y at the end; u or w; 1]        X known up to an error
    radius+ = R r + g                                               R, g rounded up

so that |z - centre+| <= radius+ in exact arithmetic; what X and the arithmetic may be off by is
added where maps are put to use (`interval_kernel`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from lmi.arithmetic.enclosure import Enclosure, Matrix, expm, inverse, powers, raised, stack
from lmi.arithmetic.exponential import FLOW_PIECES
from obsdesign.runtime.interval.model import (
    Model,
    completed,
    exactly,
    metzler_bound,
    midpoint,
    size,
)


@dataclass(frozen=True, slots=True)
class BoxMap:
    """X: (n, n + 2p + m + 1); R: (n, n); g: (n,)."""

    X: Enclosure
    R: Matrix
    g: Matrix


def box_map(
    model: Model, m: Enclosure, start: Enclosure | None, end: Enclosure | None, known: Enclosure,
    R: Matrix, g: Matrix,
) -> BoxMap:  # fmt: skip
    """Put the blocks of X side by side; a measurement that is not used has zeros."""
    unused = exactly(np.zeros((len(m.mid), len(model.C.mid))))
    known = model.less_middle(known, start, end)
    return BoxMap(stack([[m, start or unused, end or unused, known]]), R, g)


def flow_maps(model: Model, h: float, h_error: float) -> dict[str, BoxMap]:
    """Over a step of length h +- h_error: with y at its start, at its end, or without.

    Overflow shows as infinite radii, not as warnings.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        F = model.A - model.L @ model.C
        n, p = model.L.mid.shape
        free = free_map(model, h, h_error)
        Phi, forced = _columns(free.X, slice(n)), _columns(free.X, slice(n + 2 * p, None))
        K = _driven(F, model.L, h, h_error)[1]
        outer = exactly(np.eye(n)) - K @ model.C
        spread = _spread(model, h, h_error)
        start, end = Phi - K @ model.C, outer @ Phi
        return {
            "start": box_map(model, start, K, None, forced, *spread["start"]),
            "end": box_map(model, end, None, K, outer @ forced, *spread["end"]),
            "none": free,
        }


def free_map(model: Model, h: float, h_error: float) -> BoxMap:
    """Over a step of length h +- h_error without any measurement."""
    with np.errstate(over="ignore", invalid="ignore"):
        Phi, forced = _driven(model.A, model.inputs, h, h_error)
        g = _on_the_way(model, exactly(np.eye(len(model.b_rad))), h, h_error)
        return box_map(model, Phi, None, None, forced, size(Phi), g)


def _on_the_way(model: Model, left: Enclosure, h: float, h_error: float) -> Matrix:
    """Bound of int_0^h |X e^{A s}| ds b_rad, X = left, rounded up.

    In the pieces of `lmi.arithmetic.exponential.absolute_flow`, which proofs are about.
    """
    step, error = h / FLOW_PIECES, h_error / FLOW_PIECES
    flows = left @ powers(expm(model.A.scaled(step, error)), FLOW_PIECES)
    _, pushed = _comparison(metzler_bound(model.A), model.b_rad, step, error)
    return raised(size(flows).sum(axis=0) @ pushed, 2 * (len(pushed) + FLOW_PIECES))


def identity_map(model: Model) -> BoxMap:
    """No step at all."""
    n = len(model.width)
    inputs = exactly(np.zeros_like(model.inputs.mid))
    return box_map(model, exactly(np.eye(n)), None, None, inputs, np.eye(n), np.zeros(n))


def sampled(model: Model, before: BoxMap, h: float, h_error: float) -> BoxMap:
    """z+ = z + L (y - C z) at the end of a step of length h +- h_error, y measured there.

    before: the same step without it.
    """
    n, p = model.L.mid.shape
    with np.errstate(over="ignore", invalid="ignore"):
        K = exactly(np.eye(n)) - model.L @ model.C
        X = K @ before.X
        R = size(_columns(X, slice(n)))
        y_end = slice(n + p, n + 2 * p)  # the step before it does not use this measurement
        X.mid[:, y_end], X.rad[:, y_end] = model.L.mid, model.L.rad
        X = model.less_middle(X, model.L)
        g = _on_the_way(model, K, h, h_error) if h > 0 else np.zeros(n)
        return BoxMap(X, R, raised(g + size(model.L) @ model.V, 2 * (p + 1)))


def jump_maps(model: Model, gains: Mapping[str, Any]) -> dict[bool, BoxMap]:
    """Over a jump: with its measurement (True) and without one (False)."""
    G, M, C = (exactly(gains[name]) for name in ("G", "M", "C"))
    n, when, V = len(gains["G"]), gains["jump_measurement"], model.V
    c_mid, c_rad = midpoint(gains["jump_lower"], gains["jump_upper"])
    known = exactly(np.column_stack([gains.get("E", np.zeros((n, 0))), c_mid]))
    by_splits = "Gp" in gains and "period" not in gains
    by_plain_splits = when == "none" and "period" not in gains
    plain_N = _jump_width(model, G, gains if by_plain_splits else None)
    plain = box_map(model, model.similar(G), None, None, model.inward(known), plain_N,
                    model.spread(c_rad))  # fmt: skip
    if when == "none":
        return {False: plain, True: plain}
    through = exactly(np.eye(n))
    H = G - M @ C
    if when == "after":
        through = through - M @ C
        H = through @ G
    M_z = model.inward(M)
    through_z = model.inward(through)
    if "S2" in gains and "period" not in gains:
        N, g = _by_second_coordinates(model, H, through, M, c_rad, gains)
    else:
        N = _jump_width(model, H, gains if by_splits else None)
        g = raised(size(M_z) @ V + size(through_z) @ c_rad, 2 * (n + len(V)))
    corrected = box_map(model, model.similar(H), None, M_z, model.inward(through @ known), N, g)
    return {False: plain, True: corrected}


def flow_and_jump_spread(
    model: Model, gains: Mapping[str, Any], h: float, h_error: float
) -> tuple[Matrix, Matrix]:
    """(R, g) of a step of length h +- h_error and an uncorrected jump at its end, as one map."""
    with np.errstate(over="ignore", invalid="ignore"):
        G = model.similar(exactly(gains["G"]))
        Phi = expm(model.A.scaled(h, h_error))
        c_rad = midpoint(gains["jump_lower"], gains["jump_upper"])[1]
        added = model.spread(c_rad)
        if h > 0:
            added = raised(added + _on_the_way(model, G, h, h_error), 1)
        return size(G @ Phi), added


def _jump_width(model: Model, H: Enclosure, gains: Mapping[str, Any] | None) -> Matrix:
    """Upper bound of N: the stored split, completed, or the smallest one."""
    H_z = model.similar(H)
    if gains is not None and "Gp" in gains:
        return completed(H_z, gains["Gp"], gains["Gn"])
    return size(H_z)


def _by_second_coordinates(
    model: Model, H: Enclosure, through: Enclosure, M: Enclosure, c_rad: Matrix,
    gains: Mapping[str, Any],
) -> tuple[Matrix, Matrix]:  # fmt: skip
    """Theorem 7: into the coordinates of S2, there by T >= 0, and back."""
    S2, S2_inverse, T = exactly(gains["S2"]), inverse(gains["S2"]), exactly(gains["T"])
    back = size(model.inward(S2))
    forth = size(S2_inverse if model.S is None else S2_inverse @ model.S)
    inner = np.maximum(T.mid, 0.0) + size(T - S2_inverse @ H @ S2)
    n = len(back)
    N = raised(back @ raised(inner @ forth, 2 * n), 2 * n)
    entering = size(S2_inverse @ M) @ model.V + size(S2_inverse @ through) @ c_rad
    return N, raised(back @ raised(entering, 4 * n), 2 * n)


def _driven(A: Enclosure, B: Enclosure, h: float, error: float) -> tuple[Enclosure, Enclosure]:
    """e^{A h} and int_0^h e^{A s} ds B, from one block exponential."""
    n, m = B.mid.shape
    rows = [[A, B], [exactly(np.zeros((m, n))), exactly(np.zeros((m, m)))]]
    whole = expm(stack(rows).scaled(h, error))
    return _block(whole, slice(n), slice(n)), _block(whole, slice(n), slice(n, n + m))


def _columns(X: Enclosure, columns: slice) -> Enclosure:
    return Enclosure(X.mid[:, columns], X.rad[:, columns])


def _block(whole: Enclosure, rows: slice, columns: slice) -> Enclosure:
    return Enclosure(whole.mid[rows, columns], whole.rad[rows, columns])


def _comparison(W: Matrix, f: Matrix, h: float, h_error: float) -> tuple[Matrix, Matrix]:
    """(e^{W h}, int_0^h e^{W s} ds f), rounded up."""
    n = len(W)
    system = np.zeros((n + 1, n + 1))
    system[:n, :n], system[:n, n] = W, f
    whole = expm(exactly(system).scaled(h, h_error))
    return _bounds(_block(whole, slice(n), slice(n)), _block(whole, slice(n), slice(n, n + 1)))


def _spread(model: Model, h: float, h_error: float) -> dict[str, tuple[Matrix, Matrix]]:
    """(R, g) of the maps that use y, from the comparison system [q; rho; sig; 1; 1]."""
    L, b_rad = size(model.L), model.b_rad
    n, p = L.shape
    noise = raised(L @ model.V + b_rad, 2 * p)
    slope = size(model.C @ model.A)
    drift = raised(size(model.C) @ b_rad, 2 * n)
    q, rho, sig = slice(n), slice(n, 2 * n), slice(2 * n, 2 * n + p)
    system = np.zeros((2 * n + p + 2, 2 * n + p + 2))
    system[q, q], system[q, sig], system[q, -2] = model.width, L, noise
    system[rho, rho], system[rho, -1] = metzler_bound(model.A), b_rad
    system[sig, rho], system[sig, -1] = slope, drift
    whole = expm(exactly(system).scaled(h, h_error))
    part = {
        name: _block(whole, rows, columns)
        for name, rows, columns in (
            ("qq", q, q), ("q_rho", q, rho), ("q_sig", q, sig), ("q_1", q, slice(-2, -1)),
            ("q_2", q, slice(-1, None)), ("sig_rho", sig, rho), ("sig_2", sig, slice(-1, None)),
        )
    }  # fmt: skip
    return {
        "start": _bounds(part["qq"] + part["q_rho"], part["q_1"] + part["q_2"]),
        "end": _bounds(
            part["qq"] + (part["q_sig"] @ part["sig_rho"] - part["q_rho"]),
            part["q_1"] + (part["q_sig"] @ part["sig_2"] - part["q_2"]),
        ),
    }


def _bounds(R: Enclosure, g: Enclosure) -> tuple[Matrix, Matrix]:
    """Upper bounds; both are nonnegative in exact arithmetic."""
    return np.maximum(R.upper, 0.0), np.maximum(g.upper, 0.0).reshape(-1)
