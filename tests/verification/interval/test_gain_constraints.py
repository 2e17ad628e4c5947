"""Constraints on the gains of interval observers: met, proved from the file, refuted by witness."""

from __future__ import annotations

import copy
import dataclasses
import tomllib
from pathlib import Path
from typing import Any

import cvxpy as cp
import numpy as np
import pytest

import obsdesign
from obsdesign.verification.answers import reason

BASE: dict[str, Any] = {
    "flow": {"A": [[-1, 0], [1, -2]], "disturbance": {"lower": [-0.1, -0.1], "upper": [0.1, 0.1]}},
    "jump": {"G": [[2, 1], [1, 3]], "dwell_time": [1.0, "inf"],
             "disturbance": {"lower": [-0.3, -0.3], "upper": [0.3, 0.3]}},
    "output": {"C": [[0, 1]], "noise_bound": [0.03]},
    "observer": {"kind": "interval", "form": "cooperative"},
}  # fmt: skip


def problem(**changes: Any) -> obsdesign.Problem:
    """The plant of Degue's first example with other entries, named block__key."""
    body = copy.deepcopy(BASE)
    for path, value in changes.items():
        block, key = path.split("__")
        body[block][key] = value
    return obsdesign.Problem.from_dict(body)


def stated(**options: Any) -> obsdesign.Problem:
    return problem(**{f"observer__{name}": value for name, value in options.items()})


def verdicts(outcome: obsdesign.Outcome) -> dict[str, str]:
    return {claim.id: claim.verdict for claim in outcome.claims}


STRUCTURE = {"L": [[0], [1]], "M": [[1], [0]]}
REGION = {"decay": 0.9, "sector": 0.5, "jump_disc": {"centre": 1.0, "radius": 1.2}}


def test_structure_norm_and_region_are_met_and_proved() -> None:
    design = obsdesign.design(
        stated(structure=STRUCTURE, gain_norm={"L": 0.6, "M": 0.9}, objective="narrowest")
    )
    L, M = design.gains["L"], design.gains["M"]
    assert L[0, 0] == 0 == M[1, 0]
    assert 0 < np.linalg.norm(L, 2) <= 0.6
    assert 0 < np.linalg.norm(M, 2) <= 0.9
    again = verdicts(obsdesign.verify(design, paranoid=True))
    assert set(again.values()) == {"proved"}
    assert again.keys() >= {"structure", "gain_norm"}
    given = [guarantee.statement for guarantee in design.guarantees if guarantee.given]
    assert "L is zero where [[0], [1]] is and M is zero where [[1], [0]] is." in given
    # the twin: without them both are left
    free = obsdesign.design(stated(objective="narrowest")).gains
    assert np.linalg.norm(free["L"], 2) > 0.6
    assert free["M"][1, 0] != 0


@pytest.mark.parametrize(
    ("form", "given"),
    [("cooperative", {}), ("split", {}), ("coordinates", {"S": [[1, 0.25], [0.5, 1]]})],
)
def test_regions_hold_in_every_form(form: str, given: dict[str, Any]) -> None:
    design = obsdesign.design(stated(region=REGION, form=form, gains=given))
    F = design.gains["A"] - design.gains["L"] @ design.gains["C"]
    H = design.gains["G"] - design.gains["M"] @ design.gains["C"]
    flow, jump = np.linalg.eigvals(F), np.linalg.eigvals(H)
    assert flow.real.max() < -0.9
    assert np.abs(np.angle(-flow)).max() < 0.5
    assert np.abs(jump - 1.0).max() < 1.2
    assert verdicts(obsdesign.verify(design))["region"] == "proved"


def test_a_structure_is_one_of_the_plant_in_any_coordinates() -> None:
    for S in ([[1, 0.25], [0.5, 1]], [[1, 0], [0, 1]]):
        design = obsdesign.design(stated(
            structure={"M": [[1], [0]]}, form="coordinates", gains={"S": S},
        ))  # fmt: skip
        assert design.gains["M"][1, 0] == 0
        assert verdicts(obsdesign.verify(design))["structure"] == "proved"


@pytest.mark.parametrize(
    ("name", "changed"),
    [("structure", ("M", [[1.0], [1e-300]])), ("gain_norm", ("L", [[0.0], [0.6000001]])),
     ("region", ("M", [[1.0], [0.5]]))],
)  # fmt: skip
def test_gains_beyond_their_constraints_refute(name: str, changed: tuple[str, Any]) -> None:
    entry = {"structure": STRUCTURE, "gain_norm": {"L": 0.6}, "region": REGION}[name]
    design = obsdesign.design(stated(**{name: entry}))
    gain, wrong = changed
    forged = dataclasses.replace(design, gains={**design.gains, gain: np.array(wrong)})
    claim = next(c for c in obsdesign.verify(forged).claims if c.id == name)
    assert (claim.verdict, claim.evidence["witness"]["gain"]) == ("refuted", gain)


def test_a_structure_that_leaves_a_growing_part_alone_refutes_every_gain() -> None:
    # x2 grows ninefold at each jump, and only x1 may be corrected
    grows = {"flow__A": [[-1, 0], [0, -2]], "jump__G": [[0.5, 0], [0, 9]]}
    outcome = obsdesign.investigate(
        problem(observer__structure={"L": [[1], [0]], "M": [[1], [0]]}, **grows)
    )
    assert outcome.verdict == "refuted"
    claim = next(c for c in outcome.claims if c.verdict == "refuted")
    assert claim.id == "attainable"
    assert claim.evidence["witness"]["of_all_gains"]
    assert "no gain within observer.structure changes that part of the error" in reason(claim)
    # the twin: one entry more
    twin = problem(observer__structure={"L": [[1], [0]], "M": [[0], [1]]}, **grows)
    assert obsdesign.investigate(twin).verdict == "proved"


def test_a_sign_that_the_structure_keeps_refutes_the_form() -> None:
    # C sees x2: only row 1 of M makes entry (1, 2) of G - M C nonnegative
    negative = {"jump__G": [[0.5, -1], [0, 0.5]]}
    outcome = obsdesign.investigate(problem(observer__structure={"M": [[0], [1]]}, **negative))
    assert outcome.verdict == "refuted"
    text = reason(next(c for c in outcome.claims if c.id == "attainable"))
    assert text.startswith("entry (1, 2) of the jump matrix of the error is -1, and no gain")
    twin = problem(observer__structure={"M": [[1], [0]]}, **negative)
    assert obsdesign.investigate(twin).verdict == "proved"


def test_rows_that_no_entry_corrects_keep_their_widths() -> None:
    # |A| of the first two states is not Hurwitz, A is: the form cannot, other coordinates may
    body = {
        "flow": {"A": [[-1, 2, 0], [-2, -1, 0], [0, 0, 1]]},
        "output": {"C": [[1, 1, 1]], "noise_bound": [0.1]},
        "observer": {"kind": "interval", "form": "split", "structure": {"L": [[0], [0], [1]]}},
    }
    outcome = obsdesign.investigate(obsdesign.Problem.from_dict(body))
    assert outcome.verdict == "refuted"
    assert "no gain within observer.structure can touch rows 1, 2 of" in reason(
        next(c for c in outcome.claims if c.id == "attainable")
    )
    body["flow"]["A"] = [[-1, 0.5, 0], [-0.5, -1, 0], [0, 0, 1]]
    assert obsdesign.investigate(obsdesign.Problem.from_dict(body)).verdict == "proved"


def test_a_norm_too_small_is_undecided_without_a_witness() -> None:
    often = {"jump__dwell_time": [0.75, "inf"]}
    outcome = obsdesign.investigate(problem(**often, observer__gain_norm={"L": 0.1, "M": 0.1}))
    assert outcome.verdict == "undecided"
    assert not any(claim.verdict == "refuted" for claim in outcome.claims)
    wide = problem(**often, observer__gain_norm={"L": 4.0, "M": 4.0})
    assert obsdesign.investigate(wide).verdict == "proved"


def test_constraints_that_restrict_nothing_are_remarked() -> None:
    text = "form cooperative: observer.region.jump_disc restricts nothing by itself: the M chosen without constraints meets it"  # fmt: skip
    wide = {"jump_disc": {"centre": 0.0, "radius": 1e6}}
    assert text in obsdesign.investigate(stated(region=wide)).result["remarks"]
    tight = {"jump_disc": {"centre": 2.0, "radius": 0.2}}
    outcome = obsdesign.investigate(stated(region=tight))
    assert outcome.verdict == "proved"
    assert text not in outcome.result.get("remarks", ())


def test_constraints_from_python_reach_both_gains() -> None:
    called = []

    def constraints(v: Any) -> list[Any]:
        called.append("L" if v.PM is None else "M")
        if v.PL is None:  # |M_1| <= 1/2
            return [cp.abs(v.PM[0]) <= 0.5 * v.P[0, 0]]
        return [v.PL[1, 0] >= 2 * v.P[1, 1]]  # L_2 >= 2

    design = obsdesign.design(stated(form="auto", objective="feasible"), constraints=constraints)
    assert {*called} == {"L", "M"}
    assert abs(design.gains["M"][0, 0]) <= 0.5 * (1 + 1e-6)
    assert design.gains["L"][1, 0] >= 2 * (1 - 1e-6)
    assert obsdesign.verify(design).verdict == "proved"
    assert design.provenance["solver"]["name"].startswith("CVXPY/Clarabel")
    free = obsdesign.design(stated(form="auto", objective="feasible")).gains
    assert free["M"][0, 0] > 0.5
    assert free["L"][1, 0] < 2


def test_constraints_from_python_that_nothing_meets_leave_no_design() -> None:
    # stable as it is: zero gains would be proved, and do not meet them
    quiet = {"jump__G": [[0.1, 0], [0, 0.1]]}
    posed = problem(**quiet, observer__gain_limit=1.0)
    outcome = obsdesign.investigate(
        posed, constraints=lambda v: [] if v.PL is None else [v.PL[1, 0] >= 9 * cp.trace(v.P)]
    )
    assert outcome.verdict == "undecided"
    assert outcome.result["remarks"] == [
        "form cooperative: no gains were found for constraints; the condition is sufficient, not "
        "necessary"
    ]
    assert obsdesign.investigate(posed).verdict == "proved"
    with pytest.raises(obsdesign.InputError, match=r"must be convex by CVXPY's rules"):
        obsdesign.investigate(problem(**quiet), constraints=lambda v: [cp.norm(v.P) >= 1])


PERIODIC = {"output__measured": "periodic", "output__period": 0.05}


def test_with_samples_as_events_the_gain_at_samples_is_constrained() -> None:
    options = {"structure": {"L": [[0], [1]]}, "gain_norm": {"L": 0.5}}
    design = obsdesign.design(
        problem(**PERIODIC, **{f"observer__{key}": value for key, value in options.items()})
    )
    assert design.gains["L"][0, 0] == 0
    assert 0 < np.linalg.norm(design.gains["L"], 2) <= 0.5
    assert verdicts(obsdesign.verify(design)).items() >= {
        "structure": "proved", "gain_norm": "proved", "sampled_stability": "proved",
    }.items()  # fmt: skip
    limited = obsdesign.design(
        problem(**PERIODIC),
        constraints=lambda v: [v.PL[1, 0] <= 0.25 * v.P[1, 1], v.PL[0, 0] == 0],
    )
    assert 0 < limited.gains["L"][1, 0] <= 0.25 * (1 + 1e-6)
    assert obsdesign.design(problem(**PERIODIC)).gains["L"][1, 0] > 0.5
    with pytest.raises(obsdesign.InputError, match=r"^observer\.region is about A - L C"):
        problem(**PERIODIC, observer__region={"decay": 0.1})


def test_the_example_of_the_page_is_proved() -> None:
    page = (Path(__file__).parents[3] / "docs" / "interval.md").read_text("utf-8")
    body = tomllib.loads(page.split('title="one_entry.toml"')[1].split("```")[0])
    design = obsdesign.design(obsdesign.Problem.from_dict(body))
    assert design.gains["M"][1, 0] == 0
    assert np.linalg.norm(design.gains["M"], 2) <= 2.0
