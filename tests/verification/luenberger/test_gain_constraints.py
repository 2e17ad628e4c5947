"""Convex constraints on gains: met, proved from the file, and refuted where they fail."""

from __future__ import annotations

import dataclasses
import itertools
import tomllib
from pathlib import Path
from typing import Any

import cvxpy as cp
import numpy as np
import pytest

import obsdesign
from obsdesign.analysis.hidden_modes import fixed_parts
from obsdesign.verification.answers import reason
from obsdesign.verification.gain_constraints import _structure
from obsdesign.verification.luenberger.claims import claims
from tests.systems.luenberger import BASE, problem

REGION = {"decay": 1.0, "disc": {"centre": -3.0, "radius": 2.5}, "sector": 0.8}
STRUCTURE = {"L": [[1, 0], [1, 0], [0, 1]], "M": [[1, 0], [0, 0], [0, 1]]}
SERVO = {
    "flow": {"A": [[0, 1], [0, -0.5]]},
    "jump": {"G": [[1, 0], [0, 0.6]], "dwell_time": [0.2, "inf"]},
    "output": {"C": [[1, 0]]},
    "observer": {"kind": "luenberger", "gain_norm": {"L": 60.0},
                 "structure": {"L": [[1], [1]], "M": [[1], [0]]},
                 "region": {"disc": {"centre": -4.0, "radius": 1.0},
                            "jump_disc": {"centre": 0.5, "radius": 0.4}}},
}  # fmt: skip
TANKS = {
    "flow": {"A": [[-0.2, 0.2, 0], [0.2, -0.4, 0.2], [0, 0.2, 0.1]]},
    "output": {"C": [[1, 0, 0], [0, 0, 1]]},
    "observer": {"kind": "luenberger", "structure": {"L": [[1, 0], [0, 0], [0, 1]]},
                 "region": {"decay": 0.25, "sector": 0.5}},
}  # fmt: skip
PLANTS = {
    "academic": problem(observer__structure=STRUCTURE, observer__region=REGION),
    "servo": obsdesign.Problem.from_dict(SERVO),
    "tanks": obsdesign.Problem.from_dict(TANKS),
}


def verdicts(outcome: obsdesign.Outcome) -> dict[str, str]:
    return {claim.id: claim.verdict for claim in outcome.claims}


def inside(values: np.ndarray, region: dict[str, Any]) -> bool:
    disc = region.get("disc", {"centre": 0.0, "radius": np.inf})
    return bool(
        np.all(values.real < -region.get("decay", -np.inf))
        and np.all(abs(np.angle(-values)) < region.get("sector", np.pi))
        and np.all(abs(values - disc["centre"]) < disc["radius"])
    )


@pytest.mark.parametrize("name", PLANTS)
def test_structure_and_region_are_fulfilled_and_proved(name: str) -> None:
    stated = PLANTS[name]
    options: dict[str, Any] = stated.to_dict()["observer"]
    design = obsdesign.design(stated)
    assert verdicts(obsdesign.verify(design, paranoid=True)).items() >= {
        "structure": "proved", "region": "proved", "document": "proved",
    }.items()  # fmt: skip
    L, M, C = (design.gains[key] for key in "LMC")
    for gain, pattern in options["structure"].items():
        assert not design.gains[gain][np.array(pattern) == 0].any()
    assert inside(np.linalg.eigvals(design.gains["A"] - L @ C), options["region"])
    if name == "servo":
        assert np.linalg.norm(L, 2) <= 60
        errors = np.linalg.eigvals(np.array(SERVO["jump"]["G"]) - M @ C)
        assert np.all(abs(errors - 0.5) < 0.4)
    sentences = [guarantee.statement for guarantee in design.guarantees if guarantee.given]
    assert any(text.startswith("All eigenvalues of A - L C ") for text in sentences)


@pytest.mark.parametrize(("name", "gain"), [("academic", "L"), ("academic", "M"), ("servo", "M")])
def test_an_entry_that_is_not_zero_refutes_the_structure(name: str, gain: str) -> None:
    design = obsdesign.design(PLANTS[name])
    wrong = design.gains[gain].copy()
    i, j = np.argwhere(np.array(PLANTS[name].to_dict()["observer"]["structure"][gain]) == 0)[-1]
    wrong[i, j] = 1e-300
    forged = dataclasses.replace(design, gains={**design.gains, gain: wrong})
    claim = next(c for c in obsdesign.verify(forged).claims if c.id == "structure")
    assert claim.verdict == "refuted"
    witness = claim.evidence["witness"]
    assert (witness["gain"], witness["row"], witness["column"]) == (gain, i + 1, j + 1)


def test_norms_limit_the_gains_and_cost_room() -> None:
    wide = obsdesign.design(problem(observer__gain_norm={"L": 100.0}))
    free = np.linalg.norm(wide.gains["L"], 2)
    tight = {"L": 0.6 * float(free), "M": 0.2}
    design = obsdesign.design(problem(observer__gain_norm=tight))
    assert np.linalg.norm(design.gains["L"], 2) <= tight["L"]
    assert 0 < np.linalg.norm(design.gains["M"], 2) <= tight["M"]
    assert verdicts(obsdesign.verify(design))["gain_norm"] == "proved"
    # with a schedule every cell has its own gain, and its own norm
    scheduled = obsdesign.design(problem(observer__gain_norm=tight, observer__schedule=2))
    assert max(np.linalg.norm(M, 2) for M in scheduled.gains["M_cells"]) <= tight["M"]
    cells = 5.0 * scheduled.gains["M_cells"]
    forged = dataclasses.replace(scheduled, gains={**scheduled.gains, "M_cells": cells})
    claim = next(c for c in obsdesign.verify(forged).claims if c.id == "gain_norm")
    assert (claim.verdict, claim.evidence["witness"]["gain"]) == ("refuted", "M_cells[0]")


def test_given_gains_are_checked_at_the_borders_of_a_constraint() -> None:
    gains = {"L": [[3, 0], [0, 4], [0, 0]], "M": [[0, 0]] * 3}
    diagonal = {"flow__A": np.diag([-1.0, -2, -3]).tolist(), "output__C": [[0, 0, 0]] * 2}
    for constraint, verdict in [
        ({"gain_norm": {"L": 4.0}}, "proved"),
        ({"gain_norm": {"L": 4 - 1e-15}}, "refuted"),
        ({"structure": {"L": [[1, 0], [0, 1], [0, 0]]}}, "proved"),
        ({"structure": {"L": [[1, 0], [0, 0], [0, 0]]}}, "refuted"),
        ({"region": {"decay": 1 - 1e-15}}, "proved"),
        ({"region": {"decay": 1.0}}, "refuted"),
        ({"region": {"disc": {"centre": -2.0, "radius": 1 + 1e-15}}}, "proved"),
        ({"region": {"disc": {"centre": -2.0, "radius": 1.0}}}, "refuted"),
    ]:
        options = {f"observer__{name}": value for name, value in constraint.items()}
        outcome = obsdesign.investigate(problem(observer__gains=gains, **diagonal, **options))
        (name,) = constraint
        assert verdicts(outcome)[name] == verdict, constraint
        if verdict == "refuted":
            assert outcome.verdict == "refuted"
            claim = next(c for c in outcome.claims if c.id == name)
            assert claim.evidence["witness"]["of_all_gains"]
            assert reason(claim) != claim.statement


def test_structure_that_leaves_an_unstable_mode_alone_refutes_every_gain() -> None:
    no_third = {"L": [[1, 1], [1, 1], [0, 0]]}
    outcome = obsdesign.investigate(
        problem(observer__structure=no_third, observer__region={"decay": 0.1})
    )
    claim = next(c for c in outcome.claims if c.id == "region")
    assert outcome.verdict == "refuted"
    assert reason(claim).endswith("and no L within observer.structure moves it")
    # hidden from the outputs that are used, between jumps and at them
    first_only = {"L": [[1, 0]] * 3, "M": [[1, 0]] * 3}
    apart = {"flow__A": [[0, 1, 0], [-2, 0.1, 0], [0, 0, 0.2]], "jump__G": np.eye(3).tolist()}
    outcome = obsdesign.investigate(problem(observer__structure=first_only, **apart))
    assert outcome.verdict == "refuted"
    assert "no gain within observer.structure" in reason(outcome.claims[-1])
    # the twins: one more entry, or a mode that decays
    more = {"L": [[1, 0], [1, 0], [1, 1]], "M": [[1, 0]] * 3}
    assert obsdesign.investigate(problem(observer__structure=more, **apart)).verdict == "proved"
    apart["flow__A"][2][2] = -0.2
    stable = obsdesign.investigate(problem(observer__structure=first_only, **apart))
    assert stable.verdict == "proved"


@pytest.mark.parametrize(
    ("name", "pattern"),
    [("academic", [[1, 1], [1, 1], [0, 0]]), ("servo", [[1], [0]]), ("tanks", [[0, 0]] * 3)],
)
def test_a_structure_out_of_reach_of_the_region_is_refuted(
    name: str, pattern: list[list[int]]
) -> None:
    body = PLANTS[name].to_dict()
    body["observer"]["structure"] = {"L": pattern}
    outcome = obsdesign.investigate(obsdesign.Problem.from_dict(body))
    assert outcome.verdict == "refuted"
    claim = next(c for c in outcome.claims if c.id == "region")
    assert claim.evidence["witness"]["of_all_gains"]
    assert reason(claim).endswith("and no L within observer.structure moves it")


def test_the_example_of_the_page_is_proved_and_needs_its_constraints() -> None:
    page = (Path(__file__).parents[3] / "docs" / "luenberger.md").read_text("utf-8")
    body = tomllib.loads(page.split('title="carriages.toml"')[1].split("```")[0])
    design = obsdesign.design(obsdesign.Problem.from_dict(body))
    assert np.linalg.norm(design.gains["M"], 2) <= 0.5
    body["observer"] = {"kind": "luenberger"}
    free = obsdesign.design(obsdesign.Problem.from_dict(body)).gains
    L, M, C = free["L"], free["M"], free["C"]
    assert np.linalg.norm(M, 2) == pytest.approx(1.03, abs=0.005)
    angles = np.angle(-np.linalg.eigvals(free["A"] - L @ C))
    assert np.abs(angles).max() == pytest.approx(1.10, abs=0.005)
    assert np.abs(L).min() > 0.1


def test_constraints_for_which_no_gain_is_known_leave_the_answer_open() -> None:
    outcome = obsdesign.investigate(
        problem(observer__gain_norm={"L": 0.1}, observer__region={"decay": 0.3})
    )
    assert outcome.verdict == "undecided"
    assert outcome.result["remarks"] == [
        "no L was found for observer.gain_norm and observer.region; the condition used is "
        "sufficient, not necessary"
    ]


def test_fixed_parts_keep_their_eigenvalues_under_every_gain_of_the_pattern() -> None:
    rng = np.random.default_rng(3)
    counted = 0
    for _ in range(40):
        A = rng.integers(-3, 4, (4, 4)) * (rng.random((4, 4)) < 0.4)
        C = rng.integers(-2, 3, (2, 4)) * (rng.random((2, 4)) < 0.6)
        pattern = rng.random((4, 2)) < 0.3
        K = rng.standard_normal((4, 2)) * pattern
        changed = np.linalg.eigvals(A - K @ C)
        for (part,) in fixed_parts([A], C, pattern):
            for value in np.linalg.eigvals(part.astype(float)):
                assert np.abs(changed - value).min() < 1e-3 * (1 + abs(value))
                counted += 1
    assert counted > 20


def test_constraints_from_python_reach_both_gains() -> None:
    called = []

    def constraints(v: Any) -> list[Any]:
        called.append("L" if v.PM is None else "M")
        if v.PL is None:
            return [v.PM[1, :] == 0, v.P[1, [0, 2]] == 0]
        return [v.PL[:, 1] == 0, cp.trace(v.P) <= 1e6]

    design = obsdesign.design(problem(), constraints=constraints)
    assert set(called) == {"L", "M"}
    np.testing.assert_allclose(design.gains["L"][:, 1], 0, atol=1e-7)
    np.testing.assert_allclose(design.gains["M"][1], 0, atol=1e-7)
    assert obsdesign.verify(design).verdict == "proved"
    # without them neither vanishes
    free = obsdesign.design(problem())
    assert np.abs(free.gains["L"][:, 1]).max() > 0.1
    assert np.abs(free.gains["M"][1]).max() > 0.05


STABLE = {"flow__A": [[-1, 0.1, 0], [0, -2, 0], [0, 0, -3]], "jump__G": (0.5 * np.eye(3)).tolist()}


@pytest.mark.parametrize("gain", ["L", "M"])
@pytest.mark.parametrize("schedule", [{}, {"observer__schedule": 2}])
def test_constraints_that_nothing_meets_leave_no_design(
    gain: str, schedule: dict[str, Any]
) -> None:
    # zero gains would be proved, and do not meet them
    def constraints(v: Any) -> list[Any]:
        product = v.PL if gain == "L" else v.PM
        return [] if product is None else [product[0, 0] >= 1, product[0, 0] <= 0]

    outcome = obsdesign.investigate(problem(**STABLE, **schedule), constraints=constraints)
    assert outcome.verdict == "undecided"
    assert f"no {gain} was found for constraints" in outcome.result["remarks"][-1]
    met = obsdesign.investigate(problem(**STABLE, **schedule), constraints=lambda v: [])
    assert met.verdict == "proved"


def test_constraints_that_restrict_nothing_are_remarked() -> None:
    def remarks(**region: Any) -> list[str]:
        outcome = obsdesign.investigate(problem(observer__region=region))
        assert outcome.verdict == "proved"
        return list(outcome.result.get("remarks", []))

    def text(name: str, gain: str) -> str:
        return (
            f"observer.region.{name} restricts nothing by itself: the {gain} chosen without constraints "
            "meets it"
        )

    huge = {"centre": -3.0, "radius": 1e9}
    assert remarks(disc=huge, jump_disc=huge) == [text("disc", "L"), text("jump_disc", "M")]
    assert remarks(disc=huge, decay=3.0) == [text("disc", "L")]
    with pytest.raises(obsdesign.InputError, match=r"region\.decay must be a number >= 0; got -5"):
        problem(observer__region={"decay": -5})


@pytest.mark.parametrize("exponent", [-20, 20])
def test_the_unit_of_time_does_not_matter(exponent: int) -> None:
    unit = 2.0**exponent
    A = (np.array(BASE["flow"]["A"]) * unit).tolist()
    disc = {"centre": -3 * unit, "radius": 2.5 * unit}
    scaled = obsdesign.design(problem(
        flow__A=A, jump__dwell_time=[0.3 / unit, 2 / unit], observer__gain_norm={"L": 9 * unit},
        observer__structure=STRUCTURE, observer__region={"decay": unit, "disc": disc},
    ))  # fmt: skip
    disc = {"centre": -3.0, "radius": 2.5}
    plain = obsdesign.design(problem(
        observer__gain_norm={"L": 9.0}, observer__structure=STRUCTURE,
        observer__region={"decay": 1.0, "disc": disc},
    ))  # fmt: skip
    np.testing.assert_allclose(scaled.gains["L"] / unit, plain.gains["L"], rtol=1e-4)


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"observer__poles": [-1, -2, -3], "observer__region": {"decay": 0.1}}, "observer.poles fixes L, and observer.region chooses it too; drop one."),
        ({"observer__weights": {"state": [1, 1, 1]}, "observer__gain_norm": {"L": 1.0}}, "observer.weights fixes L, and observer.gain_norm chooses it too; drop one."),
        ({"observer__structure": {"L": [[1, 0]]}}, "observer.structure.L must be 3x2 (n states, p outputs), as the gain is; got 1x2."),
        ({"observer__structure": {"L": [[1, 0], [2, 0], [0, 0]]}}, "observer.structure.L must hold 0 (the entry is zero) and 1 (it is free); got 2.0."),
        ({"observer__gain_norm": {"L": 0}}, "observer.gain_norm.L must be a positive number; got 0."),
        ({"observer__region": {"sector": 2}}, "observer.region.sector must be a half angle in radians, between 0 and pi/2; got 2."),
        ({"observer__region": {"disc": {"centre": -1}}}, "observer.region.disc.radius is required; it is missing."),
        ({"observer__region": {}}, "observer.region must be a table of decay, disc, sector (of A - L C) and jump_disc (of the error's matrix at jumps); got {}."),
    ],
)  # fmt: skip
def test_constraints_that_cannot_be_read(changes: dict[str, Any], line: str) -> None:
    with pytest.raises(obsdesign.InputError) as error:
        obsdesign.investigate(problem(**changes))
    assert str(error.value) == line


def test_a_region_at_jumps_needs_jumps() -> None:
    body = {
        **TANKS,
        "observer": {"kind": "luenberger", "region": {"jump_disc": {"centre": 0, "radius": 1}}},
    }
    with pytest.raises(
        obsdesign.InputError, match=r"^\[jump\] is required by observer.region.jump_disc; it"
    ):
        obsdesign.Problem.from_dict(body)


def test_constraints_that_cannot_be_used() -> None:
    zeros = {"L": [[0, 0]] * 3, "M": [[0, 0]] * 3}
    kept = obsdesign.Problem.from_dict({**TANKS, "observer": {"kind": "unknown_input"}})
    cases: list[tuple[obsdesign.Problem, Any, str]] = [
        (problem(), lambda v: [cp.norm(v.P) >= 1], "constraints: constraints and objective must be convex by CVXPY's rules (DCP)."),
        (problem(), lambda v: [True], "constraints: a list of CVXPY constraints is required for L; got [True]."),
        (problem(observer__gains=zeros), lambda v: [], "constraints choose L and M, but both are given or must be zero."),
        (kept, lambda v: [], "constraints are available for kinds 'interval' and 'luenberger'; got 'unknown_input'."),
    ]  # fmt: skip
    for stated, constraints, line in cases:
        with pytest.raises(obsdesign.InputError) as error:
            obsdesign.design(stated, constraints=constraints)
        assert str(error.value) == line


def test_a_spoilt_region_is_not_proved() -> None:
    stated = PLANTS["servo"]
    design = obsdesign.design(stated)
    for gain, share in itertools.product("LM", (0.0, 3.0)):
        wrong = {**design.gains, gain: share * design.gains[gain]}
        claim = next(c for c in claims(stated, wrong, {}) if c.id == "region")
        assert (claim.verdict, claim.evidence["witness"]["gain"]) == ("refuted", gain)


@pytest.mark.parametrize("option", [{"gain_norm": {"M": 1.0}}, {"structure": {"M": [[1], [0]]}}])
def test_a_gain_at_jumps_of_a_plant_without_jumps_is_refused(option: dict[str, Any]) -> None:
    body = {
        "flow": {"A": [[-1, 0], [1, -2]]},
        "output": {"C": [[0, 1]]},
        "observer": {"kind": "luenberger", **option},
    }
    with pytest.raises(obsdesign.InputError, match=r"^\[jump\] is required by observer\..*\.M; it"):
        obsdesign.Problem.from_dict(body)
    # the twin: of L it may be said
    (name, entry) = next(iter(option.items()))
    body["observer"][name] = {"L": entry["M"]}
    assert obsdesign.Problem.from_dict(body).kind == "luenberger"


def test_zeros_of_a_structure_are_counted_and_kept() -> None:
    pattern, K = np.array([[1, 0], [0, 0]]), np.array([[3.0, 0.0], [0.0, 0.0]])
    assert _structure(K, pattern).evidence["zeros"] == 3
    K[1, 0] = 1e-300
    verdict = _structure(K, pattern)
    assert verdict.outcome == "refuted"
    assert (verdict.evidence["witness"]["row"], verdict.evidence["witness"]["column"]) == (2, 1)
