"""Designs: gains, poles, proofs and their twins, files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.design_file import load_design
from obsdesign.document import Design
from obsdesign.runtime import from_design
from obsdesign.verification.unknown_input.claims import claims
from tests.systems.unknown_input import plant_with_zeros, random_plant, unknown_input_problem
from tests.test_architecture import SOLVERS, run_blocked

SLOW = np.array([[-0.5, 1.0], [-1.0, -0.5]])


def example(p: int = 3, seed: int = 1, **observer: Any) -> obsdesign.Problem:
    rng = np.random.default_rng(seed)
    A, C, D = random_plant(rng, 5, p, 2)
    return unknown_input_problem(A, C, D, rng.standard_normal((5, 1)), **observer)


def with_zeros(**observer: Any) -> obsdesign.Problem:
    """Six states, three outputs, one input, zeros at -0.5 +- i in exact coordinates."""
    rng = np.random.default_rng(2)
    A = rng.integers(-3, 4, (6, 6)).astype(float)
    A[:2, :2], A[2:5, :2] = SLOW, 0
    C = rng.integers(-3, 4, (3, 6)).astype(float)
    C[:, :2] = 0
    return unknown_input_problem(A, C, [[0]] * 5 + [[1]], **observer)


def verdicts(listed: Any) -> dict[str, str]:
    return {claim.id: claim.verdict for claim in listed}


@pytest.mark.parametrize(
    "observer",
    [
        {},
        {"poles": [-1, -2, -3]},
        {"poles": [[-1, 2], -2]},
        {"weights": {"state": [1, 1, 1, 1, 9], "output": [0.1, 1, 1]}},
        {"weights": {"output": [1, 1, 4]}},
        {"differentiator": "damped"},
    ],
)
def test_what_is_open_is_found_and_proved(observer: dict[str, Any]) -> None:
    design = obsdesign.design(example(**observer))
    again = obsdesign.verify(design)
    assert set(verdicts(again.claims).values()) == {"proved"}
    assert "document" in verdicts(again.claims)
    poles = np.sort_complex(np.linalg.eigvals(design.gains["F"]))
    assert poles.real.max() < 0
    if "poles" in observer:
        expected = [complex(*np.atleast_1d(x)) for x in observer["poles"]]
        expected += [x.conjugate() for x in expected if x.imag]
        np.testing.assert_allclose(poles, np.sort_complex(expected), atol=1e-8)


@pytest.mark.parametrize(
    "poles", [[-2, -3, -4], [-2, [-3, 1]], [-2, -3, -4, [-0.5, 1]], [[-0.5, -1], -2, -3, -4]]
)
def test_zeros_stay_among_the_poles(poles: list[Any]) -> None:
    design = obsdesign.design(with_zeros(poles=poles))
    poles_of_F = np.linalg.eigvals(design.gains["F"])
    assert np.abs(poles_of_F - complex(-0.5, 1)).min() < 1e-9
    expected = [complex(*np.atleast_1d(x)) for x in poles]
    for pole in expected:
        assert np.abs(poles_of_F - pole).min() < 1e-6
    sentences = " ".join(g.statement for g in design.guarantees)
    assert "invariant zeros -0.5 +- 1i" in sentences


def test_the_riccati_gain_leaves_the_zeros_and_stabilises_the_rest() -> None:
    poles_of_F = np.linalg.eigvals(obsdesign.design(with_zeros()).gains["F"])
    assert np.abs(poles_of_F - complex(-0.5, 1)).min() < 1e-9
    assert poles_of_F.real.max() < -0.4


POLES = [
    ([-1, -2], "observer.poles must give 3 poles besides the invariant zeros -0.5 +- 1i, which stay (n - q = 5; a pair [re, im] counts with its conjugate); got 2."),
    ([-1, -2, -3, -4, -5], "observer.poles must give 3 poles besides the invariant zeros -0.5 +- 1i, which stay (n - q = 5; a pair [re, im] counts with its conjugate); got 5."),
]  # fmt: skip


@pytest.mark.parametrize(("poles", "message"), POLES)
def test_poles_that_cannot_be_had(poles: list[Any], message: str) -> None:
    with pytest.raises(obsdesign.InputError) as error:
        obsdesign.design(with_zeros(poles=poles))
    assert str(error.value) == message


BAD = [
    ({"weights": {"state": [1.0] * 5}, "poles": [-1, -2, -3]}, {}, "observer.poles and observer.weights both choose L; drop one."),
    ({}, {"flow.D": None}, "flow.D is required by kind 'unknown_input'; it is missing."),
    ({}, {"jump": {"dwell_time": [1, 2]}}, "[jump] and [[event]] must be absent for kind 'unknown_input': its equations hold between jumps only. Drop them, or choose kind luenberger and bound d as flow.disturbance."),
    ({"differentiator": "batch"}, {}, "output.noise_std is required by differentiator = 'batch', positive for every output; got [0.0, 0.0, 0.0]."),
]  # fmt: skip


@pytest.mark.parametrize(("observer", "changes", "message"), BAD)
def test_bad_input(observer: Any, changes: dict[str, Any], message: str) -> None:
    body = example(**observer).to_dict()
    for path, value in changes.items():
        if value is None:
            block, key = path.split(".")
            del body[block][key]
        else:
            body[path] = value
    with pytest.raises(obsdesign.InputError) as error:
        obsdesign.design(obsdesign.Problem.from_dict(body))
    assert str(error.value) == message


def test_given_gains_are_kept_or_refuted() -> None:
    design = obsdesign.design(example())
    given = {"T1": design.gains["T1"], "L": design.gains["L"]}
    same = obsdesign.design(example(gains=given))
    for name, value in design.gains.items():
        if not isinstance(value, str):
            np.testing.assert_allclose(same.gains[name], value, atol=1e-9, err_msg=name)
    bad = {"T1": given["T1"], "L": given["L"] - 50 * np.sign(design.gains["Z"] @ design.gains["C"]
                                                            @ given["T1"][:, :3]).T}  # fmt: skip
    outcome = obsdesign.investigate(example(gains=bad))
    assert verdicts(outcome.claims)["hurwitz"] == "refuted"
    with pytest.raises(obsdesign.InputError, match=r"observer.poles chooses L, but L is given"):
        obsdesign.design(example(gains=given, poles=[-1, -2, -3]))


def test_coordinates_do_not_change_the_estimates() -> None:
    """T1 = [Ta, D] with any Ta: the same poles give the same estimates, since d decides them."""
    rng = np.random.default_rng(0)
    A, C, D = random_plant(rng, 4, 2, 2)  # p = q: no L, so nothing is chosen
    A = A - 2 * np.eye(4)
    zeros = obsdesign.investigate(unknown_input_problem(A, C, D))
    assert zeros.verdict in ("proved", "refuted")
    A, C, D = plant_with_zeros(rng, 4, 2, 2, -np.eye(2) + [[0, 1], [0, 0]])
    own = obsdesign.design(unknown_input_problem(A, C, D))
    T1 = np.hstack([rng.standard_normal((4, 2)), D])
    other = obsdesign.design(
        unknown_input_problem(A, C, D, gains={"T1": T1, "L": np.zeros((2, 0))})
    )
    t = 0.05 * np.arange(200)
    y = np.column_stack([np.sin(t), np.cos(2 * t)])
    own_run, other_run = (from_design(d).run_batch(t, y, x=np.ones(4)) for d in (own, other))
    np.testing.assert_allclose(own_run.x, other_run.x, atol=1e-8)
    np.testing.assert_allclose(own_run.d[1:], other_run.d[1:], atol=1e-7)


@pytest.mark.parametrize("states", [[0, 0, 0, 0, 0], [3, -8, 0, 11, -5]])
def test_units_do_not_matter(states: list[int]) -> None:
    """Left to itself, the design does not depend on units; powers of two keep numbers exact.

    Those of the states are told apart to a factor of two or so, which is what balancing does.
    """
    body = example().to_dict()
    A, C, D, B = (np.array(body[b][k]) for b, k in (("flow", "A"), ("output", "C"),
                                                     ("flow", "D"), ("flow", "B")))  # fmt: skip
    own = obsdesign.design(unknown_input_problem(A, C, D, B))
    x, y, d, t = 2.0 ** np.array(states), 2.0 ** np.array([6, 0, -9]), 2.0**7, 2.0**4
    S = np.diag(x)  # x in new units, and time in units of 1/t
    other = obsdesign.design(unknown_input_problem(
        S @ A @ np.diag(1 / x) / t, np.diag(y) @ C @ np.diag(1 / x), S @ D * d / t, S @ B / t
    ))  # fmt: skip
    poles = [np.sort_complex(np.linalg.eigvals(design.gains["F"])) for design in (own, other)]
    if any(states):
        ratios = np.sort(np.abs(poles[1] * t)) / np.sort(np.abs(poles[0]))
        assert np.all((ratios > 0.5) & (ratios < 2))
        return
    np.testing.assert_allclose(poles[1] * t, poles[0], rtol=1e-7)
    rows = np.random.default_rng(0).standard_normal((40, 3))
    times = 0.1 * np.arange(40)
    own_run = from_design(own).run_batch(times, rows, x=np.zeros(5))
    other_run = from_design(other).run_batch(times * t, rows * y, x=np.zeros(5))
    np.testing.assert_allclose(other_run.x / x, own_run.x, atol=1e-6 * np.abs(own_run.x).max())
    np.testing.assert_allclose(
        other_run.d[1:] * d, own_run.d[1:], atol=1e-6 * np.abs(own_run.d[1:]).max()
    )


def test_every_false_matrix_is_refuted() -> None:
    problem = example()
    gains = dict(obsdesign.design(problem).gains)
    for name in ("T", "N", "Z", "L", "F", "H", "Gu", "X", "Xy", "Q", "R", "S", "T1"):
        wrong = gains[name] + 1e-6 * np.abs(gains[name]).max()
        result = claims(problem, gains | {name: wrong}, {})
        assert verdicts(result)["observer_equations"] == "refuted", name
    # the twin: rounding in the last digits is not held against it
    result = claims(problem, gains | {"F": gains["F"] * (1 + 1e-15)}, {})
    assert set(verdicts(result).values()) == {"proved"}


def test_gains_of_another_shape_are_refuted() -> None:
    problem = example()
    gains = dict(obsdesign.design(problem).gains)
    without = {name: value for name, value in gains.items() if name != "F"}
    for wrong in (gains | {"F": gains["F"][:2, :2]}, without, gains | {"C": gains["C"] + 1}):
        assert verdicts(claims(problem, wrong, {}))["consistent"] == "refuted"


@pytest.mark.parametrize("shape", [(1, 1, 1), (2, 2, 2), (2, 3, 2), (3, 3, 1), (4, 2, 2)])
def test_degenerate_sizes_from_file_to_estimate(
    shape: tuple[int, int, int], tmp_path: Path
) -> None:
    n, p, q = shape
    rng = np.random.default_rng(n + 7 * p)
    if (n, p, q) == (4, 2, 2):
        A, C, D = plant_with_zeros(rng, n, p, q, -np.eye(2))
    else:
        A, C, D = random_plant(rng, n, p, q)
    design = obsdesign.design(unknown_input_problem(A, C, D))
    path = tmp_path / "design.json"
    design.save(path)
    again = load_design(path)
    assert obsdesign.verify(again).verdict == "proved"
    t, y = 0.1 * np.arange(30), rng.standard_normal((30, p))
    own_run, other_run = from_design(design).run_batch(t, y), from_design(again).run_batch(t, y)
    np.testing.assert_array_equal(own_run.x, other_run.x)
    np.testing.assert_array_equal(own_run.d, other_run.d)
    assert np.isnan(own_run.d[0]).all()
    if p == q == n:  # everything is seen at once
        np.testing.assert_allclose(own_run.x @ C.T, y, atol=1e-9)


def test_verify_needs_no_solver_and_the_runtime_numpy_alone(tmp_path: Path) -> None:
    path = tmp_path / "design.json"
    obsdesign.design(example()).save(path)
    code = f"""
import obsdesign
assert obsdesign.verify(obsdesign.load_design({str(path)!r})).verdict == "proved"
"""
    done = run_blocked(SOLVERS, code)
    assert done.returncode == 0, done.stderr
    code = f"""
before = set(sys.modules)
from obsdesign.runtime import Sample, load
observer = load({str(path)!r})
state = observer.init(t=0.0)
for k in range(10):
    state, estimate = observer.step(state, Sample(k / 10, y=[1.0, 2.0, 3.0], u=[0.0]))
third = set(m.split(".")[0] for m in set(sys.modules) - before) - set(sys.stdlib_module_names)
third = set(m for m in third if not m.startswith("_"))
assert third <= {{"numpy", "obsdesign", "lmi"}}, third
"""
    done = run_blocked((*SOLVERS, "scipy", "flint", "matplotlib", "jsonschema", "click"), code)
    assert done.returncode == 0, done.stderr


def test_a_long_period_is_warned_of_with_its_number() -> None:
    body = example(poles=[-1, -2, -300]).to_dict()
    body["output"] |= {"measured": "periodic", "period": 0.1}
    design = obsdesign.design(obsdesign.Problem.from_dict(body))
    assert not any("h |f|" in g.statement for g in design.guarantees)
    (warning,) = (text for text in design.warnings if "h |f|" in text)
    assert "The steps ring: h |f| = 30 for the period h = 0.1" in warning
    body["output"]["period"] = 0.005
    fine = obsdesign.design(obsdesign.Problem.from_dict(body))
    sentences = [g for g in fine.guarantees if "h |f|" in g.statement]
    assert sentences[0].given


def test_noise_chooses_the_left_inverse() -> None:
    """Of all left inverses of C D the stored one lets the least noise into d."""
    body = example(p=4).to_dict()
    body["output"]["noise_std"] = [0.1, 1.0, 0.3, 2.0]
    problem = obsdesign.Problem.from_dict(body)
    gains = obsdesign.design(problem).gains
    V = np.diag(np.array([0.1, 1.0, 0.3, 2.0]) ** 2)
    best = gains["N"] @ V @ gains["N"].T
    rng = np.random.default_rng(0)
    for _ in range(20):
        other = gains["N"] + rng.standard_normal((2, 2)) @ gains["Z"]
        assert np.linalg.eigvalsh(other @ V @ other.T - best).min() > -1e-12


def test_the_design_is_json_that_reads_back(tmp_path: Path) -> None:
    path = tmp_path / "design.json"
    design = obsdesign.design(example(differentiator="damped"))
    design.save(path)
    again = load_design(path)
    assert isinstance(again, Design)
    assert json.loads(path.read_text())["digest"] == again.to_dict()["digest"]
    assert again.gains["differentiator"] == "damped"
