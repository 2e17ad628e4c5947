"""Whatever the input: an exit code that means something, one line for a refusal, whole files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.fuzz.cases import CASES, SMALL
from tests.fuzz.harness import judged

BATCHES, SIZE = 5, 100


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
