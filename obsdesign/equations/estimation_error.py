"""The estimation error of a linear plant with jumps.

    e'(t) = (A - L C) e + ...        between jumps
    e(t)  = H e(t-) + ...            at jumps

shared by every observer that corrects with L between jumps and with M at them.
"""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Array
from obsdesign.equations.plant import Plant


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
    """Output matrix of a measurement at a jump, from the state before it: C, or C G after it."""
    return C @ G if jump_measurement == "after" else C


def jump_disturbance_matrix(M: Array, C: Array, n: int, jump_measurement: str) -> Array:
    """Matrix of c in the error at a jump: I, or I - M C when the measurement is post-jump."""
    identity = np.eye(n, dtype=np.int64)
    return identity - M @ C if jump_measurement == "after" else identity


def idle_gains(plant: Plant) -> dict[str, str]:
    """Gains that can only be zero, since nothing is measured where they act, and why."""
    idle = dict[str, str]()
    if plant.output.measured == "at_jumps":
        idle |= {"L": "output.measured is 'at_jumps': nothing is measured between jumps"}
    if plant.jump is None:
        idle |= {"M": "there is no [jump]"}
    elif plant.output.jump_measurement == "none":
        idle |= {"M": "output.jump_measurement is 'none'"}
    return idle
