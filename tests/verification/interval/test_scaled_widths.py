"""Widths of plants in other units of their states: proved as in good units, and the same widths."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.design_file import from_dict
from obsdesign.document import digest

BASE: dict[str, Any] = {
    "flow": {"A": [[-1, 0], [1, -2]], "disturbance": {"lower": [-0.1] * 2, "upper": [0.1] * 2}},
    "jump": {"G": [[2, 1], [1, 3]], "dwell_time": [2, 5],
             "disturbance": {"lower": [-0.3] * 2, "upper": [0.3] * 2}},
    "output": {"C": [[0, 1]], "noise_bound": [0.03]},
    "observer": {"kind": "interval", "gains": {"L": [[0.0], [0.5]], "M": [[0.9], [2.5]]}},
}  # fmt: skip
PERIODIC = {"measured": "periodic", "period": 0.1}


def in_units(sizes: tuple[float, float], jumps: bool, output: dict[str, Any]) -> dict[str, Any]:
    """The plant with x = D z, D = diag(sizes), and its gains."""
    body, d = copy.deepcopy(BASE), np.array(sizes)
    body["output"] |= output
    if not jumps:
        del body["jump"], body["observer"]["gains"]["M"]
    for name, matrix in (("flow", "A"), ("jump", "G")):
        if name in body:
            part = body[name]
            part[matrix] = (d[:, None] * np.array(part[matrix]) / d).tolist()
            ends = part["disturbance"]
            part["disturbance"] = {end: (d * np.array(x)).tolist() for end, x in ends.items()}
    body["output"]["C"] = (np.array(body["output"]["C"]) / d).tolist()
    gains = body["observer"]["gains"]
    body["observer"]["gains"] = {
        name: (d[:, None] * np.array(X)).tolist() for name, X in gains.items()
    }
    return body


def widths(body: dict[str, Any]) -> dict[str, np.ndarray]:
    """`always` of each claim about widths, all of them proved."""
    outcome = obsdesign.investigate(obsdesign.Problem.from_dict(body))
    assert {c.verdict for c in outcome.claims} == {"proved"}
    return {c.id: np.array(c.evidence["always"]) for c in outcome.claims if "always" in c.evidence}


@pytest.mark.parametrize("jumps", [True, False])
@pytest.mark.parametrize("output", [{}, PERIODIC])
def test_units_of_the_states_cost_no_width(jumps: bool, output: dict[str, Any]) -> None:
    plain = widths(in_units((1.0, 1.0), jumps, output))
    assert set(plain) == ({"sampled_stability"} if output else {"width", "sampled_width"})
    for sizes in ((3e-8, 7e7), (1e-8, 1e-8)):
        scaled = widths(in_units(sizes, jumps, output))
        assert set(scaled) == set(plain)
        for claim in set(plain) - {
            "sampled_width"
        }:  # the step limit that is found depends on units
            assert scaled[claim] / sizes == pytest.approx(plain[claim], rel=1e-3)


@pytest.mark.parametrize("sizes", [(1e-8, 1e8), (1e8, 1e-8)])
def test_states_that_do_not_depend_on_each_other_have_units_of_their_own(
    sizes: tuple[float, float],
) -> None:
    body = in_units(sizes, True, {})
    body["flow"]["A"] = [[-1, 0], [0, -2]]
    body["jump"]["G"] = [[1.5, 0], [0, 3]]
    body["observer"]["gains"] = {"L": [[0.0], [0.0]], "M": [[0.0], [2.5 * sizes[1]]]}
    plain = copy.deepcopy(body)
    for part in ("flow", "jump"):
        ends = plain[part]["disturbance"]
        plain[part]["disturbance"] = {e: (np.array(x) / sizes).tolist() for e, x in ends.items()}
    plain["output"]["C"] = [[0, 1]]
    plain["observer"]["gains"]["M"] = [[0.0], [2.5]]
    assert widths(body)["width"] / sizes == pytest.approx(widths(plain)["width"], rel=1e-3)


@pytest.mark.parametrize("output", [{}, PERIODIC])
@pytest.mark.parametrize("state", [0, 1])
def test_a_width_too_small_in_one_state_is_not_proved_in_any_units(
    output: dict[str, Any], state: int
) -> None:
    """The twin: the bound of one state alone is cut to nine tenths."""
    claim = "sampled_stability" if output else "width"
    body = in_units((3e-8, 7e7), True, output)
    written = obsdesign.investigate(obsdesign.Problem.from_dict(body)).design.to_dict()
    evidence = next(c for c in written["claims"] if c["id"] == claim)["evidence"]
    evidence["always"][state] *= 0.9
    outcome = obsdesign.verify(from_dict({**written, "digest": digest(written)}))
    assert {c.id: c.verdict for c in outcome.claims}[claim] == "undecided"
