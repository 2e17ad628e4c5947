"""Do the gains of an impulsive design fit each other? Asked before anything runs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from obsdesign.equations.impulsive.gains import LONGEST_WINDOW, STRATEGIES


def require_impulsive_gains(gains: Mapping[str, Any]) -> None:
    """ValueError unless every entry that the observer uses is there, in its shape."""
    strategy = gains.get("strategy")
    if strategy not in STRATEGIES:
        raise ValueError(f"gains.strategy must be one of {', '.join(STRATEGIES)}.")
    n, p = np.shape(gains.get("A", ()))[:1], np.shape(gains.get("C", ()))[:1]
    shapes: dict[str, tuple[int, ...]] = {"A": n + n, "C": p + n, "G": n + n, "dwell_time": (2,)}
    shapes |= dict.fromkeys(("flow_lower", "flow_upper", "jump_lower", "jump_upper"), n)
    d = n
    if strategy == "subspace":
        place = gains.get("core_place", ())
        if np.shape(place) != (2,) or not _whole(place) or not n or sum(place) > n[0]:
            raise ValueError("gains.core_place must be two whole numbers, first and size.")
        d = (int(place[1]),)
        shapes |= {"basis": n + n, "core_A": d + d, "core_G": d + d, "core_C": p + d}
    if strategy == "compressed" or "image" in gains:
        r = np.shape(gains.get("image", ()))[1:]
        shapes |= {"image": d + r, "coimage": r + d}
    if strategy == "quadratic":
        cells = np.shape(gains.get("cells", ()))
        shapes |= {"cells": cells, "table": (cells[0] - 1 if cells else 0, *n, *p)}
    elif not (
        _whole([gains.get("window")])
        and 1 <= gains["window"] <= LONGEST_WINDOW
        and _above_one(gains.get("alpha"))
    ):
        raise ValueError(
            f"gains.window must be a whole number from 1 to {LONGEST_WINDOW}, and gains.alpha "
            "above 1."
        )
    for name, shape in shapes.items():
        value = gains.get(name)
        if 0 in shape or not shape or not isinstance(value, np.ndarray | list):
            raise ValueError(f"gains.{name} must have shape {shape}; got nothing of the kind.")
        if np.shape(value) != shape:
            raise ValueError(f"gains.{name} must have shape {shape}; got shape {np.shape(value)}.")
    for name in ("B", "E"):
        if name in gains and (np.ndim(gains[name]) != 2 or len(gains[name]) != n[0]):
            raise ValueError(f"gains.{name} must have {n[0]} rows.")
    if gains.get("jump_measurement") not in ("before", "after"):
        raise ValueError("gains.jump_measurement must be before or after.")


def _whole(values: Any) -> bool:
    return all(
        isinstance(value, int | float | np.number)
        and not isinstance(value, bool)
        and float(value).is_integer()
        and value >= 0
        for value in values
    )


def _above_one(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and 1 < value < np.inf
