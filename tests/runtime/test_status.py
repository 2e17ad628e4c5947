"""The status of a row: reasons with a kind that the numbers of rows do not change."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

from obsdesign.runtime.base import Estimate
from obsdesign.runtime.clocks.dwell_guard import DwellGuard
from obsdesign.runtime.replay import provisional
from obsdesign.runtime.status import (
    MISSING_SAMPLE,
    NOT_FINITE,
    OK,
    VOID,
    Reason,
    late_sample,
    reasons_of,
    status_of,
    void_since,
    with_reasons,
)


def test_a_row_without_reasons_is_ok_and_makes_no_object() -> None:
    assert status_of([], np.zeros(2)) is OK
    assert with_reasons(OK, []) is OK
    assert reasons_of(OK) == ()


def test_reasons_survive_another_reason_and_the_word_of_late_rows() -> None:
    first = status_of([late_sample(1.5, 1.0)], np.array([np.inf]))
    second = with_reasons(first, [MISSING_SAMPLE])
    third = provisional(Estimate(0.0, status=second)).status
    assert third == (
        "provisional; time 1.5 since the last sample exceeds 1; estimate is not finite; "
        "missing sample"
    )
    kinds = [reason.kind for reason in reasons_of(third)]
    assert kinds == [
        "provisional", "time since the last sample exceeds 1", NOT_FINITE, MISSING_SAMPLE,
    ]  # fmt: skip
    assert [reason.number for reason in reasons_of(third)] == [None, 1.5, None, None]


@pytest.mark.parametrize("again", [copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))])
def test_copies_keep_the_reasons(again) -> None:  # type: ignore[no-untyped-def]
    status = status_of([void_since(2.5, "bounds crossed"), late_sample(3.0, 1.0)])
    copied = again(status)
    assert copied == status
    assert [(r.kind, r.number) for r in reasons_of(copied)] == [
        (VOID, None), ("time since the last sample exceeds 1", 3.0),
    ]  # fmt: skip


def test_kinds_depend_on_the_design_and_not_on_the_row() -> None:
    guard = DwellGuard(0.5, 2.0, last_jump=0.0, jitter=0.1, last_dwell=1.0)
    early, earlier = (guard.after(t, jump=True)[1] for t in (0.3, 0.2))
    late, changed = (guard.after(t, jump=True)[1] for t in (3.0, 1.5))
    assert early != earlier
    assert early is not None
    assert earlier is not None
    assert early.kind == earlier.kind == "dwell time below 0.5"
    assert late is not None
    assert late.kind == "dwell time above 2"
    assert changed is not None
    assert (changed.kind, changed.number) == ("change of the dwell time above 0.1", 0.5)
    named = early.of_clock("dose")
    assert (named, named.kind) == ("dose: dwell time 0.3 below 0.5", "dose: dwell time below 0.5")


def test_a_text_alone_is_its_own_kind() -> None:
    assert Reason("window not full").kind == "window not full"
    assert [each.kind for each in reasons_of("window not full")] == ["window not full"]
