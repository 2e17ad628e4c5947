"""Counts of a run: reasons of one kind together, in memory that the record does not change."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.data.csv_text import estimate_line
from obsdesign.data.tally import Tally
from obsdesign.runtime import Sample, from_design
from obsdesign.runtime.base import Estimate
from obsdesign.runtime.status import VOID, late_sample, reasons_of, status_of, void_since

EXAMPLES = Path(__file__).parents[2] / "examples"
NAMES = [
    "sampled_data", "thermometer", "gantry_crane", "quarter_car", "mazenc_4", "ahn_1", "two_rooms",
    "mattsson_medvedev", "valve",
]  # fmt: skip


@functools.cache
def observer_of(name: str) -> tuple[obsdesign.Problem, Any]:
    problem = obsdesign.load_problem(EXAMPLES / f"{name}.toml")
    return problem, from_design(obsdesign.design(problem))


def bad_estimates(name: str, rows: int) -> list[Estimate]:
    """Estimates of a record that keeps nothing of its plant: times, samples, jumps, values."""
    (problem, observer), rng = observer_of(name), np.random.default_rng(5)
    plant = problem.plant
    p, t = observer.reads["y"], 0.0
    modes = [mode.name for mode in plant.modes]
    bounds = "set_membership" in observer.kind or observer.kind == "interval"
    state = observer.start(0.0, [-9.0, 9.0] * plant.n if bounds else None)
    samples, u = [], np.zeros(observer.reads["u"])
    for k in range(rows):
        y = None if rng.random() < 0.3 else rng.normal(size=p)
        jump = bool(observer.reads["jump"]) and rng.random() < 0.3
        mode = str(rng.choice(modes)) if modes else None
        samples.append(Sample(t, y, u, jump=jump, mode=mode))
        t += float(rng.choice([0.1, 0.25, 1.0])) * float(rng.random())
        if k % 50 == 49:
            t += 30.0
    return list(observer.run(state, samples))


@pytest.mark.parametrize("name", NAMES)
def test_a_longer_record_has_no_more_kinds(name: str) -> None:
    estimates = bad_estimates(name, 400)
    tally, texts, half = Tally(), set[str](), 0
    for k, estimate in enumerate(estimates):
        tally.add(estimate.t, estimate.status)
        texts |= set(reasons_of(estimate.status))
        assert estimate.status == ("; ".join(reasons_of(estimate.status)) or "ok")
        assert "," not in estimate.status
        assert len(estimate_line(estimate).split(",")) == len(observer_of(name)[1].names) + 2
        half = len(tally.kinds) if k < len(estimates) // 2 else half
    assert tally.rows == len(estimates) > tally.good
    assert len(tally.kinds) <= half + 1
    assert len(tally.kinds) < 12
    assert len(texts) >= len(tally.kinds)


def test_numbers_of_a_kind_are_a_range_with_its_first_row() -> None:
    tally = Tally()
    tally.add(0.0, "ok")
    for t, apart in ((1.5, 1.5), (4.0, 2.5), (5.2, 1.2)):
        tally.add(t, status_of([late_sample(apart, 1.0)]))
    assert str(tally) == (
        "3 time since the last sample exceeds 1 (1.2 to 2.5; first at t = 1.5), 1 ok"
    )


def test_other_limits_and_sensors_are_other_kinds() -> None:
    tally = Tally()
    reasons = [late_sample(3.0, 1.0), late_sample(3.0, 2.0), late_sample(3.0, 1.0).of_clock("gps")]
    for reason in reasons:
        tally.add(3.0, status_of([reason]))
    assert len(tally.kinds) == 3


def test_void_rows_are_counted_whatever_refuted_the_bounds() -> None:
    tally = Tally()
    for cause in ("bounds crossed", "y1 outside its bounds"):
        tally.add(1.0, status_of([void_since(0.5, cause)]))
    tally.add(2.0, "void in name alone")
    assert tally.rows_with(VOID) == 2
    assert tally.rows_with("missing sample") == 0
