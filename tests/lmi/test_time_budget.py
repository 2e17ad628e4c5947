"""Budgets nest, stretch and end searches, with evidence; proofs do not notice."""

from __future__ import annotations

import itertools
import math
import time

import numpy as np
import pytest

from lmi.arithmetic.balls import exact
from lmi.decide.dwell_search import longest_dwell
from lmi.decide.stability import decide
from lmi.find.window_search import Budget, find_windows
from lmi.prove.common_matrix import prove_common
from lmi.rank.full_rank import prove_full_rank
from lmi.rank.stack import Stack, coordinates
from lmi.time_budget import (
    collect_remarks,
    deadline,
    ended,
    ended_part,
    ending,
    remaining,
    remark,
    remark_end,
    scaled,
    sentences,
    stretch_factors,
    stretched,
    total_budget,
)
from tests.systems.pairs import SAMPLED

# less than any search takes: it is over when it is looked at
NOTHING = 1e-9


def test_the_least_of_nested_totals_counts() -> None:
    assert deadline(math.inf) == math.inf
    with total_budget(10.0):
        assert 9.0 < remaining() <= 10.0
        with total_budget(100.0):
            assert remaining() <= 10.0
        with total_budget(1.0):
            assert remaining() <= 1.0
        assert remaining() > 1.0
        assert remaining(0.5) <= 0.5
    assert remaining() == math.inf


def test_a_total_is_positive() -> None:
    for seconds in (0.0, -1.0, math.nan):
        with pytest.raises(ValueError, match="positive"), total_budget(seconds):
            pass
    with total_budget(None):
        assert remaining() == math.inf


def test_own_budgets_stretch_and_the_total_bounds_them() -> None:
    assert list(stretch_factors()) == [1.0]  # without a total there is one attempt
    with stretched(4.0):
        assert 7.0 < remaining(2.0) <= 8.0
        assert scaled(100) == 400
        with total_budget(3.0):
            assert remaining(2.0) <= 3.0
    with total_budget(100.0):
        assert list(itertools.islice(stretch_factors(), 3)) == [1.0, 4.0, 16.0]
    with total_budget(NOTHING):
        assert list(stretch_factors()) == [1.0]


def test_evidence_names_the_budget_that_ended() -> None:
    assert ended() == {}
    assert ended(deadline(100.0), 100.0) == {}
    with stretched(4.0):
        assert ended(deadline(NOTHING), 3.0) == {"ended_by": "time", "seconds": 12.0}
        with total_budget(NOTHING):
            found = ended(deadline(100.0), 100.0)
    assert found == {"ended_by": "time", "seconds": NOTHING}
    assert ending(found) == "ended after 1e-09 s"
    assert ended_part({"windows": 3, **found}) == found
    assert ended_part({"seconds": 3.0}) == {}  # seconds of something else


def test_remarks_are_made_once_and_the_last_end_counts() -> None:
    with collect_remarks() as remarks:
        remark("first")
        remark("first")
        for seconds in (1.0, 2.0):
            remark_end("gains", {"ended_by": "time", "seconds": seconds})
        remark_end("coordinates", {})
    texts = sentences(remarks)
    assert texts[0] == "first"
    assert len(texts) == 2
    assert "the search of gains ended after 2 s" in texts[1]


def test_a_search_without_time_is_undecided_and_short_and_a_proof_is_a_proof() -> None:
    F, H = SAMPLED
    slow = decide(F, H, 0.4, 1.87)
    assert slow.outcome == "proved"
    began = time.process_time()
    with total_budget(NOTHING):
        quick = decide(F, H, 0.4, 1.87)  # needs windows, which take a search
        easy = prove_common(-np.eye(2), np.eye(2) / 2, np.eye(2), 0.1, math.inf)
    assert quick.outcome == "undecided"
    assert ended_part(quick.evidence) == {"ended_by": "time", "seconds": NOTHING}
    assert easy.outcome == "proved"
    assert time.process_time() - began < 5.0


def test_what_no_time_decides_is_not_said_to_end_by_time() -> None:
    # the identity neither contracts nor grows: no budget ends this
    still = decide(np.zeros((2, 2)), np.diag([1.0, 0.5]), 0.1, 1.0, memory=0)
    assert still.outcome != "proved"
    assert ended_part(still.evidence) == {}


def test_windows_are_counted_and_stretch() -> None:
    F, H = (exact(X) for X in SAMPLED)
    few, short = Budget(windows=3), Budget(seconds=NOTHING)
    found = find_windows(F, H, 0.4, 1.87, budget=few).verdict
    assert ended_part(found.evidence) == {"ended_by": "windows", "limit": 3}
    found = find_windows(F, H, 0.4, 1.87, budget=short).verdict
    assert ended_part(found.evidence) == {"ended_by": "time", "seconds": NOTHING}
    with stretched(30.0):
        assert find_windows(F, H, 0.4, 1.87, budget=few).verdict.outcome == "proved"


def test_boxes_end_by_their_number_or_with_the_total() -> None:
    turn = np.array([[0.0, 2 * np.pi], [-2 * np.pi, 0.0]])
    stack = Stack(exact(turn), exact(np.eye(2)), exact(np.eye(2)[:1]), exact(np.eye(2)), 3)
    low, high = 0.05, 0.45
    R, _ = coordinates(stack, low, high)
    assert prove_full_rank(stack, low, high, R).outcome == "proved"
    counted = prove_full_rank(stack, low, high, R, limit=2)
    assert counted.outcome == "undecided"
    assert ended_part(counted.evidence) == {}  # --time does not change the number of boxes
    with total_budget(NOTHING):
        timed = prove_full_rank(stack, low, high, R)
    assert timed.outcome == "undecided"
    assert ended_part(timed.evidence) == {"ended_by": "time", "seconds": NOTHING}


def test_a_bracket_says_what_ended_it() -> None:
    with total_budget(NOTHING):
        bracket = longest_dwell(*SAMPLED, 0.4)
    assert bracket.proved is None
    assert bracket.ended == {"ended_by": "time", "seconds": NOTHING}
    assert longest_dwell(-np.eye(2), np.eye(2) / 2, 0.4).ended == {}
