"""A row that is not ok in Python is not ok in C, and says why."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from obsdesign.export.execution import Row
from obsdesign.export.manifest import Options
from obsdesign.export.timing import Steps
from obsdesign.runtime import Sample, from_design
from tests.export.plants import PROBLEMS, design_named
from tests.systems.compiled import Library
from tests.systems.designs import designed

MISSING, DWELL, UNCERTIFIED, OUTSIDE, CROSSED, OVERFLOW, STEP, VOID = (1 << k for k in range(8))
# where each reason of the runtime stands in C
WORDS = {"missing sample": MISSING, "dwell time": DWELL, "change": DWELL,
         "no width": UNCERTIFIED, "uncertified": UNCERTIFIED, "window not full": UNCERTIFIED, "since the last sample": UNCERTIFIED}  # fmt: skip


def with_noise(name: str) -> tuple[Any, tuple[float, ...]]:
    """The design with so much noise that no measurement contradicts anything."""
    body, steps = PROBLEMS[name]
    output = body["output"] | {"noise_bound": [1e3]}
    return designed(body | {"output": output}, allow_undecided=True), steps


def random_rows(library: Library, count: int) -> list[Row]:
    rng = np.random.default_rng(4)
    program = library.program
    rows, jumps = [], bool(program.jumps)
    for k in range(count):
        step = 0 if k == 0 else int(rng.integers(1, len(program.timing.lengths) + 1))
        y = None if rng.random() < 0.2 else np.zeros(1)
        u = rng.uniform(-1, 1, program.sizes.m)
        rows.append(Row(step, y, u, np.zeros(program.sizes.l), jumps and rng.random() < 0.15))
    return rows


@pytest.mark.parametrize("name", [name for name in PROBLEMS if name != "unknown"])
def test_timing_is_judged_as_in_python(name: str, tmp_path: Path) -> None:
    design, steps = with_noise(name)
    library, observer = (
        Library(tmp_path, design, Options("double", Steps(steps))),
        from_design(design),
    )
    n = library.program.sizes.n
    initial = [-np.ones(n), np.ones(n)] if library.program.has_bounds else [np.zeros(n)]
    library.start(*initial)
    state, ticks, reasons = observer.start(0.0, np.stack(initial, 1).reshape(-1).tolist()), 0, set()
    timing = library.program.timing
    for row in random_rows(library, 150):
        ticks += timing.ticks[row.step - 1] if row.step else 0
        w = row.w if row.jump else None
        sample = Sample(float(ticks * timing.tick), row.y, row.u, w, row.jump)
        state, estimate = observer.step(state, sample)
        _, status = library.step(row)
        wanted = 0
        for word, flag in WORDS.items():
            reasons_of_row = estimate.status.replace("contains a missing sample", "").split("; ")
            wanted |= flag if any(word in reason for reason in reasons_of_row) else 0
        assert (status == 0) is (estimate.status == "ok"), (status, estimate.status)
        assert status == wanted, (status, estimate.status)
        reasons.add(status)
    assert len(reasons) > 1


@pytest.mark.parametrize("name", ["jumps", "periodic", "point"])
def test_another_length_makes_everything_void(name: str, tmp_path: Path) -> None:
    design, steps = design_named(name)
    library = Library(tmp_path, design, Options("double", Steps(steps)))
    initial = [-np.ones(2), np.ones(2)] if library.program.has_bounds else [np.zeros(2)]
    y, u = np.zeros(1), np.zeros(1)
    library.start(*initial)
    h = library.program.timing.lengths[-1]
    assert library.step(Row(0, y, u))[1] == 0
    assert library.step(Row(1, y, u), h=float(np.nextafter(h, 1.0)))[1] == 0
    for length in (0.0, h * (1 + 1e-9), 0.123, -1.0, np.nan, np.inf):
        library.start(*initial)
        library.step(Row(0, y, u))
        ends, status = library.step(Row(1, y, u), h=length)
        assert status & STEP
        assert not library.program.has_bounds or (ends == -np.inf).all()
        assert library.step(Row(1, y, u))[1] & VOID
    library.start(*initial)
    assert library.step(Row(0, y, u))[1] == 0


@pytest.mark.parametrize(
    "name", ["jumps", "point", "impulses", "unknown", "window", "window_driven"]
)
def test_the_first_row_states_the_known_inputs(name: str, tmp_path: Path) -> None:
    """A first row with a length: u is unknown since the start. Without inputs it is taken."""
    design, steps = design_named(name)
    library = Library(tmp_path, design, Options("double", Steps(steps)))
    n, p, m = library.program.sizes.n, library.program.sizes.p, library.program.sizes.m
    library.start(*([-np.ones(n), np.ones(n)] if library.program.has_bounds else [np.zeros(n)]))
    status = library.step(Row(1, np.zeros(p), np.zeros(m)))[1]
    assert bool(status & STEP) is (name != "window")


@pytest.mark.parametrize("precision", ["double", "float"])
def test_measurements_that_contradict_the_bounds(precision: str, tmp_path: Path) -> None:
    design, steps = design_named("jumps")
    library = Library(tmp_path, design, Options(precision, Steps(steps)))
    library.start(-np.ones(2), np.ones(2))
    u = np.zeros(1)
    assert library.step(Row(0, np.array([0.5]), u))[1] == 0
    ends, status = library.step(Row(1, np.array([30.0]), u))
    assert status == OUTSIDE | CROSSED
    assert np.isfinite(ends).all()
    assert library.step(Row(1, np.array([0.5]), u))[1] & VOID


@pytest.mark.parametrize("number", [np.nan, np.inf, 1e308])
def test_numbers_that_are_not_finite(number: float, tmp_path: Path) -> None:
    design, steps = design_named("jumps")
    library = Library(tmp_path, design, Options("double", Steps(steps)))
    library.start(-np.ones(2), np.ones(2))
    library.step(Row(0, np.zeros(1), np.array([number])))
    ends, status = library.step(Row(1, np.zeros(1), np.zeros(1)))
    assert status & OVERFLOW
    assert (ends == -np.inf).all()
    library.start(-np.ones(2), np.ones(2))
    if not np.isfinite(number):
        assert library.step(Row(0, np.array([number]), np.zeros(1)))[1] == MISSING
