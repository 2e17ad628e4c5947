"""Words of parameters: what they destabilise is replayed here by simulation, in floats."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lmi.arithmetic.balls import to_float
from lmi.find.bang_bang import followed, worst_switching
from lmi.find.worst_parameters import worst_points
from lmi.refute.parameter_words import (
    Stay,
    read_stays,
    refute_constant_parameters,
    refute_parameters,
    refute_witness,
)
from tests.lmi.parameter_examples import from_ranges, oscillator, sampled, table_5

FAMILY = oscillator(0.21)


@pytest.fixture(scope="module")
def word() -> tuple[Stay, ...]:
    """A word of the oscillator, stiffness 1 +- 0.21, dwell times [1, 3]."""
    worst = worst_switching(FAMILY, 1.0, 3.0)
    assert worst is not None
    assert worst.growth > 1.005
    return worst.word


def test_a_word_that_grows_is_a_refutation(word: tuple[Stay, ...]) -> None:
    verdict = refute_parameters(FAMILY, 1.0, 3.0, word)
    assert verdict.outcome == "refuted"
    assert read_stays(verdict.witness["stays"]) == word


def test_the_witness_can_be_replayed(word: tuple[Stay, ...]) -> None:
    """By Runge and Kutta, from the witness alone: the state has grown after many repeats."""
    witness = refute_parameters(FAMILY, 1.0, 3.0, word).witness
    x = np.array([1.0, 0.3])
    sizes = []
    for _ in range(60):
        for stay in witness["stays"]:
            x = to_float(FAMILY.jump(stay["jump"])) @ x
            for piece in stay["flow"]:
                A = to_float(FAMILY.flow(piece["p"]))
                flow = solve_ivp(lambda t, z, A=A: A @ z, (0, piece["duration"]), x, rtol=1e-9)
                x = flow.y[:, -1]
        sizes.append(float(np.linalg.norm(x)))
    growth = (sizes[-1] / sizes[19]) ** (1 / 40)
    assert growth == pytest.approx(witness["spectral_radius"], rel=1e-3)
    assert growth > 1


def stay(*durations: float, p: float = 1.0, jump: tuple[float, ...] | None = (0.0,)) -> Stay:
    return Stay(jump, tuple(((p,), t) for t in durations))


@pytest.mark.parametrize(
    ("word", "reason"),
    [
        ([stay(1.0, p=1.5)], "box"),
        ([stay(1.0, jump=(-1.1,))], "box"),
        ([stay(1.0, jump=(0.0, 0.0))], "box"),
        ([stay(0.5)], "range"),
        ([stay(2.0, 1.5)], "range"),
        ([stay(2.0, -0.5)], "range"),
        ([stay(2.0, jump=None)], "range"),
        ([], "box"),
    ],
)  # fmt: skip
def test_what_is_no_word_of_the_family_refutes_nothing(word: list[Stay], reason: str) -> None:
    wild = from_ranges([[3]], [[2]], [([[1]], [[0]])], [(-1, 1)])
    verdict = refute_parameters(wild, 1.0, 3.0, word)
    assert verdict.outcome == "undecided"
    assert reason in verdict.reason
    # the twin: within the box and the range anything grows
    assert refute_parameters(wild, 1.0, 3.0, [stay(0.5, 0.5)]).outcome == "refuted"


def test_flows_without_jumps_are_for_ranges_without_an_end() -> None:
    """x' = a x decays at jumps, and grows where none come."""
    family = from_ranges([[0]], [[0.1]], [([[1]], [[0]])], [(-1, 0.5)])
    flow = stay(1.0, jump=None)
    assert refute_parameters(family, 0.0, math.inf, [flow]).outcome == "refuted"
    assert refute_parameters(family, 0.0, 1.0, [flow]).outcome == "undecided"
    both = refute_parameters(family, 0.0, math.inf, [flow, stay(1.0)])
    assert both.outcome == "undecided"


def test_a_constant_parameter_does_not_switch(word: tuple[Stay, ...]) -> None:
    constant = oscillator(0.21, is_constant=True)
    verdict = refute_parameters(constant, 1.0, 3.0, word)
    assert verdict.reason == "a constant parameter would change"


def test_a_word_that_decays_refutes_nothing() -> None:
    verdict = refute_parameters(FAMILY, 1.0, 3.0, [stay(1.0)])
    assert verdict.outcome == "undecided"
    assert verdict.evidence["growth_per_jump"] < 1


def test_corners_may_be_stable_where_the_middle_is_not() -> None:
    """G(p) = 1.05 [p, 1; -1, -p]: its eigenvalues are 0 at the corners, 1.05 in size at p = 0."""
    effect = (np.zeros((2, 2)), [[1.05, 0], [0, -1.05]])
    family = from_ranges(
        -0.01 * np.eye(2), [[0, 1.05], [-1.05, 0]], [effect], [(-1.0, 0.9)], [True]
    )
    worst = worst_points(family, 1.0, 2.0)[0]
    assert worst.p[0] == pytest.approx(0.05 / 0.95, abs=0.05)
    assert worst.theta is not None
    verdict = refute_constant_parameters(family, worst.p, 1.0, 2.0, (worst.theta,))
    assert verdict.outcome == "refuted"
    for corner in (-1.0, 1.0):
        alone = refute_constant_parameters(family, (corner,), 1.0, 2.0)
        assert alone.outcome == "undecided"


@pytest.mark.parametrize("row", range(4))
def test_constant_parameters_refute_table_5_as_it_is_printed(row: int) -> None:
    family, longest = table_5(row, gain=1.0)
    verdict = refute_constant_parameters(family, (1.0,), 0.001, longest, (longest,))
    radius = (6.5103, 7.1598, 4.7697, 5.7664)[row]
    assert verdict.outcome == "refuted"
    assert verdict.witness["spectral_radius"] == pytest.approx(radius, abs=1e-3)
    assert refute_constant_parameters(family, (1.1,), 0.001, longest).outcome == "undecided"


def test_dwell_times_in_turn_may_refute_constant_parameters() -> None:
    """Every dwell time alone decays, and two of them in turn do not."""
    effect = ([[0, 1], [-1, 0]], np.zeros((2, 2)))
    family = from_ranges(
        [[-0.1, 0], [0, -0.1]], np.diag([1.5, 0.2]), [effect], [(1.0, 1.1)], [True]
    )
    p = (-1.0,)
    assert refute_constant_parameters(family, p, 0.7, 2.6).outcome == "undecided"
    verdict = refute_constant_parameters(family, p, 0.7, 2.6, (0.7, 2.6))
    assert verdict.outcome == "refuted"
    assert verdict.witness["thetas"] == [0.7, 2.6]
    assert verdict.witness["p"] == [-1.0]
    # the twin: out of the range it is no witness
    assert refute_constant_parameters(family, p, 0.8, 2.6, (0.7, 2.6)).outcome == "undecided"


def test_a_word_follows_its_range(word: tuple[Stay, ...]) -> None:
    """The same parameters, other dwell times: in the new range, and growing alike."""
    neighbour = followed(FAMILY, 1.0, 2.99, word)
    verdict = refute_parameters(FAMILY, 1.0, 2.99, neighbour.word)
    assert verdict.outcome == "refuted"


def test_sums_of_durations_are_dwell_times_exactly() -> None:
    """0.001 and 1.6495 are no short binary numbers: words reach them, and do not pass them."""
    family = sampled(0.1)
    worst = worst_switching(family, 0.001, 1.5713)
    assert worst is not None
    assert refute_parameters(family, 0.001, 1.5713, worst.word).outcome == "refuted"


def test_stored_witnesses_are_checked(word: tuple[Stay, ...]) -> None:
    stored = refute_parameters(FAMILY, 1.0, 3.0, word).witness
    assert refute_witness(FAMILY, 1.0, 3.0, stored).outcome == "refuted"
    # the twin: at the other end of the range every stiffness decays
    assert refute_witness(oscillator(0.1), 1.0, 3.0, stored).outcome == "undecided"
    family, longest = table_5(0, gain=1.0)
    constant = {"p": [1.0], "theta": longest}
    assert refute_witness(family, 0.001, longest, constant).outcome == "refuted"


@pytest.mark.parametrize(
    "witness",
    [
        {}, {"p": [1.0, 0.0], "theta": 1.0}, {"p": None}, {"p": ["a"], "theta": 1.0},
        {"p": [math.nan], "theta": 1.0}, {"p": [0.0], "theta": "a"}, {"stays": None},
        {"stays": [{}]}, {"stays": [{"jump": [0.0], "flow": [{"p": [0.0]}]}]}, {"stays": [[1.0]]},
        {"stays": [{"jump": [0.0], "flow": [{"p": [0.0], "duration": math.nan}]}]},
    ],
)  # fmt: skip
def test_what_is_no_witness_refutes_nothing(witness: dict[str, object]) -> None:
    assert refute_witness(FAMILY, 1.0, 3.0, witness).outcome == "undecided"
