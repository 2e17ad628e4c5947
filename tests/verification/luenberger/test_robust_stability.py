"""Point observers of uncertain plants: the plant by itself, for all parameters and dwell times."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from lmi.prove.parameter_cells import certificate_of
from obsdesign.data.simulation import simulate
from obsdesign.design_file import from_dict
from obsdesign.document import Claim, Design, digest
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem
from obsdesign.runtime import from_design
from obsdesign.verification.luenberger.robust_stability import robust_claim
from obsdesign.workflow import Outcome, investigate, verify
from tests.systems.parameters import Body


def spring(radius: float = 0.1, **entries: Any) -> Body:
    """Spring and damper with stiffness 1 +- radius; jumps keep 0.8 of the speed."""
    body: Body = {
        "flow": {"A": [[0, 1], [0, -0.1]]},
        "jump": {"G": [[1, 0], [0, 0.8]], "dwell_time": [1, 3]},
        "output": {"C": [[1, 0]]},
        "parameter": [
            {"name": "stiffness", "range": [1 - radius, 1 + radius], "A": [[0, 0], [-1, 0]]}
        ],
        "observer": {"kind": "luenberger"},
    }
    return copy.deepcopy(body) | copy.deepcopy(entries)


def alone(radius: float = 0.1, **entries: Any) -> Body:
    """The same without any gains: the stability of the plant itself is all it is about."""
    body = spring(radius, **entries)
    zero = [[0], [0]]
    names = ("L", "M") if "jump" in body else ("L",)
    body["observer"] = {"kind": "luenberger", "gains": dict.fromkeys(names, zero)}
    return body


def stored(body: Body) -> Design:
    """The design of a changed file, whose digest is that of the change."""
    return from_dict({**body, "digest": digest(body)})


def outcome(body: Body) -> Outcome:
    return investigate(Problem.from_dict(body))


def robust(result: Outcome) -> Claim:
    return next(claim for claim in result.claims if claim.id == "robust_stability")


@pytest.fixture(scope="module")
def design() -> Design:
    """Of the spring with stiffness 1 +- 0.1."""
    result = outcome(spring())
    assert result.verdict == "proved"
    assert result.design is not None
    return result.design


def test_a_design_verifies_from_its_file(design: Design) -> None:
    again = stored(design.to_dict())
    assert verify(again).verdict == "proved"
    given = [entry.statement for entry in design.guarantees if entry.given]
    assert (
        "Assumed: stiffness in [0.9, 1.1]. Without disturbance and noise, state and estimation error tend to zero for every sequence of dwell times in [1.0, 3.0]."
        in given
    )
    # no rate of the nominal error is stated: parameters drive it
    assert not any("factor" in statement or "e^(-" in statement for statement in given)


def test_error_and_state_tend_to_zero_in_simulations(design: Design) -> None:
    problem = Problem.from_dict(spring())
    observer = from_design(design)
    for seed in range(3):
        run = simulate(
            problem.plant, disturbance="zero", rng=np.random.default_rng(seed), until=120,
            step=0.05, parameters="bang-bang", initial=np.array([1.0, 0.5]),
        )  # fmt: skip
        batch = observer.run_batch(run.t, run.block("y"), None, None, run.happened)
        error = np.abs(batch.x - run.block("x")).max(axis=1)
        assert error[-20:].max() < 0.02 * error.max()


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"range": [0.5, 1.5]}, "refuted"),
        ({"range": [1.0, 1.0]}, "proved"),
        ({"A": [[0, 0], [-2, 0]]}, "refuted"),  # another middle
    ],
)
def test_a_changed_problem_is_not_proved_by_the_old_certificate(
    design: Design, changes: Body, expected: str
) -> None:
    """Middle and half, vertices, all are computed from the problem of the file."""
    body = design.to_dict()
    body["problem"]["parameter"][0] |= changes
    verdict = verify(stored(body)).verdict
    assert verdict != "proved"
    # a narrower range alone would be proved by it
    problem = Problem.from_dict(spring() | {"parameter": [spring()["parameter"][0] | changes]})
    certificate = next(claim for claim in design.claims if claim.id == "robust_stability").evidence
    claim = robust_claim(problem, certificate)
    assert (claim.verdict == "proved") == (expected == "proved")


def test_a_changed_certificate_is_not_proved(design: Design) -> None:
    for place, factor in (("R", 1.3), ("nodes", 0.9)):
        body = design.to_dict()
        claim = next(entry for entry in body["claims"] if entry["id"] == "robust_stability")
        tree = claim["evidence"]["certificate"]
        if place == "R":
            tree["R"][4][0][0] *= factor
        else:
            tree["nodes"][2] *= factor
        assert verify(stored(body)).verdict != "proved"
    for broken in ({}, {"certificate": None}, {"certificate": {"halves": 3}}, {"witness": []}):
        assert robust_claim(Problem.from_dict(spring()), broken).verdict == "undecided"


def test_parameters_that_switch_refute_the_plant_alone() -> None:
    result = outcome(alone(0.21))
    assert result.verdict == "refuted"
    witness = robust(result).evidence["witness"]
    assert witness["of_all_gains"]
    assert "stiffness = 1.21 for" in witness["reason"]
    # replayed from the values, in units of the problem
    product = np.eye(2)
    for stay in witness["values"]:
        product = np.diag([1, 0.8]) @ product
        for piece in stay["flow"]:
            A = np.array([[0, 1], [-piece["values"]["stiffness"], -0.1]])
            product = expm(A * piece["duration"]) @ product
    radius = np.abs(np.linalg.eigvals(product)).max()
    assert radius == pytest.approx(witness["spectral_radius"], rel=1e-9)
    assert radius > 1


def test_a_plant_that_is_not_stable_has_an_observer_all_the_same() -> None:
    """With gains of its own the nominal error decays; that the plant need not is a warning."""
    result = outcome(spring(0.21))
    assert result.verdict == "proved"
    assert result.design is not None
    claim = next(entry for entry in result.claims if entry.id == "robust_instability")
    assert "stiffness = 1.21 for" in claim.evidence["witness"]["reason"]
    assert "of_all_gains" not in claim.evidence["witness"]
    given = [entry.statement for entry in result.guarantees if entry.given]
    assert not any("state and estimation error" in text for text in given)
    assert any("if the state does." in text for text in given)
    unstable, unbounded = result.warnings
    assert unstable.startswith("The plant by itself is not stable")
    assert unbounded.endswith("it needs bounds of x, [state].")
    assert verify(stored(result.design.to_dict())).verdict == "proved"
    # a witness that shows nothing is none: the twin
    body = result.design.to_dict()
    entry = next(each for each in body["claims"] if each["id"] == "robust_instability")
    for stay in entry["evidence"]["witness"]["stays"]:
        for piece in stay["flow"]:
            piece["p"] = [0.0]
    assert verify(stored(body)).verdict != "proved"


def test_an_open_stability_of_the_plant_is_a_warning() -> None:
    result = outcome(spring(0.16))
    assert result.verdict == "proved"
    assert result.design is not None
    assert {claim.id for claim in result.claims} == {"consistent", "dwell_stability"}
    assert result.warnings[0].startswith("The plant by itself is not proved stable")
    assert "parameters that switch grow by 0.9" in result.result["remarks"][0]
    assert verify(result.design).verdict == "proved"


def test_an_integrator_has_an_observer() -> None:
    """Position of a carriage, its drag known to a quarter: nothing pulls it back."""
    body: Body = {
        "flow": {"A": [[0, 1], [0, -1]]},
        "output": {"C": [[1, 0]]},
        "parameter": [{"name": "drag", "range": [-0.25, 0.25], "A": [[0, 0], [0, -1]]}],
        "observer": {"kind": "luenberger"},
    }
    result = outcome(body)
    assert result.verdict == "proved"
    assert "robust_stability" not in {claim.id for claim in result.claims}
    assert result.warnings
    # the twin: without gains the nominal error does not decay either
    body["observer"]["gains"] = {"L": [[0], [0]]}
    assert outcome(body).verdict == "refuted"


def test_the_same_range_held_constant_is_proved_in_cells() -> None:
    body = alone(0.3)
    body["parameter"][0]["constant"] = True
    result = outcome(body)
    assert result.verdict == "proved"
    assert robust(result).evidence["cells"] == 4
    assert result.design is not None
    assert verify(result.design).verdict == "proved"
    assert "stiffness constant in [0.7, 1.3]" in robust(result).statement
    assert outcome(alone(0.3)).verdict == "refuted"


def test_in_between_it_is_undecided_and_says_how_far_it_is() -> None:
    claim = robust(outcome(alone(0.16)))
    assert claim.verdict == "undecided"
    assert (
        "which is not instability; parameters that switch grow by 0.9" in claim.evidence["reason"]
    )


def test_without_jumps_the_flow_decides() -> None:
    """A spring whose stiffness switches twice a swing needs damping."""
    body = alone(0.05)
    del body["jump"], body["observer"]["gains"]["M"]
    result = outcome(body)
    assert result.verdict == "proved"
    assert "x' = A(p) x, tends to zero" in robust(result).statement
    body["parameter"][0]["range"] = [0.7, 1.3]
    witness = robust(outcome(body)).evidence["witness"]
    assert witness["stays"][0]["jump"] is None
    assert "without jumps" in witness["reason"]


def test_radii_of_entries_are_parameters() -> None:
    body = alone()
    del body["parameter"]
    body["flow"] = {"A": [[0, 1], [-1, -0.1]], "A_radius": [[0, 0], [0.1, 0]]}
    result = outcome(body)
    assert result.verdict == "proved"
    body["flow"]["A_radius"] = [[0, 0], [0.21, 0]]
    assert outcome(body).verdict == "refuted"


def test_a_word_has_to_change_as_slowly_as_dwell_times_do() -> None:
    """With dwell_jitter, only sequences of dwell times that the problem allows refute."""
    body = alone(0.21)
    witness = robust(outcome(body)).evidence["witness"]
    first = witness["stays"][0]
    shorter = {"jump": [0.0], "flow": [{"p": [0.0], "duration": 1.0}]}
    two = {**witness, "stays": [first] * 30 + [shorter]}
    body["jump"]["dwell_jitter"] = 0.5
    claim = robust_claim(Problem.from_dict(body), {"witness": two})
    assert claim.verdict == "undecided"
    assert robust_claim(Problem.from_dict(spring(0.21)), {"witness": two}).verdict == "refuted"
    # the twin: a single dwell time does not change
    assert robust_claim(Problem.from_dict(body), {"witness": witness}).verdict == "refuted"


def test_what_is_not_available_with_parameters_is_refused() -> None:
    body = spring()
    body["observer"] = {"kind": "luenberger", "decay_rate": 0.1}
    with pytest.raises(InputError, match=r"observer.decay_rate is not available with parameters"):
        outcome(body)
    body["observer"] = {"kind": "luenberger", "schedule": 2}
    with pytest.raises(InputError, match=r"observer.schedule is not available with parameters"):
        outcome(body)
    n = 4
    many: Body = {
        "flow": {"A": (-np.eye(n)).tolist(), "A_radius": np.full((n, n), 0.01).tolist()},
        "output": {"C": [[1, 0, 0, 0]]},
        "observer": {"kind": "luenberger"},
    }
    with pytest.raises(InputError, match=r"at most 8 may act on flow.A"):
        outcome(many)


def test_a_known_input_leaves_state_and_error_bounded() -> None:
    body = spring()
    body["flow"]["B"] = [[0], [1]]
    result = outcome(body)
    given = [entry.statement for entry in result.guarantees if entry.given]
    assert not any("state and estimation error tend to zero" in text for text in given)
    assert any("Bounded inputs, disturbance and noise leave state" in text for text in given)


def test_cells_of_a_design_are_no_deeper_than_a_file_may_be() -> None:
    """Next to a stiffness of zero cells are small: 2^-11 of the range."""
    body = spring(0.999)
    body["parameter"][0]["constant"] = True
    result = outcome(body)
    assert result.verdict == "proved"
    assert result.design is not None
    assert verify(stored(result.design.to_dict())).verdict == "proved"


def test_certificates_have_their_own_entries_alone() -> None:
    assert certificate_of({"nodes": [0.0], "R": [], "margin": 1.0, "matrices": 3}) == {
        "certificate": {"nodes": [0.0], "R": []}
    }


def test_a_design_runs_on_the_plant_that_it_names_alone(design: Design) -> None:
    """The gains hold the middle of the ranges: another middle is another plant."""
    body = design.to_dict()
    body["problem"]["parameter"][0]["range"] = [0.9, 1.2]
    with pytest.raises(InputError, match=r"gains.A differs from problem.flow.A"):
        from_design(stored(body))
    # the twin: a wider range has the same middle, and verify says that nothing is proved for it
    body["problem"]["parameter"][0]["range"] = [0.8, 1.2]
    assert from_design(stored(body)) is not None


def test_an_uncertain_known_input_drives_the_error_of_a_state_at_rest() -> None:
    """Gain 1 +- 1 of an input of 1: at gain 0 the state rests, and the estimate does not."""
    body = spring(0.05)
    del body["jump"]
    body["flow"]["B"] = [[0], [1]]
    body["parameter"].append({"name": "gain", "range": [-1, 1], "B": [[0], [1]]})
    result = outcome(body)
    assert result.design is not None
    given = [entry.statement for entry in result.guarantees if entry.given]
    assert not any("if the state does" in text for text in given)
    assert any("if state and known inputs do" in text for text in given)
    t = np.arange(0, 60, 0.1)
    rows = np.ones((len(t), 1))
    batch = from_design(result.design).run_batch(t, 0 * rows, rows, None, None)
    assert np.abs(batch.x[-1]).max() > 0.1
