"""Whole records at once: the numbers, statuses and states of one row after the other."""

from __future__ import annotations

import numpy as np
import pytest

from lmi.arithmetic.arrays import Matrix
from obsdesign.runtime.base import samples_of
from obsdesign.runtime.columns import Columns
from obsdesign.runtime.luenberger.observer import LuenbergerObserver
from obsdesign.runtime.luenberger.stretches import Stretches

N, ROWS = 3, 400
RNG = np.random.default_rng(7)
PLANT = {
    "A": (np.diag([-1.0, -2.0, -3.0]) + 0.4 * np.eye(N, k=1)).tolist(),
    "G": (0.8 * np.eye(N) + 0.1 * np.eye(N, k=1)).tolist(),
    "C": [[1.0, 0.0, 0.0], [0.0, 1.0, 1.0]], "B": [[0.0], [1.0], [0.5]], "E": [[1.0], [0.0], [0.0]],
    "L": RNG.uniform(0, 0.5, (N, 2)).tolist(), "M": RNG.uniform(0, 0.2, (N, 2)).tolist(),
    "flow_lower": [0.1, 0.0, 0.0], "flow_upper": [0.3, 0.0, 0.1], "jump_lower": [0.0, 0.1, 0.0],
    "jump_upper": [0.0, 0.3, 0.0], "noise_bound": [0.1, 0.1], "jump_measurement": "before",
    "dwell_time": [0.3, 2.0],
}  # fmt: skip
CASES: dict[str, dict[str, object]] = {
    "before": {},
    "after": {"jump_measurement": "after"},
    "none": {"jump_measurement": "none", "M": np.zeros((N, 2)).tolist()},
    "schedule": {"M_cells": RNG.uniform(0, 0.2, (3, N, 2)).tolist(), "dwell_borders": [0.5, 1.0]},
    "narrow": {"dwell_time": [0.9, 1.05], "dwell_jitter": 0.06},
    "noise centre": {"noise_centre": [0.3, -0.2]},
    "inputs": {"input_bound": [1.0], "jump_input_bound": [1.0]},
    "fast": {"A": (-1e4 * np.eye(N)).tolist()},
    "unstable": {"A": (3.0 * np.eye(N)).tolist()},
}


def observer_of(case: str) -> LuenbergerObserver:
    return LuenbergerObserver.from_gains(PLANT | CASES[case])


def record(*, is_regular: bool, case: str, gaps: int = 7) -> Columns:
    """Rows with jumps about a unit of time apart; a few without a sample, or two jumps in a row."""
    rng = np.random.default_rng(len(case))
    steps = np.full(ROWS, 0.05) if is_regular else rng.uniform(0.02, 0.08, ROWS)
    t, y = np.cumsum(steps), rng.uniform(-0.1, 0.1, (ROWS, 2))
    jump = np.zeros(ROWS, bool)
    jump[rng.integers(15, 25, ROWS // 20).cumsum() % ROWS] = True
    if gaps:
        y[rng.integers(0, ROWS, gaps), 0] = np.nan
        jump[200:202] = True
    u, w = (rng.uniform(-1, 1, (ROWS, 1)) for _ in range(2))
    if case == "inputs":
        u[300] = 1.5
    if case == "unstable":
        t[-5:] += [200.0, 300.0, 400.0, 500.0, 600.0]
    return Columns(t, y, u, w, jump)


def cut(whole: Columns, rows: slice) -> Columns:
    blocks = (whole.t, whole.y, whole.u, whole.w, whole.jump)
    return Columns(*(None if block is None else block[rows] for block in blocks))


@pytest.mark.parametrize("is_regular", [True, False])
@pytest.mark.parametrize("case", list(CASES))
def test_a_record_at_once_is_its_stream(case: str, is_regular: bool) -> None:
    observer, whole = observer_of(case), record(is_regular=is_regular, case=case)
    state = start = observer.init(float(whole.t[0]), x=[1.0, -1.0, 0.5])
    estimates = []
    for sample in samples_of(whole):
        state, estimate = observer.step(state, sample)
        estimates.append(estimate)
    after, batch = observer.batch_step(start, whole)
    assert batch.status == tuple(estimate.status for estimate in estimates)
    assert batch.x is not None
    assert np.array_equal(batch.x, np.array([e.x for e in estimates]), equal_nan=True)
    for own, other in zip(after, state, strict=True):
        np.testing.assert_array_equal(np.asarray(own), np.asarray(other))
    # in parts, wherever they are cut
    parts, now = list[Matrix](), start
    for rows in (slice(1), slice(1, 137), slice(137, 202), slice(202, 390), slice(390, ROWS)):
        now, part = observer.batch_step(now, cut(whole, rows))
        assert part.x is not None
        parts.append(part.x)
    assert np.array_equal(np.vstack(parts), batch.x, equal_nan=True)


@pytest.mark.parametrize("case", ["before", "narrow"])
def test_statuses_are_those_of_dwell_times(case: str) -> None:
    """Jumps that come too early, too late or change too much are left to the step."""
    whole = record(is_regular=True, case=case, gaps=0)
    _, batch = observer_of(case).batch_step(observer_of(case).init(float(whole.t[0])), whole)
    kinds = {status.split(" ")[0] for status in batch.status}
    assert kinds == ({"ok"} if case == "before" else {"ok", "dwell", "change"})


@pytest.mark.parametrize("case", ["before", "after", "none", "inputs"])
def test_rows_with_jumps_are_done_together(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without any fault a single row, the first, is left to the step."""
    stepped: list[int] = []
    single = Stretches._stepped

    def counted(own: Stretches, state: object, row: int) -> object:
        stepped.append(row)
        return single(own, state, row)  # type: ignore[arg-type]

    monkeypatch.setattr(Stretches, "_stepped", counted)
    observer, whole = observer_of(case), record(is_regular=True, case="before", gaps=0)
    observer.batch_step(observer.init(float(whole.t[0])), whole)
    assert stepped == [0]
