"""What one step of the unknown-input observer is made of: state, matrix, differentiator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.equations.unknown_input import matrices as equations
from obsdesign.equations.unknown_input.smoothing import smoothed
from obsdesign.runtime.base import Sample, Vector, optional_measurement

# of measurements: differences and products of larger ones overflow
_LARGEST = 1e150


class UnknownInputState(NamedTuple):
    """Everything the next step needs.

    t: time of the last row; t_seen, w, y: time, reduced state and output at the last measurement
    (y None: none yet, w then a guess or None); u: [u; 1] held since t; used: integral of it since
    t_seen; slope: (h, mean of y, y') of the last interval, for `damped`; last: its length, the
    matrix of such steps (None until a second one follows) and what there is to say of them;
    moderate: w, x and d are below `MODERATE`.
    """

    t: float
    t_seen: float
    x: Vector
    w: Vector | None
    y: Vector | None
    u: Vector
    used: Vector | None
    slope: tuple[float, Vector, Vector] | None = None
    last: tuple[float, Vector | None, str] | None = None
    started: bool = True
    moderate: bool = False


def stacked(g: Mapping[str, Any], h: float, damped: bool) -> Vector:
    """[w; y_prev; y; U] -> [w+; x; d] for an interval of length h; with damped, d without N Y'."""
    F, p = g["F"], len(g["C"])
    eye, half = np.eye(len(F)), h / 2 * F
    driven = np.hstack([eye + half, h / 2 * g["H"], h / 2 * g["H"], h * g["Gu"]])
    w = np.linalg.solve(eye - half, driven)
    x = g["X"] @ w
    x[:, len(F) + p : len(F) + 2 * p] += g["Xy"]
    w_mean = w / 2
    w_mean[:, : len(F)] += eye / 2
    slope = np.zeros_like(g["N"]) if damped else g["N"] / h
    d = g["Q"] @ w_mean
    d += np.hstack([np.zeros(g["Q"].shape), g["R"] / 2 - slope, g["R"] / 2 + slope, g["S"]])
    return np.vstack([w, x, d])


class FreeStep:
    """A step of any length without its matrix: one solution of (I - hF/2) w+ = ..., no cache."""

    def __init__(self, g: Mapping[str, Any], damped: bool) -> None:
        F, H, N, (n, k) = g["F"], g["H"], g["N"], g["X"].shape
        self.k, self.q, self.eye, self.half = k, len(N), np.eye(k), F / 2
        slope = np.zeros_like(N) if damped else N
        # [w; y_prev; y; U] -> the driven part of w', that of [x; d] beside w+, and N (y - y_prev)
        self.known = np.block(
            [
                [F / 2, H / 2, H / 2, g["Gu"]],
                [
                    np.zeros((n, k)),
                    np.zeros((n, len(g["C"]))),
                    g["Xy"],
                    np.zeros((n, g["S"].shape[1])),
                ],
                [g["Q"] / 2, g["R"] / 2, g["R"] / 2, g["S"]],
                [np.zeros((len(N), k)), -slope, slope, np.zeros(g["S"].shape)],
            ]
        )
        self.end = np.vstack([g["X"], g["Q"] / 2])

    def of(self, h: float, known: Vector) -> tuple[Vector, Vector]:
        """(w+, [x; d]) as `stacked` gives them in one."""
        k, q, driven = self.k, self.q, self.known.dot(known)
        w = known[:k] + h * driven[:k]
        if k:
            w = np.linalg.solve(self.eye - h * self.half, w)
        found = driven[k:-q] + self.end.dot(w)
        found[-q:] += driven[-q:] / h
        return w, found


def damped_slope(state: UnknownInputState, h: float, y: Vector) -> tuple[float, Vector, Vector]:
    """(h, mean of y, y') with the pole at -DAMPING; intervals of any length."""
    assert state.y is not None
    mean = (y + state.y) / 2
    if state.slope is None:
        return h, mean, (y - state.y) / h
    before, mean_before, slope = state.slope
    r = equations.DAMPING
    return h, mean, (1 + r) * (mean - mean_before) / ((h + before) / 2) - r * slope


def usable(y: ArrayLike | None, size: int) -> tuple[Vector | None, str]:
    """(the measurement or None, why it is not used)."""
    found = optional_measurement(y, size)
    if found is None:
        return None, "missing sample"
    if not np.abs(found).max() < _LARGEST:
        return None, f"measurement beyond {_LARGEST:g}"
    return found, ""


def kept(sample: Sample) -> Sample:
    """A sample that outlives the caller's arrays."""
    y, u = (None if values is None else np.array(values) for values in (sample.y, sample.u))
    return sample._replace(y=y, u=u)


def smoothed_record(samples: Sequence[Sample], deviation: Vector) -> list[Sample]:
    """The samples with each output smoothed to its noise; missing ones stay missing."""
    rows = [usable(sample.y, len(deviation))[0] for sample in samples]
    there = [k for k, y in enumerate(rows) if y is not None]
    if not there:
        return list(samples)
    t = np.array([float(samples[k].t) for k in there])
    if not np.all(np.diff(t) > 0):
        raise ValueError("time must increase in a record that is smoothed.")
    values = smoothed(t, np.array([rows[k] for k in there]), deviation)
    result = list(samples)
    for k, y in zip(there, values, strict=True):
        result[k] = samples[k]._replace(y=y)
    return result
