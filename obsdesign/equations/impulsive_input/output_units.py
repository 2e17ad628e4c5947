"""Units in which several outputs stand beside each other in features: those of y are free.

|R|, by which impulses are looked for and the plain norm fits them, adds features of all outputs.
Each is therefore divided by a unit of its output, which designs store: the deviation of its noise,
else the radius of its bounds, else the largest that an impulse of weight 1 leaves in it.
"""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.exponential import exponential_grid
from obsdesign.equations.plant import Output

_POINTS = 200


def output_units(output: Output, D: Matrix, H: Matrix, tau: float) -> Matrix | None:
    """Units (p,), of one kind for all outputs; None for one output, which stands alone.

    D = A - K C; tau: length of a window. Of an output in which no impulse is left: its largest
    coefficient, 1 where it has none.
    """
    C = output.C
    if len(C) == 1:
        return None
    if (output.noise_std > 0).all():
        return output.noise_std
    radius = output.noise_radius
    if radius is not None and (radius > 0).all():
        return radius
    with np.errstate(over="ignore", invalid="ignore"):
        states = exponential_grid(D, 0.0, tau / _POINTS, _POINTS + 1) @ H
        left = np.abs(C @ states).max(axis=(0, 2), initial=0.0)
    coefficients = np.abs(C).max(axis=1)
    shown = np.isfinite(left) & (left > 0)
    return np.where(shown, left, np.where(coefficients > 0, coefficients, 1.0))
