"""Brackets of stays in modes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lmi.decide.stay_search import stay_bracket
from lmi.modes import Modes
from lmi.prove.modes_proof import prove_modes
from tests.lmi.modes_examples import switched, unstable_second


def test_longest_stay_in_an_unstable_mode_is_that_of_the_periodic_cycle() -> None:
    bracket = stay_bracket(unstable_second(2, 2.1), "longest", (1,))
    assert bracket.verdict == "refuted"
    assert bracket.proved is not None
    assert bracket.not_proved is not None
    # between the number that is proved in the tables and the one that a cycle refutes
    assert 2.54701 <= bracket.proved < bracket.not_proved <= 2.54712
    assert prove_modes(unstable_second(2, bracket.proved), bracket.certificate).outcome == "proved"


@pytest.mark.parametrize("start", [2.0, 4.0])
def test_shortest_stay_is_the_same_from_either_side(start: float) -> None:
    bracket = stay_bracket(switched("W48", start), "shortest", (0, 1), accuracy=1e-4)
    assert bracket.proved == pytest.approx(2.70775, rel=2e-4)
    assert bracket.not_proved == pytest.approx(2.70775, rel=2e-4)


def test_everything_or_nothing_may_be_proved() -> None:
    flows = (np.array([[-1, 0.2], [0, -1]]), np.array([[-2, 0], [0.1, -1]]))
    lasting = Modes.from_flows(flows, [(1, math.inf), (1, 5)])
    assert stay_bracket(lasting, "longest", (1,)).proved == math.inf
    assert stay_bracket(lasting, "shortest", (1,)).proved == 0.0
    growing = Modes.from_flows([np.diag([1, -1]), np.diag([2, -1])], [(1, 4), (1, 5)])
    nothing = stay_bracket(growing, "longest", (1,))
    assert nothing.proved is None
    assert nothing.verdict == "refuted"
