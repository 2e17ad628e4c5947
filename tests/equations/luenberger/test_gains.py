"""Gains of a schedule: as many as there are cells."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from obsdesign.equations.luenberger.gains import LuenbergerGains

PLAIN: dict[str, Any] = {
    "A": np.eye(2), "C": np.eye(2)[:1], "flow_lower": np.zeros(2), "flow_upper": np.zeros(2),
    "jump_measurement": "before", "L": np.zeros((2, 1)), "M": np.zeros((2, 1)),
}  # fmt: skip


@pytest.mark.parametrize(
    ("cells", "borders", "arrived"),
    [(1, None, "1 and 0"), (2, 2, "2 and 2"), (None, 3, "0 and 3"), (None, 0, "0 and 0")],
)
def test_a_schedule_has_one_gain_more_than_borders(
    cells: int | None, borders: int | None, arrived: str
) -> None:
    stated: dict[str, Any] = {}
    if cells is not None:
        stated["M_cells"] = np.zeros((cells, 2, 1))
    if borders is not None:
        stated["dwell_borders"] = np.arange(1.0, borders + 1)
    with pytest.raises(ValueError, match=f"one matrix more than .*; got {arrived}."):
        LuenbergerGains(**PLAIN, **stated)
    LuenbergerGains(**PLAIN)
    LuenbergerGains(**PLAIN, M_cells=np.zeros((3, 2, 1)), dwell_borders=np.array([1.0, 2.0]))
