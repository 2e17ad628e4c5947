"""Response of a flow in one step to a state, a constant input and a ramp."""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.exponential import expm

Maps = tuple[Matrix, Matrix, Matrix]


def responses(X: Matrix, h: float) -> Maps:
    """Blocks of one exponential: e^{Xh}, int e^{Xs} ds, int e^{X(h-s)} (s/h) ds."""
    n = len(X)
    unit, zero = np.eye(n), np.zeros((n, n))
    block = np.block([[X * h, unit * h, zero], [zero, zero, unit], [zero, zero, zero]])
    flow, once, ramp = np.hsplit(expm(block)[:n], 3)
    return flow, once, ramp
