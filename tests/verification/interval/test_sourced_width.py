"""Uncertain plants whose state has no known bounds: stability and widths by what enters."""

from __future__ import annotations

import copy
import math
from typing import Any

import numpy as np
import pytest

import obsdesign
from lmi.arithmetic.balls import exact, inverse
from lmi.decide.stability import decide
from obsdesign.analysis.nominal import nominal_problem
from obsdesign.document import Claim
from obsdesign.equations.interval.certain_bounds import without_effects
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.equations.interval.sourced_width import SourcedWidth, sourced_width
from obsdesign.equations.parameters import NormalForm
from obsdesign.errors import DoesNotApply
from obsdesign.problem.problem import Problem
from obsdesign.runtime import Sample, from_design
from obsdesign.synthesis.interval.signal_sizes import SignalSizes
from obsdesign.synthesis.tube import proved_width
from obsdesign.workflow import investigate, verify
from tests.systems.parameters import Body, compartments, degue, rooms, spring


def _boundless(body: Body) -> Body:
    return {key: own for key, own in body.items() if key != "state"}


def _claims(outcome: obsdesign.Outcome) -> dict[str, Claim]:
    return {claim.id: claim for claim in outcome.claims}


def _sourced(body: Body) -> tuple[SourcedWidth, tuple[float, float]]:
    """The systems of a design that knows a box of the state, without that box."""
    problem = Problem.from_dict(body)
    gains = IntervalGains.from_document(obsdesign.design(problem).gains)
    form = NormalForm.from_plant(problem.plant, exact)
    return sourced_width(without_effects(gains), form, exact, inverse), gains.dwell_ends


def _after_jumps(body: Body, y: float) -> Any:
    """Half the proved widths after jumps where |y| is at most so much."""
    width, ends = _sourced(body)
    tubes = {
        source: proved_width(each, *ends, vanishing=True) for source, each in width.systems.items()
    }
    constant, of_y = (np.array(tubes[source]["after_jump"]) for source in ("constant", "y1"))  # type: ignore[index]
    return (constant + y * of_y)[len(constant) // 2 :] / 2


@pytest.mark.parametrize("share", [0.1])
def test_shortest_dwell_time_of_example_4_1(share: float) -> None:
    """ln(2 + 2 e) / (1 - e) for entries known up to e: no box holds x there by itself."""
    limit = math.log(2 + 2 * share) / (1 - share)
    claims = [
        _claims(investigate(Problem.from_dict(degue(share, (factor * limit,) * 2))))
        for factor in (0.999, 1.001)
    ]
    assert all("state_box" not in each for each in claims)
    below, above = (each["dwell_stability"] for each in claims)
    assert above.verdict == "proved"
    # other gains on the measured part might do, which the problem does not state
    assert below.verdict == "undecided"
    assert below.evidence["these_gains"]["witness"]["spectral_radius"] > 1


def test_known_widths() -> None:
    np.testing.assert_allclose(_after_jumps(spring(), 1.2), [0.01, 1.2998], rtol=1e-3)
    np.testing.assert_allclose(_after_jumps(compartments(), 8.3), [12.3, 8.781], rtol=1e-3)
    sensor = degue(0.0, (2, 5))
    del sensor["flow"]["A_radius"], sensor["jump"]["G_radius"]
    sensor["output"]["C_radius"] = [[0, 0.05]]
    np.testing.assert_allclose(_after_jumps(sensor, 1.5), [0.7433, 0.7079], rtol=1e-3)


@pytest.mark.parametrize(("gains", "verdict"), [(None, "proved"), ((1, 0, 0.5, 0), "refuted")])
def test_gains_decide_for_two_rooms(gains: Any, verdict: str) -> None:
    body = rooms()
    if gains is not None:
        body["observer"]["gains"] = {"L": [[gains[0]], [gains[1]]], "M": [[gains[2]], [gains[3]]]}
    width, (low, high) = _sourced(body)
    assert width.N is not None
    assert decide(width.W, width.N, low, high).outcome == verdict


@pytest.fixture(scope="module")
def growing() -> obsdesign.Design:
    """A plant that grows without end, at an uncertain rate; its first state is measured."""
    return obsdesign.design(Problem.from_dict({
        "flow": {"A": [[0.2, 0], [1, -1]], "B": [[0], [1]],
                 "disturbance": {"lower": [-0.1, 0], "upper": [0.1, 0]}},
        "output": {"C": [[1, 0]], "noise_bound": [0.1]},
        "parameter": [{"name": "growth", "range": [-0.1, 0.1], "A": [[1, 0], [0, 0.5]]},
                      {"name": "thrust", "range": [-0.2, 0.2], "B": [[0], [1]]}],
        "observer": {"kind": "interval", "gains": {"L": [[3], [0]]}},
    }))  # fmt: skip


def test_bounds_follow_a_state_that_grows(growing: obsdesign.Design) -> None:
    """It grows to e^5 and more: bounds hold it, within the width for the largest y and u."""
    evidence = {claim.id: claim.evidence for claim in growing.claims}["source_width"]
    assert set(evidence) == {"constant", "y1", "u1"}
    observer, x = from_design(growing), np.array([1.0, 0.0])
    state = observer.init(0.0, lower=[0.9, -0.1], upper=[1.1, 0.1])
    largest, u = 0.0, np.array([2.0])
    state, _ = observer.step(state, Sample(0.0, None, u))
    for k in range(2000):
        p = 0.1 * np.sign(np.sin(0.1 * k))
        for _ in range(10):
            x = x + 0.001 * np.array([(0.2 + p) * x[0] + 0.1, x[0] + (0.5 * p - 1) * x[1] + u[0]])
        y = x[:1] + 0.1 * np.sin(k)
        largest = max(largest, float(np.abs(y)[0]))
        state, estimate = observer.step(state, Sample(0.01 * (k + 1), y, u))
        assert estimate.status == "ok"
        assert (estimate.lower <= x + 1e-9).all()
        assert (estimate.upper >= x - 1e-9).all()
        limit = sum(
            factor * np.array(evidence[source]["always"])
            for source, factor in (("constant", 1.0), ("y1", largest), ("u1", 2.0))
        )
        assert (estimate.upper - estimate.lower <= 1.02 * limit[2:] + 1e-6).all() or k < 500
    assert x[0] > 10


def test_guarantees_speak_of_no_box(growing: obsdesign.Design) -> None:
    texts = [entry.statement for entry in growing.guarantees]
    assert all(
        text.startswith("Assumed: growth in [-0.1, 0.1], thrust in [-0.2, 0.2]. ") for text in texts
    )
    assert any("stays bounded as long as y, u and w do" in text for text in texts)
    assert any("|y1|" in text and "|u1|" in text for text in texts)
    assert verify(growing).verdict == "proved"


def test_a_narrower_tube_is_not_proved(growing: obsdesign.Design) -> None:
    claims = []
    for claim in growing.claims:
        evidence: Any = copy.deepcopy(claim.evidence)
        if claim.id == "source_width":
            evidence["y1"]["tube"] = (0.9 * np.array(evidence["y1"]["tube"])).tolist()
        claims.append(Claim(**{**vars(claim), "evidence": evidence}))
    outcome = verify(obsdesign.Design(**{**vars(growing), "claims": tuple(claims)}))
    assert outcome.verdict != "proved"


def test_periodic_samples_need_a_box() -> None:
    body = _boundless(rooms())
    body["flow"]["A"] = [[0.1, 0], [0, 0.05]]
    body["output"] |= {"measured": "periodic", "period": 0.5}
    body["observer"] = {"kind": "interval"}
    with pytest.raises(DoesNotApply, match=r"\[state\], bounds of x, is required by kind"):
        investigate(Problem.from_dict(body))


def _claimed(body: Body, Y: float) -> float:
    """Sum of the widths that are claimed where |y| is at most Y."""
    evidence = _claims(investigate(Problem.from_dict(body)))["source_width"].evidence
    sizes = {"constant": 1.0, "y1": Y}
    return sum(size * sum(evidence[source]["always"][2:]) for source, size in sizes.items())


@pytest.mark.parametrize(
    ("body", "form", "share"),
    [(rooms(), "split", 0.25)],
)
def test_open_gains_are_chosen_for_the_width_under_parameters(
    body: Body, form: str, share: float
) -> None:
    """Narrower than with the gains that a form has for the nominal plant."""
    body = _boundless(body)
    nominal = {key: own for key, own in body.items() if key != "parameter"}
    nominal["observer"] = {"kind": "interval", "form": form}
    nominal["output"] = {key: own for key, own in body["output"].items() if key != "C_radius"}
    mean = [sum(parameter["range"]) / 2 * np.array(parameter[key])
            for parameter in body["parameter"] for key in ("A",) if key in parameter]  # fmt: skip
    nominal["flow"] = {**body["flow"], "A": (np.array(body["flow"]["A"]) + sum(mean)).tolist()}
    gains = obsdesign.design(Problem.from_dict(nominal)).gains
    kept = {name: np.array(gains[name]).tolist() for name in ("L", "M", "S") if name in gains}
    given = {**body, "observer": {"kind": "interval", "form": form, "gains": kept}}
    free = {**body, "observer": {"kind": "interval"}}
    problem = Problem.from_dict(free)
    (Y,) = SignalSizes.from_problem(problem, nominal_problem(problem)).y
    assert _claimed(free, Y) < share * _claimed(given, Y)
