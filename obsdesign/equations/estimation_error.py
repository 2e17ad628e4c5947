"""The estimation error of a linear plant with jumps, and the plant's numbers a runtime needs.

    e'(t) = (A - L C) e + ...        between jumps
    e(t)  = H e(t-) + ...            at jumps

shared by every observer that corrects with L between jumps and with M at them.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]  # float64, or object arrays of exact rationals


def flow_error_matrix(A: Array, L: Array, C: Array) -> Array:
    """F = A - L C: the estimation error between jumps."""
    return A - L @ C


def jump_error_matrix(G: Array, M: Array, C: Array, jump_measurement: str) -> Array:
    """H: the estimation error at a jump.

    `before`: x+ = G x- + M (y- - C x-); `after`: the correction acts on the predicted post-jump
    state; `none`: no measurement at jumps.
    """
    if jump_measurement == "before":
        return G - M @ C
    if jump_measurement == "after":
        return G - M @ (C @ G)
    return G


def seen_before_jump(G: Array, C: Array, jump_measurement: str) -> Array:
    """What a measurement at a jump sees of the state before it: C, or C G for one after it."""
    return C @ G if jump_measurement == "after" else C


def jump_disturbance_matrix(M: Array, C: Array, n: int, jump_measurement: str) -> Array:
    """How c enters the error at a jump: I, or I - M C when the measurement is post-jump."""
    identity = np.eye(n, dtype=np.int64)
    return identity - M @ C if jump_measurement == "after" else identity


def plant_data(plant: Any) -> dict[str, Any]:
    """The plant's numbers that the runtime needs, under the names of a design's `gains`.

    `plant` has the attributes of `obsdesign.problem.plant.Plant`. What it does not state is left
    out: the entries of the jump where there is none, and a dwell time that may be any.
    """
    flow, jump, output = plant.flow, plant.jump, plant.output
    data: dict[str, Any] = {"A": flow.A, "C": output.C}
    if flow.B is not None:
        data["B"] = flow.B
    data |= {"flow_lower": flow.lower, "flow_upper": flow.upper}
    if jump is not None:
        data["G"] = jump.G
        if jump.E is not None:
            data["E"] = jump.E
        data |= {"jump_lower": jump.lower, "jump_upper": jump.upper}
        if jump.dwell_time is not None:
            data["dwell_time"] = list(jump.dwell_time)
        if math.isfinite(jump.dwell_jitter):
            data["dwell_jitter"] = jump.dwell_jitter
    if output.noise_bound is not None:
        data["noise_bound"] = output.noise_radius
        if output.noise_centre is not None:
            data["noise_centre"] = output.noise_centre
    return data | {"jump_measurement": output.jump_measurement}


def noise_box(bound: Any) -> tuple[NDArray[np.float64] | None, NDArray[np.float64]]:
    """(centre, radius) of bounds of the noise, (p,) or pairs (p, 2); all |v - centre| <= radius.

    centre: None where all bounds are symmetric.
    """
    values = np.asarray(bound, dtype=np.float64)
    if values.ndim == 1:
        return None, values
    lower, upper = values.T
    centre = lower + (0.5 * upper - 0.5 * lower)
    radius = np.maximum(_difference_up(upper, centre), _difference_up(centre, lower))
    return (centre if centre.any() else None), radius


def _difference_up(a: Array, b: Array) -> Array:
    """a - b, rounded up where it is rounded; by the error of a sum (Knuth, TAOCP 2, 4.2.2)."""
    difference = a - b
    virtual = difference - a
    error = (a - (difference - virtual)) - (b + virtual)
    return np.where(error > 0, np.nextafter(difference, np.inf), difference)


def idle_gains(plant: Any) -> dict[str, str]:
    """Gains that can only be zero, since nothing is measured where they act, and why."""
    idle = {}
    if plant.output.measured == "at_jumps":
        idle["L"] = "output.measured is 'at_jumps': nothing is measured between jumps"
    if plant.jump is None:
        idle["M"] = "there is no [jump]"
    elif plant.output.jump_measurement == "none":
        idle["M"] = "output.jump_measurement is 'none'"
    return idle
