"""A theta at which C misses a mode of e^{F theta} H that does not decay: found and checked.

Kept constant, such a theta lets an error live on that no measurement ever shows.
"""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import Exact, ball, exact, exp_times, norm_bound, number, precision
from lmi.rank.stack import Stack, approx_margin, coordinates
from lmi.rank.witness import MARGIN
from lmi.verdict import Verdict, refuted, undecided

_GRID, _ZOOMS, _BITS = 401, 14, 192


@np.errstate(all="ignore")
def propose_hiding(stack: Stack, low: float, high: float) -> float | None:
    """A constant theta where the stack all but loses rank; None if none is seen.

    stack: with more blocks than states, so that what it misses is missed for ever.
    """
    R, full = coordinates(stack, low, high)
    left, right = low, high
    if not full:
        return (low + high) / 2
    for zoom in range(_ZOOMS):
        thetas = np.linspace(left, right, _GRID if zoom == 0 else 33)
        margins = approx_margin(stack, np.repeat(thetas[:, None], stack.thetas, axis=1), R)
        k = int(np.argmin(np.nan_to_num(margins, nan=np.inf)))
        left, right = float(thetas[max(k - 1, 0)]), float(thetas[min(k + 1, len(thetas) - 1)])
    return float(thetas[k]) if margins[k] < MARGIN else None


@np.errstate(all="ignore")
def check_hiding(F: Exact, H: Exact, C: Exact, theta: float) -> Verdict:
    """Refuted if C misses a mode of M = e^{F theta} H of modulus >= 1, both up to MARGIN.

    |C v| and |M v - s v| must stay below MARGIN of |C||v| and |M||v|, in balls, and |s| above
    1 - MARGIN.
    """
    n = len(F)
    stack = Stack(F, H, C, exact(np.eye(n)), n + 1)
    around = stack.approx(np.repeat(theta * np.array([[1.0], [0.7], [1.3]]), n, axis=1))
    stacked, sizes = around[0], np.linalg.norm(around, axis=1).max(axis=0)
    units = np.where(sizes > 0, sizes, 1.0)
    if not np.isfinite(around).all():
        return undecided("the window overflows")
    _, values, right = np.linalg.svd(stacked / units)
    unseen = (right[values < 100 * MARGIN * max(values.max(), 1e-300)] / units).T
    if not unseen.shape[1]:
        return undecided(f"nothing is hidden at {theta!r}")
    M = Stack(F, H, exact(np.eye(n)), exact(np.eye(n)), 2).approx(np.array([[theta]]))[0][n:]
    inside = np.linalg.lstsq(unseen, M @ unseen, rcond=None)[0]
    modes, vectors = np.linalg.eig(inside)
    k = int(np.argmax(np.abs(modes)))
    v, s = unseen @ vectors[:, k], complex(modes[k])
    if abs(s) < 1 - MARGIN or not _residuals_small(stack, theta, v / np.abs(v).max(), s):
        return undecided(f"what is hidden at {theta!r} decays, or is not certainly hidden")
    shown = ", ".join(f"{x:.6g}" for x in (v / v[np.argmax(np.abs(v))]).real)
    reason = (
        f"at the constant spacing {theta:.9g} the mode {s:.6g} per impulse, of modulus "
        f"{abs(s):.9g}, is never seen; its state is ({shown}) just before an impulse"
    )
    return refuted({"thetas": [theta], "mode": {"real": s.real, "imag": s.imag},
                    "null_vector": v.real.tolist(), "reason": reason})  # fmt: skip


def _residuals_small(stack: Stack, theta: float, v: Matrix, s: complex) -> bool:
    """Is v a mode of the map at theta with factor s, and unobserved, both up to MARGIN?"""
    with precision(_BITS):
        M, output = exp_times(stack.F, theta) * ball(stack.H), ball(stack.C)
        parts = np.column_stack([v.real, v.imag])
        turn = np.array([[s.real, s.imag], [-s.imag, s.real]])
        vectors = ball(exact(parts))
        size = number(float(np.linalg.norm(parts[:, 0]))) * number(1 - 1e-9)
        off = norm_bound(M * vectors - vectors * ball(exact(turn)))
        missed = norm_bound(output * vectors)
        margin = number(MARGIN)
        small = off < margin * norm_bound(M) * size
        unseen = missed == 0 or missed < margin * norm_bound(output) * size
        return bool(small and unseen)
