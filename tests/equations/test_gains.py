"""Typed gains: what they refuse, and that nobody writes into them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from lmi.arithmetic.arrays import Array
from obsdesign.equations.gains import Gains, PlantGains
from obsdesign.equations.stored import count, flag, matrix, number, word


@dataclass(frozen=True, kw_only=True, eq=False)
class Entries(Gains):
    X: Array = matrix("p", "k")
    pair: Array | None = matrix(2, optional=True)
    size: float = number()
    many: int = count()
    name: str = word("one", "two")
    yes: bool = flag()
    perhaps: bool | None = flag(optional=True)

    @property
    def columns(self) -> dict[str, int | bool]:
        return {}


PLAIN: dict[str, Any] = {
    "A": [[0.0, 1.0], [2.0, 3.0]], "C": [[1.0, 0.0]], "X": [[5.0, 6.0, 7.0]],
    "size": 1.5, "many": 2, "name": "two", "yes": True,
}  # fmt: skip


def test_entries_are_read_and_written() -> None:
    gains = Entries.from_document(PLAIN | {"unknown": 1})
    assert (gains.n, gains.p) == (2, 1)
    assert gains.X.tolist() == PLAIN["X"]
    assert (gains.size, gains.many, gains.name, gains.yes) == (1.5, 2, "two", True)
    assert gains.pair is None
    assert gains.perhaps is None
    document = gains.to_document()
    assert set(document) == set(PLAIN)
    assert {name: np.asarray(value).tolist() for name, value in document.items()} == PLAIN
    assert Entries(**PLAIN | {"size": math.inf}).size == math.inf
    assert Entries(**PLAIN | {"perhaps": np.bool_(False)}).perhaps is False
    assert Entries(**PLAIN | {"many": np.int64(1)}).many == 1


def test_arrays_are_copies_that_nobody_writes_into() -> None:
    X = np.array(PLAIN["X"])
    gains = Entries(**PLAIN | {"X": X})
    X[0, 0] = 9.0
    assert gains.X[0, 0] == 5.0
    with pytest.raises(ValueError, match="read-only"):
        gains.X[0, 0] = 9.0


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("A", [[1.0, 2.0]], r"gains.A must have shape \(1, 1\) \(n x n\); got shape \(1, 2\)."),
        ("A", [1.0], r"gains.A must have shape n x n; got shape \(1,\)."),
        (
            "C",
            [[1.0, 2.0, 3.0]],
            r"gains.C must have shape \(1, 2\) \(p x n\); got shape \(1, 3\).",
        ),
        ("X", [[1.0], [2.0]], r"gains.X must have shape \(1, 1\) \(p x k\); got shape \(2, 1\)."),
        ("X", [[1.0], [2.0, 3.0]], r"gains.X must have shape p x k"),
        ("X", "X", "gains.X must have shape p x k"),
        ("X", [[math.nan]], "gains.X must be finite."),
        ("pair", [1.0], r"gains.pair must have shape \(2,\) \(2\); got shape \(1,\)."),
        ("pair", [1.0, math.inf], "gains.pair must be finite."),
        ("noise_centre", [1.0, 2.0], "gains.noise_centre must have shape"),
        ("size", [1.0], r"gains.size must have shape number; got shape \(1,\)."),
        ("many", 0, "gains.many must be a whole number >= 1; got 0."),
        ("many", True, "gains.many must be a whole number >= 1; got True."),
        ("many", 1.0, "gains.many must be a whole number >= 1; got 1.0."),
        ("name", "three", "gains.name must be one of one, two."),
        ("yes", 1, "gains.yes must be true or false."),
        ("perhaps", "no", "gains.perhaps must be true or false."),
    ],
)
def test_what_does_not_fit_is_refused(name: str, value: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Entries(**PLAIN | {name: value})


@pytest.mark.parametrize("name", sorted(PLAIN))
def test_what_is_missing_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match=f"gains.{name} is missing."):
        Entries.from_document({key: value for key, value in PLAIN.items() if key != name})


PLANT: dict[str, Any] = {
    "A": np.eye(2), "C": [[1.0, 0.0]], "flow_lower": [-1.0, 0.0], "flow_upper": [2.0, 4.0],
    "jump_measurement": "none",
}  # fmt: skip
JUMP: dict[str, Any] = {"G": np.eye(2), "jump_lower": [0.0, 1.0], "jump_upper": [1.0, 3.0]}


def test_numbers_of_the_plant() -> None:
    plain, full = (
        PlantGains(**PLANT),
        PlantGains(
            **PLANT, **JUMP, B=np.ones((2, 3)), E=np.ones((2, 4)), dwell_time=[0.5, math.inf]
        ),
    )
    assert plain.flow_drift.tolist() == [0.5, 2.0]
    assert plain.jump_drift.tolist() == [0.0, 0.0]
    assert full.jump_drift.tolist() == [0.5, 2.0]
    assert plain.columns == {"y": 1, "u": 0, "w": 0, "jump": False}
    assert full.columns == {"y": 1, "u": 3, "w": 4, "jump": True}
    assert plain.dwell_range == (0.0, math.inf)
    assert full.dwell_range == (0.5, math.inf)
    assert full.jump_matrix is full.G
    with pytest.raises(ValueError, match="this plant has no jumps"):
        _ = plain.jump_matrix
    for name in ("jump_lower", "jump_upper"):
        with pytest.raises(ValueError, match=f"gains.{name} must have shape n; got nothing."):
            PlantGains(**PLANT, **{key: value for key, value in JUMP.items() if key != name})
