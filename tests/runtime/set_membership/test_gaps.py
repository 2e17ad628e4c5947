"""Bounds come back after any gap, and after any start."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lmi.arithmetic.arrays import Matrix
from obsdesign.runtime import from_design
from obsdesign.runtime.base import Estimate, Sample
from obsdesign.runtime.set_membership.model import observer_model
from obsdesign.runtime.set_membership.recovery import bounds_from_samples
from obsdesign.runtime.set_membership.series import FlowSeries
from obsdesign.runtime.set_membership.stages import window_of
from obsdesign.runtime.set_membership.tables import Tables
from tests.systems.designs import designed
from tests.systems.nominal_patterns import body_of
from tests.systems.set_membership import Case, cases, flow_integral, observer_of

CASES = cases()
STEP, BEFORE, AFTER = 0.1, 12, 28


def _rows(case: Case, gap: float) -> tuple[list[Sample], Matrix]:
    """Rows with a gap, and the states; behind it the state is zero, which is possible there."""
    rng = np.random.default_rng(1)
    Phi, integral = flow_integral(case.A, STEP)
    x, t, rows, truth = np.zeros(case.n), 0.0, list[Sample](), list[Matrix]()
    for k in range(BEFORE + AFTER):
        if k == BEFORE:
            t, x = t + gap, np.zeros(case.n)
        rows.append(Sample(t, case.C @ x + case.V * rng.uniform(-1, 1, len(case.V))))
        truth.append(x)
        x, t = Phi @ x + integral @ (case.b[1] * rng.choice([-1, 1], case.n)), t + STEP
    return rows, np.array(truth)


def _widths(estimates: list[Estimate]) -> Matrix:
    return np.array([np.subtract(e.upper, e.lower) for e in estimates])


@pytest.mark.parametrize("gap", [1e2, 1e4, 1e7])
@pytest.mark.parametrize("name", ["crane", "rand2_21", "rand4_42"])
def test_bounds_after_any_gap_are_those_of_a_stream_that_starts_there(
    name: str, gap: float
) -> None:
    """Of stable plants and of growing ones, whose bounds overflow; up to the solver's tolerance."""
    case, window = replace(CASES[name], jumps=()), 8
    rows, truth = _rows(case, gap)
    observer = observer_of(case, window)
    one = np.ones(case.n)
    estimates = list(observer.run(observer.init(0.0, lower=-one, upper=one), rows))
    assert {e.status for e in estimates} <= {"ok", "bounds overflowed"}
    for estimate, x in zip(estimates, truth, strict=True):
        assert (estimate.lower <= x).all()
        assert (x <= estimate.upper).all()
    start = observer.init(rows[BEFORE].t, lower=-100 * one, upper=100 * one)
    fresh = _widths(list(observer.run(start, rows[BEFORE:])))
    after = _widths(estimates[BEFORE:])
    assert (after[window + 4 :] <= fresh[window + 4 :] * (1 + 2e-3)).all()


@pytest.mark.parametrize("size", [1e3, 1e9, 1e150])
def test_a_start_of_any_size_is_forgotten(size: float) -> None:
    case = replace(CASES["rand2_21"], jumps=())
    rows, _ = _rows(case, STEP)
    observer = observer_of(case, 8)
    widths = []
    for radius in (1.0, size):
        state = observer.init(0.0, lower=[-radius] * 2, upper=[radius] * 2)
        widths.append(_widths(list(observer.run(state, rows[:20]))))
    assert (widths[1][12:] <= widths[0][12:] * (1 + 2e-3)).all()


@pytest.mark.parametrize("name", ["degue", "rand3_31", "rand4_42"])
def test_bounds_from_samples_contain_the_state_and_need_no_start(name: str) -> None:
    case = CASES[name]
    record = case.record(extreme=True)
    observer = observer_of(case, 40)
    state = observer.init(0.0, lower=case.x0[0], upper=case.x0[1])
    for sample in record.samples[:14]:
        state, _ = observer.step(state, sample)
    model = observer_model(observer.gains)
    window = window_of(model, Tables(model), state.start, state.stages, None)
    far = replace(window, start=np.full((2, case.n), np.inf), sizes=np.full_like(window.sizes, 1e9))
    box = bounds_from_samples(far)
    assert box is not None
    z = record.truth[0] * model.scales
    assert (box[0] <= z).all()
    assert (z <= box[1]).all()
    kept = np.zeros_like(window.sampled)
    kept[0] = window.sampled[0]
    assert bounds_from_samples(replace(far, sampled=kept)) is None


@pytest.mark.parametrize("t", [0.01, 1.0, 30.0, 1e5])
def test_reach_is_above_the_integral_and_settles(t: float) -> None:
    A = np.array([[-0.1, 5.0], [-5.0, -0.1]])
    entering = np.array([[1.0], [0.0]])
    bound = FlowSeries(A).reach(t, 0.0, entering)
    s = (np.arange(200_000) + 0.5) * min(t, 60.0) / 200_000
    decay = np.exp(-0.1 * s) * min(t, 60.0) / 200_000
    least = [(decay * np.abs(np.cos(5 * s))).sum(), (decay * np.abs(np.sin(5 * s))).sum()]
    assert (bound[:, 0] >= np.array(least) * (1 - 1e-6)).all()
    assert (bound[:, 0] <= 12 * np.array(least) + 1e-2).all()


@pytest.mark.parametrize("kick", [1e5, 1e9])
@pytest.mark.parametrize("seen", ["before", "after", "none"])
def test_the_certified_width_holds_where_jumps_make_a_state_uselessly_wide(
    kick: float, seen: str
) -> None:
    """A tape that began anew at every jump would never hold the samples that the width needs."""
    body = {
        "flow": {"A": [[0.0, 1, 0], [0, 0, 0], [0, 0, 0]],
                 "disturbance": {"lower": [0, -1e-3, 0], "upper": [0, 1e-3, 0]}},
        "jump": {"disturbance": {"lower": [0, 0, -kick], "upper": [0, 0, kick]},
                 "dwell_time": [0.3, 9]},
        "output": {"C": [[1.0, 0, 0], [0, 0, 1]], "noise_bound": [0.1, 0.1], "period": 0.1,
                   "measured": "periodic", "jump_measurement": seen},
        "observer": {"kind": "set_membership", "window": 16},
    }  # fmt: skip
    design = designed(body)
    width = next(c for c in design.claims if c.id == "width")
    observer = from_design(design)
    hidden = 3 if seen == "none" else 100
    rows = [
        Sample(0.1 * k, np.zeros(2) if k % hidden else None, jump=k % 3 == 0) for k in range(1, 100)
    ]
    start = observer.init(0.0, lower=-np.ones(3), upper=np.ones(3))
    estimates = list(observer.run(start, rows))
    assert {e.status for e in estimates} == {"ok"}
    certified = np.array(width.evidence["always"])
    assert (_widths(estimates)[60:] <= certified * (1 + 1e-6)).all()
    # the twin: behind a gap, which the width is not about, the tape begins anew
    late = [Sample(row.t + 1e4, row.y, jump=row.jump) for row in rows[60:]]
    behind = list(observer.run(start, [*rows[:60], *late]))[60:]
    assert behind[0].status != "ok"
    assert (_widths(behind)[30:] <= certified * (1 + 1e-6)).all()


@pytest.mark.parametrize(
    ("jump", "last"),
    [
        (0.5, "ok"),  # the sample that was due there is hidden
        (0.4, "time 1 since the last sample exceeds 0.5"),  # none was due
    ],
)
def test_a_jump_stands_in_for_the_sample_that_it_hides(jump: float, last: str) -> None:
    body = body_of("degue", 0.5, [0.1, "inf"], window=6)
    body["output"]["jump_measurement"] = "none"
    observer = from_design(designed(body))
    y = np.zeros(1)
    rows = [Sample(0.0, y), Sample(jump, jump=True), Sample(1.0, y)]
    start = observer.init(0.0, lower=-np.ones(2), upper=np.ones(2))
    assert [each.status for each in observer.run(start, rows)] == ["ok", "ok", last]
