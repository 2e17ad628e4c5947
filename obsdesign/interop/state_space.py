"""State-space models of other packages (scipy.signal, control) as problems. Imports neither."""

from __future__ import annotations

import math
from collections.abc import Sequence
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
    dt: float | None = None,
    parameter: Sequence[Entries] | None = None,
    state: Entries | None = None,
) -> Problem:
    """A problem from a model x' = A x + B u, or x(t + dt) = A x + B u, with y = C x.

    system: anything with matrices A (n, n), B (n, m), C (p, n), D (p, m) and a time step `dt`, as
    `scipy.signal.StateSpace` and `control.StateSpace` have. flow, output: further keys of [flow]
    (D, disturbance) and [output]; jump, observer, parameter, state: those blocks, the system being
    the plant to which parameters add. dt: the step of a model in discrete
    time that does not state it (True in python-control). InputError for such a model without it, a
    feedthrough D, an object without the matrices, or A, B, C, dt given twice.
    """
    _require_strictly_proper(system)
    step = _step(system, dt)
    for block, given, taken in (("flow", flow, ("A", "B", "dt")), ("output", output, ("C",))):
        for key in taken:
            if key in (given or {}):
                raise InputError(f"{block}.{key} is given by the system; give it once.")
    known = {"B": system.B} if np.any(system.B) else {}
    known |= {} if step is None else {"dt": step}
    return Problem(
        {**(flow or {}), "A": system.A, **known},
        {**(output or {}), "C": system.C},
        jump,
        observer,
        name,
        parameter=parameter,
        state=state,
    )


def _require_strictly_proper(system: Any) -> None:
    """InputError unless the system has matrices and no feedthrough."""
    missing = [key for key in ("A", "B", "C", "D") if not hasattr(system, key)]
    if missing:
        raise InputError(
            f"system must have matrices A, B, C, D; {type(system).__name__} has no {missing[0]}. "
            "Convert a transfer function to a state space first."
        )
    if np.any(system.D):
        raise InputError(
            "system must have no feedthrough, y = C x; its D is not zero. "
            "Subtract D u from the measurement and set D to zero."
        )


def _step(system: Any, dt: float | None) -> float | None:
    """The step of a system in discrete time, None for a flow; InputError where it is not known."""
    stated = getattr(system, "dt", None)
    if stated is True:
        if dt is None:
            raise InputError(
                "system is in discrete time and does not state its step (dt is True); give it as "
                "dt=."
            )
        return dt
    if dt is not None:
        raise InputError(f"dt is stated by the system, {stated!r}; give it once.")
    if stated is None or stated == 0 or math.isinf(stated):
        return None
    return float(stated)
