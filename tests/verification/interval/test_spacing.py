"""A least time between events of different names: narrower widths, a guard, draws that keep it."""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lmi.verdict import overall
from obsdesign.data.simulation import simulate
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem
from obsdesign.runtime import Sample, from_design
from obsdesign.workflow import verify
from tests.systems.designs import designed, investigated
from tests.systems.switched import valve

Body = dict[str, Any]


def doses(spacing: float, kind: str = "interval") -> Problem:
    """A decaying state, to which two events add what is not known well."""
    box = {"lower": [-0.5], "upper": [0.5]}
    events = [
        {"name": "dose", "every": [2, 6], "disturbance": box},
        {"name": "meal", "every": [3, 7], "G": [[1.2]], "disturbance": box},
    ]
    body: Body = {
        "flow": {"A": [[-0.6]], "disturbance": {"lower": [-0.1], "upper": [0.1]}},
        "event": events,
        "sensor": [{"name": "blood", "C": [[1]], "noise_bound": 2, "every": [0, 4]}],
        "observer": {"kind": kind},
    }
    return Problem.from_dict(body | ({"timing": {"spacing": spacing}} if spacing else {}))


def width(problem: Problem, name: str = "event_width") -> float:
    (claim,) = (claim for claim in investigated(problem.to_dict()).claims if claim.id == name)
    assert claim.verdict == "proved"
    return float(np.max(claim.evidence["always"]))


def test_a_longer_spacing_never_widens() -> None:
    widths = [width(doses(spacing)) for spacing in (0.0, 0.75, 1.5)]
    assert (np.diff(widths) <= 1e-3 * widths[0]).all()
    # at once both add their width; apart, the first has decayed
    assert widths[-1] < 0.85 * widths[0]


def test_no_run_exceeds_the_width_that_the_spacing_allows() -> None:
    problem, largest = doses(1.5), 0.0
    made = designed(problem.to_dict())
    for seed, dwell in enumerate(("random", "shortest", "random", "random")):
        rng = np.random.default_rng(seed)
        run = simulate(problem.plant, until=150, dwell=dwell, rng=rng)
        batch = from_design(made).run_batch(
            run.t, run.block("y"), jump=run.happened, lower=[-9], upper=[9]
        )
        assert batch.lower is not None
        assert batch.upper is not None
        x = run.block("x")
        assert ((batch.lower <= x + 1e-12) & (x - 1e-12 <= batch.upper)).all()
        assert set(batch.status) == {"ok"}
        largest = max(largest, float((batch.upper - batch.lower)[run.t > 20].max()))
    assert largest < width(problem) < 1.3 * largest


def altered(spacing: float | None, stated: float | None) -> str:
    """The verdict on the plant's claims with another spacing in the gains, and in the problem."""
    own = designed(doses(1.5).to_dict())
    gains, problem = copy.deepcopy(dict(own.gains)), copy.deepcopy(dict(own.problem))
    for body, key, value in ((gains, "spacing", spacing), (problem, "timing", stated)):
        body.pop(key)
        if value is not None:
            body[key] = value if key == "spacing" else {"spacing": value}
    claims = verify(replace(own, gains=gains, problem=problem)).claims
    return overall(claim.verdict for claim in claims if claim.id != "document")


def test_files_that_lie() -> None:
    assert altered(1.5, 1.5) == "proved"
    assert altered(1.0, 1.5) == altered(None, 1.5) == altered(1.5, None) == "refuted"
    # the tube is for events further apart: what it states is proved no more
    assert altered(0.5, 0.5) == "undecided"
    assert altered(None, None) == "undecided"


@pytest.mark.parametrize("kind", ["interval", "set_membership"])
def test_guard_of_the_spacing(kind: str) -> None:
    made = designed(doses(1.0, kind).to_dict())
    observer = from_design(made)
    state = observer.start(0.0, [-5, 5])
    rows = [(0.0, (0,)), (0.5, (1,)), (1.5, ()), (2.5, (0,)), (5.5, (0, 1))]
    statuses = []
    for t, events in rows:
        sample = Sample(t, [0.0], jump=bool(events), events=events)
        state, estimate = observer.step(state, sample)
        statuses.append(
            [x for x in estimate.status.split("; ") if "since" in x and "last" not in x]
        )
    assert statuses[1] == ["meal: time 0.5 since dose below 1"]
    assert statuses[4] == ["meal: time 0 since dose below 1"]
    assert statuses[0] == statuses[2] == statuses[3] == []
    gains = {**made.gains, "spacing": 0.5}
    with pytest.raises(InputError, match=r"gains\.spacing differs from problem\.timing\.spacing"):
        from_design(replace(made, gains=gains))


@pytest.mark.parametrize("dwell", ["random", "shortest"])
def test_simulated_events_keep_spacing_and_clocks(dwell: str) -> None:
    for seed in range(5):
        rng = np.random.default_rng(seed)
        run = simulate(doses(1.5).plant, until=200, dwell=dwell, rng=rng)
        assert run.happened is not None
        rows, names = np.nonzero(run.happened)
        others = names[1:] != names[:-1]
        assert (np.diff(run.t[rows])[others] >= 1.5 - 1e-9).all()
        for k, (low, high) in enumerate(((2, 6), (3, 7))):
            apart = np.diff(run.t[run.happened[:, k]])
            assert low - 1e-9 <= apart.min()
            assert apart.max() <= high + 1e-9


def with_leak(spacing: float) -> Problem:
    """The valve with strokes and a leak that adds to the same tank."""
    body = valve(strokes=True).to_dict()
    box = {"lower": [-0.2, 0], "upper": [0, 0]}
    body["event"][0] |= {"disturbance": {"lower": [0, 0], "upper": [0.2, 0]}}
    body["event"].append({"name": "leak", "every": 5, "modes": ["open"], "disturbance": box})
    return Problem.from_dict(body | ({"timing": {"spacing": spacing}} if spacing else {}))


def test_spacing_within_modes() -> None:
    near, far = (width(with_leak(spacing), "mode_width") for spacing in (0.0, 4.0))
    assert far < 0.98 * near
    observer = from_design(designed(with_leak(4.0).to_dict()))
    state = observer.start(0.0, [-5, 5, -5, 5])
    state, _ = observer.step(state, Sample(0.0, [0.0], jump=True, events=(0,), mode="open"))
    _, estimate = observer.step(state, Sample(1.0, [0.0], jump=True, events=(1,)))
    assert "leak: time 1 since stroke below 4" in estimate.status


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"timing": {"spacing": -1}}, "timing.spacing must be a number >= 0"),
        ({"timing": {"space": 1}}, "unknown key 'space' in [timing]: did you mean 'spacing'"),
        ({"timing": {"memory": 1}}, "it belongs in [observer]"),
        ({"event": []}, "[[event]]"),
        ({"flow": {"A": [[0.5]], "dt": 1}}, "timing.spacing is not available with flow.dt"),
        ({"timing": {"spacing": 30}}, "at most half of the longest time of every event"),
    ],
)
def test_refusals(change: Body, text: str) -> None:
    body = doses(1.0).to_dict() | change
    with pytest.raises(InputError) as refusal:
        Problem.from_dict(body)
    assert text in str(refusal.value) or not body["event"]


def test_spacing_needs_two_events() -> None:
    body = doses(1.0).to_dict()
    del body["event"][1]
    with pytest.raises(InputError, match=r"timing\.spacing requires two events or more"):
        Problem.from_dict(body)


def test_an_event_that_a_mode_ends_need_not_come() -> None:
    """The twin is the plant without modes: there another event would come too late."""
    strokes = [
        {"name": name, "every": [2, 6], "modes": [mode],
         "disturbance": {"lower": [0.9], "upper": [1.1]}}
        for name, mode in (("stroke", "open"), ("purge", "closed"))
    ]  # fmt: skip
    body: Body = {
        "flow": {"A": [[-1.0]]},
        "mode": [{"name": name, "A": [[-1.0]], "every": [10, 20]} for name in ("open", "closed")],
        "event": strokes,
        "sensor": [{"name": "level", "C": [[1]], "noise_bound": 0.1, "every": "continuous"}],
        "timing": {"spacing": 4},
    }
    run = simulate(Problem.from_dict(body).plant, until=200.0, rng=np.random.default_rng(1))
    assert run.happened is not None
    times, names = run.t[run.happened.any(axis=1)], run.happened[run.happened.any(axis=1)]
    apart = (names[1:] != names[:-1]).any(axis=1)
    assert apart.sum() > 5
    assert (np.diff(times)[apart] >= 4 - 1e-9).all()
    del body["mode"]
    for stroke in strokes:
        del stroke["modes"]
    with pytest.raises(InputError, match="at most half of the longest time"):
        Problem.from_dict(body)
