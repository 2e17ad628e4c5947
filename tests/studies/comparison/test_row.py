"""Numbers of a row of a comparison."""

from __future__ import annotations

import numpy as np
import pytest

from obsdesign.studies.comparison.record import ComparisonRecord
from obsdesign.studies.comparison.row import _errors


@pytest.mark.parametrize(
    ("last", "worst"), [(np.inf, 0.5), (np.nan, 0.5), (2.0, 2.0)], ids=["inf", "nan", "finite"]
)
def test_errors_are_those_that_are_finite(last: float, worst: float) -> None:
    """An estimate that overflows is no number of an answer."""
    estimates, record = np.array([[0.5], [last]]), ComparisonRecord((), np.zeros((2, 1)))
    errors = _errors(record, estimates, None, np.array([True, True]))
    assert errors["worst"] == worst
    assert np.isfinite(errors["error"])


def test_nothing_finite_is_no_error() -> None:
    record = ComparisonRecord((), np.zeros((1, 1)))
    errors = _errors(record, np.array([[np.inf]]), None, np.array([True]))
    assert errors["worst"] is errors["error"] is None
