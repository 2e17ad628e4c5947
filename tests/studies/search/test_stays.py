"""Search for the shortest and the longest stay in modes."""

from __future__ import annotations

import pytest

from obsdesign.errors import InputError
from obsdesign.studies.search import search
from tests.systems.switched import valve


def test_longest_closed_stay_of_the_valve() -> None:
    outcome = search.search(valve(), "longest_dwell", of="closed")
    assert outcome.verdict == "proved"
    # while open for 2, x1 shrinks by e^-1.2; while closed it grows like e^0.05t: 24 undoes it
    assert 23.9994 <= outcome.result["proved"] < 24 < outcome.result["not_proved"] < 24.001
    assert outcome.result["not_proved_verdict"] == "refuted"


def test_a_limit_for_gains_that_were_chosen_is_none_for_others() -> None:
    outcome = search.search(valve(kind="luenberger"), "shortest_dwell", 1e-3, of="open")
    assert outcome.result["proved"] > 0
    assert outcome.result["not_proved_verdict"] == "undecided"
    assert outcome.result["these_gains"]["witness"]["stays"]


def test_what_cannot_be_searched_is_refused() -> None:
    with pytest.raises(InputError, match="--of must be a mode, one of open, closed; got 'stroke'"):
        search.search(valve(), "longest_dwell", of="stroke")
    with pytest.raises(InputError, match="Observers for modes"):
        search.search(valve(kind="impulsive"), "longest_dwell")
