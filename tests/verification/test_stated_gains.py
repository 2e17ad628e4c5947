"""Stated poles and weights against the gains: placed, proved, forged; and what refutes all gains."""

from __future__ import annotations

import copy
import json
from typing import Any

import numpy as np
import pytest

import obsdesign
from lmi.arithmetic.balls import exact
from obsdesign.analysis.stated_poles import gap
from obsdesign.synthesis.placement import placed_gain
from obsdesign.verification.stated_poles import poles_claim
from tests.systems.impulsive_input import CHAIN

# chains that float placement turned into flows that grow
ILL: dict[str, tuple[Any, Any, Any]] = {
    "chain": (
        (np.diag([-4.56, 1.56, 1.72, 0.9, 2.8]) + np.diag(np.ones(4), 1)).tolist(),
        [[1.0, 0, 0, 0, 0]],
        [-0.01, -0.011, -0.012, -0.013, -0.014],
    ),
    "longer chain": (
        (np.diag([-3.1, 1.2, 1.9, 0.7, 2.5, 1.1]) + np.diag(np.ones(5), 1)).tolist(),
        [[1.0, 0, 0, 0, 0, 0]],
        [-0.01, -0.011, -0.012, -0.013, -0.014, -0.015],
    ),
    "equal poles": (
        (np.diag([2.0, -1.0, 0.5]) + np.diag(np.ones(2), 1)).tolist(), [[1.0, 0, 0]], [-1, -1, -1],
    ),
}  # fmt: skip
FLOW: dict[str, Any] = {"A": [[0, 1], [-2, -0.3]]}
SEEN: dict[str, Any] = {
    "flow": {"A": [[0, 1, 0], [-2, -3, 1], [0, 0, 1]], "D": [[0], [0], [1]]},
    "output": {"C": [[1, 0, 0], [0, 0, 1]], "measured": "periodic", "period": 0.1},
    "observer": {"kind": "unknown_input"},
}


def luenberger(A: Any, C: Any, **observer: Any) -> obsdesign.Problem:
    body = {"flow": {"A": A}, "output": {"C": C}, "observer": {"kind": "luenberger", **observer}}
    return obsdesign.Problem.from_dict(body)


def verdict_of(body: Any, **observer: Any) -> str:
    """The verdict on a design file with other options, signed again."""
    changed = copy.deepcopy(body)
    changed["problem"]["observer"] |= observer
    claims = [obsdesign.document.Claim(**claim) for claim in changed["claims"]]
    guarantees = tuple(
        obsdesign.document.Guarantee(g["statement"], tuple(g["claims"]), g["given"])
        for g in changed["guarantees"]
    )
    design = obsdesign.document.Design(
        changed["name"], changed["kind"], changed["problem"],
        {name: np.array(v) if isinstance(v, list) else v for name, v in changed["gains"].items()},
        tuple(claims), guarantees, tuple(changed["warnings"]), changed["provenance"],
    )  # fmt: skip
    return obsdesign.verify(design).verdict


def saved(problem: obsdesign.Problem) -> Any:
    return json.loads(json.dumps(obsdesign.design(problem).to_dict()))


@pytest.mark.parametrize("name", ILL)
def test_gains_of_ill_conditioned_plants_are_placed_to_the_last_digit(name: str) -> None:
    A, C, poles = ILL[name]
    outcome = obsdesign.investigate(luenberger(A, C, poles=poles))
    assert {claim.id: claim.verdict for claim in outcome.claims} == {
        "consistent": "proved", "poles": "proved", "hurwitz": "proved",
    }  # fmt: skip
    assert obsdesign.verify(outcome.design).verdict == "proved"


@pytest.mark.parametrize("seed", range(12))
def test_placed_poles_are_those_stated_whatever_the_units(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, p = int(rng.integers(2, 6)), 1 + seed % 2
    sizes = 2.0 ** rng.integers(-10, 10, n)
    A, C = rng.normal(size=(n, n)) * sizes / sizes[:, None], rng.normal(size=(p, n)) * sizes
    poles = [-1 - 0.3 * i for i in range(n)]
    F = exact(A) - exact(placed_gain(A, C, poles)) @ exact(C)
    assert gap(F, poles).relative < 1e-9
    assert gap(F, [1.001 * poles[0], *poles[1:]]).relative > 1e-5


def test_a_gain_of_synthesis_that_misses_its_poles_refutes_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    A, C, poles = ILL["chain"]
    module = "obsdesign.synthesis.luenberger.candidates.placed_gain"
    monkeypatch.setattr(module, lambda A, C, poles: np.zeros((5, 1)))
    outcome = obsdesign.investigate(luenberger(A, C, poles=poles))
    assert outcome.verdict == "undecided"
    module = "obsdesign.synthesis.impulsive_input.observer_gain.placed_gain"
    monkeypatch.setattr(module, lambda A, C, poles: -np.ones((3, 1)))
    body = copy.deepcopy(CHAIN)
    body["observer"] |= {"poles": [-0.1, -0.15, -0.2]}
    assert obsdesign.investigate(obsdesign.Problem.from_dict(body)).verdict == "undecided"


@pytest.mark.parametrize("poles", [[0, -1], [[0, 2]], [-1, 0.5], [[0.1, 1]]])
def test_a_stated_pole_that_does_not_decay_refutes_every_gain(poles: Any) -> None:
    outcome = obsdesign.investigate(luenberger(FLOW["A"], [[1, 0]], poles=poles))
    claim = next(claim for claim in outcome.claims if claim.id == "poles")
    assert claim.verdict == "refuted"
    assert claim.evidence["witness"]["of_all_gains"]
    body = copy.deepcopy(SEEN)
    body["observer"]["poles"] = poles
    assert obsdesign.investigate(obsdesign.Problem.from_dict(body)).verdict == "refuted"


def test_a_pole_slower_than_the_decay_rate_is_refuted_and_its_twin_proved() -> None:
    for pole, verdict in ((-1.0, "refuted"), (-1.1, "proved")):
        stated = luenberger(FLOW["A"], [[1, 0]], poles=[-3, pole], decay_rate=1.0)
        assert obsdesign.investigate(stated).verdict == verdict


@pytest.mark.parametrize(
    ("true", "forged"),
    [
        ({"poles": [-2, -3]}, {"poles": [-7, -9]}),
        ({"poles": [-2, -3]}, {"poles": [-2, -3.001]}),
        ({"poles": [[-2, 1]]}, {"poles": [-2, -2]}),
        ({"weights": {"state": [1, 1], "output": [1]}}, {"weights": {"state": [9, 1], "output": [1]}}),
        ({"weights": {"state": [1, 1]}}, {"weights": {"state": [1, 1], "output": [1.01]}}),
    ],
)  # fmt: skip
def test_forged_poles_and_weights_are_refuted(true: Any, forged: Any) -> None:
    body = saved(luenberger(FLOW["A"], [[1, 0]], **true))
    assert verdict_of(body) == "proved"
    assert verdict_of(body, **forged) == "refuted"


def test_forged_poles_of_the_other_kinds_are_refuted() -> None:
    body = copy.deepcopy(CHAIN)
    body["observer"] |= {"poles": [-0.1, -0.15, -0.2]}
    file = saved(obsdesign.Problem.from_dict(body))
    assert verdict_of(file, poles=[-0.1, -0.15, -0.25]) == "refuted"
    body = copy.deepcopy(SEEN)
    body["observer"]["poles"] = [-2, -3]
    file = saved(obsdesign.Problem.from_dict(body))
    assert verdict_of(file) == "proved"
    assert verdict_of(file, poles=[-2, -4]) == "refuted"


def test_designs_without_the_claim_are_proved_again() -> None:
    body = saved(luenberger(FLOW["A"], [[1, 0]], poles=[-2, -3]))
    body["claims"] = [claim for claim in body["claims"] if claim["id"] != "poles"]
    body["guarantees"] = [g for g in body["guarantees"] if "poles" not in g["claims"]]
    assert verdict_of(body) == "proved"
    assert verdict_of(body, poles=[-2, -4]) == "refuted"


def test_poles_that_a_matrix_has_not_are_refuted() -> None:
    F = exact(np.diag([-1.0, -2.0]))
    assert poles_claim(F, [-1, -2]).verdict == "proved"
    assert poles_claim(F, [-1]).verdict == "refuted"  # one is missing
    assert poles_claim(F, [-1], has_others=True).verdict == "proved"
    assert poles_claim(F, [-3], has_others=True).verdict == "refuted"
    assert poles_claim(F, [-1, -2, -3]).verdict == "refuted"


UNITS = [2.0**-40, 1e-9, 1.0, 2.0**40]  # of time


def scaled_poles(poles: Any, unit: float) -> list[Any]:
    return [[part * unit for part in p] if isinstance(p, list) else p * unit for p in poles]


@pytest.mark.parametrize("unit", UNITS)
def test_pairs_are_told_by_their_numbers_in_every_unit_of_time(unit: float) -> None:
    A = [[0, unit], [0, 0]]
    for poles in ([[-1, 1]], [[-1, 1], [-1, -1]], [[-1, 1e-6]]):
        outcome = obsdesign.investigate(luenberger(A, [[1, 0]], poles=scaled_poles(poles, unit)))
        assert outcome.verdict == "proved"
        F = np.array(A) - np.array(outcome.design.gains["L"]) @ [[1, 0]]
        np.testing.assert_allclose(
            sorted(np.linalg.eigvals(F).imag / unit), [-poles[0][1], poles[0][1]], atol=1e-7
        )
    for poles in ([[-1, 1], [-5, -3]], [[-1, 1], [-5, 3]], [[-1, 1], [-1, -1.000001]]):
        with pytest.raises(obsdesign.InputError, match=r"must give 2 poles.*got 4\."):
            obsdesign.investigate(luenberger(A, [[1, 0]], poles=scaled_poles(poles, unit)))
    with pytest.raises(obsdesign.InputError, match=r"must give 1 poles.*got 2\."):
        obsdesign.investigate(luenberger([[0]], [[1]], poles=[[-1, 1e-10]]))


@pytest.mark.parametrize("unit", UNITS)
def test_zeros_are_told_from_poles_in_every_unit_of_time(unit: float) -> None:
    A = [[-1, 0, 0, 0], [1, -2, 0, 0], [0, 1, -1, 1], [0, 0, -1, -1]]
    body: dict[str, Any] = {
        "flow": {"A": (unit * np.array(A)).tolist(), "D": [[0], [1], [0], [0]]},
        "output": {"C": [[0, 1, 0, 0], [0, 0, 1, 0]]},
    }

    def outcome(*poles: Any) -> obsdesign.Outcome:
        observer = {"kind": "unknown_input", "poles": scaled_poles(poles, unit)}
        return obsdesign.investigate(obsdesign.Problem.from_dict({**body, "observer": observer}))

    for poles in ((-1, [-2, 1]), ([-2, 1],)):
        design = outcome(*poles).design
        assert design is not None
        claims = {claim.id: claim.verdict for claim in design.claims}
        assert claims["poles"] == "proved"
        eigenvalues = np.linalg.eigvals(np.array(design.gains["F"])) / unit
        assert min(abs(eigenvalues - (-2 + 1j))) < 1e-6
    with pytest.raises(obsdesign.InputError, match=r"besides the invariant zeros"):
        outcome(-4, [-2, 1])


def test_poles_that_need_larger_gains_than_a_file_may_hold_are_refused() -> None:
    integrators = [[0, 1], [0, 0]]
    with pytest.raises(obsdesign.InputError, match=r"a gain with an entry of 1e\+160"):
        obsdesign.investigate(luenberger(integrators, [[1, 0]], poles=[-1e80, -1e80]))
    largest = luenberger(integrators, [[1, 0]], poles=[-1e74, -1e74])
    assert obsdesign.investigate(largest).verdict == "proved"


@pytest.mark.parametrize("coupling", [1.0, 1e-5, 1e-9])
def test_weakly_coupled_states_are_placed_and_uncoupled_ones_refused(coupling: float) -> None:
    A = np.diag([-1.0, -2.0, -3.0]) + coupling * np.diag([1.0, 1.0], 1)
    poles = [-4, -5, -6]
    outcome = obsdesign.investigate(luenberger(A.tolist(), [[1, 0, 0]], poles=poles))
    assert outcome.verdict == "proved"
    A[1, 2] = 0.0
    for C in ([[1, 0, 0]], [[1, 0, 0], [0, 1, 0]]):
        with pytest.raises(obsdesign.InputError, match=r"the mode -3 .* cannot be moved"):
            obsdesign.investigate(luenberger(A.tolist(), C, poles=poles))


def test_poles_at_zero_alone_are_those_of_rounding_alone() -> None:
    """They state no unit of time: an eigenvalue of 1 beside entries of 1e9 is not one at 0."""
    body: dict[str, Any] = {
        "flow": {"A": [[0, 1e9], [0, 0]]},
        "jump": {"G": [[0.1, 0], [0, 0.1]], "dwell_time": [0.001, 0.01]},
        "output": {"C": [[1, 0]]},
        "observer": {"kind": "luenberger", "poles": [0, 0], "gains": {"M": [[0.1], [0]]}},
    }
    F = exact([[0.0, 1e9], [0.0, 0.0]])
    assert poles_claim(F, [0, 0], rate=None).verdict == "proved"
    for pole in (1.0, 1e-3):
        F = exact([[0.0, 1e9], [pole**2 / 1e9, 0.0]])
        assert poles_claim(F, [0, 0], rate=None).verdict == "refuted"
    outcome = obsdesign.investigate(obsdesign.Problem.from_dict(body))
    assert {claim.id: claim.verdict for claim in outcome.claims}["poles"] == "proved"


@pytest.mark.parametrize(
    ("A", "C", "poles"),
    [
        ([[-1]], [[3]], [-1]),  # L = 0
        ([[-1, 0.5], [0, -2]], [[0.1, 0.7]], [-1, -2]),
        ([[0, 1], [0, 0]], [[1, 0], [2, 0]], [-1, -2]),  # a sensor twice
        ([[0, 1], [0, 0]], [[1, 0], [0, 0]], [-1, -2]),  # a sensor that is off
        ([[0, 1, 0], [0, 0, 1], [0, 0, 0]], [[1, 0, 0], [0, 1, 0]], [-1, -1, -1]),
    ],
)
def test_poles_are_placed_wherever_the_outputs_together_see_the_state(
    A: Any, C: Any, poles: Any
) -> None:
    assert obsdesign.investigate(luenberger(A, C, poles=poles)).verdict == "proved"
    n = len(A)
    hidden = [[*row, 0] for row in A] + [[0] * n + [1]]
    with pytest.raises(obsdesign.InputError, match=r"the mode 1 of flow\.A cannot be moved"):
        obsdesign.investigate(luenberger(hidden, [[*row, 0] for row in C], poles=[*poles, -7]))
