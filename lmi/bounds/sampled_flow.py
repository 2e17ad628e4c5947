"""Bounds of a positive system between samples of an output that is known at samples only."""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.balls import Exact, exact, exp_times, precision, to_float, upper_ends

_BITS = 128


def sampled_flow(
    W: Exact, L: Exact, *, CA: Exact, A: Exact, C: Exact, b: Exact, h: float
) -> tuple[Exact, Exact] | None:
    """(W_h, f_h) >= 0, added to W and f where an output is sampled at most h apart.

    What the output does between samples enters like |L| sig with sig' = CA rho + C b,
    rho' = A rho + b, rho(0) the width at the sample, which is at most e^{-W_ii s} times the one s
    later. L, CA, C: nonnegative; A Metzler (absolute values of the plant's); rounded up. None
    if they overflow.
    """
    n, p = len(A), len(CA)
    zero = exact(np.zeros((n + p + 2, n + p + 2)))
    rho, sig = slice(n), slice(n, n + p)
    # [rho; sig; 1] for the part that rho(0) drives, and the same with b
    zero[rho, rho], zero[sig, rho] = A, CA
    zero[rho, -1], zero[sig, -1] = b, C @ b
    with precision(_BITS):
        whole = upper_ends(exp_times(zero, h))
        fastest = np.minimum(to_float(np.diag(W)), 0.0) * 1.000001
        if not np.isfinite(fastest).all():
            return None
        back = upper_ends(exp_times(-exact(np.diag(fastest)), h))
    if not (np.isfinite(whole).all() and np.isfinite(back).all()):
        return None
    gain = exact(np.maximum(whole[sig, rho], 0.0))
    drift = exact(np.maximum(whole[sig, -1], 0.0))
    slowed = exact(np.maximum(back, 0.0) * np.eye(n))
    return L @ gain @ slowed, L @ drift
