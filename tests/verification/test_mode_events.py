"""Events within modes: widths that no path exceeds, and claims that are not proved."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lmi.verdict import overall
from obsdesign.document import Claim
from obsdesign.equations.clocks import events_of
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.equations.modes import SwitchedGains
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem
from obsdesign.studies.search.search import search
from obsdesign.verification.interval.mode_width import width_claim
from obsdesign.verification.interval.modes import mode_system
from obsdesign.workflow import Outcome, design, investigate, verify
from tests.systems.designs import designed, investigated
from tests.systems.mode_paths import largest_widths
from tests.systems.switched import random_strokes, valve

Body = dict[str, Any]


def claim_of(outcome: Outcome, name: str) -> Claim:
    (claim,) = (claim for claim in outcome.claims if claim.id == name)
    return claim


def strokes(**entries: object) -> Problem:
    """The valve with other entries of its stroke."""
    body = valve(strokes=True).to_dict()
    body["event"][0].update(entries)
    return Problem.from_dict(body)


def widths(problem: Problem) -> dict[str, np.ndarray[Any, Any]]:
    evidence = claim_of(investigate(problem), "mode_width").evidence
    return {name: np.array(evidence[name]) for name in ("entry", "always")}


def test_no_path_exceeds_the_widths_of_the_valve_and_its_strokes() -> None:
    outcome = investigated(valve(strokes=True).to_dict())
    assert outcome.verdict == "proved"
    assert outcome.design is not None
    gains = SwitchedGains.from_document(outcome.design.gains, IntervalGains)
    evidence = claim_of(outcome, "mode_width").evidence
    for seed in range(3):
        largest = largest_widths(gains, 600, np.random.default_rng(seed))
        for (what, name), width in largest.items():
            proved = np.array(evidence[what][gains.names.index(name)])
            assert (width < proved).all()
            assert (proved < 1.35 * width).all()
    assert verify(outcome.design, paranoid=True).verdict == "proved"


@pytest.mark.parametrize("seed", [5])
def test_no_path_exceeds_the_widths_of_random_plants(seed: int) -> None:
    rng = np.random.default_rng(seed)
    outcome = investigate(random_strokes(rng, "interval"))
    assert outcome.design is not None
    gains = SwitchedGains.from_document(outcome.design.gains, IntervalGains)
    evidence = claim_of(outcome, "mode_width").evidence
    for (what, name), width in largest_widths(gains, 300, rng).items():
        proved = evidence[what][gains.names.index(name)]
        assert proved is None or (width < np.array(proved)).all()


def first_tank(**entries: object) -> Problem:
    """The first tank of the valve alone, without a correction; entries: of its stroke."""
    box = {"lower": [-0.01], "upper": [0.01]}
    modes = [
        {"name": "open", "A": [[-0.6]], "every": [2, 10], "gains": {"L": [[0]]}},
        {"name": "closed", "A": [[0.05]], "every": [1, 10], "gains": {"L": [[0]]}},
    ]
    stroke = {"name": "stroke", "every": [5, "inf"], "modes": ["open"]}
    stroke |= {"disturbance": {"lower": [-0.01], "upper": [0.01]}, **entries}
    level = {"name": "level", "C": [[1]], "noise_bound": 0.01, "every": "continuous"}
    return Problem(
        {"disturbance": box}, event=[stroke], sensor=[level], mode=modes,
        observer={"kind": "interval"},
    )  # fmt: skip


def test_rarer_and_fewer_strokes_never_widen() -> None:
    stated, still = widths(first_tank()), {"lower": [0.1], "upper": [0.1]}
    for narrower in (first_tank(every=[8, "inf"]), first_tank(disturbance=still)):
        for name, own in widths(narrower).items():
            assert (own <= stated[name] * (1 + 1e-3)).all()
    for name, own in widths(first_tank(modes=["closed", "open"])).items():
        assert (own >= stated[name]).all()
        assert own[1, 0] > 1.02 * stated[name][1, 0]  # strokes while closed too


def altered(change: Callable[[Body, Body], object]) -> str:
    """The verdict on the plant's claims in a design with changed gains or problem."""
    own = designed(valve(strokes=True).to_dict())
    gains, problem = copy.deepcopy(dict(own.gains)), copy.deepcopy(dict(own.problem))
    change(gains, problem)
    claims = verify(replace(own, gains=gains, problem=problem)).claims
    return overall(claim.verdict for claim in claims if claim.id != "document")


def of_both(**entries: object) -> Callable[[Body, Body], object]:
    """The same change of the event in gains and problem; "every" is dwell_time in gains."""

    def change(gains: Body, problem: Body) -> None:
        problem["event"][0].update(entries)
        listed = events_of(Problem.from_dict(problem).plant)
        gains["events"] = [event.to_document() for event in listed]

    return change


def test_a_tube_for_kinder_events_proves_nothing() -> None:
    assert altered(lambda gains, problem: None) == "proved"
    assert altered(of_both(every=[1, "inf"])) == "undecided"
    larger = {"lower": [0.05, 0], "upper": [0.15, 0]}
    assert altered(of_both(disturbance=larger)) == "undecided"
    assert altered(of_both(modes=["open", "closed"])) == "undecided"
    assert altered(of_both(G=[[1.5, 0], [0, 1]])) == "undecided"


def test_gains_of_other_events_are_refuted() -> None:
    def rarer(gains: Body, problem: Body) -> None:
        gains["events"][0]["dwell_time"] = np.array([6.0, np.inf])

    def everywhere(gains: Body, problem: Body) -> None:
        del gains["events"][0]["modes"]

    def silent(gains: Body, problem: Body) -> None:
        del gains["events"]

    def twice(gains: Body, problem: Body) -> None:
        gains["events"] = [*gains["events"], *gains["events"]]

    for change in (rarer, everywhere, silent, twice):
        assert altered(change) == "refuted"


def test_maps_that_widen_need_a_tube_of_their_own() -> None:
    for growth, verdict in ((1.2, "proved"), (3.0, "undecided")):
        outcome = investigate(strokes(G=[[growth, 0.1], [0, 1]]))
        claim = claim_of(outcome, "mode_stability")
        assert claim.verdict == verdict
        assert ("tube" in claim.evidence) == (verdict == "proved")
        if outcome.design is not None:
            assert verify(outcome.design).verdict == verdict


def test_stays_refute_only_where_events_may_stay_away() -> None:
    body = valve(longest_closed=24.01, strokes=True).to_dict()
    assert investigate(Problem.from_dict(body)).verdict == "refuted"
    body["event"][0] |= {"G": [[0.1, 0], [0, 1]], "every": [5, 6]}
    claim = claim_of(investigate(Problem.from_dict(body)), "mode_stability")
    assert claim.verdict == "undecided"
    assert "stroke must happen" in claim.evidence["reason"]


def test_point_observers_do_not_see_strokes() -> None:
    assert investigate(valve(kind="luenberger", strokes=True)).verdict == "proved"
    body = valve(kind="luenberger", strokes=True).to_dict()
    body["event"][0]["G"] = [[2, 0], [0, 1]]
    with pytest.raises(InputError, match=r"stroke\.G must be the identity for kind 'luenberger'"):
        investigate(Problem.from_dict(body))


def test_searches_keep_events_that_leave_the_error_as_it_is() -> None:
    problem = valve(strokes=True)
    outcome = search(problem, "longest_dwell", of="closed", accuracy=1e-3)
    assert outcome.verdict == "proved"
    assert 23.9 < outcome.result["proved"] < 24
    with pytest.raises(InputError, match=r"stroke\.G other than the identity"):
        search(strokes(G=[[1.1, 0], [0, 1]]), "longest_dwell")


# three states, two events, stays without end
LASTING: Body = {
    "flow": {"disturbance": {"lower": [-0.01, -0.01, 0], "upper": [0.01, 0.01, 0.02]}},
    "mode": [
        {"name": "a", "A": [[-0.6, 0.1, 0], [0.5, -0.4, 0.1], [0, 0.2, -0.5]], "every": [2, "inf"]},
        {"name": "b", "A": [[-1, 0, 0.3], [0, -0.7, 0], [0.1, 0, -0.9]], "every": [1, "inf"]},
    ],
    "event": [
        {
            "name": "p", "every": [5, "inf"],
            "disturbance": {"lower": [0.09, 0, 0], "upper": [0.11, 0, 0]},
        },
        {
            "name": "q", "every": [4, "inf"], "G": [[1, 0, 0], [0, 1, 0.2], [0, 0, 1]],
            "disturbance": {"lower": [0, 0, -0.1], "upper": [0, 0, 0.1]},
        },
    ],
    "sensor": [{"name": "y", "C": [[0, 1, 0]], "noise_bound": 0.01, "every": "continuous"}],
    "observer": {"kind": "interval"},
}  # fmt: skip


def lower_tube(outcome: Outcome) -> str:
    """The verdict on a tube that is lower than the one that is proved."""
    assert outcome.design is not None
    system = mode_system(SwitchedGains.from_document(outcome.design.gains, IntervalGains))
    evidence = claim_of(outcome, "mode_width").evidence
    tube = (0.9 * np.array(evidence["tube"])).tolist()
    (claim,) = width_claim(system, {"parts": evidence["parts"], "tube": tube})
    return claim.verdict


def test_a_lower_tube_is_not_proved() -> None:
    assert lower_tube(investigated(valve(strokes=True).to_dict())) == "undecided"


def test_a_width_that_is_not_proved_is_a_warning() -> None:
    """Five events leave no graph that is searched; one does, and there is no warning."""
    body = valve(strokes=True).to_dict()
    assert not designed(body).warnings
    (stroke,) = body["event"]
    body["event"] = [{**stroke, "name": f"stroke_{k}"} for k in range(5)]
    without = design(Problem.from_dict(body))
    assert without.claims[-1].id == "mode_stability"
    assert "No width of the bounds is proved" in str(without.warnings)


def test_a_search_of_them_ends_in_its_time() -> None:
    start = time.process_time()
    outcome = investigate(Problem.from_dict(LASTING), seconds=0.3)
    assert time.process_time() - start < 2.0
    assert claim_of(outcome, "mode_stability").evidence["ended_by"] == "time"
