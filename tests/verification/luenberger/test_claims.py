"""Point observers with jumps: designed, proved, executed; laws and twins."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import obsdesign
from obsdesign.analysis.hidden_modes import approx_unobservable_modes, hidden_growth, hidden_part
from obsdesign.equations.luenberger import error_system as equations
from obsdesign.synthesis.placement import placed_gain, riccati_gain
from obsdesign.verification.luenberger.claims import claims
from tests.systems.luenberger import BASE, problem


def verdicts(outcome: obsdesign.Outcome) -> dict[str, str]:
    return {claim.id: claim.verdict for claim in outcome.claims}


# --- design -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"observer__poles": [-1, [-2, 1]]},
        {"observer__decay_rate": 0.4},
        {"observer__weights": {"state": [1, 2, 3], "output": [0.1, 0.1]}},
        {"output__jump_measurement": "after"},
        {"output__measured": "at_jumps"},
        {"jump__dwell_time": [0.3, "inf"]},
        {"jump__dwell_time": [0.5, 0.5]},
        {"observer__gains": {"M": [[0, 0], [0, 0], [0, 0]]}},
    ],
)
def test_missing_gains_are_found_and_proved(changes: dict[str, Any]) -> None:
    design = obsdesign.design(problem(**changes))
    again = obsdesign.verify(design)
    assert set(verdicts(again).values()) == {"proved"}
    F = design.gains["A"] - design.gains["L"] @ design.gains["C"]
    if "observer__poles" in changes:
        poles = np.sort_complex(np.linalg.eigvals(F))
        np.testing.assert_allclose(poles, [-2 - 1j, -2 + 1j, -1], atol=1e-8)
    if "output__measured" in changes:
        assert not design.gains["L"].any()


def test_given_gains_are_kept_and_may_be_refuted() -> None:
    zeros = {"L": [[0, 0]] * 3, "M": [[0, 0]] * 3}
    outcome = obsdesign.investigate(problem(observer__gains=zeros))
    assert verdicts(outcome)["dwell_stability"] == "refuted"
    assert not outcome.design.gains["L"].any()


def test_gains_that_were_searched_for_leave_the_problem_undecided() -> None:
    # one output, six states, large jumps: gains may exist, but none of those tried is proved
    rng = np.random.default_rng(11)
    hard = {"flow__A": rng.standard_normal((6, 6)).tolist(),
            "jump__G": (5 * rng.standard_normal((6, 6))).tolist(),
            "output__C": rng.standard_normal((1, 6)).tolist()}  # fmt: skip
    outcome = obsdesign.investigate(problem(**hard))
    assert outcome.verdict == "undecided"
    reason = outcome.claims[-1].evidence["reason"]
    assert reason.startswith(
        "no gains or options that the problem leaves open were found for which it holds; "
    )


def test_a_hidden_mode_that_grows_refutes_an_endless_range() -> None:
    hidden = {"flow__A": [[-1, 0, 0], [0, 1, 0], [0, 0, -1]], "jump__G": np.eye(3).tolist(),
              "jump__dwell_time": [0.3, "inf"]}  # fmt: skip
    outcome = obsdesign.investigate(problem(**hidden))
    assert outcome.verdict == "refuted"
    flow = next(c for c in outcome.claims if c.id == "hurwitz")
    assert flow.evidence["witness"]["eigenvalue"] == {"real": 1.0, "imag": 0.0}


def test_what_no_gain_reaches_refutes_every_gain() -> None:
    # C sees neither the second state nor what it does at jumps: it is stable by itself, or never
    for growth, verdict in ((1.0, "refuted"), (-0.5, "proved")):
        hidden = {
            "flow__A": [[-1, 0, 0], [0, growth, 0], [0, 0, -1]],
            "jump__G": np.eye(3).tolist(),
        }
        assert obsdesign.investigate(problem(**hidden)).verdict == verdict
    # a jump that lets C see the state makes it a matter of gains again
    A, C = np.diag([-1.0, 1.0]), np.array([[1.0, 0.0]])
    assert hidden_part([A, np.eye(2)], C) is not None
    assert hidden_part([A, np.array([[1.0, 0.5], [0, 1]])], C) is None
    # without L a flow that is not Hurwitz refutes an endless range, whatever M is
    endless = {"output__measured": "at_jumps", "jump__dwell_time": [0.3, "inf"]}
    assert obsdesign.investigate(problem(**endless)).verdict == "refuted"


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"observer__poles": [-1, -2, -3], "observer__gains": {"L": [[0, 0]] * 3}}, "observer.poles chooses L, but L is given or must be zero; drop one."),
        ({"observer__weights": {"state": [1, 1, 1]}, "output__measured": "at_jumps"}, "observer.weights chooses L, but L is given or must be zero; drop one."),
        ({"observer__weights": {"state": [1, 1, 1]}, "observer__poles": [-1, -2, -3]}, "observer.poles and observer.weights both choose L; drop one."),
    ],
)  # fmt: skip
def test_options_that_contradict_each_other(changes: dict[str, Any], line: str) -> None:
    with pytest.raises(obsdesign.InputError) as error:
        obsdesign.investigate(problem(**changes))
    assert str(error.value) == line


@pytest.mark.parametrize("exponent", [-20, 20])
def test_the_unit_of_time_does_not_matter(exponent: int) -> None:
    unit = 2.0**exponent
    A = (np.array(BASE["flow"]["A"]) * unit).tolist()
    dwell = [t / unit for t in BASE["jump"]["dwell_time"]]
    scaled = obsdesign.design(problem(flow__A=A, jump__dwell_time=dwell))
    plain = obsdesign.design(problem())
    np.testing.assert_allclose(scaled.gains["L"] / unit, plain.gains["L"], rtol=1e-6)


def test_the_decay_rate_is_a_claim_and_its_twin_fails() -> None:
    gains = {"L": [[1, 0], [0, 0], [0, 1]], "M": [[0, 0]] * 3}
    body = {"flow__A": np.diag([-1.0, -2, -3]).tolist(), "jump__G": np.eye(3).tolist(),
            "output__C": [[0, 0, 0], [0, 0, 0]], "observer__gains": gains}  # fmt: skip
    slow = obsdesign.investigate(problem(**body, observer__decay_rate=0.99))
    assert verdicts(slow)["decay_rate"] == "proved"
    fast = obsdesign.investigate(problem(**body, observer__decay_rate=1.01))
    assert verdicts(fast) == {
        "consistent": "proved", "dwell_stability": "proved", "rates": "proved",
        "decay_rate": "refuted",
    }  # fmt: skip


def test_a_spoilt_certificate_proves_nothing() -> None:
    design = obsdesign.design(problem())
    P = np.array(next(c for c in design.claims if c.id == "dwell_stability").evidence["P"])
    stated = problem()
    assert claims(stated, design.gains, {"dwell_stability": {"P": P}})[-1].verdict == "proved"
    for bad in (-P, P + np.triu(np.ones((3, 3)), 1), np.eye(2), "P", np.diag([1e9, 1, 1])):
        assert (
            claims(stated, design.gains, {"dwell_stability": {"P": bad}})[-1].verdict == "undecided"
        )


def test_a_plant_without_jumps() -> None:
    body = copy.deepcopy(BASE)
    del body["jump"]
    design = obsdesign.design(obsdesign.Problem.from_dict(body))
    assert [c.id for c in design.claims] == ["consistent", "hurwitz"]
    assert not design.gains["M"].any()
    body["observer"]["gains"] = {"L": [[0, 0]] * 3}
    assert obsdesign.investigate(obsdesign.Problem.from_dict(body)).verdict == "refuted"


# --- gains ------------------------------------------------------------------------------------


@settings(max_examples=16, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 6), rate=st.floats(0.0, 2.0))
def test_the_riccati_gain_decays_at_the_rate(seed: int, n: int, rate: float) -> None:
    rng = np.random.default_rng(seed)
    A, C = rng.standard_normal((n, n)), rng.standard_normal((int(rng.integers(1, n + 1)), n))
    L = riccati_gain(A, C, rate=rate)
    assert np.linalg.eigvals(A - L @ C).real.max() < -rate


def test_the_riccati_gain_leaves_hidden_modes_alone() -> None:
    A, C = np.diag([2.0, 1.0, -1.0]), np.array([[1.0, 0, 0]])
    eigenvalues = np.sort(np.linalg.eigvals(A - riccati_gain(A, C) @ C).real)
    np.testing.assert_allclose(eigenvalues[1:], [max(eigenvalues[1], -1), 1], atol=1e-9)
    assert eigenvalues[0] < 0


def test_poles_are_placed_or_refused() -> None:
    A, C = np.array([[0.0, 1], [0, 0]]), np.array([[1.0, 0]])
    L = placed_gain(A, C, [[-1, 2]])
    np.testing.assert_allclose(np.sort_complex(np.linalg.eigvals(A - L @ C)), [-1 - 2j, -1 + 2j])
    cases = {
        "observer.poles must give 2 poles, one per state (a pair [re, im] counts with its conjugate); got 3.": (A, C, [-1, [-2, 1]]),
        "observer.poles: the mode 0 of flow.A cannot be moved, since output.C does not see it; leave poles out.": (A, np.array([[0.0, 1]]), [-1, -2]),
    }  # fmt: skip
    for line, arguments in cases.items():
        with pytest.raises(obsdesign.InputError) as error:
            placed_gain(*arguments)
        assert str(error.value) == line


def test_the_inequality_is_schurs_complement_of_the_contraction() -> None:
    rng = np.random.default_rng(0)
    n, p = 3, 2
    G, C, M, E = (rng.standard_normal(shape) for shape in ((n, n), (p, n), (n, p), (4, n, n)))
    root = rng.standard_normal((n, n))
    P = root @ root.T + np.eye(n)
    whole = equations.post_jump_inequality(P, P @ M, G, C, E)
    for block, flow in zip(whole, E, strict=True):
        step = (G - M @ C) @ flow
        np.testing.assert_allclose(block, block.T)
        assert (np.linalg.eigvalsh(block)[0] > 0) == (
            np.linalg.eigvalsh(P - step.T @ P @ step)[0] > 0
        )


@settings(max_examples=16, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), hidden=st.integers(0, 2))
def test_hidden_modes_are_seen_in_any_coordinates(seed: int, hidden: int) -> None:
    rng = np.random.default_rng(seed)
    n, observed = 4, 4 - hidden
    A = np.zeros((n, n))
    A[:observed, :observed] = rng.standard_normal((observed, observed))
    A[observed:, observed:] = np.diag([0.5, 1.5][:hidden])
    A[observed:, :observed] = rng.standard_normal((hidden, observed))
    C = np.hstack([rng.standard_normal((1, observed)), np.zeros((1, hidden))])
    order = rng.permutation(n)
    permuted, output = A[np.ix_(order, order)], C[:, order]  # a permutation is exact
    assert hidden_growth(permuted, output) == (hidden > 0)
    assert len(approx_unobservable_modes(permuted, output)) == hidden


# --- alternating dwell times ------------------------------------------------------------------


def sampled_data_problem(
    longest: float, jitter: float = np.inf, **options: Any
) -> obsdesign.Problem:
    """A sampled-data benchmark: every constant dwell time is stable, alternating ones are not."""
    zeros = np.zeros((3, 1)).tolist()
    G = [[1, 0, 0], [0, 1, 0], [1, 0, 0]]
    return obsdesign.Problem(
        flow={"A": [[0, 1, 0], [-2, 0.1, 1], [0, 0, 0]]},
        jump={"G": G, "dwell_time": [0.4, longest], "dwell_jitter": jitter},
        output={"C": [[1, 0, 0]]},
        observer={"kind": "luenberger", "gains": {"L": zeros, "M": zeros}, **options},
    )


def sampled_data(longest: float, jitter: float = np.inf, **options: Any) -> obsdesign.Outcome:
    return obsdesign.investigate(sampled_data_problem(longest, jitter, **options))


def test_a_sequence_of_dwell_times_may_refute_where_no_single_one_does() -> None:
    outcome = sampled_data(1.889)
    claim = outcome.claims[-1]
    assert outcome.verdict == "refuted"
    thetas = claim.evidence["witness"]["thetas"]
    product = np.eye(3)
    for theta in thetas:
        assert 0.4 <= theta <= 1.889
        flow = np.zeros((3, 3))
        flow[:] = [[0, 1, 0], [-2, 0.1, 1], [0, 0, 0]]
        from scipy.linalg import expm

        product = expm(flow * theta) @ [[1, 0, 0], [0, 1, 0], [1, 0, 0]] @ product
    assert max(abs(np.linalg.eigvals(product))) > 1


def test_no_common_p_is_not_instability() -> None:
    outcome = sampled_data(1.87, memory=0)
    claim = outcome.claims[-1]
    assert claim.verdict == "undecided"
    assert "no common P exists" in claim.evidence["reason"]
    assert claim.evidence["reason"].endswith("which is not instability")
    assert sampled_data(1.82).verdict == "proved"


def test_a_forged_sequence_refutes_nothing() -> None:
    stated = problem()
    design = obsdesign.design(stated)
    for thetas in ([0.5, 0.7], [5.0], ["x"], 3):
        forged = {"dwell_stability": {"witness": {"thetas": thetas}}}
        assert claims(stated, design.gains, forged)[-1].verdict == "undecided"


# --- laws: other units --------------------------------------------------------------------------


@pytest.mark.parametrize("jump_measurement", ["before", "after"])
@pytest.mark.parametrize("units", [(1e8, 1, 1), (1, 1e-8, 1e4), (1e-9, 1e9, 1)])
@pytest.mark.parametrize("outputs", [(1, 1), (1e7, 1e-6)])
def test_open_gains_are_proved_in_all_units(
    units: tuple[float, ...], outputs: tuple[float, ...], jump_measurement: str
) -> None:
    """States in other units, outputs in other units: a jump that only M makes stable, and none."""
    D, rows = np.diag(units), np.diag(outputs)
    back = np.diag(1 / np.array(units))
    A = np.array([[-0.3, 1, 0], [-1, -0.3, 0.2], [0, 0.4, -0.8]])
    G = np.array([[2.0, 0.3, 0], [0, 0.5, 0.1], [0.2, 0, 0.9]])
    C = np.array([[1, 0, 0.5], [0, 1, 0]])
    for is_seen, expected in ((1, "proved"), (0, "refuted")):
        outcome = obsdesign.investigate(
            problem(
                flow__A=(D @ A @ back).tolist(),
                jump__G=(D @ G @ back).tolist(),
                jump__dwell_time=[0.05, 0.2],
                output__C=(is_seen * rows @ C @ back).tolist(),
                output__jump_measurement=jump_measurement,
            )
        )
        assert verdicts(outcome)["dwell_stability"] == expected
