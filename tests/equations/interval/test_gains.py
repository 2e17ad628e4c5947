"""Gains of interval designs: what is read is what is written, and what does not fit is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from obsdesign.equations.interval.gains import IntervalGains


def entries() -> dict[str, Any]:
    """Two states, one output, jumps, form `split`."""
    unit, zero, column = np.eye(2), np.zeros((2, 2)), np.ones((2, 1))
    return {
        "form": "split", "A": -unit, "C": np.ones((1, 2)), "G": unit, "L": column, "M": column,
        "D0": -unit, "D1": zero, "Gp": unit, "Gn": zero, "noise_bound": np.zeros(1),
        "flow_lower": np.zeros(2), "flow_upper": np.zeros(2), "jump_lower": np.zeros(2),
        "jump_upper": np.zeros(2), "dwell_time": [0.5, 1.0], "jump_measurement": "before",
    }  # fmt: skip


def test_a_document_is_read_as_it_was_written() -> None:
    document = IntervalGains.from_document(entries()).to_document()
    assert next(iter(document)) == "form"
    assert document.keys() == entries().keys()
    for name, value in entries().items():
        np.testing.assert_array_equal(document[name], value)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"form": "round"}, "gains.form must be one of cooperative, split"),
        ({"D0": np.eye(3)}, r"gains.D0 must have shape \(2, 2\)"),
        ({"noise_bound": np.zeros(2)}, "gains.noise_bound must have shape"),
        ({"Gp": None}, "gains.Gp is required by form 'split'; it is missing."),
        ({"form": "coordinates"}, "gains.S is required by form 'coordinates'; it is missing."),
        ({"form": "two_coordinates", "S": np.eye(2)}, "gains.S2 is required by form"),
    ],
)
def test_what_does_not_fit_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        IntervalGains.from_document(entries() | changes)


@pytest.mark.parametrize("name", ["L", "D1", "noise_bound", "form"])
def test_what_is_missing_is_named(name: str) -> None:
    whole = entries()
    del whole[name]
    with pytest.raises(ValueError, match=f"gains.{name} is missing."):
        IntervalGains.from_document(whole)


def test_without_jumps_there_is_no_dwell_time() -> None:
    names = ("G", "Gp", "Gn", "jump_lower", "jump_upper", "dwell_time")
    gains = IntervalGains.from_document({k: v for k, v in entries().items() if k not in names})
    assert gains.dwell_ends == (np.inf, np.inf)
    assert not gains.skips_jumps
