"""Claims of finite-time designs: refusals in order with witnesses, twins that are not proved."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import obsdesign
from lmi.arithmetic.balls import precision
from obsdesign.analysis.finite_time.enclosed_gains import Sampled
from obsdesign.design_file import from_dict
from obsdesign.document import Design, digest
from obsdesign.errors import InputError
from obsdesign.verification.finite_time.claims import claims

ROTATION = [[0, 0.15], [-0.15, 0]]
L = [[0], [0.1]]


def sampled_problem(
    A: Any = ROTATION, C: Any = ((0.3, 0.0),), period: float = 0.05, *, flow: Any = None,
    output: Any = None, jump: Any = None, **observer: Any,
) -> obsdesign.Problem:  # fmt: skip
    return obsdesign.Problem(
        flow={"A": A, **(flow or {})}, jump=jump, observer={"kind": "finite_time", **observer},
        output={"C": C, "measured": "periodic", "period": period, **(output or {})},
    )  # fmt: skip


def failed(problem: obsdesign.Problem) -> obsdesign.Claim:
    """The one refuted claim; it is the last one that is told."""
    outcome = obsdesign.investigate(problem)
    assert outcome.verdict == "refuted"
    assert [c.verdict for c in outcome.claims[:-1]] == ["proved"] * (len(outcome.claims) - 1)
    return outcome.claims[-1]


def reason(claim: obsdesign.Claim) -> str:
    return str(claim.evidence["witness"]["reason"])


# --- refusals, in order ---------------------------------------------------------------------------

WRONG: list[tuple[dict[str, Any], str]] = [
    ({"window": 6.02}, "observer.window must be a multiple of output.period = 0.05; got 6.02, which is 120.4 periods. The nearest multiples are 6 and 6.05."),
    ({"window": 0.04}, "observer.window must be at least output.period = 0.05; got 0.04. The window holds no sample."),
    ({"window": 1e6}, "observer.window must hold at most 20000 samples; got 2e+07, 1000000.0 with period 0.05."),
    ({"method": "minimax", "window": 6, "output": {"noise_bound": 0}}, "observer.method = 'minimax' needs a nonzero output.noise_bound or flow.disturbance: it makes the largest error small, and without either there is none."),
    ({"half_sample_correction": True, "window": 6}, "observer.half_sample_correction belongs to method = 'approximate'; the method is 'least_squares', which has no bias to correct."),
    ({"objective": "least_noise", "window": 6}, "observer.objective = 'least_noise' chooses the window of method 'least_squares', and nothing else; observer.window = 6.0 is given. Leave one out."),
    ({"objective": "longest_period"}, "observer.objective = 'longest_period' chooses L and the window of methods 'exact' and 'approximate' by condition (13); the method is 'least_squares', which has none."),
    ({"method": "minimax", "window": 6}, "output.noise_bound is required by observer.method = 'minimax', which guarantees bounds; it is missing. If y is free of noise, write noise_bound = [0.0]."),
    ({"objective": "shortest_window", "method": "minimax", "window": 6, "output": {"noise_bound": [1]}}, "observer.objective = 'shortest_window' chooses the window of method 'minimax', and nothing else; observer.window = 6.0 is given. Leave one out."),
    ({"objective": "shortest_window", "method": "exact", "window": 6}, "observer.objective = 'shortest_window' chooses the window; observer.window = 6.0 is given. Leave one out."),
    ({"objective": "least_noise", "method": "exact", "window": 6, "gains": {"L": L}}, "observer.objective = 'least_noise' chooses L and the window of method 'exact'; observer.gains.L and observer.window are given. Leave one of them out."),
    ({"output": {"measured": "continuous"}, "window": 6}, "output.measured must be periodic for kind 'finite_time'; got 'continuous'."),
]  # fmt: skip


@pytest.mark.parametrize(("changes", "message"), WRONG)
def test_problems_that_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as error:
        obsdesign.investigate(sampled_problem(**changes))
    assert str(error.value) == message


def test_decimal_windows_are_whole() -> None:
    # 0.3 / 0.1 is 2.9999999999999996 in binary64
    assert obsdesign.design(sampled_problem(period=0.1, window=0.3)).gains["samples"] == 3


def test_unobservable_even_if_detectable() -> None:
    claim = failed(sampled_problem([[-1, 0], [0, -2]], [[1, 0]], window=1))
    assert claim.id == "observable"
    assert reason(claim) == "the state (0, 1) is unobservable: C A^k x = 0 for all k"
    # the twin: a coupling so small that floats would call it zero is enough for the claim itself
    tiny = obsdesign.investigate(sampled_problem([[-1, 1e-30], [0, -2]], [[1, 0]], window=1))
    assert {c.id: c.verdict for c in tiny.claims}["observable"] == "proved"


@pytest.mark.parametrize("method", ["exact", "approximate"])
def test_no_gain_helps_an_unobservable_state(method: str) -> None:
    """L is open, yet the answer is no, not perhaps."""
    claim = failed(sampled_problem([[-1, 0], [0, -2]], [[1, 0]], window=1, method=method))
    assert claim.id == "observable"
    period = 2 * np.pi / 0.3
    claim = failed(sampled_problem(period=period, window=2 * period, method=method))
    assert claim.id == "sampled_observable"
    assert failed(sampled_problem(window=0.05, method=method)).id == "window_long_enough"
    # the twin: an L that was looked for and is of no use refutes nothing
    fast = sampled_problem([[50, 1], [0, 40]], [[1, 0]], 0.5, window=20, method=method)
    assert obsdesign.investigate(fast).verdict != "refuted"


@pytest.mark.parametrize("method", ["least_squares", "exact", "approximate"])
def test_gains_beyond_floats_are_an_answer(method: str) -> None:
    # e^{50 T} with T = 20 overflows
    given = {} if method == "least_squares" else {"gains": {"L": [[1], [1]]}}
    for sign in (1, -1) if method == "least_squares" else (1,):
        A = sign * np.array([[50.0, 1], [0, 40]])
        problem = sampled_problem(A, [[1, 0]], 0.5, window=20, method=method, **given)
        outcome = obsdesign.investigate(problem)
        assert outcome.verdict in ("proved", "refuted", "undecided")
        gains = outcome.design.gains  # type: ignore[union-attr]
        assert np.isfinite(gains["window_gain"]).all()
        # where all has decayed, no gains at all are right
        right = bool(np.any(gains["window_gain"])) or sign < 0
        assert (outcome.verdict == "proved") == right


def test_pathological_sampling_names_pair_and_period() -> None:
    period = 2 * np.pi / 0.3
    claim = failed(sampled_problem(period=period, window=2 * period))
    assert claim.id == "sampled_observable"
    text = reason(claim)
    assert text.startswith("pathological sampling: the eigenvalues ")
    assert "differ by 1 times 2 pi i / period" in text
    assert repr(period) in text
    vector = np.array(claim.evidence["witness"]["vector"])
    assert np.linalg.norm(vector) == pytest.approx(1)
    # close to it the plant is solved: k = 2 at 95 % of that period
    assert obsdesign.design(sampled_problem(period=20.0, window=40.0)).gains["samples"] == 2


@pytest.mark.parametrize(("period", "samples"), [(0.05, 6), (0.02, 12)])
def test_a_window_that_would_do_is_named(period: float, samples: int) -> None:
    # six slow modes in one output: neighbouring samples are almost the same
    plant = {"A": np.diag([0.1, 0.2, 0.3, 0.4, 0.5, 0.6]), "C": [[1] * 6]}
    claim = failed(sampled_problem(**plant, period=period, window=samples * period))
    assert claim.id == "sampled_observable"
    advice = re.search(r"hardly see a state; (\d+) of them, a window of (\S+), see", reason(claim))
    assert advice is not None
    window = float(advice[2])
    assert window == pytest.approx(period * int(advice[1]))
    outcome = obsdesign.investigate(sampled_problem(**plant, period=period, window=window))
    assert outcome.verdict == "proved"
    # the twin: where no window helps, none is named
    claim = failed(sampled_problem(**plant, period=1e-5, window=6e-5))
    assert reason(claim).endswith("hardly see a state; change the period or the window")


def test_several_outputs_survive_a_pathological_period() -> None:
    period = 2 * np.pi / 0.3
    design = obsdesign.design(sampled_problem(C=np.eye(2), period=period, window=2 * period))
    assert any("near pathological sampling" in text for text in design.warnings)


def test_too_few_samples() -> None:
    chain = np.diag([1.0, 1.0, 1.0], 1)
    claim = failed(sampled_problem(chain, [[1, 0, 0, 0]], 0.1, window=0.3))
    assert claim.id == "window_long_enough"
    assert reason(claim) == "the window holds 3 samples; at least 4 are needed"
    obsdesign.design(sampled_problem(chain, [[1, 0, 0, 0]], 0.1, window=0.4))
    # two outputs need fewer
    both = [[1, 0, 0, 0], [0, 0, 1, 0]]
    obsdesign.design(sampled_problem(chain, both, 0.1, window=0.2))
    assert reason(failed(sampled_problem(chain, both, 0.1, window=0.1))).endswith(
        "at least 2 are needed"
    )


@pytest.mark.parametrize("method", ["approximate", "exact"])
def test_zero_injection(method: str) -> None:
    claim = failed(sampled_problem(window=6, method=method, gains={"L": [[0], [0]]}))
    assert claim.id == (
        "difference_invertible" if method == "approximate" else "injection_invertible"
    )
    assert reason(claim).endswith("is singular: L C = 0")


def test_a_singular_difference_names_its_window() -> None:
    # x'' = u, F = A + L C with eigenvalues +-2 pi i: e^{-F T} = I at T = 1, and M_T has rank 1
    gain = [[0], [-((2 * np.pi) ** 2)]]
    chain = [[0, 1], [0, 0]]
    plant: dict[str, Any] = {"A": chain, "C": [[1, 0]], "period": 0.125, "gains": {"L": gain}}
    claim = failed(sampled_problem(**plant, window=1, method="approximate"))
    assert claim.id == "difference_invertible"
    assert "at T = 1: smallest singular value less than 1e-14 of its norm;" in reason(claim)
    obsdesign.design(sampled_problem(**plant, window=0.75, method="approximate"))
    # the exact observer has its own matrix, which is regular there
    obsdesign.design(sampled_problem(**plant, window=1, method="exact"))


def test_condition_13_fails_and_blocks_nothing() -> None:
    design = obsdesign.design(
        sampled_problem(period=0.5, window=6, method="approximate", gains={"L": L})
    )
    entries = [entry for entry in design.guarantees if "Theorem 1" in entry.statement]
    assert [entry.given for entry in entries] == [False]
    assert "it holds for periods below 0.0515755343" in entries[0].statement
    # the twin
    design = obsdesign.design(sampled_problem(window=6, method="approximate", gains={"L": L}))
    assert [e.given for e in design.guarantees if "Theorem 1" in e.statement] == [True, True]


# --- stored numbers that are not what they should be ----------------------------------------------


def changed(design: Design, name: str, change: Any) -> Design:
    value = np.array(design.gains[name], copy=True)
    return replace(design, gains={**design.gains, name: change(value)})


@pytest.mark.parametrize("method", ["least_squares", "exact", "approximate"])
def test_gains_that_miss_are_refuted(method: str) -> None:
    given = {} if method == "least_squares" else {"gains": {"L": L}}
    design = obsdesign.design(sampled_problem(window=6, method=method, **given))
    assert obsdesign.verify(design, paranoid=True).verdict == "proved"

    def nudge(G: Any) -> Any:
        G[0, 3] *= 1 + 1e-6
        return G

    outcome = obsdesign.verify(changed(design, "window_gain", nudge))
    assert outcome.verdict == "refuted"
    wrong = [c.id for c in outcome.claims if c.verdict == "refuted"]
    assert wrong[0] == ("unbiased" if method == "least_squares" else "gains_of_the_method")


def numbers(value: Any, path: tuple[Any, ...] = ()) -> Any:
    """Paths of all numbers in nested lists and dictionaries."""
    if isinstance(value, dict | list):
        for name, inner in value.items() if isinstance(value, dict) else enumerate(value):
            yield from numbers(inner, (*path, name))
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield path


@pytest.mark.parametrize("method", ["least_squares", "exact", "approximate"])
def test_every_number_in_evidence_is_checked(method: str) -> None:
    given = {} if method == "least_squares" else {"gains": {"L": L}}
    output = {"noise_bound": [0.1]}
    whole = obsdesign.design(
        sampled_problem(period=0.25, window=2, method=method, output=output, **given)
    )
    assert obsdesign.verify(from_dict(whole.to_dict())).verdict == "proved"  # the twin
    every = 3 if method == "approximate" else 1  # its integral takes a while
    for path in list(numbers(whole.to_dict()["claims"]))[::every]:
        if path[-1] == 1:  # of intervals one end
            continue
        body = whole.to_dict()
        inner: Any = body["claims"]
        for name in path[:-1]:
            inner = inner[name]
        inner[path[-1]] = 1.1 * inner[path[-1]] + 1e-300
        body["digest"] = digest({name: x for name, x in body.items() if name != "digest"})
        # a ratio of singular values in floats proves nothing
        wanted = "undecided" if path[-1] == "approx_ratio" else "refuted"
        assert obsdesign.verify(from_dict(body)).verdict == wanted, path


def test_weights_of_missing_samples_are_those_of_the_problem() -> None:
    both = {"noise_std": [0.1, 0.2]}
    design = obsdesign.design(sampled_problem(C=np.eye(2), period=0.25, window=2, output=both))
    assert design.gains["deviations"].tolist() == [0.5, 1.0]
    outcome = obsdesign.verify(changed(design, "deviations", lambda d: d[::-1]))
    assert outcome.verdict == "refuted"
    assert {c.id: c.verdict for c in outcome.claims}["consistent"] == "refuted"


def test_a_small_radius_is_refuted() -> None:
    problem = sampled_problem(
        window=6, flow={"disturbance": {"lower": [-1, -1], "upper": [1, 1]}},
        output={"noise_bound": [0.1]},
    )  # fmt: skip
    design = obsdesign.design(problem)
    outcome = obsdesign.verify(changed(design, "radius", lambda r: r * (1 - 1e-6)))
    verdicts = {c.id: c.verdict for c in outcome.claims}
    assert verdicts["error_radius"] == "refuted"
    # nor may what runs be wider than what is told
    wider = obsdesign.verify(changed(design, "radius", lambda r: r * 1.5))
    assert {c.id: c.verdict for c in wider.claims}["error_radius"] == "refuted"
    rounded = obsdesign.verify(changed(design, "radius", lambda r: r * (1 + 1e-12)))
    assert {c.id: c.verdict for c in rounded.claims}["error_radius"] == "proved"


def test_another_l_or_window_is_noticed() -> None:
    design = obsdesign.design(sampled_problem(window=6, method="exact", gains={"L": L}))
    for name, change in (("L", lambda X: 2 * X), ("A", lambda X: 2 * X)):
        outcome = claims(
            obsdesign.Problem.from_dict(design.problem), changed(design, name, change).gains, {}
        )
        assert [c.verdict for c in outcome] == ["refuted"]
        assert outcome[0].id == "consistent"


def test_json_round_trip_and_claims_again() -> None:
    for method in ("least_squares", "exact", "approximate", "minimax"):
        problem = sampled_problem(window=1, method=method, output={"noise_bound": [0.1]})
        design = obsdesign.design(problem)
        again = from_dict(design.to_dict())
        assert again.to_dict() == design.to_dict()
        assert obsdesign.verify(again).verdict == "proved"


def test_high_gain_costs_digits_but_not_the_answer() -> None:
    # k = 120, L = [-20, -50]: floats reach 7e-3 here; rounding once from balls costs nothing
    design = obsdesign.design(
        sampled_problem(window=6, method="exact", gains={"L": [[-20], [-50]]})
    )
    error = {c.id: c for c in design.claims}["unbiased"].evidence["error"]
    assert error < 1e-12
    rows = np.abs(design.gains["window_gain"])
    assert np.linalg.norm(rows, 2) == pytest.approx(3.68 * 1.19523, rel=5e-3)


def test_huge_gains_are_reported() -> None:
    chain = np.diag([1.0] * 3, 1)
    design = obsdesign.design(sampled_problem(chain, [[1, 0, 0, 0]], 0.01, window=0.04))
    assert any("of 16 digits are lost" in text for text in design.warnings)


# --- laws -----------------------------------------------------------------------------------------


@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 10**6), n=st.integers(1, 5), p=st.integers(1, 3))
def test_claims_do_not_depend_on_coordinates_or_units(seed: int, n: int, p: int) -> None:
    rng = np.random.default_rng(seed)
    A, C = rng.standard_normal((n, n)), rng.standard_normal((min(p, n), n))
    scale = 2.0 ** rng.integers(-6, 6, n)
    outputs = 2.0 ** rng.integers(-6, 6, len(C))
    gains = []
    for X, Y in ((A, C), (A * scale[:, None] / scale, outputs[:, None] * C / scale)):
        design = obsdesign.design(sampled_problem(X, Y, 0.125, window=0.125 * 3 * n))
        gains.append(design.gains["window_gain"])
    if len(C) == 1:  # several outputs change their weights with their units
        scaled = scale[:, None] * gains[0] / np.tile(outputs, 3 * n)
        assert np.abs(gains[1] - scaled).max() <= 1e-9 * np.abs(scaled).max()


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_series_of_one_period_against_an_ode(seed: int) -> None:
    from scipy.integrate import solve_ivp

    from lmi.arithmetic.exponential import expm
    from lmi.arithmetic.norms import middles
    from obsdesign.analysis.finite_time.enclosed_gains import injection

    rng = np.random.default_rng(seed)
    n, p = int(rng.integers(1, 4)), int(rng.integers(1, 3))
    A, C, gain = (rng.standard_normal(s) for s in ((n, n), (p, n), (n, p)))
    period = float(rng.uniform(0.05, 1.0))

    def flow(s: float, q: Any) -> Any:
        return ((A + gain @ C @ expm(-A * s)) @ q.reshape(n, n)).ravel()

    P = solve_ivp(flow, (0, period), np.eye(n).ravel(), "DOP853", rtol=1e-10, atol=1e-10).y[:, -1]
    with precision(160):
        sampled = Sampled.from_plant(A, C, period, 1)
        enclosed = middles(sampled.forward + sampled.forward @ injection(sampled, gain) @ sampled.C)
    assert np.abs(P.reshape(n, n) - enclosed).max() <= 1e-7 * np.abs(enclosed).max()


@pytest.mark.parametrize(
    ("objective", "method", "samples"),
    [
        ("shortest_window", "least_squares", 2), ("shortest_window", "approximate", 84),
        ("longest_period", "approximate", 105),
    ],
)  # fmt: skip
def test_the_objective_chooses_the_window(objective: str, method: str, samples: int) -> None:
    kept = {"gains": {"L": L}} if method == "approximate" else {}
    design = obsdesign.design(sampled_problem(method=method, objective=objective, **kept))
    assert design.gains["samples"] == samples
    if kept:
        given = [e.given for e in design.guarantees if e.statement.startswith("Theorem 1")]
        assert given == [True]


@pytest.mark.parametrize("method", ["least_squares", "minimax", "exact"])
def test_a_gain_that_is_not_used_is_reported(method: str) -> None:
    bounded = {"noise_bound": [0.01]}
    problem = sampled_problem(method=method, window=6, gains={"L": L}, output=bounded)
    warnings = [w for w in obsdesign.design(problem).warnings if "observer.gains.L" in w]
    assert len(warnings) == (0 if method == "exact" else 1)
    plain = sampled_problem(method=method, window=6, output=bounded)
    if method != "exact":
        same, expected = obsdesign.design(problem).gains, obsdesign.design(plain).gains
        assert np.array_equal(same["window_gain"], expected["window_gain"])


def test_least_noise_is_no_worse() -> None:
    sizes = {}
    for objective in ("longest_period", "least_noise"):
        design = obsdesign.design(
            sampled_problem(period=0.5, window=6, method="exact", objective=objective)
        )
        sizes[objective] = np.linalg.norm(design.gains["window_gain"])
    least = np.linalg.norm(
        obsdesign.design(sampled_problem(period=0.5, window=6)).gains["window_gain"]
    )
    assert least <= sizes["least_noise"] * (1 + 1e-9)
    assert sizes["least_noise"] <= sizes["longest_period"] * (1 + 1e-9)


@pytest.mark.parametrize("n", [1, 2])
def test_everything_is_chosen_where_nothing_is_given(n: int) -> None:
    rng = np.random.default_rng(n)
    A, C = rng.standard_normal((n, n)), rng.standard_normal((1, n))
    for method in ("least_squares", "exact", "approximate"):
        design = obsdesign.design(sampled_problem(A, C, 0.25, method=method))
        assert obsdesign.verify(design).verdict == "proved"


def test_what_the_guarantees_are_without() -> None:
    design = obsdesign.design(
        sampled_problem(
            window=6, flow={"D": [[1], [0]]}, output={"noise_bound": [0.1]},
            jump={"H": [[1], [0]], "dwell_time": [1, 2]},
        )
    )  # fmt: skip
    sentences = [entry.statement for entry in design.guarantees]
    assert sentences[0] == (
        "Once the window is full of samples and without disturbance, noise, unknown input d or "
        "unannounced impulses in it, the estimate is the state, to rounding."
    )
    assert "a full window without unknown input d or unannounced impulses" in sentences[1]
    assert "G" not in design.gains  # no data announce such jumps


def test_designs_keep_the_published_schema() -> None:
    import json
    from importlib.resources import files

    import jsonschema

    schema = json.loads(
        files("obsdesign").joinpath("problem/design.schema.json").read_text("utf-8")
    )
    for method in ("least_squares", "exact", "approximate"):
        kept = {} if method == "least_squares" else {"gains": {"L": L}}
        design = obsdesign.design(sampled_problem(window=1, method=method, **kept))
        jsonschema.validate(design.to_dict(), schema)


@pytest.mark.parametrize("unit", [1e6, 1e-9])
@pytest.mark.parametrize("method", ["exact", "approximate"])
def test_units_of_the_states_do_not_decide(method: str, unit: float) -> None:
    units = np.array([1.0, unit])
    plain = obsdesign.design(sampled_problem(period=0.5, window=6, method=method, gains={"L": L}))
    design = obsdesign.design(
        sampled_problem(
            (np.array(ROTATION) * units[:, None] / units).tolist(), period=0.5, window=6,
            method=method, gains={"L": (np.array(L) * units[:, None]).tolist()},
        )
    )  # fmt: skip
    expected = plain.gains["window_gain"] * units[:, None]
    assert design.gains["window_gain"] == pytest.approx(expected, rel=1e-9)
    # the twin: nothing is fed back in any units
    with pytest.raises(obsdesign.NotProved, match="is singular: L C = 0"):
        obsdesign.design(sampled_problem(period=0.5, method=method, gains={"L": [[0], [0]]}))


def test_a_window_too_long_for_fast_modes_says_so() -> None:
    plant = [[-200, 0], [0, 100]]
    with pytest.raises(
        obsdesign.NotProved, match=r"grows by e\^40, .* choose a window below 0\.12"
    ):
        obsdesign.design(sampled_problem(plant, [[1, 1]], period=0.05, window=0.4))
    obsdesign.design(sampled_problem(plant, [[1, 1]], period=0.05, window=0.1))  # what it advises


def test_a_gain_is_found_where_norms_mislead() -> None:
    """Six integrators, and one in units of 1e140: L in the units of the file is of no use."""
    chain = np.diag([1.0] * 5, 1)
    obsdesign.design(sampled_problem(chain, [[1] + [0] * 5], 0.01, method="exact"))
    tiny = {"A": [[0, 1e-140], [0, 0]], "C": [[1, 0]], "period": 1.0, "window": 2}
    obsdesign.design(sampled_problem(**tiny, method="exact"))
    # the twin: a gain that is given is not replaced
    with pytest.raises(obsdesign.NotProved, match="nearly singular"):
        obsdesign.design(sampled_problem(**tiny, method="exact", gains={"L": [[1e-140], [1e-140]]}))


@pytest.mark.parametrize("method", ["exact", "approximate"])
def test_gains_are_the_same_in_all_coordinates(method: str) -> None:
    """S A S^-1, C S^-1, S L have the gains S G: S changes the norms of Theorem 1 and no noise."""
    rng = np.random.default_rng(5)
    A, C, gain = rng.standard_normal((3, 3)), rng.standard_normal((1, 3)), np.ones((3, 1)) / 8
    S = np.array([[1.0, 2, 0], [0, 1, -1], [0, 0, 1]])
    back = np.linalg.inv(S)
    gains = [
        obsdesign.design(sampled_problem(X, Y, 0.25, window=3, method=method, gains={"L": Z})).gains
        for X, Y, Z in ((A, C, gain), (S @ A @ back, C @ back, S @ gain))
    ]
    transformed = S @ gains[0]["window_gain"]
    assert np.abs(gains[1]["window_gain"] - transformed).max() <= 1e-9 * np.abs(transformed).max()


def test_least_noise_is_close_to_the_best_of_all_windows() -> None:
    """T is a whole number of periods: no other one is more than a few per cent better."""
    more: Any = {
        "flow": {"disturbance": {"lower": [-0.1, -0.1], "upper": [0.1, 0.1]}},
        "output": {"noise_bound": [1.0]},
    }
    chain = [[0, 1], [0, -0.1]]
    chosen = obsdesign.design(
        sampled_problem(chain, [[1, 0]], 0.1, objective="least_noise", **more)
    ).gains
    radii = np.array(
        [
            obsdesign.design(sampled_problem(chain, [[1, 0]], 0.1, window=0.1 * k, **more)).gains[
                "radius"
            ]
            for k in range(8, 200, 4)
        ]
    )
    # the states have different best windows: the worst one, relative to its own best, counts
    best = radii.min(axis=0)
    assert (chosen["radius"] / best).max() <= 1.12 * (radii / best).max(axis=1).min()


def test_tiny_entries_count() -> None:
    # cubes of 1e-140 underflow
    obsdesign.design(sampled_problem([[0, 1e-140], [0, 0]], [[1, 0]], period=1, window=2))
    with pytest.raises(obsdesign.NotProved, match="is unobservable"):
        obsdesign.design(sampled_problem([[0, 0], [0, 0]], [[1, 0]], period=1, window=2))
