"""Impulsive observers designed and proved: strategies, refusals with witnesses, laws, twins."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.equations.impulsive.formulas import Core, window_gains
from obsdesign.equations.impulsive.gains import ImpulsiveGains
from obsdesign.errors import InputError
from tests.systems.impulsive import (
    DOUBLE,
    OSCILLATOR,
    SPLINE,
    chain,
    claim,
    first,
    impulsive_problem,
    investigate,
    rebased,
    verdicts,
)

EXPONENTIALS = (SPLINE, [0.1, 0.8])
HIDDEN_MODE = (np.diag([0.0, 0.3]), np.eye(2), first(2))


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
    assert verdicts(outcome) == {
        "consistent": "proved", "bounded_spacing": "refuted", "shortest_spacing": "proved"
    }  # fmt: skip
    witness = claim(outcome, "bounded_spacing").evidence["witness"]
    assert witness["reason"] == (
        "jump.dwell_time has no longest spacing: the bounds of the window, and with them uniform "
        "convergence, need one; give a finite jump.dwell_time[1]"
    )


HALVED = (np.diag([0.2, -0.1]), np.diag([1.0, 0.5]), first(2))  # what C misses decays


@pytest.mark.parametrize("plant", [SPLINE, rebased(SPLINE, 1), DOUBLE, OSCILLATOR])
@pytest.mark.parametrize("measured", ["before", "after"])
@pytest.mark.parametrize("growth", [1.0, 1.5])
def test_a_range_from_0_on_needs_a_positive_end_where_impulses_at_once_hide_a_mode(
    plant: Any, measured: str, growth: float
) -> None:
    """Of modulus 1 no gain is refuted: impulses at once take no time, in which all may decay."""
    A, G, C = plant[0], growth * np.asarray(plant[1]), plant[2]
    for strategy in ("auto", "quadratic"):
        outcome = investigate(
            (A, G, C), [0.0, 0.4], strategy=strategy, output={"jump_measurement": measured}
        )
        assert verdicts(outcome)["bounded_spacing"] == "proved"
        shortest = claim(outcome, "shortest_spacing")
        if growth == 1:
            assert outcome.verdict == shortest.verdict == "undecided"
            assert shortest.evidence["reason"].endswith("give a positive jump.dwell_time[0]")
            continue
        assert outcome.verdict == "refuted"
        witness = shortest.evidence["witness"]
        hidden = np.array(witness["null_vector"])
        np.testing.assert_allclose((C @ G if measured == "after" else C) @ hidden, 0, atol=1e-9)
        np.testing.assert_allclose(G @ hidden, witness["mode"]["real"] * hidden, atol=1e-9)
        assert witness["reason"].endswith("give a positive jump.dwell_time[0]")


def test_a_plant_that_decays_by_itself_is_not_refuted_for_impulses_at_once() -> None:
    """Without any gain its error is below e^-t, whatever the impulses that only hide a state."""
    plant = (-np.eye(2), np.eye(2), first(2))
    outcome = investigate(plant, [0.0, 1.0], strategy="quadratic")
    assert verdicts(outcome)["hidden_decays"] == outcome.verdict == "undecided"
    assert "no time passes" in claim(outcome, "hidden_decays").evidence["reason"]
    assert investigate(plant, [0.001, 1.0]).verdict == "proved"


@pytest.mark.parametrize(
    ("A", "G"),
    [
        (np.diag([-1.0, 0.1]), np.eye(2)),  # grows between impulses
        (np.diag([-1.0, 0.0]), np.eye(2)),  # stays for ever
        (np.diag([-1.0, 0.1]), np.diag([1.0, -1.0])),
        (np.diag([-1.0, 0.0]), np.diag([1.0, -1.0])),
    ],
)
@pytest.mark.parametrize("strategy", ["quadratic", "subspace"])
def test_what_grows_as_time_passes_is_refuted_from_spacing_0_on(
    A: Any, G: Any, strategy: str
) -> None:
    outcome = investigate((A, G, first(2)), [0.0, 1.0], strategy=strategy)
    assert verdicts(outcome)["hidden_decays"] == outcome.verdict == "refuted"


@pytest.mark.parametrize(
    ("plant", "dwell"),
    [
        (SPLINE, [0.1, 0.4]),  # the twins of the same plants
        (DOUBLE, [0.1, 0.4]),
        ((DOUBLE[0], np.eye(2), np.eye(2)), [0.0, 0.4]),  # C misses nothing
        ((np.diag([0.1, 0.2]), np.array([[1.0, 1.0], [0.0, 1.0]]), first(2)), [0.0, 0.4]),
        (HALVED, [0.0, 0.4]),
    ],
)
def test_both_ends_of_the_spacings_are_proved(plant: Any, dwell: list[float]) -> None:
    outcome = investigate(plant, dwell)
    assert outcome.verdict == "proved"
    assert claim(outcome, "bounded_spacing").evidence["longest"] == dwell[1]
    shortest = claim(outcome, "shortest_spacing")
    assert shortest.evidence["shortest"] == dwell[0]
    assert ("positive lower bound" in shortest.statement) == (dwell[0] > 0)


@pytest.mark.parametrize("strategy", ["subspace", "quadratic"])
def test_parts_and_cells_of_an_endless_range_are_refused(strategy: str) -> None:
    A, G, C = DOUBLE
    body: dict[str, Any] = {
        "flow": {"A": A}, "jump": {"G": G, "dwell_time": [0.5, "inf"]},
        "output": {"C": C, "measured": "at_jumps"},
        "observer": {"kind": "impulsive", "strategy": strategy},
    }  # fmt: skip
    with pytest.raises(InputError, match=rf"observer\.strategy = '{strategy}' is built for a"):
        obsdesign.Problem(**body)  # at the door, before anything is designed
    obsdesign.Problem(**body | {"jump": {"G": G, "dwell_time": [0.5, 2.0]}})
    obsdesign.Problem(**body | {"jump": {"G": G}})  # of which the kind says what it lacks
    for other in ("full", "compressed"):
        assert investigate(DOUBLE, [0.5, "inf"], strategy=other).verdict == "refuted"


def test_too_short_a_window_is_refused() -> None:
    outcome = investigate((chain(3), np.eye(3), first(3)), [0.1, 0.8], window=2)
    witness = claim(outcome, "strongly_observable").evidence["witness"]
    assert witness["reason"] == "2 measured numbers cannot tell 3 states apart"


def test_spacing_zero_is_an_ordinary_end_of_the_range() -> None:
    outcome = investigate(DOUBLE, [0.0, 1.0], strategy="full")
    assert outcome.verdict == "refuted"
    assert claim(outcome, "strongly_observable").evidence["witness"]["thetas"] == [0.0]
    assert claim(outcome, "shortest_spacing").verdict == "undecided"
    everything = (np.diag([-0.1, 0.2]), np.eye(2), np.eye(2))
    assert investigate(everything, [0.0, 1.0]).verdict == "proved"


# --- the gain -----------------------------------------------------------------------------------


@pytest.mark.parametrize("plant", [DOUBLE, OSCILLATOR])
def test_units_of_time_do_not_matter(plant: Any) -> None:
    A, G, C = (np.asarray(entry) for entry in plant)
    windows = {
        obsdesign.design(impulsive_problem((A * unit, G, C), [0.1 / unit, 0.4 / unit])).gains[
            "window"
        ]
        for unit in (1.0, 2.0**-20, 2.0**20)
    }
    assert len(windows) == 1


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


# --- a measurement that shows nothing ---------------------------------------------------------------


@pytest.mark.parametrize("dwell", [[0.05, 0.05], [0.05, 1.0]])
@pytest.mark.parametrize("scale", [1.0, 1e150, 1e-150])
def test_a_measurement_after_a_jump_that_sees_nothing_is_refuted(
    dwell: list[float], scale: float
) -> None:
    """C G = 0: y after a jump is 0 whatever the state was."""
    A = np.zeros((4, 4))
    A[1, 2] = 1
    G = [[0, 0, 0, 0], [1, 1, 0, 0], [0, 0, 1, 0], [0, 1, 1, 1]]
    plant = (A, G, [[scale, 0, 0, 0]])
    outcome = investigate(plant, dwell, output={"jump_measurement": "after"})
    assert outcome.verdict == "refuted"
    # the twin: a plant whose jump leaves the first state alone is seen through it
    whole = investigate(DOUBLE, [0.5, 1.5], output={"jump_measurement": "after"})
    assert whole.verdict == "proved"


@pytest.mark.parametrize("seed", range(20))
def test_measurements_that_see_nothing_are_answered(
    seed: int, capfd: pytest.CaptureFixture[str]
) -> None:
    """Random C G = 0: an answer, and no word of a library on standard output."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 5))
    A, G = rng.integers(-2, 3, (2, n, n)).astype(float)
    G[0] = 0
    C = np.eye(n)[:1] * 10.0 ** rng.integers(-3, 4)
    outcome = investigate((A, G, C), [0.05, 0.5], output={"jump_measurement": "after"})
    assert outcome.verdict in ("proved", "refuted", "undecided")
    assert capfd.readouterr().out == ""


@pytest.mark.parametrize(
    "G", [np.diag([0.5, 0.5]), np.diag([0.0, 0.5]), 0.3 * np.array([[1.0, 0], [0, -1]])]
)
@pytest.mark.parametrize("stated", [{"window": 2}, {"alpha": 1.5}, {"window": 3, "alpha": 1.1}])
def test_a_plant_that_decays_by_itself_is_never_refuted(G: Any, stated: dict[str, Any]) -> None:
    """Gains of zero estimate it, whatever window is asked for and whatever C does not see."""
    plant = (-np.eye(2), G, first(2))
    assert investigate(plant, [1, 2], **stated).verdict != "refuted"
    # the twin: with an unseen state that does not decay, no gain of any strategy does
    grows = (np.diag([-1.0, 0.0]), np.eye(2), first(2))
    assert investigate(grows, [1, 2], **stated).verdict == "refuted"


def test_one_spacing_is_one_cell_without_width() -> None:
    problem = impulsive_problem(SPLINE, [0.4, 0.4], strategy="quadratic")
    outcome = obsdesign.investigate(problem)
    assert outcome.verdict == "proved"
    assert np.asarray(outcome.design.gains["cells"]).tolist() == [0.4, 0.4]
