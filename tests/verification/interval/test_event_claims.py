"""Widths of interval observers for several clocks: published cases, twins, forged designs."""

from __future__ import annotations

import copy
import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import obsdesign
from lmi.find.graph_tube import input_sizes, proposed_tubes
from obsdesign.analysis.interval.event_graph import width_graph
from obsdesign.data.simulation import simulate
from obsdesign.document import Claim
from obsdesign.problem.problem import Problem
from obsdesign.runtime import Sample, from_design
from obsdesign.runtime.base import rows_of
from tests.systems.designs import designed, investigated
from tests.systems.event_widths import (
    doses,
    is_stable,
    motor,
    oral_doses,
    positioning,
    shortest,
    system_of,
    two_states,
)


def claims_of(body: dict[str, Any]) -> dict[str, Claim]:
    return {c.id: c for c in investigated(body).claims}


@pytest.mark.parametrize("gap", [0.05, 0.2, 0.5])
def test_the_shortest_time_between_jumps_is_the_limit(gap: float) -> None:
    """Stable from the limit on, where a sample comes as late as it may; below it not proved."""
    low = shortest(gap)
    assert is_stable(two_states((1.001 * low, 1.5 * low), gap), 1)
    for cells in (1, 8):
        assert not is_stable(two_states((low - 1e-4, 1.5 * low), gap), cells)


def test_below_the_limit_both_claims_are_undecided() -> None:
    low = shortest(0.5)
    claims = claims_of(two_states((low - 1e-4, 1.5 * low), 0.5))
    for name in ("event_stability", "event_width"):
        assert claims[name].verdict == "undecided"
        assert "no tube was found" in claims[name].evidence["reason"]


@pytest.mark.parametrize(("every", "gap", "simulated", "published"), [
    ((2, 3), 0.5, (1.5742, 1.5928), (1.6410, 1.6839)),
    ((1, 1.5), 0.2, (4.6119, 3.5204), (5.2799, 4.0528)),
])  # fmt: skip
def test_widths_after_a_jump_are_between_simulated_and_published_ones(
    every: tuple[float, float], gap: float, simulated: Any, published: Any
) -> None:
    width = claims_of(two_states(every, gap))["event_width"]
    assert width.verdict == "proved"
    after = np.array(width.evidence["after"]["hit"])
    assert (np.array(simulated) <= after).all()
    assert (after <= np.array(published)).all()


@pytest.mark.parametrize(("body", "simulated", "most"), [
    (motor(0.01, 0.05), (0.01044, 0.04395, 0.10042), (0.01066, 0.04425, 0.1005)),
    (motor(0.03, 0.15), (0.01141, 0.0478, 0.10045), (0.01167, 0.04791, 0.1006)),
    (motor(0.1, 0.5), (0.0150, 0.0499, 0.1005), (0.0160, 0.0500, 0.1006)),
    (positioning(0.3, 5), (2.73, 0.19, 0.199), (2.97, 0.22, 0.201)),
    (positioning(0.3, 20), (0, 0.19, 0.199), (5.82, 0.22, 0.201)),
])  # fmt: skip
def test_widths_of_two_sensors_without_events(
    body: dict[str, Any], simulated: Any, most: Any
) -> None:
    width = claims_of(body)["event_width"]
    assert width.verdict == "proved"
    always = np.array(width.evidence["always"])
    assert (np.array(simulated) <= always).all()
    assert (always <= np.array(most)).all()


def widths_of_a_tube(body: dict[str, Any], cells: int) -> Any:
    """The largest widths of the first tube that floats propose, not proved."""
    system = system_of(body)
    nodes = width_graph(system, cells)
    assert nodes is not None
    tube = next(proposed_tubes(nodes.graph, 1e-7 * input_sizes(nodes.graph)))
    return tube[list(nodes.always)].max(axis=0)


@pytest.mark.parametrize(("gap", "cells", "simulated", "most"), [
    (2, 8, (6.2, 4.88), (7.061, 6.216)),
])  # fmt: skip
def test_widths_of_ticks(gap: float, cells: int, simulated: Any, most: Any) -> None:
    always = widths_of_a_tube(oral_doses(gap), cells)[4:]
    assert (np.array(simulated) <= always).all()
    assert (always <= np.array(most)).all()


# a rise and fall between samples in which 16 cells had longer ticks than 8, of other lengths
DRAINED: dict[str, Any] = {
    "flow": {
        "A": [[-0.96, 0.18], [0.67, -0.6]],
        "disturbance": {"lower": [-0.01, -0.01], "upper": [0.01, 0.01]},
    },
    "event": [
        {"name": "drain", "G": [[0.72, -0.09], [0.24, 0.7]], "every": [1.573, 2.084],
         "disturbance": {"lower": [-1, -1], "upper": [1, 1]}},
    ],
    "sensor": [{"name": "s", "C": [[1, 0]], "noise_bound": 0.01, "every": [0, 0.7265]}],
    "observer": {"kind": "interval"},
}  # fmt: skip


# events that widen as much as samples narrow: the fixed point takes more than 25 rounds
WIDENED: dict[str, Any] = {
    "flow": {
        "A": [[-0.778, 0.503, 0.328], [0.368, -2.14, 0.222], [-0.675, 0.894, -1.03]],
        "disturbance": {"lower": [-0.723, -0.825, -0.316], "upper": [0.723, 0.825, 0.316]},
    },
    "event": [
        {"name": "e", "every": [1.14, 1.24],
         "G": [[1.56, 0.00247, 0.0322], [-0.267, 1.28, 0.175], [0.163, 0.0613, 1.33]],
         "disturbance": {"lower": [-1, -1, -1], "upper": [1, 1, 1]}},
    ],
    "sensor": [{"name": "s", "C": [[0, 0, 1]], "noise_bound": 0.01, "every": [0, 1.01]}],
    "observer": {"kind": "interval"},
}  # fmt: skip


@pytest.mark.parametrize(("body", "cells"), [
    (DRAINED, (4, 8)), (doses(2), (2, 4)), (two_states((2, 3), 0.37), (2, 4)),
    (two_states((1, 1.5), 0.2), (4, 8)),
])  # fmt: skip
def test_more_cells_never_give_the_wider_width(body: dict[str, Any], cells: Any) -> None:
    """Ticks are there for all of them, and those of more cells divide those of fewer."""
    widths = [widths_of_a_tube(body, count) for count in cells]
    for coarse, fine in itertools.pairwise(widths):
        assert (fine <= coarse * (1 + 1e-4)).all()


@pytest.mark.parametrize("body", [two_states((2, 3), 0.5), doses(2), motor(0.03, 0.15)])
def test_bounds_that_run_are_as_narrow_as_claimed(body: dict[str, Any]) -> None:
    """Whatever the clocks do inside what is stated: random times, ends of ranges, lost samples."""
    design = designed(body)
    evidence = next(c.evidence for c in design.claims if c.id == "event_width")
    always, observer = np.array(evidence["always"]), from_design(design)
    n, until = len(always), 12.0 if body["name"] == "motor" else 60.0
    run = simulate(
        Problem.from_dict(body).plant, until=until, disturbance="random",
        rng=np.random.default_rng(0),
    )  # fmt: skip
    rows = list(rows_of(run.t, run.block("y"), w=run.block("w"), jump=run.happened))
    start: Any = {"lower": -np.ones(n), "upper": np.ones(n)}
    state = observer.init(rows[0].t, **start)  # type: ignore[attr-defined]
    listed = list(observer.run(state, rows))[2 * len(rows) // 3 :]
    widths = np.array([one.upper - one.lower for one in listed])  # type: ignore[operator]
    assert (widths <= always * (1 + 1e-9)).all()
    assert {one.status for one in listed} == {"ok"}


def test_a_sensor_of_any_time_is_not_counted_on() -> None:
    body = positioning(0.3, 5)
    body["sensor"][1]["every"] = [0, "inf"]
    for claim in ("event_stability", "event_width"):
        reason = claims_of(body)[claim].evidence["reason"]
        assert "sensor gps may be silent for any time, and is not counted on" in reason


def test_an_event_that_may_stay_away_needs_a_flow_that_decays() -> None:
    body = two_states((1, 2), 0.2)
    body["event"][0]["every"] = [1, "inf"]
    assert claims_of(body)["event_width"].verdict == "proved"
    body["flow"]["A"] = [[0, 0], [1, -2]]
    reason = claims_of(body)["event_stability"].evidence["reason"]
    assert "no longest time of hit is stated" in reason


def test_a_sensor_that_is_read_at_the_event_is_part_of_it() -> None:
    """At every jump: stable where no sample of its own is; twin: without it not."""
    body = two_states((1.05, 1.2), 5.0)
    assert not is_stable(body, 1)
    for sees in ("before", "after"):
        more = copy.deepcopy(body)
        more["sensor"].append({"name": "at_hit", "C": [[0, 1]], "noise_bound": 0.03, "at": "hit"})
        more["sensor"][1]["sees"] = sees
        assert is_stable(more, 1)


@pytest.mark.parametrize("kept", [1.0, 0.5])
def test_an_event_ahead_of_another_takes_its_gain_away(kept: float) -> None:
    """A gain acts at the first event of a row: widths grow there; twin: events never share one."""
    body: dict[str, Any] = {
        "flow": {"A": [[-0.1, 0], [0, -0.1]]},
        "event": [
            {"name": "dose", "G": (kept * np.eye(2)).tolist(), "every": [0.5, 1]},
            {"name": "hit", "G": [[3, 3], [3, 3]], "every": [0.5, 1]},
        ],
        "sensor": [{"name": "y", "C": [[1, 1]], "noise_bound": 0.01, "at": "hit"}],
        "observer": {"kind": "interval"},
    }
    outcome = investigated(body)
    assert outcome.design is not None
    assert claims_of(body)["event_stability"].verdict == "undecided"
    apart = {**body, "timing": {"spacing": 0.1}}
    assert claims_of(apart)["event_stability"].verdict == "proved"
    observer: Any = from_design(outcome.design)
    widths = []
    for events in ((0, 1), (1,)):
        state = observer.init(0.0, lower=[-1, -1], upper=[1, 1])
        for k in range(1, 8):
            y = [0.0] if 1 in events else None
            state, estimate = observer.step(state, Sample(0.7 * k, y, events=events))
        widths.append(float((estimate.upper - estimate.lower).max()))
    assert widths[0] > 10
    assert widths[1] < 0.1


def test_two_sensors_together_do_what_none_does_alone() -> None:
    """Both orders of the last samples; twins: each of them alone, and gaps that are too long."""
    body: dict[str, Any] = {
        "flow": {"A": [[-0.5, 0.3, 0], [0.2, -0.4, 0.3], [0.1, 0, -0.3]]},
        "event": [{"name": "hit", "G": (3 * np.eye(3)).tolist(), "every": [1.2, 2]}],
        "sensor": [
            {"name": "a", "C": [[1, 0, 0]], "noise_bound": 0.1, "every": [0, 0.1]},
            {"name": "b", "C": [[0, 1, 0]], "noise_bound": 0.1, "every": [0, 0.3]},
            {"name": "c", "C": [[0, 0, 1]], "noise_bound": 0.1, "at": "hit"},
        ],
        "observer": {"kind": "interval"},
    }
    assert is_stable(body, 2)
    for place in (0, 1):
        alone = copy.deepcopy(body)
        del alone["sensor"][place]
        assert not is_stable(alone, 4)


@pytest.mark.parametrize("body", [two_states((2, 3), 0.5), motor(0.03, 0.15)])
@pytest.mark.parametrize("name", ["event_stability", "event_width"])
def test_a_forged_tube_is_not_believed(body: dict[str, Any], name: str) -> None:
    design = designed(body)
    assert obsdesign.verify(design).verdict == "proved"
    claim = next(c for c in design.claims if c.id == name)
    tube = np.array(claim.evidence["tube"])
    smaller = np.where(np.arange(tube.size).reshape(tube.shape) == 1, 1e-6 * tube, tube)
    forgeries: list[dict[str, Any]] = [
        {"tube": smaller.tolist()}, {"tube": (-tube).tolist()}, {"tube": tube.tolist()[:-1]},
        {"tube": [["x"]]}, {"cells": 10**6}, {"cells": True},
    ]  # fmt: skip
    if "always" in claim.evidence:
        forgeries.append({"always": (0.99 * np.array(claim.evidence["always"])).tolist()})
    for forged in forgeries:
        changed = replace(claim, evidence={**claim.evidence, **forged})
        claims = tuple(changed if c.id == name else c for c in design.claims)
        assert obsdesign.verify(replace(design, claims=claims)).verdict != "proved", forged


def test_a_tube_of_other_clocks_is_not_believed() -> None:
    """The graph is made from the problem: a tube for samples twice as often proves nothing."""
    good, bad = (designed(motor(gap, 0.15), allow_undecided=True)
                 for gap in (0.015, 0.03))  # fmt: skip
    assert obsdesign.verify(replace(bad, claims=good.claims)).verdict != "proved"


@pytest.mark.parametrize("every", [(1.3, 1.3), (1.3, "inf")])
def test_widths_are_proved_for_ranges_of_all_lengths(every: tuple[float, Any]) -> None:
    """A longer range never has the smaller width."""
    width = claims_of(two_states(every, 0.2))["event_width"]
    assert width.verdict == "proved"
    assert (np.array(width.evidence["always"]) >= (2.43, 2.05)).all()
    assert (np.array(width.evidence["always"]) <= (2.45, 2.08)).all()
