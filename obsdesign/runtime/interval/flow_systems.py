"""The linear systems whose exponentials are the maps of a step (`maps`)."""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import Enclosure, raised, stack
from obsdesign.runtime.interval.model import Model, exactly, metzler_bound, size


def with_inputs(A: Enclosure, B: Enclosure) -> Enclosure:
    """[[A, B], [0, 0]]: the flow of the states and of inputs that hold."""
    n, m = B.mid.shape
    return stack([[A, B], [exactly(np.zeros((m, n))), exactly(np.zeros((m, m)))]])


def comparison_system(model: Model) -> Matrix:
    """The flow of [q; rho; sig; 1; 1] behind the maps that use y."""
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
    return system


def comparison_blocks(n: int, p: int) -> dict[str, tuple[slice, slice]]:
    """(rows, columns) of the blocks of its exponential that maps are made of."""
    q, rho, sig = slice(n), slice(n, 2 * n), slice(2 * n, 2 * n + p)
    return {
        "qq": (q, q), "q_rho": (q, rho), "q_sig": (q, sig), "q_1": (q, slice(-2, -1)),
        "q_2": (q, slice(-1, None)), "sig_rho": (sig, rho), "sig_2": (sig, slice(-1, None)),
    }  # fmt: skip
