"""Cases of laws of the test suite that take seconds each: larger plants, open gains, finer numbers.

python -m pytest tests/long/slow_cases.py        five minutes on one core
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from lmi.arithmetic.balls import precision
from lmi.decide.dwell_search import dwell_bracket
from obsdesign.analysis.finite_time.enclosed_gains import Sampled
from obsdesign.equations.finite_time.condition_13 import approx_log_longest_period
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.equations.modes import SwitchedGains
from obsdesign.verification.finite_time.theorem_1 import Norms
from tests.lmi.decide import test_uncertain_stability as uncertain_stability
from tests.lmi.prove import test_chords as chords
from tests.long.check_agrees import disagreements
from tests.papers import test_medina as medina
from tests.studies.check import test_which_kinds as which_kinds
from tests.studies.search import test_period as period
from tests.synthesis.impulsive_input import test_operator as operator
from tests.synthesis.luenberger import test_gain_search as gain_search
from tests.systems.designs import investigated
from tests.systems.event_widths import doses, oral_doses
from tests.systems.mode_paths import largest_widths
from tests.systems.pairs import SAMPLED
from tests.systems.parameters import spring
from tests.verification import test_choices as choices
from tests.verification import test_mode_events as mode_events
from tests.verification import test_parameter_laws as laws
from tests.verification.interval import test_event_claims as event_claims
from tests.verification.interval import test_gain_constraints as constraints
from tests.verification.interval import test_several_events as several_events
from tests.verification.interval import test_sourced_width as sourced_width
from tests.verification.interval import test_uncertain_examples as examples
from tests.verification.luenberger import test_error_bound as error_bound


@pytest.mark.parametrize("plant", [gain_search.kicked_often, gain_search.turned])
def test_no_constraint_gives_a_smaller_bound(plant: Any) -> None:
    gain_search.test_no_constraint_gives_a_smaller_bound(plant, {"M": 0.5})


def test_less_noise_gives_no_larger_bound_with_jumps() -> None:
    gain_search.test_less_noise_gives_no_larger_bound(gain_search.kicked_with_one_gain, (0, 0.01))


def test_open_gains_of_the_kicked_spring() -> None:
    given = ((13.9, 59.2), (7.09, 19.8), (2.0, -1.0))
    error_bound.test_open_gains_are_those_of_the_least_proved_bound(error_bound.kicked(), given)


@pytest.mark.parametrize("example", which_kinds.HARD)
def test_check_says_what_design_says(example: str) -> None:
    assert disagreements(which_kinds.load(example)) == []


def test_a_slow_bracket_is_as_tight_as_windows_and_words_allow() -> None:
    bracket = dwell_bracket(*SAMPLED, "shortest", 1.0)
    assert bracket.verdict == "refuted"
    assert bracket.not_proved > 0.2105
    assert bracket.proved is not None
    assert bracket.proved < 0.2155


def test_widths_between_samples_are_those_of_their_ages() -> None:
    """Plasma and tissue: between simulated and published; tissue follows slowly."""
    width = event_claims.claims_of(oral_doses(6))["event_width"]
    assert width.verdict == "proved"
    always = np.array(width.evidence["always"])[4:]
    assert (always >= (8.7, 4.88)).all()
    assert (always <= (9.65, 11.66)).all()


@pytest.mark.parametrize(("every", "gap", "simulated", "published"), [
    ((2, 3), 0.05, (1.4063, 1.2027), (1.4119, 1.2093)),
    ((2, 3), 0.2, (1.4855, 1.3867), (1.4991, 1.3947)),
    ((1.2, 1.8), 0.2, (2.8390, 2.3427), (2.9689, 2.4281)),
])  # fmt: skip
def test_widths_after_a_jump(
    every: tuple[float, float], gap: float, simulated: Any, published: Any
) -> None:
    event_claims.test_widths_after_a_jump_are_between_simulated_and_published_ones(
        every, gap, simulated, published
    )


@pytest.mark.parametrize("every", [(1.3, 1.9), (1.3, 40)])
def test_widths_of_ranges(every: tuple[float, float]) -> None:
    event_claims.test_widths_are_proved_for_ranges_of_all_lengths(every)


@pytest.mark.parametrize(("gap", "cells", "simulated", "most"), [
    (0.5, 8, (2.79, 0), (2.877, 2.645)), (2, 16, (6.2, 4.88), (6.847, 5.863)),
])  # fmt: skip
def test_widths_of_ticks(gap: float, cells: int, simulated: Any, most: Any) -> None:
    event_claims.test_widths_of_ticks(gap, cells, simulated, most)


def test_more_cells_never_give_the_wider_width() -> None:
    event_claims.test_more_cells_never_give_the_wider_width(doses(2), (4, 8))
    event_claims.test_more_cells_never_give_the_wider_width(event_claims.WIDENED, (8, 16))


@pytest.mark.parametrize(("plant", "arguments", "until"), [
    (several_events.kicked, (0.5,), 40.0), (several_events.bolus, (2,), 160.0),
    (doses, (8,), 160.0),
])  # fmt: skip
def test_no_sequence_is_wider_than_what_is_proved(
    plant: Any, arguments: tuple[float], until: float
) -> None:
    several_events.test_no_sequence_is_wider_than_what_is_proved(plant, arguments, until)


def test_open_gains_are_chosen_for_the_width_under_parameters() -> None:
    body = spring(output={"C": [[1, 0]], "C_radius": [[0.05, 0]], "noise_bound": [0.01]})
    sourced_width.test_open_gains_are_chosen_for_the_width_under_parameters(
        body, "coordinates", 0.92
    )


@pytest.mark.parametrize("share", [0.01, 0.2])
def test_shortest_dwell_time_of_example_4_1(share: float) -> None:
    sourced_width.test_shortest_dwell_time_of_example_4_1(share)


@pytest.mark.parametrize(
    ("rates", "radii"), [((), (0.805, 0.920)), (tuple(examples._RATES), (8.08, 6.52))]
)
def test_oral_doses(rates: tuple[str, ...], radii: tuple[float, float]) -> None:
    examples.test_oral_doses(rates, radii)


def test_a_ball_whose_impacts_hardly_ever_come() -> None:
    examples.test_a_ball_needs_a_longest_time_between_impacts(100.0, "proved")


def test_regions_hold_in_open_coordinates() -> None:
    constraints.test_regions_hold_in_every_form("coordinates", {})


@pytest.mark.parametrize("changes", [{"margin": 0.5}, {"state_correction": False}])
def test_an_operator_that_nobody_chose_is_not_named_alone(changes: dict[str, Any]) -> None:
    operator.test_an_operator_that_nobody_chose_is_not_named_alone(changes)


def test_a_window_that_is_open_grows_until_it_shows_the_state() -> None:
    choices.test_a_window_that_is_open_grows_until_it_shows_the_state(6, {})


def test_a_state_that_no_window_showed_is_undecided() -> None:
    assert choices.verdict(choices.cascade(10, operator="integral")) == "undecided"


def test_three_states_two_events_and_stays_without_end_are_proved() -> None:
    outcome = investigated(mode_events.LASTING)
    assert outcome.verdict == "proved"
    assert outcome.design is not None
    gains = SwitchedGains.from_document(outcome.design.gains, IntervalGains)
    evidence = mode_events.claim_of(outcome, "mode_width").evidence
    largest = largest_widths(gains, 300, np.random.default_rng(0))
    for (where, mode), width in largest.items():
        assert (width < evidence[where][gains.names.index(mode)]).all()
    assert mode_events.lower_tube(outcome) == "undecided"


@pytest.mark.parametrize("seed", range(6, 20))
def test_random_bases_have_the_same_verdicts_and_are_dead_beat(seed: int) -> None:
    medina.test_random_bases_have_the_same_verdicts_and_are_dead_beat(seed)


@pytest.mark.parametrize("seed", [*range(6, 24), 105, 639])
def test_random_stiff_families_are_proved_and_their_twins_are_not(seed: int) -> None:
    chords.test_random_stiff_families_are_proved_and_their_twins_are_not(seed)


@pytest.mark.parametrize(
    ("radius", "proved", "refuted"), [(0.1, 1.5513, 1.5713), (0.2, 1.4172, 1.4372)]
)
def test_sampled_control_with_pole_and_gain_that_vary(
    radius: float, proved: float, refuted: float
) -> None:
    uncertain_stability.test_sampled_control_with_pole_and_gain_that_vary(radius, proved, refuted)


@pytest.mark.parametrize("change", [laws._permuted, laws._mirrored, laws._split])
def test_another_way_to_write_parameters_changes_no_verdict(change: Any) -> None:
    laws.test_another_way_to_write_parameters_changes_no_verdict("no box, two matrices", change)


def test_shortest_window_with_any_gain() -> None:
    assert period.search_result("shortest_window")["proved"] == pytest.approx(3.5)


def test_coordinates_with_any_gain_allow_longer_periods() -> None:
    result = period.search_result(A=period.CHAIN, C=[[1, 0]])
    extension = result["coordinates"]
    assert extension["proved"] > 1.01 * result["proved"]
    S, back = np.array(extension["S"]), np.linalg.inv(extension["S"])
    chain, output = S @ np.array(period.CHAIN) @ back, np.array([[1.0, 0]]) @ back
    value = approx_log_longest_period(chain, output, S @ extension["L"], extension["window"])
    assert math.exp(value) == pytest.approx(extension["proved"], rel=1e-6)


def test_coordinates_that_allow_shorter_windows() -> None:
    result = period.search_result("shortest_window", A=period.CHAIN, C=[[1, 0]], period=1e-4)
    extension = result["coordinates"]
    assert extension["samples"] < result["samples"] / 4
    assert extension["proved"] == extension["samples"] * 1e-4 == extension["window"]
    chain, output = np.array(period.CHAIN, dtype=float), np.array([[1.0, 0.0]])
    with precision(160):
        sampled = Sampled.from_plant(chain, output, 1e-4, extension["samples"])
        for S, holds in ((np.array(extension["S"]), True), (None, False)):
            sizes = Norms.from_sampled(sampled, np.array(extension["L"]), S)
            assert sizes is not None
            assert sizes.condition(1e-4) == ("proved" if holds else "refuted")
