"""What samples determine: proved, refuted with a direction, or refused with the shortest window."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.analysis.set_membership.requirements import shortest_window
from obsdesign.design_file import from_dict
from obsdesign.document import Claim, digest
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem
from obsdesign.workflow import Outcome, investigate

# x1 is measured, x2 is never seen, x3 follows both
HIDDEN: dict[str, Any] = {
    "flow": {"A": [[-1, 0, 0], [0, 0.1, 0], [1, 1, -2]]},
    "output": {"C": [[1, 0, 0]], "noise_bound": [0.03], "measured": "periodic", "period": 0.1},
    "observer": {"kind": "set_membership", "window": 8},
}


def _with(change: dict[str, Any], base: dict[str, Any] = HIDDEN) -> dict[str, Any]:
    body = copy.deepcopy(base)
    for path, value in change.items():
        block, name = path.split(".")
        body.setdefault(block, {})[name] = value
    return body


def _outcome(body: dict[str, Any]) -> Outcome:
    return investigate(Problem.from_dict(body))


def _claim(outcome: Outcome, name: str) -> Claim:
    return next(claim for claim in outcome.claims if claim.id == name)


def test_a_growing_mode_that_no_sample_sees_is_refuted_with_its_direction() -> None:
    outcome = _outcome(HIDDEN)
    assert outcome.verdict == "refuted"
    witness = _claim(outcome, "attainable").evidence["witness"]
    A, direction = np.array(HIDDEN["flow"]["A"]), np.array(witness["approx_direction"])
    assert pytest.approx(A @ direction) == 0.1 * direction
    assert direction[0] == 0.0
    assert "the worst direction is x2 + 0.476 x3" in witness["reason"]


def test_its_stable_twin_is_proved() -> None:
    A = [[-1, 0, 0], [0, -0.1, 0], [1, 1, -2]]
    outcome = _outcome(_with({"flow.A": A}))
    assert outcome.verdict == "proved"
    assert _claim(outcome, "attainable").evidence["dimension"] == 2


@pytest.mark.parametrize(("factor", "verdict"), [(0.5, "proved"), (1.0, "refuted")])
def test_jumps_decide_on_what_is_not_seen(factor: float, verdict: str) -> None:
    """x2 grows by e^(0.1 theta), theta up to 2, and is multiplied at each jump."""
    G = [[1, 0, 0], [0, factor, 0], [0, 0, 0.9]]
    outcome = _outcome(_with({"jump.G": G, "jump.dwell_time": [1.0, 2.0]}))
    assert outcome.verdict == verdict
    assert _claim(outcome, "attainable").verdict == verdict


def test_samples_that_are_all_lost_at_jumps_promise_no_width() -> None:
    """A jump at every sample, which is not taken then; its twin is taken before the jump.

    The state is observable at other spacings, which is all that is claimed.
    """
    change = {"jump.G": [[1.0, 0], [0, 1]], "jump.dwell_time": [0.1, 0.1],
              "flow.A": [[0, 1], [0, 0]], "output.C": [[1, 0]],
              "output.jump_measurement": "none"}  # fmt: skip
    body = _with(change)
    outcome = _outcome(body)
    assert "along flow and jumps" in _claim(outcome, "observable_window").statement
    assert "every sample falls on a jump" in outcome.warnings[0]
    body["output"]["jump_measurement"] = "before"
    outcome = _outcome(body)
    assert "every window of 8 stages" in _claim(outcome, "observable_window").statement
    assert outcome.verdict == "proved"


OBSERVED = _with({"flow.A": [[0, 1, 0], [0, 0, 1], [0, 0, 0]]})


@pytest.mark.parametrize(("window", "is_long_enough"), [(2, False), (3, True)])
def test_a_window_shorter_than_observability_needs_is_refused(
    window: int, is_long_enough: bool
) -> None:
    body = _with({"observer.window": window}, OBSERVED)
    if is_long_enough:
        assert _claim(_outcome(body), "observable_window").verdict == "proved"
        return
    with pytest.raises(InputError, match=r"observer\.window must be at least 3: .* got 2"):
        _outcome(body)


def test_stages_without_samples_do_not_count() -> None:
    """At jumps a stage of flow and one of a jump share a sample."""
    body = _with({"jump.G": np.eye(3).tolist(), "jump.dwell_time": [1.0, 1.0],
                  "output.measured": "at_jumps"}, OBSERVED)  # fmt: skip
    del body["output"]["period"]
    assert shortest_window(Problem.from_dict(body).plant) == 6
    body["output"]["C"] = [[1, 0, 0], [0, 1, 0]]
    body["output"]["noise_bound"] = [0.03, 0.03]
    assert shortest_window(Problem.from_dict(body).plant) == 4


@pytest.mark.parametrize(("period", "is_narrow"), [(np.pi, False), (1.0, True)])
def test_samples_that_alias_a_mode_leave_no_narrow_bounds(period: float, is_narrow: bool) -> None:
    """A swing that is seen at the same phase every time; pi in binary64 is not quite pi."""
    body = _with({"flow.A": [[0, 1], [-1, 0]], "output.C": [[1, 0]], "output.period": period,
                  "flow.disturbance": {"lower": [-0.1] * 2, "upper": [0.1] * 2}})  # fmt: skip
    widths = [row["width"] for row in _outcome(body).result["states"]]
    assert all(width is not None and width < 2 for width in widths) == is_narrow


@pytest.mark.parametrize(
    ("entry", "value", "named"),
    [
        ("output.noise_bound", None, r"output\.noise_bound is required .* missing"),
        ("flow.D", [[1], [0], [0]], r"flow\.D is refused .* Give bounds as flow\.d_bounds"),
        ("flow.disturbance", {"lower": [0] * 3, "upper": [0, 0, "inf"]},
         r"flow\.disturbance\.upper, entry 3 must be a number"),
    ],
)  # fmt: skip
def test_bounds_that_are_missing_are_named(entry: str, value: Any, named: str) -> None:
    body = _with({entry: value})
    if value is None:
        del body["output"]["noise_bound"]
    with pytest.raises(InputError, match=named):
        _outcome(body)


def test_a_stored_window_that_is_too_short_is_refuted() -> None:
    design = obsdesign.design(Problem.from_dict(OBSERVED)).to_dict()
    design["problem"]["observer"]["window"] = 2
    design["gains"]["window"] = 2
    del design["gains"]["multipliers"]
    outcome = obsdesign.verify(from_dict({**design, "digest": digest(design)}))
    assert outcome.verdict == "refuted"
    assert "at least 3" in outcome.claims[0].evidence["witness"]["reason"]


@pytest.mark.parametrize("measured", ["at_jumps", "periodic"])
@pytest.mark.parametrize("n", [1, 2])
def test_jumps_that_leave_nothing_are_designed(measured: str, n: int) -> None:
    """G = 0: the state after a jump is the disturbance alone."""
    output: dict[str, Any] = {"C": [[1] + [0] * (n - 1)], "noise_bound": [0.1]}
    output |= {"measured": measured} | ({"period": 0.5} if measured == "periodic" else {})
    body = {
        "flow": {"A": (-np.eye(n)).tolist()},
        "jump": {
            "G": np.zeros((n, n)).tolist(), "dwell_time": [1, 2],
            "disturbance": {"lower": [1.0] * n, "upper": [2.0] * n},
        },
        "output": output,
        "observer": {"kind": "set_membership"},
    }  # fmt: skip
    outcome = obsdesign.investigate(obsdesign.Problem.from_dict(body))
    assert outcome.verdict == "proved"


@pytest.mark.parametrize("kick", [5e5, 1e6, 1e8])
def test_a_marginal_mode_that_no_sample_sees_is_refuted_whatever_its_jumps(kick: float) -> None:
    """Its rate is one but for rounding, and the width that multipliers would hold infinite."""
    body = {
        "flow": {"A": [[0.0, 1, 0], [0, 0, 1], [0, 0, 0]],
                 "disturbance": {"lower": [-0.4, -0.2, -0.02], "upper": [0.4, 0.2, 0.02]}},
        "jump": {"disturbance": {"lower": [-0.01, -0.01, -kick], "upper": [0.01, 0.01, kick]},
                 "dwell_time": [0.25, 1]},
        "output": {"C": [[0.0, 1, 0]], "noise_bound": 0.01, "measured": "periodic", "period": 0.05},
        "observer": {"kind": "set_membership"},
    }  # fmt: skip
    assert obsdesign.investigate(obsdesign.Problem.from_dict(body)).verdict == "refuted"
    # the twin: where its sensor is the first state it is seen
    body["output"]["C"] = [[1.0, 0, 0]]
    assert obsdesign.investigate(obsdesign.Problem.from_dict(body)).verdict == "proved"


@pytest.mark.parametrize(("dwell", "window"), [(0.4, 8), (1.0, 16), (2.5, 30)])
def test_a_window_that_is_open_is_long_enough_to_determine_the_state(
    dwell: float, window: int
) -> None:
    """The second state is seen behind the next jump alone, which swaps both."""
    body: dict[str, Any] = {
        "flow": {"A": [[0.5, 0], [0, 0.5]], "disturbance": {"lower": [-1, -1], "upper": [1, 1]}},
        "jump": {"G": [[0, 1], [1, 0]], "dwell_time": [dwell, "inf"]},
        "output": {"C": [[1, 0]], "noise_bound": 0.1, "measured": "periodic", "period": 0.1},
        "observer": {"kind": "set_membership"},
    }
    design = obsdesign.design(obsdesign.Problem.from_dict(body))
    assert design.gains["window"] == window
    # the twin: a shorter one does not
    body["observer"]["window"] = round(dwell / 0.1)
    claims = obsdesign.investigate(obsdesign.Problem.from_dict(body)).claims
    assert next(c for c in claims if c.id == "observable_window").verdict == "undecided"
