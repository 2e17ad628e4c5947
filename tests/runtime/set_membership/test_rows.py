"""What rows may bring: jumps, inputs, own bounds, gaps, contradictions, lag and directions."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import obsdesign
from lmi.arithmetic.arrays import Matrix
from obsdesign.data.simulation import simulate
from obsdesign.errors import DoesNotApply, InputError
from obsdesign.problem.problem import Problem
from obsdesign.runtime import from_design
from obsdesign.runtime.base import Sample, samples_of
from obsdesign.runtime.bounds import Bounds
from obsdesign.runtime.columns import Columns
from obsdesign.runtime.progress import Progress
from obsdesign.runtime.set_membership.observer import SetMembershipObserver
from obsdesign.runtime.set_membership.tape import strip_cut
from obsdesign.runtime.stored_state import progress_from_text, state_text
from tests.systems.designs import designed
from tests.systems.set_membership import Case, bounds_of, cases, observer_of

CASES = cases()
PLANT: dict[str, Any] = {
    "flow": {
        "A": [[-1.0, 0.4], [1.0, -2.0]],
        "B": [[0.0], [1.0]],
        "disturbance": {"lower": [-0.1], "upper": [0.2]},
        "disturbance_matrix": [[1.0], [-0.5]],
    },
    "jump": {
        "G": [[1.2, 0.3], [0.2, 0.9]],
        "E": [[1.0], [0.0]],
        "disturbance": {"lower": [-0.05, 0.0], "upper": [0.05, 0.1]},
        "disturbance_matrix": [[1.0, 1.0], [1.0, -1.0]],
        "dwell_time": [0.5, 2.0],
    },
    "output": {"C": [[0.3, 1.0]], "noise_bound": [[-0.01, 0.04]]},
    "observer": {"kind": "set_membership", "window": 8, "fixed_lag": 3, "directions": [[1, -1]]},
}


def _problem(**changes: dict[str, Any]) -> Problem:
    blocks = {name: {**PLANT[name], **changes.get(name, {})} for name in PLANT}
    return Problem.from_dict(blocks)


def _simulated(problem: Problem, kind: str, seed: int = 0) -> tuple[list[Sample], Matrix]:
    """The samples of a run and the true states."""
    rng = np.random.default_rng(seed)
    run = simulate(
        problem.plant, until=6.0, step=0.1, initial=[0.6, -0.2], disturbance=kind, rng=rng
    )
    record = Columns.from_arrays(
        run.t, run.block("y"), run.block("u"), run.block("w"), run.columns["jump"]
    )
    return list(samples_of(record)), run.block("x")


def _estimates(problem: Problem, samples: list[Sample]) -> list[Any]:
    observer = from_design(obsdesign.design(problem))
    state = observer.start(0.0, [-1.0, 1.0] * problem.plant.n)
    return list(observer.run(state, samples))


def _boxes(estimates: list[Any]) -> Matrix:
    return np.array([[e.lower, e.upper] for e in estimates])


def _contain(boxes: Matrix, truth: Matrix) -> bool:
    slack = 1e-12 * (1.0 + np.abs(truth))  # the simulated truth is rounded
    return bool(((boxes[:, 0] <= truth + slack) & (truth - slack <= boxes[:, 1])).all())


@pytest.mark.parametrize("kind", ["extreme", "random", "sine"])
@pytest.mark.parametrize("when", ["before", "after", "none"])
def test_bounds_contain_the_state_whatever_a_row_brings(when: str, kind: str) -> None:
    """Known inputs, structured disturbances, asymmetric noise, jumps measured in three ways."""
    problem = _problem(output={"jump_measurement": when})
    samples, truth = _simulated(problem, kind)
    estimates = _estimates(problem, samples)
    assert {e.status for e in estimates} <= {"ok", "missing sample"}
    assert _contain(_boxes(estimates), truth)
    along = np.array([e.directions[:, 0] for e in estimates])
    difference = truth[:, 0] - truth[:, 1]
    assert (along[:, 0] <= difference + 1e-12).all()
    assert (along[:, 1] >= difference - 1e-12).all()
    boxes = _boxes(estimates)
    interval = boxes[:, 1, 0] - boxes[:, 0, 1] - (boxes[:, 0, 0] - boxes[:, 1, 1])
    assert ((along[:, 1] - along[:, 0]) <= interval + 1e-12).all()
    assert (along[:, 1] - along[:, 0])[9:].mean() < 0.97 * interval[9:].mean()


def test_lagged_bounds_are_about_the_state_some_rows_ago_and_narrower() -> None:
    problem = _problem()
    samples, truth = _simulated(problem, "random")
    estimates = _estimates(problem, samples)
    boxes, lagged = _boxes(estimates), np.array([e.lagged for e in estimates])
    assert np.isnan(lagged[:3]).all()
    there = ~np.isnan(lagged[:, 0, 0])
    assert there[3:].mean() > 0.9
    rows = np.flatnonzero(there)
    assert _contain(lagged[rows], truth[rows - 3])
    assert (lagged[rows, 0] >= boxes[rows - 3, 0]).all()
    assert (lagged[rows, 1] <= boxes[rows - 3, 1]).all()
    width, before = np.ptp(lagged[rows], axis=1), np.ptp(boxes[rows - 3], axis=1)
    assert width.mean() < 0.9 * before.mean()


def test_a_structured_disturbance_is_narrower_than_its_box_and_intervals_accept_it() -> None:
    problem = _problem()
    samples, truth = _simulated(problem, "extreme")
    flow, jump = problem.plant.flow, problem.plant.jump
    assert jump is not None
    b, c = flow.b_bounds, jump.c_bounds
    boxed = {
        "flow": {k: v for k, v in PLANT["flow"].items() if k != "disturbance_matrix"}
        | {"disturbance": {"lower": b[0].tolist(), "upper": b[1].tolist()}},
        "jump": {k: v for k, v in PLANT["jump"].items() if k != "disturbance_matrix"}
        | {"disturbance": {"lower": c[0].tolist(), "upper": c[1].tolist()}},
    }
    own = _boxes(_estimates(problem, samples))
    box = _boxes(_estimates(Problem.from_dict(PLANT | boxed), samples))
    assert _contain(box, truth)
    assert (np.ptp(own, axis=1)[9:] <= np.ptp(box, axis=1)[9:] * (1 + 1e-3)).all()
    assert np.ptp(own, axis=1)[9:].mean() < 0.95 * np.ptp(box, axis=1)[9:].mean()
    interval = problem.for_kind("interval")[0]
    estimates = _boxes(_estimates(interval, samples))
    assert _contain(estimates, truth)


def test_bounds_of_rows_narrow_and_the_state_stays_inside() -> None:
    """The declared bounds are wider than those of the rows, which the record keeps."""
    problem = _problem()
    samples, truth = _simulated(problem, "random")
    wider = _problem(
        flow={"disturbance": {"lower": [-0.5], "upper": [0.5]}},
        output={"noise_bound": [[-0.1, 0.1]]},
    )
    own = Bounds(b=([-0.1], [0.2]), v=([-0.01], [0.04]))
    narrowed = _boxes(_estimates(wider, [s._replace(bounds=own) for s in samples]))
    assert _contain(narrowed, truth)
    declared, tight = _boxes(_estimates(wider, samples)), _boxes(_estimates(problem, samples))
    assert np.ptp(narrowed, axis=1).mean() < 0.7 * np.ptp(declared, axis=1).mean()
    # the step to the first row knows the declared bounds alone
    assert np.allclose(narrowed[9:], tight[9:], rtol=2e-2, atol=2e-3)


@pytest.mark.parametrize(("name", "offset"), [("degue", 3.0), ("rand2_21", 2.0), ("crane", 3.0)])
def test_a_fault_is_refuted_at_its_row_and_names_the_samples(name: str, offset: float) -> None:
    case = CASES[name]
    samples = [
        s._replace(y=s.y + offset * case.V) if k >= 26 and s.y is not None else s
        for k, s in enumerate(case.record().samples[:40])
    ]
    observer = observer_of(case, 8)
    state = observer.init(0.0, lower=case.x0[0], upper=case.x0[1])
    states, estimates = [], []
    for sample in samples:
        state, estimate = observer.step(state, sample)
        states.append(state)
        estimates.append(estimate)
    usual = {"ok", "missing sample"}
    first = next(k for k, e in enumerate(estimates) if e.status not in usual)
    assert first == 26
    status = estimates[26].status
    assert status.startswith("bounds crossed: samples at ")
    assert f"{samples[26].t:.9g}" in status
    assert any(f"{s.t:.9g}" in status for s in samples[10:26])
    assert (samples[26].t, status) in [tuple(e) for e in estimates[26].events]
    assert all("void since time" in e.status for e in estimates[27:])
    ended = observer.reset(states[26], lower=case.x0[0] - 20, upper=case.x0[1] + 20)
    assert observer.step(ended, samples[27])[1].status in usual


@pytest.mark.parametrize("seed", range(12))
def test_nothing_is_refuted_without_a_fault(seed: int) -> None:
    case = CASES["degue"]
    samples = case.record(extreme=seed % 2 == 0, seed=seed).samples[:50]
    observer = observer_of(case, 8)
    state = observer.init(0.0, lower=case.x0[0], upper=case.x0[1])
    assert {e.status for e in observer.run(state, samples)} == {"ok"}


def test_stored_multipliers_are_used_and_never_widen() -> None:
    """With one step of the search, those of the full search help in the same window."""
    case = replace(CASES["degue"], jumps=())
    samples = case.record().samples[:30]
    mu = np.zeros((1, 2, 8, 1))
    mu[0, 1, -1, 0] = 1.0  # x2 = y - v
    mu[0, 0, -1, 0], mu[0, 0, -4, 0] = 2.5, -1.5
    plain = bounds_of(observer_of(case, 8, steps=1), case, samples)
    stored = bounds_of(observer_of(case, 8, steps=1, multipliers=mu), case, samples)
    assert (stored[:, 0] >= plain[:, 0]).all()
    assert (stored[:, 1] <= plain[:, 1]).all()
    assert (np.ptp(stored, axis=1) < np.ptp(plain, axis=1)).any()


def test_a_stream_resumes_from_its_file() -> None:
    problem = _problem()
    design = obsdesign.design(problem)
    observer = from_design(design)
    assert isinstance(observer, SetMembershipObserver)
    samples, _ = _simulated(problem, "random")
    state = observer.start(0.0, [-1.0, 1.0, -1.0, 1.0])
    for sample in samples[:20]:
        state, _ = observer.step(state, sample)
    text = state_text(design, Progress(state))
    again = progress_from_text(text, design, from_design(design), "state").state
    for sample in samples[20:]:
        (state, one), (again, other) = observer.step(state, sample), observer.step(again, sample)
        assert np.array_equal(one.lower, other.lower)
        assert np.array_equal(one.upper, other.upper)
        assert np.array_equal(one.lagged, other.lagged)


def test_a_strip_cuts_a_box_that_is_unbounded_on_one_side() -> None:
    box = np.array([[-1.0, 0.0], [np.inf, 2.0]])
    strip = np.array([[0.5], [0.7]])
    with np.errstate(invalid="ignore"):
        cut = strip_cut(box, np.array([[1.0, 0.0]]), strip)
        both = strip_cut(box, np.array([[1.0, 1.0]]), strip)
    assert cut is not None
    assert both is not None
    assert cut[0, 0] <= 0.5
    assert cut[1, 0] >= 0.7 or cut[1, 0] == np.inf
    assert both[0, 0] == -1.0
    assert both[1, 0] >= 0.7


def test_overflow_leaves_infinite_bounds() -> None:
    case = replace(CASES["degue"], A=np.array([[50.0, 0.0], [1.0, -2.0]]))
    observer = observer_of(case, 4)
    state = observer.init(0.0, lower=case.x0[0], upper=case.x0[1])
    estimates = list(observer.run(state, [Sample(0.0), Sample(30.0), Sample(31.0, [0.1])]))
    assert (estimates[-1].upper == np.inf).any()
    assert "bounds overflowed" in estimates[-1].status


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"flow": {"D": [[1], [0]]}}, "flow.D is refused by kind 'set_membership'"),
        ({"jump": {"H": [[1], [0]]}}, "jump.H is refused by kind 'set_membership'"),
    ],
)
def test_unbounded_inputs_are_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(DoesNotApply, match=words):
        obsdesign.design(_problem(**changes))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"observer": {"fixed_lag": 8}}, "fixed_lag must be less than observer.window = 8; got 8"),
        ({"observer": {"directions": [[1]]}}, "directions, row 1, must have 2 entries"),
        ({"observer": {"directions": [[0, 0]]}}, "directions, row 1 must not be zero"),
        ({"observer": {"window": 0}}, "from 1 to 200"),
        ({"flow": {"disturbance_matrix": [[1.0]]}}, "disturbance_matrix must have 2 rows"),
        ({"flow": {"disturbance_matrix": [[1, 0], [0, 1]]}}, "one per column of"),
    ],
)
def test_entries_that_do_not_fit_are_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        _problem(**changes)


def test_bounds_of_the_noise_are_required() -> None:
    blocks = {**PLANT, "output": {"C": [[0.3, 1.0]]}}
    with pytest.raises(DoesNotApply, match="noise_bound is required by kind 'set_membership'"):
        designed(blocks)


def test_a_normal_form_keeps_the_disturbance_matrix() -> None:
    problem = _problem()
    assert Problem.from_dict(problem.to_dict()) == problem
    lower, upper = problem.plant.flow.b_bounds
    assert lower.tolist() == [-0.1, -0.1]
    assert upper.tolist() == [0.2, 0.05]


def test_a_measured_state_recovers_from_overflow() -> None:
    box = np.array([[-np.inf, -np.inf], [np.inf, np.inf]])
    strip = np.array([[0.5], [0.7]])
    cut = strip_cut(box, np.array([[2.0, 0.0]]), strip)
    assert cut is not None
    np.testing.assert_allclose(cut[:, 0], [0.25, 0.35], rtol=1e-12)
    assert cut[0, 0] <= 0.25
    assert cut[1, 0] >= 0.35
    np.testing.assert_array_equal(cut[:, 1], [-np.inf, np.inf])
    # the twin: the other state may be anything, and so may this one
    open_cut = strip_cut(box, np.array([[2.0, 1.0]]), strip)
    np.testing.assert_array_equal(open_cut, box)


def test_a_jump_between_two_samples_misses_none() -> None:
    flow = {"A": [[-1, 0], [1, -2]]}
    jump = {"G": [[0.5, 0], [0, 0.5]], "dwell_time": [0.5, "inf"]}
    output = {"C": [[0, 1]], "noise_bound": [0.03], "measured": "periodic", "period": 0.5}
    problem = Problem.from_dict(
        {"flow": flow, "jump": jump, "output": output, "observer": {"kind": "set_membership"}}
    )
    rows = [Sample(0.0, [0.0]), Sample(0.3, None, jump=True), Sample(0.5, [0.0])]
    assert [e.status for e in _estimates(problem, rows)] == ["ok", "ok", "ok"]
    rows = [Sample(0.0, [0.0]), Sample(0.5, None, jump=True), Sample(1.0, [0.0])]
    missed = [e.status for e in _estimates(problem, rows)]
    assert missed[:2] == ["ok", "missing sample"]
    assert "since the last sample" in missed[2]


@pytest.mark.parametrize("t", [np.nan, np.inf])
def test_an_initial_time_is_finite(t: float) -> None:
    observer = observer_of(CASES["degue"], 4)
    with pytest.raises(ValueError, match="time must be finite"):
        observer.init(t, lower=[0, 0], upper=[1, 1])


def test_samples_that_contradict_each_other_are_named_and_no_others() -> None:
    """x' = 0 and |v| <= 0.1: the last sample and the one that bounds x most."""
    plant = Case(
        "still", np.zeros((1, 1)), np.eye(1), np.eye(1), np.array([[-9.0], [9.0]]),
        np.zeros((2, 1)), np.zeros((2, 1)), np.full(1, 0.1), np.arange(1.0, 9.0),
    )  # fmt: skip
    observer = observer_of(plant, 8)
    state = observer.init(0.0, lower=plant.x0[0], upper=plant.x0[1])
    for k, y in enumerate([0.05, 0.02, -0.06, 0.04, 0.03, 0.06]):
        state, estimate = observer.step(state, Sample(float(k), y=[y]))
        assert estimate.status == "ok"
    state, estimate = observer.step(state, Sample(6.0, y=[0.5]))
    assert estimate.status.startswith("bounds crossed: samples at 2 6 contradict")


@pytest.mark.parametrize(("when", "due"), [("none", False), ("before", True), ("after", True)])
def test_a_sample_is_due_at_a_jump_where_jumps_are_measured(when: str, due: bool) -> None:
    observer = from_design(obsdesign.design(_problem(output={"jump_measurement": when})))
    state = observer.start(0.0, [-1.0, 1.0] * 2)
    state, _ = observer.step(state, Sample(0.0, u=[0.0]))
    state, _ = observer.step(state, Sample(0.1, y=[0.0]))
    state, estimate = observer.step(state, Sample(0.7, jump=True))
    assert ("missing sample" in estimate.status) is due
    _, estimate = observer.step(state, Sample(0.8))
    assert "missing sample" in estimate.status
