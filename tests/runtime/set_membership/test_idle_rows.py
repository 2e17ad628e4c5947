"""Rows without a sample use up no stages of the window: they never widen what later rows report."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.equations.set_membership.gains import SetMembershipGains
from obsdesign.runtime.base import Sample
from obsdesign.runtime.set_membership.observer import SetMembershipObserver
from obsdesign.runtime.set_membership.tape import Tape

A, G = np.array([[0.0, 1.0], [0.0, -2.0]]), np.diag([1.0, 0.9])
NOISE, DRIFT, WINDOW = 0.003, 0.05, 4


@cache
def _observer() -> SetMembershipObserver:
    entries = {
        "A": A, "B": [[0.0], [0.8]], "C": [[1.0, 0.0]], "G": G, "noise_bound": [NOISE],
        "flow_lower": [0.0, -DRIFT], "flow_upper": [0.0, DRIFT], "jump_lower": [0.0, -0.01],
        "jump_upper": [0.0, 0.01], "dwell_time": [0.2, 1.0], "jump_measurement": "before",
        "measured": "at_jumps", "window": WINDOW, "steps": 12,
    }  # fmt: skip
    return SetMembershipObserver(SetMembershipGains.from_document(entries))


def _record(idle: int, *, inputs: bool = False) -> tuple[list[Sample], Matrix]:
    """Samples at jumps, so many idle rows between two of them, and the true states.

    inputs: does the known input change in the idle rows, which are then stages?
    """
    rng = np.random.default_rng(3)
    x, t, u = np.array([0.0, 0.5]), 0.0, np.ones(1)
    rows, truth = [Sample(0.0, np.zeros(1), u=u)], [x]
    for spacing in rng.uniform(0.2, 1.0, 12).round(2):
        began, drift = t, rng.uniform(-DRIFT, DRIFT)
        for k in range(1, idle + 2):
            later = began + spacing * k / (idle + 1)
            still = (0.8 * u[0] + drift) / 2.0  # the speed that this input keeps
            h, fall = later - t, np.exp(-2.0 * (later - t))
            speed = still + (x[1] - still) * fall
            position = x[0] + still * h + (x[1] - still) * (1.0 - fall) / 2.0
            x, t = np.array([position, speed]), later
            if k <= idle:
                u = u * (-1.0) ** k if inputs else u
                rows.append(Sample(t, u=u))
                truth.append(x)
        y = x[:1] + rng.uniform(-NOISE, NOISE)
        x = G @ x + [0.0, rng.uniform(-0.01, 0.01)]
        rows.append(Sample(t, y, jump=True, u=u))
        truth.append(x)
    return rows, np.array(truth)


def _boxes(observer: SetMembershipObserver, rows: list[Sample]) -> Matrix:
    state = observer.start(0.0, [-0.01, 0.01, -1.0, 2.0])
    return np.array([[e.lower, e.upper] for e in observer.run(state, rows)])


def _contain(boxes: Matrix, truth: Matrix) -> bool:
    slack = 1e-12 * (1.0 + np.abs(truth))
    return bool(((boxes[:, 0] <= truth + slack) & (truth - slack <= boxes[:, 1])).all())


def test_idle_rows_never_widen_the_bounds_of_later_rows() -> None:
    """However many they are; a window of stages would hold none of the jumps before."""
    plain = _boxes(_observer(), _record(0)[0])
    widths = plain[:, 1] - plain[:, 0]
    for idle in (1, 7):
        rows, truth = _record(idle)
        boxes = _boxes(_observer(), rows)
        assert _contain(boxes, truth)
        at_jumps = boxes[:: idle + 1]
        assert (at_jumps[:, 1] - at_jumps[:, 0] <= widths + 1e-9).all()


def test_rows_with_another_input_are_stages_of_their_own() -> None:
    """A flow is continued with equal inputs alone: the truth stays inside where they change."""
    rows, truth = _record(3, inputs=True)
    assert _contain(_boxes(_observer(), rows), truth)


def test_lagged_bounds_keep_a_stage_for_every_row() -> None:
    """With `fixed_lag` the state of each row is bounded later: no stage takes its place."""
    observer = SetMembershipObserver(replace(_observer().gains, fixed_lag=1))
    rows, _ = _record(7)
    state = observer.start(0.0, [-0.01, 0.01, -1.0, 2.0])
    for row in rows[:8]:
        state, _ = observer.step(state, row)
    assert [stage.t for stage in state.stages] == [row.t for row in rows[:8]][-WINDOW:]


def test_a_stage_is_continued_only_by_the_same_flow() -> None:
    """Not by a jump, behind a sample, with other inputs or bounds, or where its start is gone."""
    observer, (rows, _) = _observer(), _record(7)
    state = observer.start(0.0, [-0.01, 0.01, -1.0, 2.0])
    for row in rows[:4]:
        state, _ = observer.step(state, row)
    assert [stage.t for stage in state.stages] == [0.0, rows[3].t]
    tape, last = Tape(state.start, state.stages, state.box), state.stages[-1]
    assert tape.before_idle(last) is not None
    for other in (
        last._replace(jump=True), last._replace(known=last.known + 1.0),
        last._replace(radius=last.radius + 1.0), last._replace(in_time=False),
    ):  # fmt: skip
        assert tape.before_idle(other) is None
    sampled = last._replace(strip=np.zeros((2, 1)))
    assert tape._replace(stages=(*tape.stages[:-1], sampled)).before_idle(last) is None
    assert tape._replace(stages=tape.stages[-1:]).before_idle(last) is None
