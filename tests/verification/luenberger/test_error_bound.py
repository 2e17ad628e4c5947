"""Bounds of the error of uncertain plants: their numbers, their certificates, and simulations."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from lmi.find.peak_to_peak import DisturbedOutput, peak_gain
from obsdesign.data.simulation import simulate
from obsdesign.design_file import from_dict
from obsdesign.document import Claim, Design, digest
from obsdesign.problem.problem import Problem
from obsdesign.runtime import Sample, from_design
from obsdesign.runtime.known_inputs import LARGE_U, LARGE_W
from obsdesign.runtime.luenberger.observer import LuenbergerObserver
from obsdesign.workflow import Outcome, verify
from tests.systems.designs import designed, investigated
from tests.systems.parameters import Body


def spring(L: tuple[float, float] | None = None, **entries: Any) -> Body:
    """Spring and damper with stiffness 1 +- 0.2 and a position of at most 1.2."""
    body: Body = {
        "flow": {
            "A": [[0, 1], [0, -0.4]],
            "disturbance": {"lower": [0, -0.05], "upper": [0, 0.05]},
        },
        "output": {"C": [[1, 0]], "noise_bound": [0.01]},
        "parameter": [{"name": "stiffness", "range": [0.8, 1.2], "A": [[0, 0], [-1, 0]]}],
        "state": {"lower": [-1.2, -3], "upper": [1.2, 3]},
        "observer": {"kind": "luenberger"},
    }
    body = copy.deepcopy(body) | copy.deepcopy(entries)
    if L is not None:
        body["observer"]["gains"] = {"L": [[value] for value in L]}
    return body


def kicked(**entries: Any) -> Body:
    """The same, kicked every 2 to 6 time units."""
    jump = {
        "G": [[1, 0], [0, 1]],
        "dwell_time": [2, 6],
        "disturbance": {"lower": [0, -0.3], "upper": [0, 0.3]},
    }
    return spring(jump=jump, **entries)


KICKED = kicked(observer={"kind": "luenberger", "gains": {"L": [[7], [20]], "M": [[0.5], [0.3]]}})


def warmed() -> Body:
    """A single state with an uncertain rate, warmed every 1 to 2 time units."""
    return {
        "flow": {"A": [[-0.2]], "disturbance": {"lower": [-0.05], "upper": [0.05]}},
        "jump": {"G": [[1]], "dwell_time": [1, 2],
                 "disturbance": {"lower": [-0.3], "upper": [0.3]}},
        "output": {"C": [[1]], "noise_bound": [0.01]},
        "parameter": [{"name": "rate", "range": [-0.1, 0.1], "A": [[1]]}],
        "state": {"lower": [-3], "upper": [3]},
        "observer": {"kind": "luenberger", "gains": {"M": [[0]]}},
    }  # fmt: skip


def bound(result: Outcome) -> Claim:
    return next(claim for claim in result.claims if claim.id == "error_bound")


def stored(body: Body) -> Design:
    return from_dict({**body, "digest": digest(body)})


def evidence_of(body: Body, name: str = "error_bound") -> Body:
    entry: Body = next(claim for claim in body["claims"] if claim["id"] == name)["evidence"]
    return entry


@pytest.mark.parametrize(
    ("L", "expected"),
    [
        ((7.09, 19.8), (0.02600, 0.13068)),
        ((2.0, -1.0), (0.37746, 0.75000)),
        ((0.0, 0.0), (0.93523, 0.92644)),
        ((13.9, 59.2), (0.01730, 0.12116)),
    ],
)
def test_numbers_of_the_spring(L: tuple[float, float], expected: tuple[float, float]) -> None:
    """Sum over columns of int |e^(Fs) E| ds, here by the midpoint rule."""
    always = bound(investigated(spring(L))).evidence["always"]
    assert always == pytest.approx(expected, rel=2e-3)
    assert (np.array(always) > np.array(expected) * (1 - 1e-3)).all()


@pytest.mark.parametrize("L", [(-2.863, -2.638), (-41.84, -25.104)])
def test_what_a_parameter_adds_to_flow_and_output_is_counted_together(
    L: tuple[float, float],
) -> None:
    """The bound is the sum of int |e^(Fs) (A_1 - L C_1)_j| x_j ds, here by the midpoint rule."""
    body: Body = {
        "flow": {"A": [[-0.7, 0.3], [0.9, -0.6]]}, "output": {"C": [[-1, 0]]},
        "parameter": [{"name": "p", "range": [-0.1, 0.1], "A": [[0, -0.5], [0, -0.3]],
                       "C": [[0.2, 0.3]]}],
        "state": {"lower": [-2, 1], "upper": [2, 3]},
        "observer": {"kind": "luenberger", "gains": {"L": [[value] for value in L]}},
    }  # fmt: skip
    gain = np.array(L)[:, None]
    F = np.array(body["flow"]["A"]) - gain @ [[-1, 0]]
    effect = 0.1 * (np.array([[0, -0.5], [0, -0.3]]) - gain @ [[0.2, 0.3]])
    state, step, total = np.hstack([effect * [2, 1], effect @ [[0], [2]]]), 1e-3, np.zeros(2)
    state = expm(F * step / 2) @ state
    flow = expm(F * step)
    for _ in range(30_000):
        total, state = total + step * np.abs(state).sum(axis=1), flow @ state
    always = bound(investigated(body)).evidence["always"]
    assert always == pytest.approx(total, rel=1e-2)
    assert (np.array(always) > total * (1 - 1e-3)).all()


def test_an_attaining_disturbance_comes_close_to_the_bound() -> None:
    """The worst signs of parameter, disturbance and noise, computed backwards from the end."""
    always = bound(investigated(spring((2.0, -1.0)))).evidence["always"]
    step, count = 1e-3, 30_000
    F = np.array([[-2.0, 1.0], [0.0, -0.4]])
    E = np.array([[0.0, 0.0, -0.02], [0.24, 0.05, 0.01]])
    for i in range(2):
        costate, courses = np.eye(2)[i], []
        for _ in range(count):
            courses.append(np.sign(costate @ E))
            costate = costate + step * costate @ F
        e = np.zeros(2)
        for d in reversed(courses):
            e = e + step * (F @ e + E @ d)
        assert 0.99 * always[i] < e[i] <= always[i] * 1.001


def test_the_inequality_gives_the_gain_of_the_theory() -> None:
    """Abedor, Nagpal, Poolla (1996) for the spring, at the rate 1.5 and at a better one."""
    system = DisturbedOutput(
        np.array([[0, 1], [-1, -0.4]]), np.array([[1.0, 0.0]]),
        np.array([[0, 0, 0], [0.24, 0.05, 0]]), np.array([[0, 0, 0.01]]),
    )  # fmt: skip
    gain, better = peak_gain(system, 1.5), peak_gain(system, 5.0)
    assert gain is not None
    assert better is not None
    assert gain.L[:, 0] == pytest.approx([7.084, 19.777], rel=1e-3)
    assert gain.bound == pytest.approx(0.1721, rel=1e-3)
    assert better.bound == pytest.approx(0.1316, rel=1e-3)
    # the bound is of every state at once: those by states are smaller
    always = bound(investigated(spring((7.084, 19.777)))).evidence["always"]
    assert max(always) < gain.bound
    assert peak_gain(system, 1e9) is None


@pytest.mark.parametrize(
    ("body", "given"),
    [(spring(), ((13.9, 59.2), (7.09, 19.8), (2.0, -1.0))), (warmed(), ((1.0,), (5.0,), (30.0,)))],
    ids=["flow", "kicked"],
)
def test_open_gains_are_those_of_the_least_proved_bound(
    body: Body, given: tuple[tuple[float, ...], ...]
) -> None:
    units = np.array(body["state"]["upper"])
    result = investigated(body)
    assert "searched" in result.result["form"]
    cost = (np.array(bound(result).evidence["always"]) / units).sum()
    for L in given:
        gains = body["observer"].get("gains", {}) | {"L": [[value] for value in L]}
        own = body | {"observer": {"kind": "luenberger", "gains": gains}}
        always = np.array(bound(investigated(own)).evidence["always"])
        assert cost < (always / units).sum() * 1.001


def test_other_units_of_the_file_give_the_same_bound() -> None:
    body = spring()
    metres = np.array(bound(investigated(body)).evidence["always"])
    body["flow"]["A"] = [[0, 1e-3], [0, -0.4]]
    body["flow"]["disturbance"] = {"lower": [0, -50], "upper": [0, 50]}
    body["parameter"][0]["A"] = [[0, 0], [-1000, 0]]
    body["state"] = {"lower": [-1.2, -3000], "upper": [1.2, 3000]}
    again = np.array(bound(investigated(body)).evidence["always"])
    assert again == pytest.approx(metres * [1, 1000], rel=2e-2)


def test_without_noise_no_gain_is_preferred_for_its_speed() -> None:
    body = spring()
    del body["output"]["noise_bound"]
    result = investigated(body)
    assert result.result["form"] == "Riccati L"
    sentence = next(
        e.statement for e in result.guarantees if "ultimate bound of the est" in e.statement
    )
    assert "continuously without noise" in sentence
    # what states gains or restricts them is heeded
    stated = spring(observer={"kind": "luenberger", "poles": [-2, -3]})
    assert investigated(stated).result["form"] == "placed L"


def test_effects_on_one_direction_cancel() -> None:
    """Two rooms that exchange heat: their difference counts, at most 6 degrees, not 24."""
    body: Body = {
        "flow": {"A": [[-0.1, 0], [0, -0.15]], "disturbance": {"lower": [2.2, 2.6], "upper": [2.2, 2.6]}},
        "output": {"C": [[1, 0]], "noise_bound": [0.05]},
        "parameter": [{"name": "exchange", "range": [0.5, 1.5], "A": [[-1, 1], [1, -1]]}],
        "state": {"lower": [18, 18], "upper": [24, 24]},
        "observer": {"kind": "luenberger", "gains": {"L": [[3], [0.5]]}},
    }  # fmt: skip
    together = bound(investigated(body)).evidence["always"]
    body["flow"] |= {"A": [[-1.1, 1], [1, -1.15]], "A_radius": [[0.5, 0.5], [0.5, 0.5]]}
    del body["parameter"]
    apart = bound(investigated(body)).evidence["always"]
    assert (np.array(apart) > 5 * np.array(together)).all()


@pytest.mark.parametrize("body", [spring(), KICKED], ids=["flow", "kicked"])
def test_a_design_verifies_from_its_file_and_no_smaller_bound_does(body: Body) -> None:
    design = designed(body)
    stated = design.to_dict()
    assert verify(stored(stated)).verdict == "proved"
    assumed = next(
        entry.statement
        for entry in design.guarantees
        if "ultimate bound of the est" in entry.statement
    )
    assert assumed.startswith(
        "Assumed: stiffness in [0.8, 1.2]; x from (-1.2, -3) to (1.2, 3) at every instant, as "
        "[state] says."
    )
    for name in ("always", "before_jump"):
        for i in range(2):
            changed = copy.deepcopy(stated)
            if name in evidence_of(changed):
                evidence_of(changed)[name][i] *= 0.99
                result = verify(stored(changed))
                assert result.verdict != "proved"
                assert bound(result).verdict == "undecided"


@pytest.mark.parametrize(
    ("block", "change"),
    [
        ("parameter", {"range": [0.6, 1.4]}),  # the same middle
        ("output", {"noise_bound": [0.05]}),
        ("flow", {"disturbance": {"lower": [0, -0.2], "upper": [0, 0.2]}}),
        ("state", {"lower": [-2, -3], "upper": [2, 3]}),
        ("jump", {"disturbance": {"lower": [0, -0.6], "upper": [0, 0.6]}}),
        ("jump", {"dwell_time": [0.5, 6]}),
    ],
)
def test_whatever_acts_more_is_not_covered_by_the_bound(block: str, change: Body) -> None:
    stated = designed(KICKED).to_dict()
    problem = stated["problem"]
    target = problem[block][0] if block == "parameter" else problem[block]
    target |= change
    # gains of the same problem, so that the bound alone is at stake
    for name, place in (("noise_bound", "output"), ("dwell_time", "jump")):
        if name in change:
            stated["gains"][name] = problem[place][name]
    for name in ("flow", "jump"):
        if "disturbance" in problem[name]:
            for end in ("lower", "upper"):
                stated["gains"][f"{name}_{end}"] = problem[name]["disturbance"][end]
    result = verify(stored(stated))
    claims = {claim.id: claim.verdict for claim in result.claims}
    assert claims["consistent"] == "proved"
    assert claims["error_bound"] == "undecided"


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("T", [[1.0, 0.0], [0.0, 1.0]]),
        ("T", [[1.0, 0.0], [1.0, 0.0]]),
        ("per_jump", 0.01),
        ("per_jump", -1.0),
    ],
)
def test_a_forged_norm_proves_nothing(name: str, value: Any) -> None:
    body = kicked()
    body["observer"]["gains"] = {"L": [[2], [0]], "M": [[0], [0]]}
    stated = designed(body).to_dict()
    assert verify(stored(stated)).verdict == "proved"
    assert "tube" not in evidence_of(stated)  # signs matter: it oscillates
    evidence_of(stated)[name] = value
    assert bound(verify(stored(stated))).verdict == "undecided"


def cascade() -> Body:
    """Two stages, turned at jumps, whose error has a tube, and a norm that says more."""
    body = kicked(observer={"kind": "luenberger", "gains": {"L": [[0], [0]], "M": [[0], [0]]}})
    body["jump"] |= {"G": [[0.5, -0.3], [0.3, 0.5]], "dwell_time": [0.5, "inf"]}
    body["flow"]["A"] = [[-1, 0], [1, -1]]
    body["parameter"][0] |= {"range": [0.9, 1.1], "A": [[0, 0], [1, 0]]}
    return body


@pytest.mark.parametrize("part", ["per_jump", "tube"])
def test_a_forged_part_that_no_bound_needs_is_not_proved_either(part: str) -> None:
    stated = designed(cascade()).to_dict()
    evidence = evidence_of(stated)
    assert {"tube", "per_jump"} <= set(evidence)
    other = {**stated, "claims": copy.deepcopy(stated["claims"])}
    for name in ("T", "per_jump") if part == "tube" else ("tube",):
        evidence_of(other).pop(name)
    evidence_of(other)["always"] = [1 + value for value in evidence["always"]]
    evidence_of(other)["before_jump"] = [1 + value for value in evidence["before_jump"]]
    assert bound(verify(stored(other))).verdict == "proved"  # each part by itself is true
    if part == "per_jump":
        evidence["per_jump"] *= 0.5
    else:
        evidence["tube"] = {key: [0.5 * x for x in own] for key, own in evidence["tube"].items()}
    assert bound(verify(stored(stated))).verdict == "undecided"


def test_a_forged_tube_proves_nothing() -> None:
    stated = designed(cascade()).to_dict()
    assert verify(stored(stated)).verdict == "proved"
    for name in ("T", "per_jump"):
        evidence_of(stated).pop(name, None)
    tube = evidence_of(stated)["tube"]
    evidence_of(stated)["tube"] = {key: [0.5 * x for x in own] for key, own in tube.items()}
    evidence_of(stated)["always"] = tube["before_jump"]
    assert bound(verify(stored(stated))).verdict == "undecided"


@pytest.mark.parametrize("body", [spring((2.0, -1.0)), KICKED], ids=["flow", "kicked"])
def test_errors_of_simulations_stay_within_the_bound(body: Body) -> None:
    design = designed(body)
    always = np.array(evidence_of(design.to_dict())["always"])
    problem, observer = Problem.from_dict(body), from_design(design)
    for seed in range(2):
        run = simulate(
            problem.plant, disturbance="extreme", rng=np.random.default_rng(seed), until=40,
            step=0.02, parameters="bang-bang", initial=np.array([0.2, 0.1]),
        )  # fmt: skip
        batch = observer.run_batch(run.t, run.block("y"), None, None, run.happened)
        inside = np.abs(run.block("x")).max(axis=0) <= [1.2, 3]
        assert inside.all()
        error = np.abs(batch.x - run.block("x"))[len(run.t) // 2 :]
        assert (error <= always).all()


def test_a_proved_box_serves_where_none_is_stated() -> None:
    body = copy.deepcopy(KICKED)
    del body["state"]
    body["flow"]["A"] = [[-0.5, 0.1], [0, -0.6]]
    body["parameter"][0] |= {"range": [-0.2, 0.2], "A": [[0, 0], [1, 0]]}
    body["jump"]["G"] = [[0.5, 0], [0, 0.5]]
    design = designed(body)
    assert verify(stored(design.to_dict())).verdict == "proved"
    sentence = next(
        e.statement for e in design.guarantees if "ultimate bound of the est" in e.statement
    )
    assert "proved ultimate bound of |x|" in sentence
    changed = design.to_dict()
    evidence_of(changed, "state_box")["always"] = [0.1, 0.1]
    assert verify(stored(changed)).verdict != "proved"
    # without disturbances the box is nearly zero, and the error is that of the noise
    for block in ("flow", "jump"):
        del body[block]["disturbance"]
    undisturbed = designed(body)
    claims = {claim.id: claim for claim in undisturbed.claims}
    assert max(claims["state_box"].evidence["always"]) < 1e-5
    bounds = [bound(investigated(body)).evidence["always"]]
    del body["parameter"][0]
    body["parameter"] = [{"name": "none", "range": [0, 0], "A": [[0, 0], [1, 0]]}]
    bounds.append(bound(investigated(body)).evidence["always"])
    assert bounds[0] == pytest.approx(bounds[1], rel=1e-3, abs=1e-6)


def test_a_known_input_needs_a_bound_where_it_is_uncertain() -> None:
    body = spring()
    body["flow"] |= {"B": [[0], [1]], "input_bound": [2.0]}
    body["parameter"].append({"name": "motor", "range": [0.9, 1.1], "B": [[0], [1]]})
    with_motor = np.array(bound(investigated(body)).evidence["always"])
    assert (with_motor > np.array(bound(investigated(spring())).evidence["always"])).all()
    del body["flow"]["input_bound"]
    result = investigated(body)
    assert result.verdict == "proved"
    assert not any(claim.id == "error_bound" for claim in result.claims)


def test_a_middle_that_is_no_float_counts() -> None:
    """The nominal A is rounded; what it lacks of the exact middle is an effect too."""
    body = spring((2.0, -1.0))
    body["parameter"][0]["range"] = [1.1, 1.1]
    body["flow"].pop("disturbance")
    body["output"].pop("noise_bound")
    body["flow"]["A"] = [[0, 1], [0.1, -0.4]]
    always = np.array(bound(investigated(body)).evidence["always"])
    assert (always > 0).all()
    assert (always < 1e-15).all()


def test_a_known_input_beyond_its_bound_has_a_status() -> None:
    body = spring()
    body["flow"] |= {"B": [[0], [1]], "input_bound": [2.0]}
    body["parameter"].append({"name": "motor", "range": [0.9, 1.1], "B": [[0], [1]]})
    design = designed(body)
    assert verify(stored(design.to_dict())).verdict == "proved"
    t = np.arange(6) * 0.1
    u = np.array([[2.0], [2.0], [2.5], [-2.0], [-3.0], [0.0]])
    observer = from_design(design)
    batch = observer.run_batch(t, np.zeros((6, 1)), u, None, None)
    # u of a row acts on the step that follows; from then on the bound is void
    assert batch.status[:4] == ("ok", "ok", "ok", LARGE_U)
    assert batch.status[4] == f"void since time 0.3 ({LARGE_U})"
    assert batch.status[5] == f"{LARGE_U}; void since time 0.3 ({LARGE_U})"
    # the bound is of the problem: a design with another one is not of it
    changed = design.to_dict()
    changed["gains"]["input_bound"] = [9.0]
    assert verify(stored(changed)).verdict == "refuted"


def test_a_bound_that_is_void_counts_again_after_reset() -> None:
    body = spring()
    body["flow"] |= {"B": [[0], [1]], "input_bound": [2.0]}
    observer = from_design(designed(body))
    assert isinstance(observer, LuenbergerObserver)

    def row(t: float, u: float) -> Sample:
        return Sample(t, y=np.zeros(1), u=np.array([u]))

    state, statuses = observer.init(0.0), []
    for k, u in enumerate((0.0, 2.5, *[0.0] * 500)):
        state, estimate = observer.step(state, row(0.1 * k, u))
        statuses.append(estimate.status)
    assert statuses[:3] == ["ok", "ok", LARGE_U]
    assert all("void since" in status for status in statuses[3:])  # however long ago it was
    state = observer.reset(state, x=[0.1, 0.0])
    state, estimate = observer.step(state, row(60.0, 1.0))
    assert estimate.status == "ok"
    # a design without parameters counts on no bound of u
    del body["parameter"], body["state"], body["flow"]["input_bound"]
    body["flow"]["A"] = [[0, 1], [-1, -0.4]]
    certain = from_design(designed(body))
    u = np.array([[0.0], [1e6], [0.0], [0.0]])
    batch = certain.run_batch(0.1 * np.arange(4), np.zeros((4, 1)), u, None, None)
    assert set(batch.status) == {"ok"}


def test_without_a_bound_of_the_error_no_input_voids_it() -> None:
    """It oscillates, and no box is stated: there is no claim that counts on input_bound."""
    body = spring()
    body["flow"] |= {"B": [[0], [1]], "input_bound": [2.0]}
    del body["state"]
    design = designed(body)
    assert verify(stored(design.to_dict())).verdict == "proved"
    u = np.array([[0.0], [9.0], [0.0], [0.0]])
    batch = from_design(design).run_batch(0.1 * np.arange(4), np.zeros((4, 1)), u, None, None)
    assert set(batch.status) == {"ok"}


def test_jumps_have_a_status_for_their_inputs_too() -> None:
    body = copy.deepcopy(KICKED)
    body["jump"] |= {"E": [[0], [1]], "input_bound": [1.0]}
    body["parameter"].append({"name": "hammer", "range": [0.9, 1.1], "E": [[0], [1]]})
    observer = from_design(designed(body))
    t, jump = np.array([0.0, 3.0, 6.0]), np.array([False, True, True])
    w = np.array([[0.0], [1.0], [-1.5]])
    batch = observer.run_batch(t, np.zeros((3, 1)), None, w, jump)
    assert [LARGE_W in status for status in batch.status] == [False, False, True]


def test_gains_are_no_larger_than_the_bounds_need() -> None:
    """A state that is measured is known as well as its noise by any large gain."""
    body: dict[str, Any] = {
        "flow": {"A": [[-0.3, 0.2], [0.3, -0.2]],
                 "disturbance": {"lower": [-0.3, 0], "upper": [0.3, 0]}},
        "output": {"C": [[0.05, 0]], "noise_bound": [0.02]},
        "state": {"lower": [0, 0], "upper": [165, 140]},
        "parameter": [{"name": "clearance", "range": [0.14, 0.26], "A": [[-1, 0], [0, 0]]}],
        "observer": {"kind": "luenberger"},
    }  # fmt: skip
    bounds = []
    for options in ({}, {"gains": {"L": [[1.2e8], [3.18]]}}):
        body["observer"] = {"kind": "luenberger", **options}
        result = investigated(body)
        assert result.design is not None
        bounds.append(np.array(bound(result).evidence["always"]))
        if not options:
            assert np.abs(result.design.gains["L"]).max() < 1e5
    assert (bounds[0] <= 1.1 * bounds[1]).all()


@pytest.mark.parametrize(
    ("changes", "needs"),
    [
        ({"state": None}, "[state]"),
        ({"input": True}, "flow.input_bound"),
        ({"input": True, "state": None}, "flow.input_bound"),
    ],
)
def test_what_a_bound_would_need_is_said(changes: Body, needs: str) -> None:
    body = spring()
    if changes.get("input"):
        body["flow"]["B"] = [[0], [1]]
        body["parameter"].append({"name": "gain", "range": [-0.1, 0.1], "B": [[0], [1]]})
    if "state" in changes:
        del body["state"]
        # it oscillates: no box is proved
        body["parameter"][0]["range"] = [0.8, 1.2]
    result = investigated(body)
    assert "error_bound" not in {claim.id for claim in result.claims}
    assert any(
        "No bound of the estimation error" in text and needs in text for text in result.warnings
    )


@pytest.mark.parametrize(
    ("parameter", "gains", "is_zero"),
    [
        ({"range": [-0.1, 0.1], "C": [[0.2, 0]]}, {}, True),  # L = 0: the sensor is not used
        ({"range": [0.0, 0.0], "A": [[1, 0], [0, 0]]}, {"L": [[0], [0]]}, True),
        ({"range": [-0.1, 0.1], "C": [[0.2, 0]]}, {"L": [[1], [1]]}, False),
    ],
)
def test_an_error_that_nothing_drives_has_the_bound_zero(
    parameter: Body, gains: Body, is_zero: bool
) -> None:
    body = {
        "flow": {"A": [[-0.7, 0.3], [0.9, -0.6]]}, "parameter": [{"name": "p"} | parameter],
        "output": {"C": [[1, 0]], "noise_bound": [0.01]},
        "state": {"lower": [-2, -2], "upper": [2, 2]},
        "observer": {"kind": "luenberger"} | ({"gains": gains} if gains else {}),
    }  # fmt: skip
    claim = bound(investigated(body))
    assert claim.verdict == "proved"
    assert (max(claim.evidence["always"]) == 0) == is_zero


@pytest.mark.parametrize("kind", ["luenberger", "interval"])
def test_a_box_without_parameters_is_not_used_and_this_is_said(kind: str) -> None:
    body = spring(observer={"kind": kind})
    body["flow"]["A"] = [[-1, 0.2], [0, -0.4]]
    with_parameter = investigated(body)
    del body["parameter"]
    texts = [result.result.get("remarks", []) for result in (with_parameter, investigated(body))]
    assert [any("uses [state]" in text for text in listed) for listed in texts] == [False, True]
