"""The run-time guard: dwell times in their range, and no faster change than was designed for."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign import Problem
from obsdesign.document import Design
from obsdesign.runtime import from_design
from obsdesign.runtime.clocks.dwell_guard import DwellGuard
from tests.systems.designs import designed


def objections(guard: DwellGuard, instants: list[float]) -> list[str | None]:
    reasons = []
    for t in instants:
        guard, objection = guard.after(t, jump=True)
        reasons.append(objection)
    return reasons


def test_a_change_beyond_the_jitter_is_said_and_the_next_one_is_judged_anew() -> None:
    guard = DwellGuard(0.5, 2.0, jitter=0.2)
    # dwell times 1, 1.2, 1.5, 1.4: only the third changes by more than 0.2
    assert objections(guard, [0.3, 1.3, 2.5, 4.0, 5.4]) == [
        None, None, None, "change 0.3 of the dwell time above 0.2", None,
    ]  # fmt: skip


def test_decimal_time_stamps_at_the_very_limit_are_no_objection() -> None:
    guard = DwellGuard(0.1, 0.4, jitter=0.1)
    instants, t = [], 0.0
    for k in range(200):
        t += 0.1 if k % 2 else 0.2
        instants.append(round(t, 10))
    assert set(objections(guard, instants)) == {None}


def test_without_a_limit_any_change_inside_the_range_is_fine() -> None:
    guard = DwellGuard(0.5, 2.0)
    assert objections(guard, [0.0, 0.5, 2.5, 3.0]) == [None] * 4
    assert objections(guard, [0.0, 0.4]) == [None, "dwell time 0.4 below 0.5"]


# --- every kind that a range of dwell times is claimed for ------------------------------------------


def problem(kind: str, measured: str = "continuous") -> Problem:
    period = {"period": 0.1} if measured == "periodic" else {}
    return Problem.from_dict({
        "flow": {"A": [[-1, 0], [1, -2]]},
        "jump": {"G": [[0.5, 0], [0, 0.5]], "dwell_time": [0.7, 2.0]},
        "output": {"C": [[0, 1]], "noise_bound": 0.1, "measured": measured, **period},
        "observer": {"kind": kind, **({"window": 0.5} if kind == "finite_time" else {})},
    })  # fmt: skip


def statuses(design: Design, jumps: list[float]) -> dict[float, str]:
    """The status of every row of a plant at rest that jumps at these times."""
    observer: Any = from_design(design)
    t = np.round(np.arange(0, 6, 0.1), 10)
    box = {"lower": [-1, -1], "upper": [1, 1]} if design.kind == "interval" else {"x": [0, 0]}
    batch = observer.run_batch(t, np.zeros((len(t), 1)), jump=np.isin(t, jumps), **box)
    return dict(zip(t.tolist(), batch.status, strict=True))


@pytest.mark.parametrize(
    ("kind", "measured"),
    [("interval", "continuous"), ("interval", "periodic"), ("interval", "at_jumps"),
     ("luenberger", "continuous"), ("luenberger", "at_jumps"), ("impulsive", "at_jumps")],
)  # fmt: skip
def test_jumps_outside_the_range_of_the_design_void_the_guarantee(kind: str, measured: str) -> None:
    design = obsdesign.design(problem(kind, measured))
    inside = statuses(design, [0.3, 1.0, 1.7, 3.7, 5.0])
    assert set(inside.values()) == {"ok"}
    outside = statuses(design, [0.3, 1.0, 1.5, 3.6])
    assert outside[1.0] == "ok"
    assert outside[1.5] == "dwell time 0.5 below 0.7"
    assert outside[3.6].startswith("dwell time 2.1 above 2")


def test_finite_time_claims_no_range_and_begins_again_at_every_jump() -> None:
    design = obsdesign.design(problem("finite_time", "periodic"))
    rows = statuses(design, [1.0, 1.2])
    assert rows[1.0] == rows[1.2] == rows[1.6] == "window not full"
    assert rows[0.9] == rows[1.8] == "ok"


@pytest.mark.parametrize("kind", ["interval", "luenberger", "impulsive"])
def test_another_range_in_the_gains_than_in_the_problem_is_refused(kind: str) -> None:
    measured = "at_jumps" if kind == "impulsive" else "continuous"
    design = obsdesign.design(problem(kind, measured))
    for low, high in ((0.8, 2.0), (0.7, 1.9), (0.1, 2.0), (0.7, 9.0)):
        forged = replace(design, gains={**design.gains, "dwell_time": [low, high]})
        with pytest.raises(obsdesign.InputError, match=r"gains\.dwell_time differs from problem"):
            from_design(forged)


def test_the_range_of_a_search_for_the_shortest_is_wider_below_only() -> None:
    body = problem("interval").to_dict()
    body["observer"] = {"kind": "interval", "objective": "shortest_dwell"}
    design = designed(body)
    low, high = design.gains["dwell_time"]
    assert low < 0.7
    assert high == 2.0
    assert set(statuses(design, [0.3, 0.8, 2.7, 4.6]).values()) == {"ok"}
    for wrong in ([low, 9.0], [0.8, high], [-1.0, high]):
        with pytest.raises(obsdesign.InputError, match=r"gains\.dwell_time differs from problem"):
            from_design(replace(design, gains={**design.gains, "dwell_time": wrong}))


@pytest.mark.parametrize("kind", ["interval", "set_membership", "luenberger", "finite_time"])
def test_in_discrete_time_an_event_is_missing_at_its_longest_time(kind: str) -> None:
    """No later row has it; the twin in continuous time may still have it at that instant."""
    body = {
        "flow": {"A": [[0.5]], "dt": 0.1}, "jump": {"G": [[0.5]], "dwell_time": [0.2, 0.4]},
        "output": {"C": [[1]], "noise_bound": 0.1},
        "observer": {"kind": kind, **({"window": 0.1} if kind == "finite_time" else {})},
    }  # fmt: skip
    observer: Any = from_design(designed(body))
    t = np.round(np.arange(12) * 0.1, 10)
    is_bounded = kind in {"interval", "set_membership"}
    start = {"lower": [-1], "upper": [1]} if is_bounded else {"x": [0]}
    batch = observer.run_batch(t, np.zeros((12, 1)), jump=np.isin(t, [0.1, 0.5]), **start)
    # behind the last event: at its longest time, and beyond it
    assert "missing event" in batch.status[9]
    assert "dwell time 0.5 above 0.4" in batch.status[10]
    assert not any("event" in status or "dwell" in status for status in batch.status[:9])
    guard = DwellGuard(0.2, 0.4, last_jump=0.1)
    assert guard.after(0.5, jump=False)[1] is None
    assert guard.after(0.5, jump=False, is_step=True)[1] == "missing event"
    assert guard.after(0.5, jump=True, is_step=True)[1] is None
