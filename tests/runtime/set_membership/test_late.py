"""Measurements that arrive late, and those of some outputs alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from obsdesign.runtime.base import Estimate, Sample
from obsdesign.runtime.set_membership.observer import SetMembershipObserver
from obsdesign.runtime.set_membership.state import SetMembershipState
from tests.systems.set_membership import Case, Record, cases, observer_of

CASES = cases()


def _stepped(
    observer: SetMembershipObserver, case: Case, samples: list[Sample]
) -> tuple[SetMembershipState, Estimate]:
    state = observer.init(0.0, lower=case.x0[0], upper=case.x0[1])
    for sample in samples:
        state, estimate = observer.step(state, sample)
    return state, estimate


def _shared(case: Case, record: Record, late: int, count: int) -> tuple[Sample, list[Sample]]:
    """The late sample, and the rows without it: between the others, or a row without y."""
    samples = list(record.samples[:count])
    sample = samples[late]
    rest = [*samples[:late], *samples[late + 1 :]]
    if sample.jump:
        rest.insert(late, sample._replace(y=None))
    return sample, rest


@pytest.mark.parametrize("when", ["before", "after"])
@pytest.mark.parametrize("late", [6, 9, 10, 11, 13])
def test_a_late_sample_gives_the_bounds_of_one_in_time(late: int, when: str) -> None:
    """In a step, or at a jump (row 10), whose measurement is before or after it."""
    case = replace(CASES["rand4_42"], missing=0.0)
    record = case.record()
    observer = observer_of(case, 30)
    if when == "after":  # what the plant would show behind its jump
        samples = [
            s._replace(y=case.C @ x) if s.jump else s
            for s, x in zip(record.samples, record.truth, strict=True)
        ]
        record = replace(record, samples=tuple(samples))
        observer = SetMembershipObserver(replace(observer.gains, jump_measurement="after"))
    sample, rest = _shared(case, record, late, 16)
    state, before = _stepped(observer, case, rest)
    _, in_time = _stepped(observer, case, list(record.samples[:16]))
    later, estimate = observer.late(state, sample.t, sample.y)
    assert estimate.status == "ok"
    assert estimate.t == before.t
    slack = 2e-3 * np.subtract(in_time.upper, in_time.lower)
    assert (np.abs(estimate.lower - in_time.lower) <= slack).all()
    assert (np.abs(estimate.upper - in_time.upper) <= slack).all()
    assert (estimate.lower >= before.lower).all()
    assert (estimate.upper <= before.upper).all()
    if late == 13:  # a recent one tells more than those around it
        widths = [np.subtract(e.upper, e.lower).sum() for e in (estimate, before)]
        assert widths[0] < 0.99 * widths[1]
    following, own = record.samples[16], record.truth[16]
    _, last = observer.step(later, following)
    assert ((last.lower <= own) & (own <= last.upper)).all()
    assert len(later.stages) == len(state.stages) + (not sample.jump)


def test_late_samples_of_a_long_stream_keep_the_state_inside() -> None:
    """Every third sample comes two rows late; the window is full, and its oldest stage leaves."""
    case = replace(CASES["rand2_21"], missing=0.0)
    record = case.record(extreme=True)
    observer = observer_of(case, 6)
    state = observer.init(0.0, lower=case.x0[0], upper=case.x0[1])
    waiting: list[Sample] = []
    for k, (sample, x) in enumerate(zip(record.samples, record.truth, strict=True)):
        if k % 3 == 1 and not sample.jump:
            waiting.append(sample)
            continue
        state, estimate = observer.step(state, sample)
        if k % 3 == 0 and waiting:
            own = waiting.pop()
            state, estimate = observer.late(state, own.t, own.y)
            assert estimate.status in ("ok", f"late sample at {own.t:.9g} is older than the window")
        assert ((estimate.lower <= x) & (x <= estimate.upper)).all()
        assert len(state.stages) <= 6


def test_a_late_sample_that_is_too_old_changes_no_bound() -> None:
    case = CASES["degue"]
    observer = observer_of(case, 4)
    state, before = _stepped(observer, case, list(case.record().samples[:12]))
    _, estimate = observer.late(state, 0.25, [0.3])
    assert estimate.status == "late sample at 0.25 is older than the window"
    assert (estimate.lower >= before.lower).all()
    assert (estimate.upper <= before.upper).all()


def test_a_late_sample_that_contradicts_is_refuted() -> None:
    case = CASES["degue"]
    record = case.record()
    observer = observer_of(case, 8)
    state, _ = _stepped(observer, case, list(record.samples[:12]))
    wrong = np.asarray(record.samples[10].y) + 5.0
    state, estimate = observer.late(state, 1.05, wrong)
    assert "bounds crossed: samples at" in estimate.status
    assert " 1.05 " in estimate.status
    _, following = observer.step(state, record.samples[12])
    assert "void since time 1.1" in following.status


@pytest.mark.parametrize(
    ("t", "y", "words"),
    [
        (2.0, [0.1], "must be at most at 1.1"),
        (1.0, [np.nan], "must have a finite entry"),
        (1.0, [0.1, 0.2], "y must have 1 entries; got 2"),
        (np.nan, [0.1], "time must be finite"),
    ],
)
def test_what_is_no_late_sample_is_refused(t: float, y: list[float], words: str) -> None:
    case = CASES["degue"]
    observer = observer_of(case, 8)
    state, _ = _stepped(observer, case, list(case.record().samples[:12]))
    with pytest.raises(ValueError, match=words):
        observer.late(state, t, y)


def test_a_late_sample_at_a_jump_that_hides_it_is_refused() -> None:
    case = CASES["rand2_21"]
    observer = observer_of(case, 8)
    observer = SetMembershipObserver(replace(observer.gains, jump_measurement="none"))
    samples = list(case.record().samples[:13])
    state, _ = _stepped(observer, case, samples)
    jump = next(s for s in samples if s.jump)
    with pytest.raises(ValueError, match="jump_measurement is none"):
        observer.late(state, jump.t, [0.1])


def test_outputs_that_are_missing_drop_their_strip_alone() -> None:
    """Never wider than without the row's sample, nor narrower than with all of it."""
    case = replace(CASES["rand4_42"], missing=0.0)
    record = case.record(extreme=True)
    samples = list(record.samples[:40])

    def widths(hidden: list[int]) -> tuple[list[str], np.ndarray]:
        changed = []
        for k, sample in enumerate(samples):
            y = np.array(sample.y)
            if k % 2:
                y[hidden] = np.nan
            changed.append(sample._replace(y=y))
        observer = observer_of(case, 8, steps=12)
        state = observer.init(0.0, lower=case.x0[0], upper=case.x0[1])
        estimates = list(observer.run(state, changed))
        for estimate, x in zip(estimates, record.truth, strict=False):
            assert ((estimate.lower <= x) & (x <= estimate.upper)).all()
        size = [np.subtract(e.upper, e.lower) for e in estimates]
        return [e.status for e in estimates], np.array(size)

    (_, whole), (partly, second), (none, without) = widths([]), widths([1]), widths([0, 1])
    assert partly[1] == "missing sample of y2"
    assert none[1] == "missing sample"
    assert partly[2] == "ok"
    assert (second[8:].mean(axis=0) < without[8:].mean(axis=0)).all()
    assert (second[8:].mean(axis=0) > whole[8:].mean(axis=0)).all()


def test_a_late_sample_from_before_a_reset_changes_no_bound() -> None:
    case = CASES["rand4_42"]
    record = case.record()
    observer = observer_of(case, 8)
    state, _ = _stepped(observer, case, list(record.samples[:12]))
    state = observer.reset(state, lower=case.x0[0], upper=case.x0[1])
    sample = record.samples[8]
    assert sample.y is not None
    state, estimate = observer.late(state, sample.t, sample.y)
    assert estimate.status == f"late sample at {sample.t:.9g} is older than the window"
    np.testing.assert_allclose([estimate.lower, estimate.upper], case.x0)
    state, estimate = observer.step(state, record.samples[12])
    assert estimate.status == "ok"
