"""Units of states, powers of two, in which maps are balanced; numpy only.

Rows and columns are of like size where states depend on each other (Osborne's iteration, in the
largest entry). States that depend on others, but not they on them (block triangular maps), are
graded: their unit grows until that coupling is at most one.

Source: E. E. Osborne, On pre-conditioning of matrices, J. ACM 7 (1960), 338-345.
"""

from __future__ import annotations

from operator import add, sub

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Array

_SWEEPS = 40
_SETTLED = 0.5  # bits: a sweep that changes no unit by more ends the iteration
# binary logarithm of the largest unit: D^-1 P D^-1 must stay in the range of floats
LARGEST_UNIT = 240


def balance(maps: Array) -> Array:
    """Powers of two d, (n,), for which diag(d) M diag(1/d) is balanced and graded.

    maps: (n, n) or (k, n, n), finite; of several maps the largest entries count.
    """
    bits = -units_in_bits(np.abs(maps).reshape(-1, *maps.shape[-2:]).max(axis=0))
    return np.asarray(np.exp2(np.clip(np.round(bits - bits.max(initial=0.0)), -LARGEST_UNIT, 0)))


def units_in_bits(size: Array) -> Array:
    """Binary logarithms x of units for which size[i, j] 2^(x_j - x_i) is balanced and graded."""
    weights = np.full(size.shape, -np.inf)
    np.log2(size, out=weights, where=size > 0)
    np.fill_diagonal(weights, -np.inf)
    reach = reachable(weights > -np.inf)
    if reach.all():  # one part, as of most plants
        return _osborne(weights)
    units, part = np.zeros(len(size)), np.argmax(reach & reach.T, axis=1)
    # a part comes after those that it depends on
    for first in sorted({*part.tolist()}, key=lambda first: int(reach[first].sum())):
        members, others = np.flatnonzero(part == first), np.flatnonzero(part != first)
        units[members] = _osborne(weights[np.ix_(members, members)])
        coupling = weights[np.ix_(members, others)] + units[others] - units[members, None]
        units[members] += max(float(coupling.max(initial=-np.inf)), 0.0)
    return units


def reachable(edges: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which states each state depends on, at once or through others; itself included."""
    reach = edges | np.eye(len(edges), dtype=bool)
    while True:
        further = reach @ reach
        if (further == reach).all():
            return reach
        reach = further


def _osborne(weights: Array) -> Array:
    """Units of states all of which depend on each other; in bits, the smallest 0."""
    # numpy costs more than sums of so few floats
    rows, columns = weights.tolist(), weights.T.tolist()
    units = [0.0] * len(rows)
    for _ in range(_SWEEPS if len(units) > 1 else 0):
        largest = 0.0
        for i, unit in enumerate(units):
            row = max(map(add, rows[i], units)) - unit
            column = max(map(sub, columns[i], units)) + unit
            step = (row - column) / 2
            units[i] += step
            largest = max(largest, abs(step))
        if largest <= _SETTLED:
            break
    return np.array(units) - min(units)
