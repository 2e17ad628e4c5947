"""Widths that are claimed hold for samples off the period too, or a row says that none is claimed."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest

import obsdesign
from lmi.arithmetic.exponential import expm
from obsdesign.runtime import Sample, from_design
from obsdesign.runtime.interval.observer import IntervalObserver

Matrix = np.ndarray[Any, np.dtype[np.float64]]


@cache
def periodic_design(when: str = "before", dwell: float = 1.25) -> obsdesign.Design:
    # |I - L C| = [[1, 5], [0, 0]]: each use of a sample widens x1 by five times the width of x2
    return obsdesign.design(
        obsdesign.Problem(
            flow={"A": [[-1, 0], [0, -1]],
                  "disturbance": {"lower": [-1e-3] * 2, "upper": [1e-3] * 2}},
            jump={"G": [[1, 0], [0, 1]], "dwell_time": [dwell, dwell],
                  "disturbance": {"lower": [-1e-3] * 2, "upper": [1e-3] * 2}},
            output={"C": [[0, 1]], "noise_bound": [0.5], "measured": "periodic", "period": 1.0,
                    "jump_measurement": when},
            observer={"kind": "interval", "gains": {"L": [[5], [1]], "M": [[0], [0]]}},
        )
    )  # fmt: skip


def claimed(design: obsdesign.Design, name: str = "sampled_stability") -> Matrix:
    return np.array(next(c for c in design.claims if c.id == name).evidence["always"])


def record(observer: IntervalObserver, extra: list[float], dwell: float) -> tuple[list[Any], ...]:
    """Samples a period apart from 0, at all jumps, and at further times; the state decays."""
    jumps = {round(dwell * k, 9) for k in range(1, int(47 / dwell) + 1)}
    times = sorted({float(k) for k in range(48)} | jumps | set(extra))
    x, state, now = np.ones(2), observer.init(0.0, lower=[1, 1], upper=[1, 1]), 0.0
    estimates, truth, samples = [], [], []
    for t in times:
        x = expm(-np.eye(2) * (t - now)) @ x
        samples.append(Sample(t, x[1:].copy(), jump=t in jumps))
        state, row = observer.step(state, samples[-1])
        estimates.append(row)
        truth.append(x)
        now = t
    return estimates, truth, samples


@pytest.mark.parametrize("when", ["before", "after"])
@pytest.mark.parametrize("early", [(), (0.25, 0.75), (0.2, 0.4, 0.6, 0.8)])
@pytest.mark.parametrize("dwell", [1.25, 1.0001])
def test_samples_off_the_period_only_narrow(when: str, early: Any, dwell: float) -> None:
    design = periodic_design(when, dwell)
    extra = [round(k + part, 9) for k in range(47) for part in early]
    rows, truth, _ = record(from_design(design), extra, dwell)
    for row, x in zip(rows, truth, strict=True):
        assert row.status == "ok"
        assert np.all(row.lower <= x)
        assert np.all(x <= row.upper)
        assert np.all(row.upper - row.lower <= claimed(design) * (1 + 1e-9))


def test_a_sample_off_the_period_never_makes_a_later_row_wider() -> None:
    observer = from_design(periodic_design())
    extra = [round(k + part, 9) for k in range(47) for part in (0.1, 0.75)]
    rows, _, samples = record(observer, extra, 1.25)
    state = observer.init(0.0, lower=[1, 1], upper=[1, 1])
    for row, sample in zip(rows, samples, strict=True):
        seen = sample.y if sample.t % 1 == 0 else None
        state, bare = observer.step(state, Sample(sample.t, seen, jump=sample.jump))
        widths = [one.upper - one.lower for one in (row, bare)]
        assert np.all(widths[0] <= widths[1] * (1 + 1e-9))


def test_batches_know_the_period_as_well() -> None:
    observer = from_design(periodic_design())
    rows, _, samples = record(observer, [round(0.05 * k, 9) for k in range(930)], 1.25)
    batch = observer.run_batch(
        [s.t for s in samples], [s.y for s in samples], jump=[s.jump for s in samples],
        lower=[1, 1], upper=[1, 1],
    )  # fmt: skip
    assert list(batch.status) == [row.status for row in rows]
    np.testing.assert_allclose(batch.upper, [row.upper for row in rows], atol=1e-9)


def test_a_period_without_its_sample_is_said() -> None:
    observer = from_design(periodic_design())
    state = observer.init(0.0, lower=[1, 1], upper=[1, 1])
    said = []
    for t in (0.0, 0.6, 1.2, 1.8):
        state, row = observer.step(state, Sample(t, [math.exp(-t)]))
        said.append(row.status)
    late = "no sample 1 after the one at 0: no width is guaranteed"
    assert said == ["ok", "ok", late, "ok"]


def unstable_design(when: str = "none", gain: float = 3.0) -> obsdesign.Design:
    return obsdesign.design(
        obsdesign.Problem(
            flow={"A": [[1.0]], "disturbance": {"lower": [-0.1], "upper": [0.1]}},
            jump={"G": [[1.0]], "dwell_time": [0.02, 0.5]},
            output={"C": [[1]], "noise_bound": [0.03], "jump_measurement": when, "period": 0.1},
            observer={"kind": "interval", "gains": {"L": [[gain]], "M": [[0]]}},
        )
    )


def test_a_step_without_a_sample_at_either_end_is_said() -> None:
    design = unstable_design()
    sentence = next(g["statement"] for g in design.guarantees if "0.1 apart" in g["statement"])
    assert "a sample between any two jumps" in sentence
    said = _statuses(from_design(design), jumps=(0.12, 0.14, 0.16))
    nothing = "no sample at either end of the step: no width is guaranteed"
    assert said == ["ok", "ok", "ok", nothing, nothing, "ok", "ok"]
    assert set(_statuses(from_design(design), jumps=(0.12, 0.25))) == {"ok"}


def test_where_y_is_known_at_jumps_no_sample_is_asked_for_between_them() -> None:
    design = unstable_design("before")
    assert not any("between any two jumps" in g["statement"] for g in design.guarantees)
    said = _statuses(from_design(design), jumps=(0.12, 0.14, 0.16), seen=True)
    assert set(said) == {"ok"}


def _statuses(observer: IntervalObserver, jumps: tuple[float, ...], seen: bool = False) -> Any:
    state, said = observer.init(0.0, lower=[0], upper=[0]), []
    for t in sorted({0.0, 0.1, 0.2, 0.3} | set(jumps)):
        y = None if t in jumps and not seen else [0.0]
        state, row = observer.step(state, Sample(t, y, jump=t in jumps))
        said.append(row.status)
    return said


@cache
def dwell_of_a_period(when: str) -> obsdesign.Design:
    return obsdesign.design(
        obsdesign.Problem(
            flow={"A": [[-1, 0], [1, -2]],
                  "disturbance": {"lower": [-0.1] * 2, "upper": [0.1] * 2}},
            jump={"G": [[1.5, 0.5], [0.2, 1.3]], "dwell_time": [0.25, 1.0],
                  "disturbance": {"lower": [-0.3] * 2, "upper": [0.3] * 2}},
            output={"C": [[1, 0], [0, 1]], "noise_bound": [0.03, 0.03], "measured": "periodic",
                    "period": 0.25, "jump_measurement": when},
            observer={"kind": "interval"},
        )
    )  # fmt: skip


def _run_with_jumps(when: str, jumps: tuple[float, ...]) -> tuple[Matrix, list[str]]:
    """(widths relative to `always`, statuses) of rows from 1 to 2: samples all 0.25, and jumps."""
    design = dwell_of_a_period(when)
    observer = from_design(design)
    state, found = observer.init(0.0, lower=[-2, -2], upper=[2, 2]), []
    samples = {0.25 * k for k in range(9)}
    for t in sorted({*samples, *jumps}):
        y = np.zeros(2) if t in samples else None
        state, row = observer.step(state, Sample(t, y, jump=t in jumps))
        found.append((t, float(((row.upper - row.lower) / claimed(design)).max()), row.status))
    found = [entry for entry in found if entry[0] >= 1.0]
    return np.array([width for _, width, _ in found]), [status for _, _, status in found]


@pytest.mark.parametrize("when", ["before", "after"])
@pytest.mark.parametrize("off", [2.0**-51, 1e-12, 1.2e-10])
def test_two_jumps_between_samples_say_that_no_width_is_claimed(when: str, off: float) -> None:
    """A dwell time of the period, but for the tolerance of time: widths more than double."""
    widths, statuses = _run_with_jumps(when, (1.25 + off, 1.5 - off))
    assert widths.max() > 2
    assert statuses[int(np.argmax(widths))] == (
        "second jump since the sample at 1.25: no width is guaranteed"
    )
    assert sum("second jump" in status for status in statuses) == 1


@pytest.mark.parametrize("when", ["before", "after"])
@pytest.mark.parametrize("shift", [-1e-12, 0.0, 1e-12, 0.1])
def test_a_jump_in_every_period_keeps_the_width(when: str, shift: float) -> None:
    jumps = tuple(0.25 * k + shift for k in range(3, 7))
    widths, statuses = _run_with_jumps(when, jumps)
    assert set(statuses) == {"ok"}
    assert (widths <= 1).all()
