"""Interval observers of plants with parameters: bounds hold, and follow the estimated effect."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from obsdesign.runtime.base import Sample
from obsdesign.runtime.interval.fleet import Fleet
from obsdesign.runtime.interval.observer import IntervalObserver
from tests.systems.uncertain_plants import (
    PATTERNS,
    Course,
    Play,
    Uncertain,
    boxed,
    course,
    margins,
    random_uncertain,
)

_WITHOUT: dict[str, Any] = {"effects": [], "flow_correction": None, "jump_correction": None}
# rounding of the simulated truth, relative to the largest state
_ROUNDING = 1e-12


def _spring(**gains: Any) -> Uncertain:
    """A spring of stiffness 1 +- 0.2, its position measured, with kicks."""
    effect = {"A": np.array([[0, 0], [-0.2, 0]]), "Q": np.array([[0], [-0.2]])}
    return Uncertain(
        A=np.array([[0, 1], [-1, -0.4]]), C=np.array([[1.0, 0]]), V=np.array([0.01]),
        b=np.array([[0, 0], [0, 0.05]]), effects=[effect], G=np.eye(2),
        c=np.array([[0, 0], [0, 0.3]]),
        gains={"L": np.array([[2.0], [-1]]), "M": np.array([[1.0], [0]])} | gains,
    )  # fmt: skip


def _boxed(limit: float) -> dict[str, Any]:
    """Entries of a design of the spring for |x| <= limit."""
    return boxed(_spring(), np.full(2, -limit), np.full(2, limit))


def _record(plant: Uncertain, pattern: str, rows: int, seed: int = 0) -> tuple[Any, Any, Any, Any]:
    """(t, y, jump, x) of the plant from x = (0.5, 0), samples 0.05 apart, a jump in 60."""
    rng = np.random.default_rng(seed)
    play = Play(plant, pattern, rng, np.array([0.5, 0]))
    y, x, jump = np.empty((rows, 1)), np.empty((rows, 2)), np.arange(rows) % 60 == 59
    for k in range(rows):
        play.flow(0.05, np.zeros(0))
        y[k] = play.measured()
        if jump[k]:
            play.jump(np.zeros(0))
        x[k] = play.x
    return 0.05 * np.arange(1, rows + 1), y, jump, x


def _bounds(observer: IntervalObserver, record: Any, **initial: Any) -> Any:
    t, y, jump, _ = record
    initial = {"lower": [0.0, -0.5], "upper": [1.0, 0.5]} | initial
    return observer.run_batch(t, y, jump=jump, **initial)


def _run(seed: int, scale: float = 1.0, **more: Any) -> tuple[Uncertain, Course, Any]:
    """A random plant, a course of it, and the state it starts from."""
    rng = np.random.default_rng(seed)
    plant = random_uncertain(rng, **more)
    x = rng.standard_normal(plant.n)
    return plant, course(Play(plant, PATTERNS[seed % 3], rng, x, scale), 16, 0.1), x


@pytest.mark.parametrize("seed", range(12))
def test_bounds_hold_whatever_the_parameters_do(seed: int) -> None:
    """With the box of the state known and without, which is never narrower."""
    plant, run, x = _run(seed)
    first = (x - 0.1, x + 0.3 * (seed % 2))
    worst, widths = margins(plant.observer(), run, *first)
    assert worst.min() > -_ROUNDING
    assert np.isfinite(widths).all()
    known, narrower = margins(plant.observer(**boxed(plant, run.lower, run.upper)), run, *first)
    assert known.min() > -_ROUNDING
    assert (narrower <= widths + 1e-12).all()


def test_bounds_are_left_where_parameters_leave_their_ranges() -> None:
    """By a half, in most of these plants: the bounds are not wide for nothing."""
    beyond = []
    for seed in range(0, 18, 3):
        plant, run, x = _run(seed, scale=1.5, periodic=False)
        beyond.append(margins(plant.observer(), run, x, x)[0].min() < -1e-6)
    assert sum(beyond) >= 3


@pytest.mark.parametrize("pattern", PATTERNS)
def test_widths_follow_the_estimated_effect(pattern: str) -> None:
    """Of a spring that swings by 1.2 at most: narrower than with the largest effect at all times."""
    plant = _spring()
    record = _record(plant, pattern, 600)
    adaptive = _bounds(plant.observer(), record)
    both, wide = (_bounds(plant.observer(**_boxed(1.5), **more), record) for more in ({}, _WITHOUT))
    assert {*adaptive.status, *both.status, *wide.status} == {"ok"}
    x, late = record[-1], slice(300, None)
    for batch in (adaptive, both, wide):
        assert np.minimum(batch.upper - x, x - batch.lower).min() > -_ROUNDING
    assert (both.lower >= np.maximum(adaptive.lower, wide.lower) - 1e-12).all()
    assert (both.upper <= np.minimum(adaptive.upper, wide.upper) + 1e-12).all()
    speed = [float((each.upper - each.lower)[late, 1].mean()) / 2 for each in (adaptive, wide)]
    assert 0.3 < speed[0] < 0.5
    assert speed[1] > 1.6 * speed[0]


def test_an_effect_of_zero_changes_no_number() -> None:
    plant = _spring()
    plant.effects = [{"A": np.zeros((2, 2)), "C": np.zeros((1, 2))}]
    without = plant.observer(**_WITHOUT)
    record = _record(plant, "constant", 100)
    ours, theirs = _bounds(plant.observer(), record), _bounds(without, record)
    assert np.array_equal(ours.lower, theirs.lower)
    assert np.array_equal(ours.upper, theirs.upper)


def test_two_halves_of_a_parameter_are_the_whole() -> None:
    plant, halves = _spring(), _spring()
    halves.effects = 2 * [{key: 0.5 * own for key, own in plant.effects[0].items()}]
    record = _record(plant, "bang-bang", 200)
    ours, theirs = (_bounds(each.observer(), record) for each in (plant, halves))
    np.testing.assert_allclose(ours.lower, theirs.lower, rtol=0, atol=1e-12)
    np.testing.assert_allclose(ours.upper, theirs.upper, rtol=0, atol=1e-12)


def test_narrower_bounds_stay_inside() -> None:
    """Both of initial bounds and of the known box of the state."""
    record = _record(_spring(), "bang-bang", 200)
    wide = _bounds(_spring().observer(**_boxed(1.6)), record)
    for box, initial in ((1.6, {"lower": [0.3, -0.1], "upper": [0.6, 0.2]}), (1.5, {})):
        narrow = _bounds(_spring().observer(**_boxed(box)), record, **initial)
        assert (narrow.lower >= wide.lower - 1e-14).all()
        assert (narrow.upper <= wide.upper + 1e-14).all()


@pytest.mark.parametrize("is_boxed", [False, True])
def test_a_stream_a_record_and_a_fleet_agree(is_boxed: bool) -> None:
    observer = _spring().observer(**(_boxed(1.5) if is_boxed else {}))
    t, y, jump, _ = record = _record(_spring(), "bang-bang", 150)
    y[[20, 90]] = np.nan
    batch = _bounds(observer, record)
    fleet = Fleet((observer,) * 9)
    first: dict[str, Any] = {"t": t[0], "lower": [0.0, -0.5], "upper": [1.0, 0.5]}
    state, many = observer.init(**first), fleet.init(**first)
    for k, now in enumerate(t):
        sample = Sample(float(now), None if np.isnan(y[k, 0]) else y[k], jump=bool(jump[k]))
        state, estimate = observer.step(state, sample)
        many, estimates = fleet.step(many, now, y[k], jump=jump[k])
        assert np.array_equal(estimate.lower, batch.lower[k])
        assert np.array_equal(estimate.upper, batch.upper[k])
        np.testing.assert_allclose(estimates.lower[:, 4], estimate.lower, rtol=0, atol=1e-12)
        np.testing.assert_allclose(estimates.upper[:, 4], estimate.upper, rtol=0, atol=1e-12)


@pytest.mark.parametrize("L", [[[0.0], [0]], [[2.0], [-1]]])
def test_an_ordinary_step_is_that_of_its_kernel(L: Any) -> None:
    """Without L the first measurement of a step acts by its forms alone."""
    observer, state = _spring(L=np.array(L)).observer(), None
    t, y, _, _ = _record(_spring(), "bang-bang", 40)
    for k, now in enumerate(t.tolist()):
        state = state or observer.init(0.0, lower=[0.0, -0.5], upper=[1.0, 0.5])
        plain = observer.step(state._replace(is_usual=False), Sample(now, y[k]))[1]
        state, estimate = observer.step(state, Sample(now, y[k]))
        assert np.array_equal(estimate.lower, plain.lower)
        assert np.array_equal(estimate.upper, plain.upper)


@pytest.mark.parametrize("start", [1.7e9, 1.7e18])
def test_large_time_stamps(start: float) -> None:
    """Their rounding widens bounds; it does not break them."""
    plant, rng = _spring(), np.random.default_rng(0)
    play = Play(plant, "adversarial", rng, np.array([0.5, 0]))
    observer = plant.observer()
    state = observer.init(start, lower=[0.4, -0.1], upper=[0.6, 0.1])
    step = max(0.05, 4 * float(np.spacing(start)))
    t = start
    for _ in range(10 if step < 1 else 2):
        h = (t + step) - t
        play.flow(h, np.zeros(0))
        t += h
        state, estimate = observer.step(state, Sample(t, play.measured()))
        assert np.minimum(estimate.upper - play.x, play.x - estimate.lower).min() > -_ROUNDING


def test_a_state_outside_its_box_is_a_status() -> None:
    """Bounds that do not count on the box go on, and hold here: the box was left at once."""
    plant = _spring()
    record = _record(plant, "constant", 100)
    batch = _bounds(plant.observer(**_boxed(0.3)), record, lower=[0.45, -0.1], upper=[0.6, 0.1])
    assert batch.status[0] == "state box refuted"
    assert all("void since time 0.05 (state box refuted)" in text for text in batch.status[1:])
    assert np.isfinite(batch.lower).all()


def test_bounds_of_rows_are_refused() -> None:
    observer = _spring().observer()
    assert observer.declared_bounds is None
