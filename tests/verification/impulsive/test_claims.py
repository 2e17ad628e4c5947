"""Impulsive observers designed and proved: strategies, refusals with witnesses, laws, twins."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.analysis.impulsive_noise import simulated
from obsdesign.equations.impulsive.formulas import Core, window_gains
from obsdesign.equations.impulsive.gains import ImpulsiveGains
from obsdesign.verification.impulsive.claims import claims
from tests.systems.impulsive import (
    DOUBLE,
    OSCILLATOR,
    SPLINE,
    chain,
    claim,
    first,
    impulsive_problem,
    verdicts,
)

EXPONENTIALS = (SPLINE, [0.1, 0.8])
HIDDEN_MODE = (np.diag([0.0, 0.3]), np.eye(2), first(2))


def investigate(plant: Any, dwell: Any, **more: Any) -> obsdesign.Outcome:
    return obsdesign.investigate(impulsive_problem(plant, dwell, **more))


# --- strategies ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("plant", "dwell", "form", "ids"),
    [
        ((chain(3), np.eye(3), first(3)), [0.1, 0.8], "full", []),
        (SPLINE, [0.1, 0.8], "compressed", ["image"]),
        (([[0, 1], [4, 0]], np.diag([1.0, 0]), first(2)), [0.1, 0.8], "compressed", ["image"]),
        (([[0, 0], [1, -1]], np.eye(2), first(2)), [0.2, 1.0], "subspace", ["rest_decays", "invariant"]),
        (([[0, 0], [1, -1]], [[1, 0], [1, 1]], first(2)), [0.2, 1.0], "subspace", ["hidden_decays", "invariant"]),
        ((np.array(OSCILLATOR[0]) - 0.1 * np.eye(2), np.eye(2), first(2)), [0.4, 0.6], "quadratic", ["contracting"]),
    ],
)  # fmt: skip
def test_strategies_are_tried_from_strong_to_weak(
    plant: Any, dwell: Any, form: str, ids: list[str]
) -> None:
    outcome = investigate(plant, dwell)
    assert (outcome.verdict, outcome.result["form"]) == ("proved", form)
    assert set(ids) <= set(verdicts(outcome))
    again = obsdesign.verify(outcome.design)
    assert set(verdicts(again).values()) == {"proved"}
    assert all(entry.given for entry in outcome.design.guarantees)
    earlier = list(outcome.result["forms"])[:-1]
    assert all(outcome.result["forms"][name]["verdict"] == "refuted" for name in earlier)


@pytest.mark.parametrize("strategy", ["compressed", "subspace", "quadratic"])
def test_each_strategy_by_itself_serves_the_spline(strategy: str) -> None:
    outcome = investigate(SPLINE, [0.4, 0.5], strategy=strategy)
    assert outcome.verdict == "proved"
    assert outcome.design.gains["strategy"] == strategy
    assert obsdesign.verify(outcome.design).verdict == "proved"


def test_the_spline_itself_is_refused_with_its_state() -> None:
    outcome = investigate(SPLINE, [0.1, 0.8], strategy="full")
    witness = claim(outcome, "strongly_observable").evidence["witness"]
    assert (outcome.verdict, witness["null_vector"]) == ("refuted", [0.0, 0.0, 0.0, 1.0])
    with pytest.raises(obsdesign.NotProved):
        obsdesign.design(impulsive_problem(SPLINE, [0.1, 0.8], strategy="full"))


def test_exact_integer_bases_are_proved_exactly() -> None:
    T = np.array([[1, 2, 0, 1], [0, 1, 3, 0], [0, 0, 1, 2], [0, 0, 0, 1.0]])
    back = np.round(np.linalg.inv(T))
    assert np.array_equal(T @ back, np.eye(4))
    plant = (T @ SPLINE[0] @ back, T @ SPLINE[1] @ back, SPLINE[2] @ back)
    for strategy, name in (("compressed", "image"), ("subspace", "invariant")):
        outcome = investigate(plant, [0.1, 0.8], strategy=strategy)
        assert outcome.verdict == "proved"
        assert claim(outcome, name).evidence["exact"] is True


def test_parts_of_a_cascade_keep_most_of_their_rate() -> None:
    plant = ([[0, 0], [1, -1]], [[1, 0], [1, 1]], first(2))
    rate = claim(investigate(plant, [0.2, 1.0]), "rate").evidence
    assert 0.95 < rate["per_impulse"] < 0.96  # the hidden part reaches 0.95


# --- refusals name their witness ----------------------------------------------------------------


def test_an_unobservable_mode_that_grows_is_named() -> None:
    outcome = investigate(HIDDEN_MODE, [0.2, 1.0])
    assert outcome.verdict == "refuted"
    reason = claim(outcome, "hidden_decays").evidence["witness"]["reason"]
    assert reason.startswith("it does not decay by itself: at dwell time 1.0")
    assert reason.endswith("its flow has the mode 0.3")


def test_a_pathological_spacing_refutes_everything() -> None:
    outcome = investigate(OSCILLATOR, [0.4, 0.6])
    assert outcome.verdict == "refuted"
    hidden = claim(outcome, "detectable").evidence["witness"]
    assert hidden["thetas"] == pytest.approx([0.5], abs=1e-9)
    assert hidden["mode"]["real"] == pytest.approx(-1.0)
    full = investigate(OSCILLATOR, [0.4, 0.6], strategy="full")
    witness = claim(full, "strongly_observable").evidence["witness"]
    assert witness["thetas"] == pytest.approx([0.5], abs=1e-9)
    # the twin: a range without half turns
    assert investigate(OSCILLATOR, [0.1, 0.4]).verdict == "proved"


def test_a_longer_window_does_not_help_against_a_constant_spacing() -> None:
    for window in (2, 3, 5):
        outcome = investigate(OSCILLATOR, [0.4, 0.6], strategy="full", window=window)
        witness = claim(outcome, "strongly_observable").evidence["witness"]
        assert outcome.verdict == "refuted"
        assert witness["thetas"] == pytest.approx([0.5] * (window - 1), abs=1e-6)


def test_a_witness_keeps_to_the_jitter() -> None:
    # constant spacings always do
    outcome = investigate(
        OSCILLATOR, [0.4, 0.6], strategy="full", window=3, jump={"dwell_jitter": 0.0}
    )
    assert outcome.verdict == "refuted"


def test_no_longest_spacing_is_refused_with_the_reason() -> None:
    outcome = investigate(DOUBLE, [0.5, "inf"])
    assert verdicts(outcome) == {"consistent": "proved", "bounded_spacing": "refuted"}
    witness = claim(outcome, "bounded_spacing").evidence["witness"]
    assert witness["reason"] == (
        "jump.dwell_time has no longest spacing: the bounds of the window, and with them uniform "
        "convergence, need one; give a finite jump.dwell_time[1]"
    )


def test_too_short_a_window_is_refused() -> None:
    outcome = investigate((chain(3), np.eye(3), first(3)), [0.1, 0.8], window=2)
    witness = claim(outcome, "strongly_observable").evidence["witness"]
    assert witness["reason"] == "2 measured numbers cannot tell 3 states apart"


def test_spacing_zero_is_an_ordinary_end_of_the_range() -> None:
    assert investigate(DOUBLE, [0.0, 1.0], strategy="full").verdict == "refuted"
    everything = (np.diag([-0.1, 0.2]), np.eye(2), np.eye(2))
    assert investigate(everything, [0.0, 1.0]).verdict == "proved"


# --- window, alpha, rates, noise ----------------------------------------------------------------


def test_windows_are_the_shortest_or_as_asked() -> None:
    assert investigate(DOUBLE, [0.5, 1.5]).design.gains["window"] == 2
    two = (chain(3) + np.diag([-0.1, 0.2, 0.3]), np.eye(3), np.eye(3)[[0, 2]])
    assert investigate(two, [0.2, 1.0]).design.gains["window"] == 2
    long = investigate(DOUBLE, [0.5, 1.5], window=64)
    assert (long.verdict, long.design.gains["window"]) == ("proved", 64)
    assert claim(long, "strongly_observable").evidence["blocks"] == 2


@pytest.mark.parametrize("strategy", ["full", "compressed", "subspace", "quadratic"])
def test_a_decay_rate_is_reached_and_claimed(strategy: str) -> None:
    plant = DOUBLE if strategy == "full" else SPLINE
    outcome = investigate(plant, [0.4, 0.5], strategy=strategy, decay_rate=0.6)
    assert verdicts(outcome)["decay_rate"] == "proved"
    rate = claim(outcome, "rate").evidence
    assert rate["in_time"] >= 0.6 * (1 - 1e-6)
    assert rate["per_impulse"] <= math.exp(-0.6 * 0.5) * (1 + 1e-9)
    assert obsdesign.verify(outcome.design).verdict == "proved"


def test_an_alpha_too_small_for_the_rate_is_said() -> None:
    outcome = investigate(DOUBLE, [0.5, 1.5], decay_rate=1.0, alpha=1.2, strategy="full")
    assert verdicts(outcome)["decay_rate"] == "undecided"
    assert "alpha must be at least" in claim(outcome, "decay_rate").evidence["reason"]


@pytest.mark.parametrize(
    ("plant", "dwell", "options"),
    [
        (DOUBLE, [0.5, 1.5], {"window": 3}),
        ((chain(3), np.eye(3), first(3)), [0.1, 0.8], {}),
        (SPLINE, [0.1, 0.8], {}),
        (SPLINE, [0.4, 0.5], {"strategy": "subspace"}),
        (SPLINE, [0.4, 0.5], {"strategy": "quadratic"}),
        (([[0, 0], [1, -1]], [[1, 0], [1, 1]], first(2)), [0.2, 1.0], {}),
    ],
)  # fmt: skip
def test_brute_force_never_contradicts_the_rate(plant: Any, dwell: Any, options: Any) -> None:
    design = obsdesign.design(impulsive_problem(plant, dwell, **options))
    rate = next(c for c in design.claims if c.id == "rate").evidence
    for seed in range(3):
        for growth, steps in growths(design, dwell, seed):
            assert growth <= rate["constant"] * rate["per_impulse"] ** steps * (1 + 1e-9)


def growths(design: Any, dwell: Any, seed: int) -> list[tuple[float, int]]:
    """(norm of the product of N error maps just before impulses, N), from the runtime's gains."""
    from lmi.arithmetic.exponential import expm
    from obsdesign.runtime import Sample, from_design

    rng = np.random.default_rng(seed)
    observer: Any = from_design(design)
    A, G, C = (design.gains[name] for name in "AGC")
    spacings = rng.choice([*dwell, sum(dwell) / 2], 12) if seed else rng.uniform(*dwell, 12)
    state = observer.init(t=0.0)
    product, growths, t = np.eye(len(A)), [], 0.1
    for count, spacing in enumerate([*spacings, 0.0]):
        state, _ = observer.step(state, Sample(t, y=np.zeros(len(C)), jump=True))
        L, _ = observer._gain(state)
        growths.append((float(np.linalg.norm(product, 2)), count))
        product = expm(A * spacing) @ (G + L @ C) @ product
        t += spacing
    return growths


def test_noise_targets_choose_window_and_alpha() -> None:
    outcome = investigate(DOUBLE, [0.5, 1.5], noise_target=[0.9, 0.5])
    gains = ImpulsiveGains.from_document(outcome.design.gains)
    assert gains.window is not None
    assert gains.alpha is not None
    assert (simulated(gains, np.ones(1)).std <= [0.9, 0.5]).all()
    # neither a shorter window nor a faster memory would do
    shorter = replace(gains, window=gains.window - 1, alpha=1.02)
    assert not (simulated(shorter, np.ones(1)).std <= [0.9, 0.5]).all()
    faster = replace(gains, alpha=gains.alpha * 1.02)
    assert not (simulated(faster, np.ones(1)).std <= [0.9, 0.5]).all()
    halved = investigate(DOUBLE, [0.5, 1.5], noise_target=[0.45, 0.25], output={"noise_std": [0.5]})
    assert halved.design.gains["alpha"] == pytest.approx(gains.alpha, rel=1e-3)


def test_a_noise_target_out_of_reach_is_undecided() -> None:
    outcome = investigate(DOUBLE, [0.5, 1.5], noise_target=[0.3, 0.1], window=3)
    assert outcome.verdict == "undecided"
    reason = claim(outcome, "noise_target").evidence["reason"]
    assert reason.startswith("with a window of 3 and alpha 1.02 the estimated standard deviations")


def test_the_estimate_is_that_of_simulated_noise() -> None:
    from obsdesign.runtime import Sample, from_design

    design = obsdesign.design(impulsive_problem(DOUBLE, [0.5, 1.5], window=4, alpha=1.3))
    observer: Any = from_design(design)
    rng = np.random.default_rng(8)
    state, errors, t = observer.init(t=0.0), [], 0.0
    for _ in range(3000):
        t += rng.uniform(0.5, 1.5)
        state, estimate = observer.step(state, Sample(t, y=rng.standard_normal(1), jump=True))
        errors.append(estimate.x)
    measured = np.std(errors[20:], axis=0)
    gains = ImpulsiveGains.from_document(design.gains)
    assert measured == pytest.approx(simulated(gains, np.ones(1)).std, rel=0.08)


# --- forged and damaged designs -----------------------------------------------------------------


def verified(design: Any, **changes: Any) -> dict[str, str]:
    forged = replace(design, gains={**design.gains, **changes})
    return verdicts(obsdesign.verify(forged))


@pytest.fixture(scope="module")
def compressed() -> Any:
    return obsdesign.design(impulsive_problem(SPLINE, [0.1, 0.8]))


def test_false_gains_are_not_believed(compressed: Any) -> None:
    gains = compressed.gains
    wrong = np.array(gains["image"])
    wrong[0, 0] += 1e-3
    assert verified(compressed, image=wrong)["image"] == "undecided"
    assert verified(compressed, coimage=np.zeros((3, 4)))["image"] == "undecided"
    assert verified(compressed, window=2)["strongly_observable"] == "refuted"
    for name, value in (
        ("window", 0),
        ("window", 3.5),
        ("alpha", 1.0),
        ("alpha", "a"),
        ("strategy", "none"),
        ("image", 3),
    ):
        assert verified(compressed, **{name: value})["consistent"] == "refuted"
    assert verified(compressed, A=gains["A"] + 1)["consistent"] == "refuted"


def of_earlier_release(design: Any) -> Any:
    """The design with its margin as an earlier release stated it, of rows that are not scaled."""

    def older(claim: Any) -> Any:
        if claim.id != "strongly_observable":
            return claim
        text = claim.statement.replace(
            "in units of its rows and of usual spacings", "of that at usual spacings"
        )
        assert text != claim.statement
        return replace(claim, statement=text, evidence={**claim.evidence, "margin": 0.0017})

    return replace(design, claims=tuple(older(one) for one in design.claims))


@pytest.mark.parametrize("plant", [SPLINE, (chain(3), np.eye(3), first(3))])
def test_a_margin_in_older_words_is_unconfirmed_not_false(plant: Any) -> None:
    design = obsdesign.design(impulsive_problem(plant, [0.1, 0.8]))
    outcome = obsdesign.verify(of_earlier_release(design))
    found = verdicts(outcome)
    assert found.pop("document") == "undecided"
    assert set(found.values()) == {"proved"}
    reason = outcome.claims[-1].evidence["reason"]
    assert "'strongly_observable' is stated as by an earlier release" in reason


def test_older_words_are_no_cover(compressed: Any) -> None:
    old = of_earlier_release(compressed)
    image = np.array(old.gains["image"])
    image[0, 0] += 1e-3
    for gains in ({"window": 2}, {"A": old.gains["A"] + 1}):
        assert "refuted" in verified(old, **gains).values()
    assert verified(old, image=image)["image"] == "undecided"

    def stated(**changes: Any) -> dict[str, str]:
        told = [replace(c, **changes) if c.id == "rate" else c for c in old.claims]
        return verdicts(obsdesign.verify(replace(old, claims=tuple(told))))

    assert stated(statement="the error is zero")["document"] == "refuted"
    wider = [replace(c, statement=c.statement.replace("0.8]", "9]")) for c in old.claims]
    found = verdicts(obsdesign.verify(replace(old, claims=tuple(wider))))
    assert found["document"] == "refuted"
    # the sentence of today with numbers of then
    new = [c if c.id != "strongly_observable" else next(
        replace(n, evidence=c.evidence) for n in compressed.claims if n.id == c.id
    ) for c in old.claims]  # fmt: skip
    assert verdicts(obsdesign.verify(replace(old, claims=tuple(new))))["document"] == "undecided"


@pytest.mark.parametrize(
    ("claim", "change", "verdict"),
    [
        ("strongly_observable", {"sigma_min": 0.5}, "undecided"),
        ("strongly_observable", {"largest": 1.0}, "undecided"),
        ("rate", {"constant": 2.0}, "undecided"),
        ("strongly_observable", {"sigma_max": 0.5}, "refuted"),
        ("strongly_observable", {"asked": 1e-4}, "undecided"),
        ("strongly_observable", {"blocks": 2}, "refuted"),
        ("bounded_spacing", {"longest": 0.7}, "refuted"),
    ],
)
def test_bounds_of_another_course_of_the_proof_are_unconfirmed(
    compressed: Any, claim: str, change: dict[str, float], verdict: str
) -> None:
    """As sharp as their boxes, which another release cuts otherwise; all else is as it was."""
    told = [replace(c, evidence={**c.evidence, **change}) if c.id == claim else c
            for c in compressed.claims]  # fmt: skip
    outcome = obsdesign.verify(replace(compressed, claims=tuple(told)))
    assert verdicts(outcome)["document"] == verdict
    assert not outcome.guarantees


@pytest.mark.parametrize(
    "evidence",
    [{}, {"asked": "x"}, {"asked": -1.0}, {"blocks": 99}, {"witness": {"thetas": [0.4] * 3}}],
)
def test_evidence_is_checked_not_believed(compressed: Any, evidence: Any) -> None:
    changed = [
        replace(c, evidence=evidence) if c.id == "strongly_observable" else c
        for c in compressed.claims
    ]
    again = obsdesign.verify(replace(compressed, claims=tuple(changed)))
    assert verdicts(again)["strongly_observable"] == "proved"


def test_a_promise_too_good_is_corrected(compressed: Any) -> None:
    changed = [
        replace(c, evidence={**c.evidence, "constant": 2.0}) if c.id == "rate" else c
        for c in compressed.claims
    ]
    again = obsdesign.verify(replace(compressed, claims=tuple(changed)))
    assert claim(again, "rate").evidence["constant"] > 1e6


def test_quadratic_tables_are_checked() -> None:
    design = obsdesign.design(impulsive_problem(SPLINE, [0.4, 0.5], strategy="quadratic"))
    gains = design.gains
    assert verified(design, table=0 * gains["table"])["contracting"] == "undecided"
    assert verified(design, cells=gains["cells"] - 0.01)["contracting"] == "refuted"
    body = design.to_dict()
    again = obsdesign.design_file.from_dict(json.loads(json.dumps(body)))
    assert obsdesign.verify(again).verdict == "proved"


def test_claims_without_certificates_find_their_own() -> None:
    problem = impulsive_problem((chain(3), np.eye(3), first(3)), [0.1, 0.8])
    gains = obsdesign.design(problem).gains
    assert {c.verdict for c in claims(problem, gains, {})} == {"proved"}


def test_a_design_survives_its_file(compressed: Any, tmp_path: Any) -> None:
    compressed.save(tmp_path / "d.json")
    again = obsdesign.load_design(tmp_path / "d.json")
    again.save(tmp_path / "e.json")
    assert (tmp_path / "d.json").read_bytes() == (tmp_path / "e.json").read_bytes()
    assert obsdesign.verify(again).verdict == "proved"


# --- the gain -----------------------------------------------------------------------------------


@pytest.mark.parametrize("unit", [2.0**-20, 2.0**20])
def test_units_of_time_do_not_matter(unit: float) -> None:
    A, G, C = SPLINE
    plain = obsdesign.design(impulsive_problem(SPLINE, [0.1, 0.8]))
    scaled = obsdesign.design(impulsive_problem((A * unit, G, C), [0.1 / unit, 0.8 / unit]))
    assert scaled.gains["window"] == plain.gains["window"]


def test_a_measurement_after_the_impulse_sees_what_is_left() -> None:
    outcome = investigate(SPLINE, [0.1, 0.8], output={"jump_measurement": "after"})
    assert outcome.verdict == "proved"
    core = Core.from_gains(ImpulsiveGains.from_document(outcome.design.gains), np.asarray)
    assert np.array_equal(core.C, SPLINE[2] @ SPLINE[1])


def test_the_gain_moves_with_the_basis() -> None:
    from lmi.arithmetic.exponential import expm

    rng = np.random.default_rng(0)
    A, G, C = rng.standard_normal((3, 3)), rng.standard_normal((3, 3)), rng.standard_normal((1, 3))
    T = rng.standard_normal((3, 3))
    back = np.linalg.inv(T)
    spacings = rng.uniform(0.1, 0.8, 4)[:, None, None]
    plain = window_gains(Core(A, C, G), expm(A * spacings), 1.2)
    rebased = window_gains(
        Core(T @ A @ back, C @ back, T @ G @ back), expm(T @ A @ back * spacings), 1.2
    )
    np.testing.assert_allclose(rebased, T @ plain, rtol=1e-6)


# --- odd plants ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("plant", "dwell", "verdict"),
    [
        (([[1e3, 0], [0, 1]], np.eye(2), [[1, 1]]), [0.1, 10.0], "undecided"),  # flows overflow
        ((chain(2), np.eye(2), [[1e-150, 0]]), [0.1, 1.0], "proved"),
        ((chain(2), np.eye(2), [[1e150, 0]]), [0.1, 1.0], "proved"),
        ((chain(2), np.eye(2), [[1, 0], [1, 0]]), [0.1, 1.0], "proved"),  # an output twice
        ((chain(2), np.eye(2), [[1, 0], [0, 1], [1, 1]]), [0.1, 1.0], "proved"),
        ((np.zeros((2, 2)), np.eye(2), [[1, 0]]), [0.1, 1.0], "refuted"),
        ((np.zeros((2, 2)), np.zeros((2, 2)), [[0, 0]]), [0.1, 1.0], "proved"),  # forgets by itself
        (([[0.0]], [[-1.0]], [[1.0]]), [0.1, 1.0], "proved"),
        (DOUBLE, [0.5, 0.5], "proved"),
        (([[0, 1e12], [0, 0]], np.eye(2), [[1e-6, 0]]), [0.1, 1.0], "proved"),  # units
    ],
)  # fmt: skip
def test_odd_plants_get_an_answer(plant: Any, dwell: Any, verdict: str) -> None:
    outcome = investigate(plant, dwell)
    assert outcome.verdict == verdict
    if verdict == "proved":
        assert obsdesign.verify(outcome.design).verdict == "proved"


def test_a_decay_rate_beyond_all_numbers() -> None:
    with pytest.raises(obsdesign.InputError) as error:
        investigate(DOUBLE, [0.5, 1.0], decay_rate=1e4)
    assert str(error.value) == (
        "observer.decay_rate must be at most 200 / jump.dwell_time[1] here; got 10000.0. "
        "Is it in the plant's unit of time?"
    )


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (
            {"decay_rate": 25.0},
            "observer.decay_rate = 25.0 weighs the oldest of 2 impulses by alpha^-1 with alpha = "
            "1.932e+16: fewer digits than binary64 has; at most alpha = 1e+07 can be executed.",
        ),
        (
            {"alpha": 1e150, "window": 4},
            "observer.alpha = 1e+150 weighs the oldest of 2 impulses by alpha^-1 with alpha = "
            "1e+150: fewer digits than binary64 has; at most alpha = 1e+07 can be executed.",
        ),
        ({"window": 100000}, "observer.window must be at most 4096 impulses; got 100000."),
    ],
)
def test_what_no_runtime_could_execute_is_refused(options: dict, line: str) -> None:
    problem = obsdesign.Problem.from_dict({
        "flow": {"A": [[0, 1], [0, 0]]},
        "jump": {"dwell_time": [0.5, 1.5]},
        "output": {"C": [[1, 0]], "measured": "at_jumps"},
        "observer": {"kind": "impulsive", **options},
    })  # fmt: skip
    with pytest.raises(obsdesign.InputError) as caught:
        obsdesign.investigate(problem)
    assert str(caught.value) == line
