"""Evidence of a file against that of a new proof: what may be missing, what may differ."""

from __future__ import annotations

from typing import Any

import pytest

from obsdesign.verification.same_evidence import difference


def evidence(**expected: Any) -> dict[str, Any]:
    return {"approx_expected": {"peak": 1.0, **expected}}


def test_numbers_that_older_files_do_not_have_may_be_missing() -> None:
    proved = evidence(time_std=0.1, weight_std=0.2)
    assert difference("uniqueness", evidence(), proved) is None
    assert difference("uniqueness", evidence(time_std=0.1), proved) is None


@pytest.mark.parametrize(
    "stored",
    [
        evidence(time_std=0.05, weight_std=0.2),
        evidence(time_std=0.1, weight_std="0.2"),
        evidence(time_std=0.1, weight_std=0.2, other=1.0),
        {"approx_expected": {"time_std": 0.1, "weight_std": 0.2}},
    ],
)
def test_other_numbers_and_missing_ones_are_differences(stored: dict[str, Any]) -> None:
    assert difference("uniqueness", stored, evidence(time_std=0.1, weight_std=0.2)) is not None
