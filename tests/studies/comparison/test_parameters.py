"""All kinds on a record of an uncertain plant: bounds hold, and the filter takes the middle."""

from __future__ import annotations

import numpy as np
import pytest

import obsdesign
from obsdesign.problem.problem import Problem
from obsdesign.studies.comparison.compare import compare_with_kalman
from obsdesign.studies.comparison.record import ComparisonRecord
from obsdesign.studies.comparison.row import REFERENCE
from tests.systems.parameters import Body, degue, spring


@pytest.mark.parametrize("body", [spring(), degue(0.05)])
def test_a_default_record_is_inside_what_bounds_assume(body: Body) -> None:
    """It starts in the middle of [state], or at rest: no row has an objection."""
    problem = Problem.from_dict(body)
    designs = [
        obsdesign.design(problem),
        obsdesign.design(problem.for_kind("set_membership")[0]),
    ]
    record = ComparisonRecord.from_simulation(problem.plant, rng=np.random.default_rng(0))
    rows = {row.kind: row for row in compare_with_kalman(designs, record)}
    assert rows["interval"].without == rows["set_membership"].without == 0
    assert rows[REFERENCE].error is not None
    assert rows["set_membership"].error is not None
    assert rows[REFERENCE].error < 1.5 * rows["set_membership"].error
