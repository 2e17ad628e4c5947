"""Each step of check_events.py by itself, against numbers computed another way."""

from __future__ import annotations

import math
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lmi.arithmetic.exponential import expm
from obsdesign.checker import check_events as check

check.NotProved = check.NotProved
INF = math.inf


def fractions(v: Any) -> Any:
    return [Fraction(float(a)) for a in v]


def exact(X: Any) -> Any:
    return [fractions(row) for row in X]


def flow(W: Any, f: Any) -> Any:
    return check.PositiveFlow(exact(W), fractions(f))


def refused(step: Any, *values: Any) -> bool:
    try:
        step(*values)
    except check.NotProved:
        return True
    return False


def span(low: float, high: float) -> Any:
    return Fraction(low), Fraction(high) if high < INF else INF


# paths -------------------------------------------------------------------------------------------


def test_systems_that_are_not_positive_are_refused() -> None:
    flow([[-1, 0], [2, -1]], [0, 1])
    for W, f in (
        ([[-1, -1e-9], [2, -1]], [0, 1]), ([[-1, 0], [-1e-9, -1]], [0, 1]),
        ([[-1, 0], [2, -1]], [-1e-9, 1]), ([[-1, 0], [2, -1]], [1, -1e-9]),
    ):  # fmt: skip
        assert refused(flow, W, f)


def test_boxes_have_each_of_their_terms() -> None:
    """X = E + K, Y = e^(Z (t + h)) + K, K = h^2 / 8 e^(P h) |Z^2 E|."""
    W, f, t, h = np.array([[-2.0, 1.0], [0.5, 0.25]]), np.array([0.5, 1.0]), 0.375, 0.5
    Z = np.zeros((3, 3))
    Z[:2, :2], Z[:2, 2] = W, f
    E, end = expm(Z * t), expm(Z * (t + h))
    K = h * h / 8 * expm(np.maximum(Z, 0) * h) @ np.abs(Z @ Z @ E)
    boxes = flow(W, f).box(Fraction(t), Fraction(h))
    for box, expected in zip(boxes, (E + K, end + K), strict=True):
        got = np.array([[float(a) for a in row] for row in box])
        assert np.allclose(got, expected, rtol=1e-12, atol=1e-15)


def test_boxes_have_a_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(check, "MOST_BOXES", 2)
    path = flow([[-1]], [0])
    for t in (0, 1, 0):
        path.box(Fraction(t), Fraction(1))
    assert refused(path.box, Fraction(2), Fraction(1))


@pytest.mark.parametrize("low", [0.0, 0.5])
@pytest.mark.parametrize(
    ("W", "f", "start"),
    [
        ([[-1, 0], [1, -2]], [0, 0], [1, 0.1]), ([[-1, 0.25], [1, -2]], [1, 0.5], [0.25, 0.5]),
        ([[0.5, 0.25], [0.5, -1]], [0, 0.5], [1, 1]), ([[-20, 1], [20, -2]], [0, 1], [2, 0]),
    ],
)  # fmt: skip
def test_a_path_is_below_its_peak_and_no_less(W: Any, f: Any, start: Any, low: float) -> None:
    Z = np.zeros((3, 3))
    Z[:2, :2], Z[:2, 2] = W, f
    times = np.linspace(low, low + 2.0, 2001)[:, None, None]
    peaks = (expm(Z * times) @ np.append(start, 1.0))[:, :2].max(axis=0)
    for i, peak in enumerate(peaks):
        for share, expected in ((1.0001, True), (1 - 1e-6, False)):
            limit, path = Fraction(peak * share), flow(W, f)
            assert path.is_below(fractions(start), i, limit, span(low, low + 2.0)) == expected


def test_one_time_is_a_range() -> None:
    path = flow([[-1]], [0])
    at = span(1.0, 1.0)
    assert path.is_below([Fraction(1)], 0, Fraction(0.3679), at)
    assert not path.is_below([Fraction(1)], 0, Fraction(0.3678), at)
    assert not flow([[0]], [0]).is_below([Fraction(1)], 0, Fraction(1), at)


def test_ranges_without_end() -> None:
    """u' = f - u from u(low) on: below the larger of what it is there and f, for ever."""
    for f, start, low, top in (
        (0.0, 1.0, 0.0, 1.0), (0.0, 1.0, 1.0, math.exp(-1)), (0.5, 1.0, 0.5, 0.5 + 0.5 * math.exp(-0.5)),
    ):  # fmt: skip
        for share, expected in ((1 + 1e-4, True), (1 - 1e-4, False)):
            own = flow([[-1]], [f])
            limit = Fraction(top * share)
            assert own.is_below([Fraction(start)], 0, limit, span(low, INF)) == expected
    lagging = flow([[-1, 0], [1, -2]], [0, 0])  # u2 rises up to log 2, where it is 1/4
    for limit, expected in ((0.2501, True), (0.2499, False)):
        start = fractions([1, 0])
        assert lagging.is_below(start, 1, Fraction(limit), span(0.0, INF)) == expected
    late = span(0.65, INF)  # later than the first time tried, before the peak
    for limit, expected in ((0.2501, True), (0.24999, False)):
        assert lagging.is_below(fractions([1, 0]), 1, Fraction(limit), late) == expected
    start = [Fraction(1)]
    assert refused(flow([[0]], [0]).is_below, start, 0, Fraction(9), span(0.0, INF))
    assert refused(flow([[0.1]], [0]).is_below, start, 0, Fraction(9), span(0.0, INF))
    assert refused(flow([[-1]], [2]).is_below, start, 0, Fraction(9), span(0.0, INF))


@pytest.mark.parametrize("ends", [(0.0, 0.73), (0.66, 1.5), (0.0, 1.45), (0.3, 0.75), (0.69, 0.7)])
def test_a_peak_is_met_wherever_it_is_in_a_range(ends: Any) -> None:
    """e^-t - e^-2t has its peak 1/4 at 0.69; both ends of the range are lower."""
    lagging, start = flow([[-1, 0], [1, -2]], [0, 0]), fractions([1, 0])
    for limit, expected in ((0.250001, True), (0.249999, False)):
        assert lagging.is_below(start, 1, Fraction(limit), span(*ends)) == expected


def test_a_box_that_meets_the_limit_is_not_below_it() -> None:
    path, start, at = flow([[-1]], [0]), [Fraction(1)], Fraction(1)
    bound = max(check.dot(X[0], [*start, at]) for X in path.box(at, Fraction(0)))
    assert not path.is_below(start, 0, bound, (at, at))
    assert path.is_below(start, 0, bound + Fraction(1, 2**300), (at, at))


@pytest.mark.parametrize(
    ("values", "radius", "T"),
    [
        ({1: 1.0, 2: 3.0, 3: 2.0, 5: 0.5, 4: 9.0}, 0.0, 4), ({1: 1.0, 2: 0.5}, 0.0, 1),
        ({1: 1.0, 2: 1.0, 3: 0.5}, 0.0, 2), ({1: 1.0, 2: 0.7, 3: 0.4}, 0.5, 2),
    ],
)  # fmt: skip
def test_a_time_of_return_is_certified_by_the_ends_of_balls(
    values: Any, radius: float, T: int
) -> None:
    """u(1 + T) < u(1) with u(1) in a ball of this radius."""
    path, whole = flow([[-1]], [0]), 1 << check.BITS

    def at(t: Fraction) -> check.Ball:
        x = int(values.get(t, 9.0) * whole)
        return check.Ball([[x, 0], [0, whole]], int(radius * whole) if t == 1 else 0)

    path.map = at
    assert path.time_of_return([Fraction(1), Fraction(0)], Fraction(1)) == T


def test_a_time_of_return_is_one_for_every_entry() -> None:
    for speed in (2.0**-20, 1.0, 2.0**20):
        path = flow([[-speed, 0], [speed, -2 * speed]], [0, 0])
        for low in (0.0, 1.0 / speed):
            y = fractions([1, 0.125, 1])
            T = path.time_of_return(y, Fraction(low))
            u, later = (
                [check.dot(row, y) for row in check.upper_ends(path.map(t))[:-1]]
                for t in (Fraction(low), Fraction(low) + T)
            )
            assert all(b < a for a, b in zip(u, later, strict=True))
            assert float(T) * speed <= 16
    assert refused(
        flow([[0, 0], [0, -1]], [0, 0]).time_of_return, fractions([1, 1, 1]), Fraction(0)
    )
    assert refused(
        flow([[-1, 0], [0, 0]], [0, 0]).time_of_return, fractions([1, 1, 1]), Fraction(0)
    )
    assert refused(flow([[-1]], [1]).time_of_return, fractions([1, 1]), Fraction(0))


def test_a_map_and_the_least_of_several() -> None:
    assert check.dot(fractions([1, -2]), fractions([3, 4])) == -5
    maps = [
        (exact([[1, 0], [0, 2]]), fractions([0, 1])),
        (exact([[2, 0], [0, 1]]), fractions([1, 0])),
    ]
    assert check.least(maps, fractions([3, 4])) == [3, 4]
    assert check.least(maps[:1], fractions([3, 4])) == [3, 9]
    assert check.least(maps[1:], fractions([3, 4])) == [7, 4]


# ranges of time ----------------------------------------------------------------------------------


def test_times_in_two_ranges() -> None:
    for X, Y, both in (
        ((0, 2), (1, 3), [(1, 2)]), ((1, 3), (0, 2), [(1, 2)]), ((0, 1), (1, 2), [(1, 1)]),
        ((0, 1), (2, 3), []), ((2, 3), (0, 1), []), ((0, INF), (1, 2), [(1, 2)]),
        ((1, 2), (0, 9), [(1, 2)]), ((0, INF), (1, INF), [(1, INF)]),
    ):  # fmt: skip
        assert check.meet(span(*X), span(*Y)) == [span(*x) for x in both]


def test_differences_of_times() -> None:
    """s - t >= 0, s in the first and t in the second."""
    for X, Y, less in (
        ((5, 6), (1, 2), [(3, 5)]), ((1, 2), (1, 2), [(0, 1)]), ((1, 2), (3, 4), []),
        ((1, 2), (2, 3), [(0, 0)]), ((1, INF), (0, 2), [(0, INF)]), ((5, 5), (1, 1), [(4, 4)]),
        ((1, 4), (2, 3), [(0, 2)]),
    ):  # fmt: skip
        assert check.less(span(*X), span(*Y)) == [span(*x) for x in less]


def test_equal_parts() -> None:
    assert check.parts(Fraction(3), 1) == [(0, 3)]
    assert check.parts(Fraction(3), 3) == [(0, 1), (1, 2), (2, 3)]
    assert check.parts(Fraction(1), 2) == [(0, Fraction(1, 2)), (Fraction(1, 2), 1)]


def test_times_from_a_mark_to_the_next() -> None:
    """Event 0 at the first; at the next, 1 happens: what had passed of both must agree."""
    first = check.Mark((0,), {0: span(2, 3), 1: span(0, 1)})
    following = check.Mark((1,), {0: span(0, 2), 1: span(2, 4)})
    assert first.until(following) == [span(1, 2)]
    late = check.Mark((1,), {0: span(0, 0.5), 1: span(2, 4)})
    assert first.until(late) == []
    soon = check.Mark((1,), {0: span(0, 0.5), 1: span(0.25, 1)})
    assert first.until(soon) == [span(0, 0.5)]
    again = check.Mark((0,), {0: span(2, 3), 1: span(2, 3)})
    assert first.until(again) == [span(2, 3)]
    assert check.Mark((0,), {0: span(1, 1)}).until(check.Mark((0,), {0: span(1, INF)})) == [
        span(1, INF)
    ]


def clocks(*every: Any, spacing: float = 0.0, read: tuple[int, ...] = ()) -> Any:
    """What `Marks` reads of a system."""
    events = [SimpleNamespace(every=span(*ends)) for ends in every]
    design = SimpleNamespace(events=events, spacing=Fraction(spacing))
    return SimpleNamespace(design=design, events=[*range(len(events))], is_read=lambda e: e in read)


def test_ages_of_an_event_that_has_not_happened_again() -> None:
    marks = check.Marks(clocks((2, 5), (1, INF)), 1, 3)
    assert marks.unit == 1
    assert marks.ages(0, 3) == [span(0, 1), span(1, 2), span(2, 3), span(3, 4), span(4, 5)]
    assert marks.ages(0, 1) == [span(0, 1), span(1, 2), span(2, 5)]
    assert marks.ages(1, 3) == [span(0, 1), span(1, INF)]
    other = check.Marks(clocks((0, 3), (2, 2)), 1, 1)
    assert other.ages(0, 1) == [span(0, 3)]
    assert other.ages(1, 3) == [span(0, 2), span(2, 2)]
    assert marks.count(Fraction(1, 2)) == 1
    assert marks.count(Fraction(5, 2)) == 3
    assert marks.count(Fraction(10**6)) == check.MOST_PARTS
    assert check.Marks(clocks((0, 3)), 2, 1).unit is None
    assert check.Marks(clocks((0, 3)), 2, 1).count(Fraction(7)) == 2


def test_kinds_of_marks() -> None:
    """Several at once where a sensor is read at one of them, and no spacing keeps them apart."""
    pairs = [(0, 1), (1, 0)]
    for words, kinds in (
        ({"read": (0,)}, [(0,), (1,), *pairs]), ({}, [(0,), (1,)]),
        ({"read": (1,), "spacing": 0.5}, [(0,), (1,)]), ({"read": (1,)}, [(0,), (1,), *pairs]),
    ):  # fmt: skip
        assert check.Marks(clocks((2, 3), (2, 3), **words), 1, 1).kinds == kinds


def test_ages_of_others_are_at_least_the_spacing() -> None:
    marks = check.Marks(clocks((2, 3), (2, 3), spacing=0.5), 1, 1)
    ages = {mark.passed[1 - mark.events[0]] for mark in marks.marks}
    assert ages == {span(0.5, 2), span(2, 3)}
    assert {mark.passed[mark.events[0]] for mark in marks.marks} == {span(2, 3)}


def test_marks_have_a_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(check, "MOST_MARKS", 4)
    assert len(check.Marks(clocks((2, 3), (2, 3), spacing=0.5), 1, 1).marks) == 4
    assert refused(check.Marks, clocks((2, 3), (2, 3), spacing=0.5), 1, 2)


def test_marks_that_come_a_few_times_only_are_left_out() -> None:
    """Both every 2: whatever their distance, it stays; a mark that none leads to is none."""
    marks = check.Marks(clocks((2, 2), (2, 2)), 2, 1)
    for y, before in marks.before.items():
        for x, time in before:
            assert x in marks.before
            assert time in marks.marks[x].until(marks.marks[y])
    never = check.Marks(clocks((1, 1), (5, 5)), 1, 1)  # 0 happens each second: 1 is old or new
    for mark in never.before:
        own = never.marks[mark]
        assert 0 in own.events or own.passed[0][1] <= 1


# a plant without events --------------------------------------------------------------------------


def still(W: Any, f: Any, samples: Any = ()) -> Any:
    """What `prove_still` reads: (gap, map of a sample) of each sensor."""
    sensors = [SimpleNamespace(gap=Fraction(gap)) for gap, _, _ in samples]
    design = SimpleNamespace(sensors=sensors, counted=[*range(len(sensors))])
    maps = [[[(exact(N), fractions(k))]] for _, N, k in samples]
    return SimpleNamespace(
        design=design, W=exact(W), f=fractions(f), flow=flow(W, f), sampled=lambda s: maps[s]
    )


def test_an_entry_that_falls() -> None:
    for f, expected in ((0.75, True), (1.0, False), (1.25, False)):
        assert refused(check.prove_still, still([[-1]], [f]), fractions([1])) != expected
    assert not refused(
        check.prove_still, still([[-1, 0.5], [0, -1]], [0.25, 0.5]), fractions([1, 1])
    )


def test_an_entry_that_falls_beside_one_that_grows() -> None:
    """x2 is held by its samples alone; x1 falls as long as x2 is below its bound."""
    system = still([[-1, 0.5], [0, 3]], [0, 0], [(0.1, [[1, 0], [0, 0]], [0, 0.25])])
    for v, expected in (([1, 1], True), ([0.25, 1], False), ([1, 0.3], False)):
        assert refused(check.prove_still, system, fractions(v)) != expected


def test_an_entry_that_is_low_a_time_later() -> None:
    """x1 falls; x2 rises where it starts, and all flow for 2: e^-2 + 2 e^-2 = 0.41."""
    system = still([[-1, 0], [1, -1]], [0, 0])
    for v, expected in ((0.5, True), (0.4, True), (0.1, False)):
        assert refused(check.prove_still, system, fractions([1, v])) != expected


def test_an_entry_by_its_samples() -> None:
    """From 1/4 at a rate of 1/2 + 1/2: below 1 for less than log(1.5 / .75)."""
    for gap, expected in ((0.69, True), (0.70, False)):
        system = still([[1]], [0.5], [(gap, [[0.25]], [0])])
        assert refused(check.prove_still, system, [Fraction(1)]) != expected
        system = still([[1]], [0.5], [(9, [[1]], [0]), (gap, [[0]], [0.25])])
        assert refused(check.prove_still, system, [Fraction(1)]) != expected
    for other, expected in (([0.25], True), ([0.75], False)):  # x2 pushes x1 by what is left of it
        system = still([[0, 2], [0, 0]], [0, 0], [(0.5, [[0, 0], [0, 0]], [0.5, *other])])
        start = fractions([1, 0.76])
        assert refused(check.prove_still, system, start) == (not expected)


def test_an_entry_alone_while_others_are_held() -> None:
    """x2 would grow to 4.8 between samples of x1, but is below v2 by samples of its own.

    So x1 is below 1/4 + 8 v2 / 2, and 1/4 + 8 (4.8 / 40) does not count.
    """
    samples = [(0.5, [[0, 0], [0, 0]], [0.25, 1e-8]), (0.01, [[1, 0], [0, 0]], [0, 1e-8])]
    system = still([[0, 8], [0, 40]], [0, 0], samples)
    for v2, expected in ((0.187, True), (0.188, False)):
        assert refused(check.prove_still, system, fractions([1, v2])) != expected


# maps of events and samples ----------------------------------------------------------------------

UNIT = [[1.0, 0.0], [0.0, 1.0]]


def event(name: str, G: Any, every: Any = (1, 2), M: Any = ((0, 0), (0, 0))) -> Any:
    return check.Event(name, exact(G), exact(M), span(*every))


def sensor(name: str, output: int, at: str | None = None, sees: str = "before") -> Any:
    return check.Sensor(name, [output], Fraction(0 if at else 1), at, sees)


def maps_of(
    events: Any, sensors: Any = (), A: Any = ((-1, 0), (0, -1)), spacing: float = 0.0
) -> Any:
    """The maps of a plant with two outputs, C = I, noise of 1 and 1/2, widths of b 1/4 and 0."""
    design = SimpleNamespace(
        n=2, A=exact(A), C=exact(UNIT), L=exact([[0.5, 0.0], [0.25, 0.0]]), f=fractions([0.25, 0]),
        V=fractions([1, 0.5]), events=list(events), sensors=list(sensors),
        spacing=Fraction(spacing),
    )  # fmt: skip
    return check.WidthMaps(design, homogeneous=False)


@pytest.mark.parametrize(
    ("G", "every", "read", "counts"),
    [
        (UNIT, (1, 2), False, False), ([[-0.5, 0], [0, -1]], (1, 2), False, False),
        ([[0, 0], [0, 0]], (1, 2), False, False), ([[-2, 0], [0, 1]], (1, 2), False, True),
        ([[1.5, 0], [0, 1]], (1, 2), False, True), ([[1, 0], [-0.1, 1]], (1, 2), False, True),
        ([[1, 0.1], [0, 1]], (1, 2), False, True), (UNIT, (0, 2), False, True),
        (UNIT, (1, 2), True, True),
    ],
)  # fmt: skip
def test_events_that_count(G: Any, every: Any, read: bool, counts: bool) -> None:
    sensors = [sensor("s", 0, "hit" if read else None)]
    assert maps_of([event("hit", G, every)], sensors).events == ([0] if counts else [])


@pytest.mark.parametrize(
    ("M", "spacing", "counting"),
    [(1.0, 0.0, [0, 1]), (1.0, 0.5, [1]), (0.0, 0.0, [1])],
)
def test_an_event_that_may_stand_ahead_of_a_gain_counts(
    M: float, spacing: float, counting: list[int]
) -> None:
    events = [event("dose", UNIT), event("hit", [[2, 0], [0, 1]], M=exact([[0, 0], [M, 0]]))]
    assert maps_of(events, [sensor("s", 0, "hit")], spacing=spacing).events == counting


def test_widths_flow_by_absolute_values_off_the_diagonal() -> None:
    system = maps_of([], A=[[-1, -0.5], [0.25, -2]])
    assert exact([[-1, 0.5], [0.25, -2]]) == system.W
    assert system.f == fractions([0.25, 0])
    still = check.WidthMaps(system.design, homogeneous=True)
    assert still.f == still.V == [0, 0]


def test_corrections_by_the_outputs_that_are_measured() -> None:
    """|X - gain C| and 2 |gain| V, by both outputs, by either, by none."""
    system, X, gain = maps_of([]), exact([[1, 2], [-3, 4]]), exact([[2, -1], [0, 5]])
    for outputs, N, k in (
        ([0, 1], [[1, 3], [3, 1]], [5, 5]), ([0], [[1, 2], [3, 4]], [4, 0]),
        ([1], [[1, 3], [3, 1]], [1, 5]), ([], [[1, 2], [3, 4]], [0, 0]),
    ):  # fmt: skip
        assert system.corrected(X, gain, outputs) == (N, k)


def test_a_sample_bounds_the_states_that_it_measures() -> None:
    system = maps_of([], [sensor("s", 1)])
    system.design.C = exact([[1, 0], [2, -4]])
    (maps,) = system.sampled(0)
    rows = ([[0, 2], [0.5, 0]], [0.5, 0.25])
    assert maps == [
        (exact(UNIT), [0, 0]),
        (exact(UNIT), [0, 0]),
        (exact(rows[0]), fractions(rows[1])),
    ]


def test_gains_at_events_need_what_was_measured_before_the_first() -> None:
    """Stages of a row: samples before, an event each, samples after; maps to choose from in each."""
    by_first, by_second = [[1, 0], [0, 0]], [[0, 0], [0, 1]]
    read = [sensor("s", 0, "a"), sensor("t", 1, "b")]
    for M, counts in ((by_first, [3, 3, 2, 1]), (by_second, [3, 3, 1, 1])):
        system = maps_of([event("a", UNIT, M=M), event("b", UNIT, M=M)], read)
        assert [len(stage) for stage in system.happened((0, 1))] == counts
    for M, counts in ((by_first, [3, 2]), (by_second, [3, 1])):
        system = maps_of([event("a", UNIT, M=M), event("b", UNIT, M=M)], read)
        assert [len(stage) for stage in system.happened((0,))] == counts
    late = [sensor("s", 0, "a", "after")]
    system = maps_of([event("a", UNIT, M=by_first)], late)
    assert [len(stage) for stage in system.happened((0,))] == [1, 3]
    twice = maps_of([event("a", UNIT, M=by_first), event("b", UNIT, M=by_first)], read[:1])
    assert [len(stage) for stage in twice.happened((0, 1))] == [3, 2, 1]


def test_graphs_have_a_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    system = maps_of([event("a", UNIT, (0, 2))], [sensor("s", 0)])
    system.design.spacing, system.design.counted = Fraction(0), [0]
    marks = check.Marks(system, 2, 1)
    size = len(check.Graph(system, marks).nodes)
    monkeypatch.setattr(check, "MOST_NODES", size)
    assert len(check.Graph(system, marks).nodes) == size
    monkeypatch.setattr(check, "MOST_NODES", size - 1)
    assert refused(check.Graph, system, marks)


# what a proof begins with ------------------------------------------------------------------------


def plant_of(rates: Any, *events: Any) -> Any:
    """A design without sensors, of one rate for each state."""
    n = len(rates)
    zeros = [Fraction(0)] * n
    return SimpleNamespace(
        n=n, A=exact(np.diag(rates)), C=[], L=[[]] * n, f=zeros, V=[], events=list(events),
        sensors=[], counted=[], spacing=Fraction(0),
    )  # fmt: skip


WIDENS = [[2.0, 0.0], [0.0, 2.0]]


@pytest.mark.parametrize("rates", [(-1, -1), (0.01, -1), (-1, 0.01), (-1, 0)])
def test_the_width_falls_by_itself_where_events_stay_away(
    rates: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever a graph of the instants at events proves."""
    monkeypatch.setattr(check, "prove_graph", lambda *values: None)
    monkeypatch.setattr(check, "Marks", lambda *values: None)
    monkeypatch.setattr(check, "Graph", lambda *values: SimpleNamespace(nodes=[[]]))
    finite, endless = event("a", WIDENS), event("b", WIDENS, (1, INF))
    falls, evidence = max(rates) < 0, {"tube": [[1.0, 1.0]], "cells": 1}
    for events, proved in (
        ([endless], falls), ([endless, endless], falls), ([finite], True), ([finite, endless], True),
        ([endless, finite], True), ([endless, event("c", UNIT)], falls),
    ):  # fmt: skip
        plant = plant_of(rates, *events)
        assert refused(check.prove_stability, plant, evidence) != proved


def test_graphs_of_two_kinds_and_a_bound_for_each_node(monkeypatch: pytest.MonkeyPatch) -> None:
    made, met = [], []

    def graph(system: Any, marks: Any) -> Any:
        made.append(marks)
        return SimpleNamespace(nodes=[[]] * (2 if marks[1] == 1 else 3))

    monkeypatch.setattr(check, "prove_graph", lambda s, own, tube: met.append(len(own.nodes)))
    monkeypatch.setattr(check, "Marks", lambda system, cells, beyond: (cells, beyond))
    monkeypatch.setattr(check, "Graph", graph)
    plant = plant_of((-1, -1), event("a", WIDENS))
    for rows, cells, proved in (
        (2, 4, True), (3, 4, True), (1, 4, False), (4, 4, False), (2, 0, False), (3, 0, False),
        (2, -1, False), (2, True, False), (2, 1.0, False), (2, 10**4, False),
    ):  # fmt: skip
        evidence = {"tube": [[1.0, 1.0]] * rows, "cells": cells}
        assert refused(check.prove_stability, plant, evidence) != proved
    assert made[:2] == [(4, 1), (4, 4)]
    assert met == [2, 3]


def test_bounds_have_a_sign() -> None:
    """A bound below zero falls where the flow grows."""
    for rates, v, proved in (
        ((-1, -1), [1, 1], True), ((1, 1), [-1, -1], False), ((-1, 1), [1, -1], False),
        ((1, 1), [-0.5, -0.5], False), ((-1, -1), [1, 0], False),
    ):  # fmt: skip
        evidence = {"tube": [list(map(float, v))], "cells": 1}
        assert refused(check.prove_stability, plant_of(rates), evidence) != proved


def test_widths_are_at_least_their_tube(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(check, "prove_still", lambda *values: None)
    for v, always, proved in (
        ([1, 1], [2, 1], True), ([1, 1], [2, 0.5], False), ([1, 1], [0.5, 2], False),
        ([0, 1], [1, 1], False), ([-0.5, 1], [1, 1], False), ([1, 0], [1, 1], False),
    ):  # fmt: skip
        evidence = {"tube": [v], "always": always}
        plant = plant_of((-1, -1))
        assert refused(check.prove_width, plant, evidence) != proved
        if proved:
            assert check.prove_width(plant, evidence).endswith("at most (2.0, 1.0)")


def test_inputs_count_in_widths() -> None:
    plant = plant_of((-1, -1))
    for f, proved in ((0.5, True), (1.5, False)):
        plant.f = fractions([f, 0])
        evidence = {"tube": [[1.0, 1.0]], "always": [1.0, 1.0], "cells": 1}
        assert refused(check.prove_width, plant, evidence) != proved
        check.prove_stability(plant, evidence)


@pytest.mark.parametrize(("every", "cells", "count"), [((0.1, 0.1), 1, 10), ((0, 0.01), 2, 2)])
def test_ages_of_samples_grow_from_mark_to_mark(every: Any, cells: int, count: int) -> None:
    """Events in quick succession, a sample somewhere in each second: all ages up to 1 at them."""
    system = maps_of([event("a", WIDENS, every)], [sensor("s", 0)])
    system.design.spacing, system.design.counted = Fraction(0), [0]
    graph = check.Graph(system, check.Marks(system, cells, 1))
    assert len(graph.cells[0]) == count
    assert graph.aged == {0: {(0, i) for i in range(count)}}
