"""Samples of an interval observer: the absolute values that its slope scheme is bounded by."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from obsdesign.equations.interval.splits import Array, absolute_metzler, in_coordinates
from obsdesign.equations.interval.width import Coordinates


def slope_scheme(
    gains: Mapping[str, Any], lift: Callable[[Any], Array], inverse: Callable[[Any], Any]
) -> tuple[Array, Array, Array, Array, Array]:
    """(|L|, |C A|, Mz(A), |C|, Delta b) in the observer's coordinates: see `runtime.interval`.

    Between two samples sig' = |C A| rho + |C| Delta b and rho' = Mz(A) rho + Delta b, and the width
    grows by |L| sig.
    """
    numbers = {name: lift(gains[name]) for name in ("A", "C", "L", "S") if name in gains}
    frame = Coordinates.of(numbers, inverse)
    A = in_coordinates(numbers["A"], frame.S, frame.S_inverse)
    C = numbers["C"] if frame.S is None else numbers["C"] @ frame.S
    size = lift(gains["flow_upper"]) - lift(gains["flow_lower"])
    inward = np.abs(frame.inward(np.eye(len(A), dtype=np.int64)))
    L = np.abs(frame.inward(numbers["L"]))
    return L, np.abs(C @ A), absolute_metzler(A), np.abs(C), inward @ size
