"""Budgets are values: they stretch and end searches, with evidence; proofs do not notice."""

from __future__ import annotations

import dataclasses
import itertools
import math
import time

import numpy as np
import pytest

from lmi.arithmetic.balls import exact
from lmi.decide.dwell_search import dwell_bracket
from lmi.decide.stability import decide
from lmi.find.window_search import Effort, find_windows
from lmi.prove.common_matrix import prove_common
from lmi.rank.full_rank import prove_full_rank
from lmi.rank.stack import Stack, coordinates
from lmi.time_budget import (
    UNLIMITED,
    Remark,
    TimeBudget,
    ended_part,
    ending,
    last_end,
    remark_end,
    sentences,
)
from tests.systems.pairs import SAMPLED

# less than any search takes: it is over when it is looked at
NOTHING = 1e-9
NO_TIME = TimeBudget.from_seconds(NOTHING)


def test_a_total_is_a_value_and_ends_at_a_moment() -> None:
    assert TimeBudget.from_seconds(None) == UNLIMITED
    assert UNLIMITED.remaining() == math.inf
    budget = TimeBudget.from_seconds(10.0)
    assert 9.0 < budget.remaining() <= 10.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        budget.end = math.inf  # type: ignore[misc]


def test_a_total_is_positive() -> None:
    for seconds in (0.0, -1.0, math.nan):
        with pytest.raises(ValueError, match="positive"):
            TimeBudget.from_seconds(seconds)


def test_a_total_ends_a_proof_over_dwell_times() -> None:
    F, H, P = np.diag([-1.0, -2.0]), 0.5 * np.eye(2), np.eye(2)
    verdict = prove_common(F, H, P, 0.1, 3.0, budget=NO_TIME)
    assert verdict.outcome == "undecided"
    assert ended_part(verdict.evidence) == {"ended_by": "time", "seconds": NOTHING}
    assert prove_common(F, H, P, 0.1, 3.0).outcome == "proved"


def test_own_limits_stretch() -> None:
    assert [*UNLIMITED.attempts()] == [UNLIMITED]  # without a total there is one attempt
    assert UNLIMITED.stretched(4.0).scaled(100) == 400
    assert UNLIMITED.stretched(1e300).scaled(2) == 2 * 10**9
    budget = TimeBudget.from_seconds(100.0)
    attempts = [*itertools.islice(budget.attempts(), 3)]
    assert [attempt.factor for attempt in attempts] == [1.0, 4.0, 16.0]
    assert {attempt.end for attempt in attempts} == {budget.end}
    assert [*NO_TIME.attempts()] == [NO_TIME]


def test_evidence_names_the_budget_that_ended() -> None:
    assert UNLIMITED.ended() == {}
    assert TimeBudget.from_seconds(100.0).ended() == {}
    evidence = NO_TIME.stretched(4.0).ended()
    assert evidence == {"ended_by": "time", "seconds": NOTHING}
    assert ending(evidence) == "ended after 1e-09 s"
    assert ended_part({"windows": 3, **evidence}) == evidence
    assert ended_part({"seconds": 3.0}) == {}  # seconds of something else


def test_remarks_are_made_once_and_the_last_end_counts() -> None:
    first = Remark("first")
    ends = [{"ended_by": "time", "seconds": seconds} for seconds in (1.0, 2.0)]
    remarks = [first, first, *(entry for end in ends for entry in remark_end("gains", end))]
    remarks += remark_end("coordinates", {})
    texts = sentences(remarks)
    assert texts[0] == "first"
    assert len(texts) == 2
    assert "the search of gains ended after 2 s" in texts[1]
    assert last_end(remarks) == ends[1]
    assert last_end([first]) == {}


def test_a_search_without_time_is_undecided_and_short_and_a_proof_is_a_proof() -> None:
    F, H = SAMPLED
    slow = decide(F, H, 0.4, 1.87)
    assert slow.outcome == "proved"
    began = time.process_time()
    quick = decide(F, H, 0.4, 1.87, budget=NO_TIME)  # needs windows, which take a search
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
    few = Effort(windows=3)
    verdict = find_windows(F, H, 0.4, 1.87, effort=few).verdict
    assert ended_part(verdict.evidence) == {"ended_by": "windows", "limit": 3}
    verdict = find_windows(F, H, 0.4, 1.87, budget=NO_TIME).verdict
    assert ended_part(verdict.evidence) == {"ended_by": "time", "seconds": NOTHING}
    stretched = UNLIMITED.stretched(30.0)
    verdict = find_windows(F, H, 0.4, 1.87, effort=few, budget=stretched).verdict
    assert verdict.outcome == "proved"


def test_the_work_of_the_solver_is_counted_and_stretches() -> None:
    F, H = (exact(X) for X in SAMPLED)
    little = Effort(work=200)
    verdict = find_windows(F, H, 0.4, 1.87, effort=little).verdict
    end = ended_part(verdict.evidence)
    assert end["ended_by"] == "windows"
    assert 1 < end["limit"] < 20
    stretched = UNLIMITED.stretched(1000.0)
    verdict = find_windows(F, H, 0.4, 1.87, effort=little, budget=stretched).verdict
    assert verdict.outcome == "proved"


def test_boxes_end_by_their_number_or_with_the_total() -> None:
    turn = np.array([[0.0, 2 * np.pi], [-2 * np.pi, 0.0]])
    stack = Stack(exact(turn), exact(np.eye(2)), exact(np.eye(2)[:1]), exact(np.eye(2)), 3)
    low, high = 0.05, 0.45
    R, _ = coordinates(stack, low, high)
    assert prove_full_rank(stack, low, high, R).outcome == "proved"
    counted = prove_full_rank(stack, low, high, R, limit=2)
    assert counted.outcome == "undecided"
    assert ended_part(counted.evidence) == {}  # --time does not change the number of boxes
    timed = prove_full_rank(stack, low, high, R, budget=NO_TIME)
    assert timed.outcome == "undecided"
    assert ended_part(timed.evidence) == {"ended_by": "time", "seconds": NOTHING}


def test_a_bracket_says_what_ended_it() -> None:
    bracket = dwell_bracket(*SAMPLED, "longest", 0.4, budget=NO_TIME)
    assert bracket.proved is None
    assert bracket.ended == {"ended_by": "time", "seconds": NOTHING}
    assert dwell_bracket(-np.eye(2), np.eye(2) / 2, "longest", 0.4).ended == {}


def test_a_slow_machine_comes_to_the_same_bracket(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, brackets, ends = time.process_time, [], []
    F, H = (exact(X) for X in SAMPLED)
    for slow in (1.0, 10.0):  # the twin runs on a clock that is ten times as fast
        monkeypatch.setattr(time, "process_time", lambda slow=slow: slow * clock())
        brackets.append(dwell_bracket(*SAMPLED, "shortest", 1.0, accuracy=0.5))
        ends.append(find_windows(F, H, 0.212, 1.0, effort=Effort(windows=10)).verdict)
    assert ended_part(ends[0].evidence) == {"ended_by": "windows", "limit": 10}
    assert brackets[0] == brackets[1]
    assert ends[0] == ends[1]


def test_a_part_of_a_budget_ends_earlier() -> None:
    whole = TimeBudget.from_seconds(100.0)
    assert whole.part(0.25).remaining() == pytest.approx(25.0, abs=1.0)
    assert whole.part(0.25).seconds == 100.0
    ended = TimeBudget.from_seconds(1e-9)
    assert ended.part(0.5).end == ended.end
    assert UNLIMITED.part(0.5) == UNLIMITED
