"""A design in the hands of other tools: gains for MATLAB, an estimator for python-control."""

from __future__ import annotations

import io
import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from lmi.arithmetic.arrays import Matrix, Value
from obsdesign.column_names import numbered
from obsdesign.document import Design
from obsdesign.equations.estimation_error import flow_error_matrix
from obsdesign.equations.luenberger.gains import LuenbergerGains, StepGains
from obsdesign.errors import InputError
from obsdesign.output_files import write_bytes

# why the observer of a kind is no linear time-invariant system from (y, u) to x_hat
_NOT_LINEAR = {
    "interval": "it answers with bounds, which follow its jumps and the noise bounds",
    "impulsive": "it works on the measurements of a sliding window of impulses",
    "finite_time": "it works on the samples of a sliding window",
    "impulsive_input": "it looks for impulses in a sliding window and answers with a delay",
    "unknown_input": "it differentiates y, which no proper state-space model does",
}


def save_mat(design: Design, path: str | os.PathLike[str]) -> None:
    """Write gains to a MATLAB file, each under its name; name, kind and digest beside them.

    The plant and the [observer] block stand in the struct `problem`, with the keys of a problem
    file; infinity is Inf. Vectors are columns. An existing file is replaced whole or not at all;
    InputError when it cannot be written.
    """
    from scipy.io import savemat

    about = {"name": design.name, "kind": design.kind, "digest": design.digest}
    body = {**_matlab(design.gains), **about, "problem": _matlab(design.problem)}
    content = io.BytesIO()
    savemat(content, body, long_field_names=True, oned_as="column")
    write_bytes(path, content.getvalue())


def _matlab(value: Value) -> Value:
    """Values that savemat accepts: dicts, texts, arrays; rows of different shape as cells."""
    if isinstance(value, Mapping):
        return {str(key): _matlab(item) for key, item in value.items() if item is not None}
    if isinstance(value, bool):
        return np.array(value)
    if isinstance(value, str):
        return np.array(np.inf) if value == "inf" else value
    if isinstance(value, list | tuple):
        parts = [_matlab(item) for item in value]
        shapes = {np.shape(part) if isinstance(part, np.ndarray) else None for part in parts}
        if len(shapes) == 1 and None not in shapes:
            return np.array(parts)
        cells = np.empty(len(parts), dtype=object)
        cells[:] = parts
        return cells
    return np.asarray(value, dtype=np.float64)


def control_estimator(design: Design) -> Any:
    """The observer as a `control.StateSpace` from (y1, ..., yp, u1, ..., um) to x_hat.

        x_hat' = (A - L C) x_hat + [L, B] (y; u),    n states, n outputs

    In discrete time, with the step dt of the plant and the estimate before the sample as its state,
    x_hat = (I - L C) z + L y, z+ = A x_hat + B u.
    It makes sense for kind `luenberger` without jumps. InputError for every other design, with the
    reason; where the middle of flow.disturbance is not zero, since a linear system adds no
    constant; and when python-control (extra `interop`) is not installed.
    """
    gains, why = design.gains, _reason_against_linear(design)
    if why is not None:
        raise InputError(
            f"a control estimator exists for kind 'luenberger' without jumps; this design is of "
            f"kind {design.kind!r}: {why}. Run it with obsdesign.runtime."
        )
    is_discrete = "dt" in gains
    typed = (StepGains if is_discrete else LuenbergerGains).from_document(gains)
    if np.any(typed.flow_lower + typed.flow_upper):
        raise InputError(
            "a control estimator needs flow.disturbance with its middle at 0, since a linear "
            "system adds no constant; it is elsewhere. Take the middle out of the plant first."
        )
    try:
        import control
    except ImportError:
        raise InputError(
            "a control estimator requires the package `control`; it is missing: "
            "pip install 'obsdesign[interop]'."
        ) from None
    (n, p), m = typed.L.shape, typed.m
    states = [f"x{i + 1}_hat" for i in range(n)]
    inputs = [*numbered("y", p), *numbered("u", m)]
    return control.StateSpace(
        *_matrices(typed), inputs=inputs, outputs=states, states=states,
        name=f"{design.name}_observer",
    )  # fmt: skip


def _reason_against_linear(design: Design) -> str | None:
    """Why the estimator is no time-invariant linear system, or None."""
    gains = design.gains
    if "modes" in gains:
        return "its gains change with the mode"
    if design.kind != "luenberger":
        return _NOT_LINEAR.get(design.kind)
    if gains.get("period", gains.get("dt")) != gains.get("dt"):
        return "it is corrected every few steps alone"
    if "G" in gains:
        return "its estimate jumps with the plant; a state-space model does not"
    return None


def _matrices(gains: LuenbergerGains | StepGains) -> tuple[Matrix, Matrix, Matrix, Matrix, float]:
    """A, B, C, D of the estimator from (y, u) to x_hat, and its time step, 0 for a flow."""
    A, L, C, (n, p) = gains.A, gains.L, gains.C, gains.L.shape
    B = np.zeros((n, 0)) if gains.B is None else gains.B
    still = np.zeros((n, B.shape[1]))
    if isinstance(gains, LuenbergerGains):
        F = flow_error_matrix(A, L, C)
        return F, np.hstack([L, B]), np.eye(n), np.hstack([np.zeros((n, p)), still]), 0
    kept = np.eye(n) - L @ C
    return A @ kept, np.hstack([A @ L, B]), kept, np.hstack([L, still]), gains.step
