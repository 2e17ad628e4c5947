"""Gains of uncertain plants: chosen for the claimed bound of the error, under constraints too."""

from __future__ import annotations

import itertools
import time
from typing import Any

import numpy as np
import pytest

from lmi.arithmetic.arrays import Matrix
from lmi.find.peak_to_peak import DisturbedOutput, PeakGain, peak_gain
from lmi.time_budget import TimeBudget
from obsdesign.analysis.nominal import nominal_problem
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.luenberger import peak_gains
from obsdesign.synthesis.luenberger.driven_plant import GainPair
from obsdesign.synthesis.luenberger.error_bound import known_box
from obsdesign.synthesis.luenberger.peak_gains import GainSearch
from obsdesign.synthesis.luenberger.searched_gains import gain_search
from obsdesign.workflow import Outcome, investigate
from tests.systems.designs import designed
from tests.systems.designs import investigated as outcome
from tests.systems.parameters import Body
from tests.verification.luenberger.test_error_bound import bound, kicked, spring

UNITS = np.array([1.2, 3])


def cost(result: Outcome) -> float:
    """The sum of the claimed bounds, in units of the box."""
    return float((np.array(bound(result).evidence["always"]) / UNITS).sum())


def constrained(**options: Any) -> Body:
    return spring(observer={"kind": "luenberger", **options})


def noiseless(body: Body) -> Body:
    del body["output"]["noise_bound"]
    return body


@pytest.mark.parametrize(
    ("body", "admissible"),
    [
        (constrained(gain_norm={"L": 25.0}), (8, 23)),
        (noiseless(constrained(gain_norm={"L": 1000.0})), (60, 990)),
        (constrained(structure={"L": [[1], [0]]}), (2.2, 0)),
        (constrained(structure={"L": [[0], [1]]}), (0, 7.6)),
        (constrained(region={"disc": {"centre": -3.0, "radius": 2.0}}), (9.2, 19)),
        (noiseless(constrained(region={"disc": {"centre": -3.0, "radius": 2.0}})), (9.2, 19)),
    ],
    ids=["norm", "norm without noise", "first", "second", "disc", "disc without noise"],
)
def test_gains_under_constraints_are_chosen_for_the_bound(
    body: Body, admissible: tuple[float, float]
) -> None:
    """No admissible L that was tried by hand has a bound that is smaller by more than 3 %."""
    result = outcome(body)
    assert result.verdict == "proved"  # the claims on the constraints among others
    given = body | {"observer": body["observer"] | {"gains": {"L": [[v] for v in admissible]}}}
    by_hand = outcome(given)
    assert by_hand.verdict == "proved"
    assert cost(result) < 1.03 * cost(by_hand)


def test_without_noise_or_limit_what_is_missing_is_said() -> None:
    result = outcome(noiseless(spring()))
    assert any("output.noise_bound" in text for text in result.result["remarks"])
    # nor is anything said where L is limited
    assert "remarks" not in outcome(spring((2.0, -1.0))).result


def sensed(noise: float | None = 0.01, disturbance: float = 1.0, **observer: Any) -> Body:
    """A parameter acts on the flow and on the sensor: what it adds to both partly cancels."""
    b = disturbance * np.array([0.1, 0.05])
    output: Body = {"C": [[-1, 0]]} | ({} if noise is None else {"noise_bound": [noise]})
    return {
        "flow": {"A": [[-0.7, 0.3], [0.9, -0.6]],
                 "disturbance": {"lower": (-b).tolist(), "upper": b.tolist()}},
        "parameter": [{"name": "p", "range": [-0.1, 0.1], "A": [[0, -0.5], [0, -0.3]],
                       "C": [[0.2, 0.3]]}],
        "output": output, "state": {"lower": [-1.2, -3], "upper": [1.2, 3]},
        "observer": {"kind": "luenberger", **observer},
    }  # fmt: skip


def sensed_twice(noise: float | None = 0.01, disturbance: float = 1.0, **observer: Any) -> Body:
    body = sensed(noise, disturbance, **observer)
    body["parameter"].append({"name": "q", "range": [-0.2, 0.2], "A": [[0, -0.2], [-0.4, 0]]})
    return body


@pytest.mark.parametrize(("entry", "is_limited"), [(0.2, True), (None, False)])
def test_parameters_on_the_output_limit_gains_as_noise_does(
    entry: float | None, is_limited: bool
) -> None:
    body = sensed(noise=None)
    if entry is None:
        del body["parameter"][0]["C"]
    remarks = outcome(body).result.get("remarks", [])
    assert any("nothing limits it" in text for text in remarks) == (not is_limited)


def sampled_at_jumps(**observer: Any) -> Body:
    """The spring, its position measured at kicks alone, which come often."""
    body = kicked(observer={"kind": "luenberger", **observer})
    body["jump"]["dwell_time"] = [0.4, 0.6]
    body["jump"]["disturbance"] = {"lower": [0, -0.02], "upper": [0, 0.02]}
    body["output"]["measured"] = "at_jumps"
    return body


def test_jump_gains_are_chosen_for_the_bound() -> None:
    result = outcome(sampled_at_jumps())
    assert result.design is not None
    assert np.any(result.design.gains["M"])
    # of the largest margin of stability, as without parameters; another
    for M in ((1.0, 1.0), (0.8, 0.5)):
        given = outcome(sampled_at_jumps(gains={"M": [[value] for value in M]}))
        assert cost(result) < 1.02 * cost(given)


def test_constraints_hold_at_jumps_too() -> None:
    result = outcome(sampled_at_jumps(gain_norm={"M": 0.5}))
    assert result.verdict == "proved"
    assert result.design is not None
    assert np.linalg.norm(result.design.gains["M"], 2) <= 0.5
    given = outcome(sampled_at_jumps(gains={"M": [[0.45], [0.2]]}))
    assert cost(result) < 1.02 * cost(given)


def first_search(body: Body) -> GainSearch:
    problem = Problem.from_dict(body)
    box = known_box(problem)
    assert box is not None
    search = gain_search(problem, nominal_problem(problem), box, None)
    assert search is not None
    return search


def estimate(body: Body, L: Matrix, M: Matrix) -> float:
    return first_search(body).cost(GainPair(L, M))


@pytest.mark.parametrize("when", ["before", "after"])
@pytest.mark.parametrize("gains", [((7.0, 20.0), (0.5, 0.3)), ((2.0, -1.0), (0.9, 0.0))])
def test_estimates_are_near_the_proved_bounds(
    gains: tuple[tuple[float, float], tuple[float, float]], when: str
) -> None:
    body = kicked()
    body["output"]["jump_measurement"] = when
    L, M = (np.array([[a], [b]]) for a, b in gains)
    value = estimate(body, L, M)
    body["observer"]["gains"] = {"L": L.tolist(), "M": M.tolist()}
    assert value == pytest.approx(cost(investigate(Problem.from_dict(body))), rel=0.12)


def test_errors_that_grow_have_no_estimate() -> None:
    L, zero = np.array([[7.0], [20.0]]), np.zeros((2, 1))
    assert np.isfinite(estimate(kicked(), L, zero))
    assert np.isinf(estimate(kicked(), -L, zero))  # between jumps
    assert np.isinf(estimate(kicked(), zero, np.array([[3.0], [0.0]])))  # at them
    assert np.isinf(estimate(spring(), -L, zero))


def test_units_of_states_output_and_time_do_not_matter() -> None:
    """Speed in mm/s, y in mm, time in ms: gains are the same numbers in these units."""
    plain = outcome(constrained(structure={"L": [[1], [1]]}))
    body = constrained(structure={"L": [[1], [1]]})
    body["flow"] = {
        "A": [[0, 1e-6], [0, -0.4e-3]],
        "disturbance": {"lower": [0, -0.05], "upper": [0, 0.05]},
    }
    body["output"] = {"C": [[1000, 0]], "noise_bound": [10]}
    body["parameter"][0]["A"] = [[0, 0], [-1, 0]]
    body["state"] = {"lower": [-1.2, -3000], "upper": [1.2, 3000]}
    other = outcome(body)
    assert plain.design is not None
    assert other.design is not None
    bounds = np.array(bound(other).evidence["always"]) / [1, 1000]
    assert bounds == pytest.approx(np.array(bound(plain).evidence["always"]), rel=2e-2)


THREE_STATES: Body = {
    "flow": {"A": [[0, 1, 0], [0, 0, 1], [-2, -5, -4]],
             "disturbance": {"lower": [0, 0, -0.1], "upper": [0, 0, 0.1]}},
    "parameter": [{"name": "p", "range": [-0.2, 0.2], "A": [[0, 1, 0], [0, 0, -1], [0, 0, 1]]}],
    "output": {"C": [[0, 0, -1], [0, 2, 0]], "noise_bound": [0.01, 0.05]},
    "state": {"lower": [-2, -2, -2], "upper": [2, 2, 2]},
    "observer": {"kind": "luenberger"},
}  # fmt: skip


def test_units_of_outputs_do_not_change_the_gains() -> None:
    own = designed(THREE_STATES).gains["L"]
    C, V = np.array([[0, 0, -1.0], [0, 2.0, 0]]), np.array([0.01, 0.05])
    scale = np.array([2.0**-10, 2.0**10])
    output = {"C": (C * scale[:, None]).tolist(), "noise_bound": (V * scale).tolist()}
    other = designed(THREE_STATES | {"output": output}).gains["L"]
    assert other * scale == pytest.approx(own, rel=1e-4, abs=1e-6 * np.abs(own).max())


def test_gains_that_matter_in_their_ratio_alone_are_not_large() -> None:
    """A heater whose input gain is known to 10 %: gains of 5e4 had the same bounds as of 12."""
    heater: Body = {
        "flow": {"A": [[-0.2, 0.1], [0.05, -0.1]], "B": [[1], [0]], "input_bound": [1],
                 "disturbance": {"lower": [0, -0.01], "upper": [0, 0.01]}},
        "parameter": [{"name": "gain", "range": [-0.1, 0.1], "B": [[1], [0]]}],
        "output": {"C": [[0, 1]], "noise_bound": [0.05]},
        "observer": {"kind": "luenberger"},
    }  # fmt: skip
    assert np.abs(designed(heater).gains["L"]).max() < 100


def kicked_often(noise: float = 0.01, **observer: Any) -> Body:
    """The spring kicked every 0.4 to 0.6, its position measured all the time."""
    body = sampled_at_jumps(**observer)
    del body["output"]["measured"]
    body["output"]["noise_bound"] = [noise]
    body["state"] = {"lower": [-1.5, -1.5], "upper": [1.5, 1.5]}
    return body


def turned(noise: float = 0.01, **observer: Any) -> Body:
    """A rotation that jumps stretch; y mixes its states, so that L and M matter together."""
    return {
        "flow": {"A": [[0, 0.3], [-1.3, 0]], "disturbance": {"lower": [0, -0.05], "upper": [0, 0.05]}},
        "jump": {"G": [[1.1, -0.1], [0, 0.9]], "dwell_time": [0.5, 0.8]},
        "parameter": [{"name": "p", "range": [-0.1, 0.1], "A": [[0, 0], [1, 0]]}],
        "output": {"C": [[0.6, 0.4]], "noise_bound": [noise]},
        "state": {"lower": [-1.5, -1.5], "upper": [1.5, 1.5]},
        "observer": {"kind": "luenberger", **observer},
    }  # fmt: skip


@pytest.mark.parametrize(
    ("plant", "norms"),
    [
        (sampled_at_jumps, {"M": 0.5}),
        (constrained, {"L": 40.0}),
        (sensed, {"L": 2.0}),
        (sensed_twice, {"L": 20.0}),
    ],
    ids=["at jumps", "without jumps", "sensed", "sensed twice"],
)
def test_no_constraint_gives_a_smaller_bound(plant: Any, norms: dict[str, float]) -> None:
    """What a constraint admits is open without it too."""
    free, held = plant(), plant(gain_norm=norms)
    assert cost(outcome(free)) < 1.01 * cost(outcome(held))


def kicked_with_one_gain(noise: float = 0.01) -> Body:
    return kicked_often(noise, gains={"M": [[0], [0]]}, structure={"L": [[1], [0]]})


def quiet(noise: float = 0.01, **observer: Any) -> Body:
    """The spring without kicks."""
    body = constrained(**observer)
    body["output"]["noise_bound"] = [noise]
    return body


@pytest.mark.parametrize(
    ("plant", "levels"),
    [(quiet, (0.0, 1e-8, 0.01)), (sensed, (0.0, 0.01))],
)
def test_less_noise_gives_no_larger_bound(plant: Any, levels: tuple[float, ...]) -> None:
    """Without any noise too, where the fastest gain that is proved would be the best."""
    costs = [cost(outcome(plant(noise))) for noise in levels]
    assert all(less <= 1.01 * more for less, more in itertools.pairwise(costs))
    assert costs[0] < 0.99 * costs[-1]
    assert "remarks" not in outcome(plant(0.0)).result


@pytest.mark.parametrize("plant", [sensed, sensed_twice])
def test_less_disturbance_gives_no_larger_bound(plant: Any) -> None:
    costs = [cost(outcome(plant(disturbance=part))) for part in (0.0, 0.5, 1.0)]
    assert all(less <= 1.01 * more for less, more in itertools.pairwise(costs))
    assert costs[0] < 0.95 * costs[-1]


def test_a_gain_that_leaves_a_singular_map_at_jumps_has_a_bound() -> None:
    """M C = 1 for the measured state: the norm of the fastest contraction is far from round."""
    gains = {"L": [[12.2], [62.2]], "M": [[0.99998], [0]]}
    near = outcome(kicked_often(gains=gains | {"M": [[0.99], [0]]}))
    assert cost(outcome(kicked_often(gains=gains))) == pytest.approx(cost(near), rel=0.01)


@pytest.mark.parametrize(("seconds", "most"), [(None, 12), (0.04, 4)])
def test_time_ends_the_line_of_rates(
    seconds: float | None, most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its best gain so far is the first L, with time or without."""
    rates = set()

    def slow_gain(system: DisturbedOutput, rate: float) -> PeakGain | None:
        end = time.process_time() + 0.02
        while time.process_time() < end:
            rates.add(rate)
        return peak_gain(system, rate)

    monkeypatch.setattr(peak_gains, "peak_gain", slow_gain)
    L = first_search(quiet()).first_flow_gain(TimeBudget.from_seconds(seconds))
    assert L is not None
    assert len(rates) == most if seconds is None else 0 < len(rates) < most


def test_a_search_of_gains_leaves_time_for_the_proofs() -> None:
    """Two seconds of processor time, a tenth of what the search takes without a limit."""
    start = time.process_time()
    result = investigate(Problem.from_dict(turned()), seconds=2.0)
    assert time.process_time() - start < 4.0
    verdicts = {claim.id: claim.verdict for claim in result.claims}
    assert verdicts["dwell_stability"] == verdicts["error_bound"] == "proved"
    assert any("gains for the least bound" in text for text in result.result["remarks"])
