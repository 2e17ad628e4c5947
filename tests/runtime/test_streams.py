"""What all kinds owe a stream: samples are the caller's, and a record has at least one row."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.data.simulation import simulate
from obsdesign.data.stream import estimates_of
from obsdesign.runtime import Sample, from_design
from obsdesign.runtime.base import rows_of

EXAMPLES = Path(__file__).parents[2] / "examples"
NAMES = [
    "sampled_data", "degue_4_1", "oral_doses", "ahn_1", "quarter_car", "gantry_crane",
    "mazenc_4", "mattsson_medvedev",
]  # fmt: skip


@functools.cache
def recorded(name: str) -> tuple[Any, Any, tuple[Sample, ...]]:
    """(observer, its start, 60 samples) of an example, with noise."""
    problem = obsdesign.load_problem(EXAMPLES / f"{name}.toml")
    design = obsdesign.design(problem)
    observer = from_design(design)
    record = simulate(problem.plant, rng=np.random.default_rng(3))
    initial = [-3.0, 3.0] * problem.plant.n if design.kind == "interval" else None
    given = {letter: record.block(letter) for letter in "uw" if record.block(letter).size}
    samples = rows_of(record.t, record.block("y"), **given, jump=record.columns.get("jump"))
    rows = tuple(samples)[:60]
    return observer, observer.start(rows[0].t, initial), rows


def through_one_buffer(samples: Iterable[Sample]) -> Iterator[Sample]:
    """The same rows, each array overwritten by the next one and at last by nonsense."""
    held: dict[str, Any] = {}
    for sample in samples:
        for letter in "yuw":
            values = getattr(sample, letter)
            if values is not None:
                held.setdefault(letter, np.empty(len(values)))[:] = values
        there = {a: held[a] for a in "yuw" if getattr(sample, a) is not None}
        yield sample._replace(**there)
        for values in held.values():
            values[:] = 1e6


def numbers(estimates: Iterable[Any]) -> list[Any]:
    return [
        [None if x is None else np.array(x).tolist() for x in (row.x, row.lower, row.upper)]
        + [None if row.d is None else row.d[np.isfinite(row.d)].tolist(), row.status]
        for row in estimates
    ]


@pytest.mark.parametrize("name", NAMES)
def test_a_stream_may_reuse_one_buffer(name: str) -> None:
    observer, state, samples = recorded(name)
    own = numbers(estimates_of(observer, state, iter(samples), live=True))
    shared = numbers(estimates_of(observer, state, through_one_buffer(samples), live=True))
    assert len(own) == len(samples)
    assert shared == own


@pytest.mark.parametrize("name", NAMES)
def test_a_record_without_rows_is_refused(name: str) -> None:
    observer, _, _ = recorded(name)
    n = observer.gains["A"].shape[0]
    box = {"lower": [-1.0] * n, "upper": [1.0] * n}
    bounds = box if observer.kind == "interval" else {}
    with pytest.raises(ValueError, match="at least one row is required"):
        observer.run_batch([], [], **bounds)
