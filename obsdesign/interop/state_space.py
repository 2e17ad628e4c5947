"""State-space models of other packages (scipy.signal, control) as problems. Imports neither."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from lmi.arithmetic.arrays import Entries
from obsdesign.errors import InputError
from obsdesign.problem.plant import Jump
from obsdesign.problem.problem import Problem


def from_state_space(
    system: Any,
    *,
    flow: Entries | None = None,
    jump: Jump | Entries | None = None,
    output: Entries | None = None,
    observer: Entries | None = None,
    name: str = "plant",
) -> Problem:
    """A problem from a continuous-time model x' = A x + B u, y = C x.

    system: anything with matrices A (n, n), B (n, m), C (p, n), D (p, m) and a time step `dt`, as
    `scipy.signal.StateSpace` and `control.StateSpace` have. flow, output: further keys of [flow]
    (D, disturbance) and [output]; jump, observer: those blocks. InputError for a discrete model, a
    feedthrough D, an object without the matrices, or A, B, C given twice.
    """
    _require_strictly_proper(system)
    for block, given, taken in (("flow", flow, "AB"), ("output", output, "C")):
        for key in taken:
            if key in (given or {}):
                raise InputError(f"{block}.{key} is given by the system; give it once.")
    known = {"B": system.B} if np.any(system.B) else {}
    return Problem(
        {**(flow or {}), "A": system.A, **known},
        {**(output or {}), "C": system.C},
        jump,
        observer,
        name,
    )


def _require_strictly_proper(system: Any) -> None:
    """InputError unless the system has matrices, is continuous in time and has no feedthrough."""
    missing = [key for key in ("A", "B", "C", "D") if not hasattr(system, key)]
    if missing:
        raise InputError(
            f"system must have matrices A, B, C, D; {type(system).__name__} has no {missing[0]}. "
            "Convert a transfer function to a state space first."
        )
    step = getattr(system, "dt", None)
    if step is True or (step is not None and step != 0 and not math.isinf(step)):
        raise InputError(f"system must be continuous in time; its time step dt is {step!r}.")
    if np.any(system.D):
        raise InputError(
            "system must have no feedthrough, y = C x; its D is not zero. "
            "Subtract D u from the measurement and set D to zero."
        )
