"""Claims of `interval` for uncertain plants: known numbers, laws, and changed files."""

from __future__ import annotations

import copy
import math
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.analysis.widened import StateBounds, widened
from obsdesign.document import Claim
from obsdesign.errors import DoesNotApply, InputError
from obsdesign.problem.problem import Problem
from obsdesign.studies.search.search import search
from obsdesign.workflow import investigate, verify
from tests.systems.parameters import Body, compartments, degue, rooms, spring


def _claims(outcome: obsdesign.Outcome) -> dict[str, Claim]:
    return {claim.id: claim for claim in outcome.claims}


def _radius(body: Body, *names: str) -> list[float]:
    """Half the proved widths after and before jumps."""
    outcome = investigate(Problem.from_dict(body))
    assert outcome.verdict == "proved"
    width = _claims(outcome)["width"].evidence
    return [value / 2 for name in names for value in width[name]]


@pytest.mark.parametrize(
    ("body", "after", "before"),
    [
        (degue(0.05), (0.6186, 0.5680), (0.1359, 0.1261)),
        (degue(0.05, (2, 5)), (0.8821, 0.7390), (0.2557, 0.2142)),
        (spring(), (0.01, 1.2948), (0.5249, 0.9948)),
        (compartments(), (12.235, 8.7165), (8.235, 8.7166)),
        (rooms(), (1.5913, 3.6408), (1.6318, 3.4658)),
    ],
)
def test_widths_of_known_plants(body: Body, after: object, before: object) -> None:
    stated = _radius(body, "after_jump", "before_jump")
    np.testing.assert_allclose(stated, [*after, *before], rtol=2e-4)  # type: ignore[misc]


def test_the_box_is_proved_from_the_plant_itself() -> None:
    outcome = investigate(Problem.from_dict(degue(0.05)))
    box = _claims(outcome)["state_box"].evidence
    np.testing.assert_allclose(box["after_jump"], [0.6529, 0.7811], atol=2e-4)
    np.testing.assert_allclose(box["before_jump"], [0.1100, 0.1160], atol=2e-4)
    assert outcome.design is not None
    assert verify(outcome.design).verdict == "proved"
    text = outcome.guarantees[0].statement
    assert text.startswith(
        "Assumed: 7 parameters in their ranges. The proved ultimate bound of |x| is (0.652856, 0.781052)"
    )
    assert all("state_box" in entry.claims for entry in outcome.guarantees if entry.given)


def test_a_plant_that_may_grow_has_no_proved_box() -> None:
    """Exactly from 1.27730 on |x| stays bounded by itself."""
    shortest = 1.2774
    assert "state_box" in _claims(investigate(Problem.from_dict(degue(0.05, (shortest,) * 2))))
    below = _claims(investigate(Problem.from_dict(degue(0.05, (1.2772, 1.2772)))))
    assert "state_box" not in below
    assert "source_width" in below
    boxed = degue(0.05, (1.2772, 1.2772)) | {"state": {"lower": [-3, -3], "upper": [3, 3]}}
    assert "state_box" not in _claims(investigate(Problem.from_dict(boxed)))


def test_without_jumps_the_box_is_one_linear_inequality() -> None:
    body = spring()
    del body["jump"], body["state"]
    body["flow"] |= {"A": [[-2, 1], [0, -0.5]]}
    body["parameter"] = [{"name": "drag", "range": [-0.1, 0.1], "A": [[0, 0], [0, 1]]}]
    body["observer"] = {"kind": "interval"}
    outcome = investigate(Problem.from_dict(body))
    assert outcome.verdict == "proved"
    np.testing.assert_allclose(
        _claims(outcome)["state_box"].evidence["always"], [0.0625, 0.125], rtol=1e-4
    )


def test_a_range_of_one_number_changes_no_number() -> None:
    """Neither gains nor claims: those of the plant without the parameter, bit for bit."""
    body = spring(parameter=[{"name": "p", "range": [0, 0], "A": [[1, 2], [3, 4]]}])
    plain = {key: value for key, value in body.items() if key not in ("parameter", "state")}
    one, other = (investigate(Problem.from_dict(each)) for each in (body, plain))
    assert one.claims[1:] == other.claims[1:]
    assert one.design is not None
    assert other.design is not None
    for name, value in other.design.gains.items():
        assert np.array_equal(one.design.gains[name], value), name
    middle = spring(parameter=[{"name": "p", "range": [1, 1], "A": [[0, 0], [-1, 0]]}])
    stiff = copy.deepcopy(plain)
    stiff["flow"]["A"] = [[0, 1], [-1, -0.4]]
    claims = [investigate(Problem.from_dict(each)).claims[1:] for each in (middle, stiff)]
    assert claims[0] == claims[1]


def _mirrored(body: Body) -> None:
    first = body["parameter"][0]
    first["range"] = [-first["range"][1], -first["range"][0]]
    first["A"] = (-np.array(first["A"])).tolist()


def _split(body: Body) -> None:
    """Two parameters of half the range each, the one about 0."""
    first = body["parameter"][0]
    half = (first["range"][1] - first["range"][0]) / 4
    middle = (first["range"][1] + first["range"][0]) / 2
    body["parameter"][0] = first | {"range": [middle - half, middle + half]}
    body["parameter"].append(first | {"name": "more", "range": [-half, half]})


def _shifted(body: Body) -> None:
    """The middle of the range in flow.A."""
    first = body["parameter"][0]
    A = np.array(body["flow"]["A"], float) + sum(first["range"]) / 2 * np.array(first["A"])
    half = (first["range"][1] - first["range"][0]) / 2
    body["flow"]["A"], first["range"] = A.tolist(), [-half, half]


@pytest.mark.parametrize(
    "change", [lambda body: body["parameter"].reverse(), _mirrored, _split, _shifted]
)
def test_another_way_to_write_a_parameter_changes_no_number(change: Any) -> None:
    body = rooms()
    body["flow"]["A"] = [[-0.125, 0], [0, -0.25]]  # sums of these are exact
    body["parameter"][1]["range"] = [0.125, 0.375]
    other = copy.deepcopy(body)
    change(other)
    plain, changed = (
        widened(problem, StateBounds.stated(problem.plant))  # type: ignore[arg-type]
        for problem in map(Problem.from_dict, (body, other))
    )
    assert plain.problem == changed.problem
    for name in ("flow", "jump", "output"):
        assert getattr(plain, name).tolist() == getattr(changed, name).tolist()


def test_effects_of_exchange_do_not_count_the_mean() -> None:
    """Rooms from 18 to 24 exchange at most 3 in excess, not 24."""
    problem = Problem.from_dict(rooms())
    bounds = StateBounds.stated(problem.plant)
    assert bounds is not None
    np.testing.assert_allclose(widened(problem, bounds).flow, [3, 3], rtol=1e-14)


def test_uncertain_inputs_need_a_bound() -> None:
    body = spring()
    body["flow"]["B"] = [[0], [1]]
    body["parameter"].append({"name": "thrust", "range": [-0.1, 0.1], "B": [[0], [1]]})
    with pytest.raises(
        DoesNotApply, match=r"flow\.input_bound is required by parameter\.thrust\.B"
    ):
        investigate(Problem.from_dict(body))
    body["flow"]["input_bound"] = [2]
    problem = Problem.from_dict(body)
    bounds = StateBounds.stated(problem.plant)
    assert bounds is not None
    added = widened(problem, bounds).flow
    np.testing.assert_allclose(added, [0, 0.24 + 0.2], rtol=1e-12)
    outcome = investigate(problem)
    assert outcome.verdict == "proved"
    assert "known inputs within input_bound" in outcome.guarantees[0].statement


def test_noise_and_shaped_disturbances_grow_by_their_effects() -> None:
    body = spring()
    body["output"] |= {"C_radius": [[0.05, 0]], "noise_bound": [[-0.01, 0.03]]}
    body["jump"] |= {
        "disturbance_matrix": [[1], [1]], "disturbance": {"lower": [-0.3], "upper": [0.3]},
        "G_radius": [[0, 0.5], [0, 0]],
    }  # fmt: skip
    problem = Problem.from_dict(body)
    bounds = StateBounds.stated(problem.plant)
    assert bounds is not None
    certain = widened(problem, bounds).problem.plant
    np.testing.assert_allclose(certain.output.noise_bound, [[-0.07, 0.09]], rtol=1e-12)  # type: ignore[arg-type]
    assert certain.jump is not None
    assert certain.jump.disturbance_matrix is not None
    assert certain.jump.disturbance_matrix.tolist() == [[1, 1], [1, 0]]
    assert certain.jump.upper.tolist() == [0.3, 0.6]


@pytest.fixture(scope="module")
def sensed() -> obsdesign.Design:
    """Rooms with a sensor that is uncertain too."""
    body = rooms()
    body["output"]["C_radius"] = [[0.001, 0]]
    return obsdesign.design(Problem.from_dict(body))


@pytest.mark.parametrize(
    ("entry", "change"),
    [
        ("effects", lambda value: value[1:]),
        ("flow_effect", lambda value: 0.5 * value),
        ("flow_upper", lambda value: value - 1e-9),
        ("state_upper", lambda value: value - 1e-9),
        ("noise_bound", lambda value: 0.9 * value),
        ("A", lambda value: value * (1 + 1e-12)),
    ],
)
def test_changed_gains_are_refuted(sensed: obsdesign.Design, entry: str, change: Any) -> None:
    forged = dict(sensed.gains) | {entry: change(sensed.gains[entry])}
    outcome = verify(obsdesign.Design(**{**vars(sensed), "gains": forged}))
    assert outcome.verdict == "refuted"
    assert _claims(outcome)["consistent"].verdict == "refuted"


def test_a_smaller_box_is_not_proved() -> None:
    """Gains and box that agree, of a box that the state leaves."""
    problem = Problem.from_dict(degue(0.05))
    design = obsdesign.design(problem)
    claims = {claim.id: claim for claim in design.claims}
    box = {key: np.multiply(claims["state_box"].evidence[key], 0.9).tolist()
           for key in ("tube", "after_jump", "before_jump", "always")}  # fmt: skip
    ends = (np.array(box[key]) for key in ("tube", "always", "before_jump"))
    bounds = StateBounds.proved(*ends)
    certain = widened(problem, bounds)
    kept = {key: design.gains[key] for key in ("L", "M", "D0", "D1", "Gp", "Gn", "form")}
    same = obsdesign.design(certain.problem).gains
    gains = {**same, **kept, **certain.entries}
    verification = obsdesign.verification.kind.verification_of("interval")
    proofs = {name: claim.evidence for name, claim in claims.items()} | {"state_box": box}
    verdicts = {claim.id: claim.verdict for claim in verification.claims(problem, gains, proofs)}
    assert verdicts["consistent"] == "proved"
    assert verdicts["state_box"] == "undecided"


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"form": "two_coordinates"}, "form 'two_coordinates' is not available with parameters"),
        ({"objective": "shortest_dwell"}, "[state] is required by observer.objective"),
    ],
)
def test_options_that_parameters_do_not_go_with(options: Body, text: str) -> None:
    body = degue(0.05)
    body["observer"] = {"kind": "interval", **options}
    with pytest.raises(InputError) as refusal:
        investigate(Problem.from_dict(body))
    assert text in str(refusal.value)


def test_search_of_dwell_times_needs_a_stated_box() -> None:
    with pytest.raises(InputError, match=r"--for shortest_dwell requires \[state\]"):
        search(Problem.from_dict(degue(0.05)), "shortest_dwell")
    boxed = degue(0.0) | {"state": {"lower": [-3, -3], "upper": [3, 3]}}
    bracket = search(Problem.from_dict(boxed), "shortest_dwell", accuracy=1e-3).result
    assert math.isclose(bracket["proved"], math.log(2), rel_tol=1e-3)
