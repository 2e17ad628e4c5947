"""The run-time guard: dwell times in their range, and no faster change than was designed for."""

from __future__ import annotations

from obsdesign.runtime.base import DwellGuard


def objections(guard: DwellGuard, instants: list[float]) -> list[str | None]:
    found = []
    for t in instants:
        guard, objection = guard.after(t, jump=True)
        found.append(objection)
    return found


def test_a_change_beyond_the_jitter_is_said_and_the_next_one_is_judged_anew() -> None:
    guard = DwellGuard.of({"dwell_time": [0.5, 2.0], "dwell_jitter": 0.2})
    # dwell times 1, 1.2, 1.5, 1.4: only the third changes by more than 0.2
    assert objections(guard, [0.3, 1.3, 2.5, 4.0, 5.4]) == [
        None, None, None, "dwell time changed by 0.3, more than 0.2", None,
    ]  # fmt: skip


def test_decimal_time_stamps_at_the_very_limit_are_no_objection() -> None:
    guard = DwellGuard.of({"dwell_time": [0.1, 0.4], "dwell_jitter": 0.1})
    instants, t = [], 0.0
    for k in range(200):
        t += 0.1 if k % 2 else 0.2
        instants.append(round(t, 10))
    assert set(objections(guard, instants)) == {None}


def test_without_a_limit_any_change_inside_the_range_is_fine() -> None:
    guard = DwellGuard.of({"dwell_time": [0.5, 2.0]})
    assert objections(guard, [0.0, 0.5, 2.5, 3.0]) == [None] * 4
    assert objections(guard, [0.0, 0.4]) == [None, "dwell time 0.4 below 0.5"]
