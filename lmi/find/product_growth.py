"""Growth of a product of maps and its gradient, for searches of the worst one. Floats only."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from lmi.arithmetic.arrays import Array

# what an optimiser minimises of a product without growth: e^-1000 is zero
NO_GROWTH = 1e3
# a modulus below it is zero, as far as floats go
_VANISHING = 1e-280

# place of a map, products of the maps before each -> (D, P): the derivative of the product up to
# and with the map is D P
Derivative = Callable[[int, Sequence[Array]], tuple[Array, Array]]


def growth_loss(maps: Sequence[Array], derivative: Derivative) -> tuple[float, Array]:
    """-log rho(M_k ... M_1) / k and its gradient: d lambda = y* dM x / (y* x).

    NO_GROWTH and a gradient of zero where the product is beyond floats, or vanishes.
    """
    k, n = len(maps), maps[0].shape[-1]
    before = [np.eye(n)]
    for M in maps:
        before.append(M @ before[-1])
    if not np.isfinite(before[-1]).all():
        return NO_GROWTH, np.zeros(k)
    values, vectors = np.linalg.eig(before[-1])
    top = int(np.argmax(np.abs(values)))
    value, x = values[top], vectors[:, top]
    if abs(value) < _VANISHING:
        return NO_GROWTH, np.zeros(k)
    lefts, left_vectors = np.linalg.eig(before[-1].T)
    y = left_vectors[:, int(np.argmin(np.abs(lefts - value)))]
    scale = value * (y @ x)
    slope, after = np.zeros(k), y
    if abs(scale) < _VANISHING:
        return -float(np.log(abs(value))) / k, slope
    for i in reversed(range(k)):
        D, P = derivative(i, before)
        slope[i] = float(np.real(after @ D @ P @ x / scale))
        after = after @ maps[i]
    return -float(np.log(abs(value))) / k, -slope / k
