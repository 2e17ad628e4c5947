"""Units in which several outputs stand beside each other in features: those of y are free.

|R|, by which impulses are looked for without noise and the plain norm fits them, adds features of
all outputs. Each is therefore divided by a unit of its output, which designs store: the deviation
of its noise, proportional noise that of the largest output that an impulse of weight 1 makes, else
the radius of its bounds, else the largest that an impulse of weight 1 leaves in its residual. Where
K cancels an impulse in an output but for rounding, or but for what joining samples by lines leaves
of it, it is what states are without K.
"""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.exponential import exponential_grid
from obsdesign.equations.estimation_error import flow_error_matrix
from obsdesign.equations.impulsive_input.evaluation_rule import has_noise
from obsdesign.equations.plant import Plant

_POINTS = 200
# of |C| |x|, x after an impulse without K: what is less is rounding, in any units of x and y
_LEAST_SHARE = 1e-9
# of the same, in deviations of sampled outputs from the lines that join the samples
_LEAST_RESOLVED = 100.0


def output_units(plant: Plant, K: Matrix, H: Matrix, tau: float) -> Matrix | None:
    """Units (p,), of one kind for all outputs; None for one output, which stands alone.

    tau: length of a window. Of an output that no impulse reaches: its largest coefficient, 1 where
    it has none.
    """
    A, output, C = plant.flow.A, plant.output, plant.output.C
    if len(C) == 1:
        return None
    radius = output.noise_radius
    if not has_noise(output) and radius is not None and (radius > 0).all():
        return radius
    with np.errstate(over="ignore", invalid="ignore"):
        states, free = (
            exponential_grid(flow, 0.0, tau / _POINTS, _POINTS + 1) @ H
            for flow in (flow_error_matrix(A, K, C), A)
        )
        left = np.abs(C @ states).max(axis=(0, 2), initial=0.0)
        whole = (np.abs(C) @ np.abs(free)).max(axis=(0, 2), initial=0.0)
        shown = np.abs(C @ free).max(axis=(0, 2), initial=0.0)
    coefficients = np.abs(C).max(axis=1)
    whole = np.where(np.isfinite(whole) & (whole > 0), whole, coefficients)
    if has_noise(output):
        outputs = np.where(np.isfinite(shown) & (shown > _LEAST_SHARE * whole), shown, whole)
        return np.asarray(np.hypot(output.noise_std, output.noise_cv * outputs))
    shown = np.isfinite(left) & (left > _least_left(plant, K) * whole)
    return np.where(shown, left, np.where(whole > 0, whole, 1.0))


def _least_left(plant: Plant, K: Matrix) -> float:
    """Part of an impulse that K must leave of an output: of less, samples show their spacing.

    h^2 / 8 |y''| is the largest distance of y from a line between samples h apart.
    """
    period = plant.output.period
    if period is None:
        return _LEAST_SHARE
    flows = plant.flow.A, flow_error_matrix(plant.flow.A, K, plant.output.C)
    fastest = max(float(np.abs(np.linalg.eigvals(flow)).max()) for flow in flows)
    return max(_LEAST_SHARE, _LEAST_RESOLVED * (fastest * period) ** 2 / 8)
