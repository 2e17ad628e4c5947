"""Whatever the input: an exit code that means something, one line for a refusal, whole files."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.fuzz.cases import CASES, SMALL, design_text
from tests.fuzz.differences import differs
from tests.fuzz.harness import Case, Outcome, judged, refusal_faults

BATCHES, SIZE = 5, 40  # `tests.long.fuzz` has any number of them


@pytest.mark.parametrize("batch", range(BATCHES))
@pytest.mark.parametrize("sort", CASES)
def test_every_call_ends_as_it_should(sort: str, batch: int, tmp_path: Path) -> None:
    codes = []
    for seed in range(batch * SIZE, (batch + 1) * SIZE):
        case = CASES[sort](np.random.default_rng([seed, 2, *sort.encode()]), SMALL)
        code, faults = judged(case, tmp_path)
        assert not faults, (seed, case.name, case.arguments, faults)
        codes.append(code)
    # cases that are all refused, or all good, would show nothing
    assert 0 < codes.count(2) < SIZE
    assert codes.count(0) > 0


@pytest.mark.parametrize(
    ("name", "gain", "is_other"),
    [("two_rates", "L", False), ("two_rates", "A", True), ("sampled", "L", True)],
)
def test_open_gains_may_be_any_that_are_proved(name: str, gain: str, is_other: bool) -> None:
    base, body = json.loads(design_text(name)), json.loads(design_text(name))
    assert not differs(base, body)
    body["gains"][gain][0][0] += 1e16
    assert differs(base, body) == is_other


@pytest.mark.parametrize(("errors", "faulty"), [(1, False), (3, True)])
def test_rows_left_out_are_no_error_lines(errors: int, faulty: bool) -> None:
    late = "obsdesign: standard input: the row of t = -9 arrived at 0, 24 later; it is skipped.\n"
    wrong = "obsdesign: standard input line 4: received must be at least t.\n"
    case = Case("pipe", {}, ["run"], stdin="t\n")
    assert bool(refusal_faults(case, Outcome(2, "", late * 3 + wrong * errors, 0.1))) == faulty
