"""The jump of a point estimate as a product."""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.equations.gains import PlantGains
from obsdesign.export.program import Product, Sizes


def noise_centre(gains: PlantGains) -> Matrix:
    """Middle of the bounds of the noise (p,)."""
    return np.zeros(gains.p) if gains.noise_centre is None else gains.noise_centre


def jump_product(gains: PlantGains, M: Matrix | None, sizes: Sizes) -> Product:
    """The product of a jump with the correction M (y - C x), None without its measurement."""
    n, p = sizes.n, sizes.p
    E = np.zeros((n, 0)) if gains.E is None else gains.E
    known = np.hstack([E, gains.jump_drift[:, None]])
    x, y = gains.jump_matrix, np.zeros((n, p))
    if M is not None and gains.jump_measurement != "none":
        if gains.jump_measurement == "after":
            left = np.eye(n) - M @ gains.C
            x, known = left @ x, left @ known
        else:
            x = x - M @ gains.C
        known[:, -1] -= M @ noise_centre(gains)
        y = M
    rows = np.hstack([x, np.zeros((n, p)), y, known])
    return Product(sizes.widened(rows, sizes.l, has_magnitudes=False))
