"""At which row a contradiction is reported: where the exact set becomes empty, and not before."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from obsdesign.runtime.base import Sample
from obsdesign.runtime.set_membership.proposals import propose_contradiction
from tests.systems.feasible_set import Program
from tests.systems.set_membership import Case, observer_of, random_case


def _drifting(samples: Sequence[Sample], rate: float, output: int, V: float) -> list[Sample]:
    """The samples with an output that drifts by a rate, in noise bounds for each row, from row 6 on."""
    drifting = []
    for k, sample in enumerate(samples):
        if k > 6 and sample.y is not None:
            y = np.array(sample.y)
            y[output] += rate * (k - 6) * V
            sample = sample._replace(y=y)
        drifting.append(sample)
    return drifting


def _reported(case: Case, samples: Sequence[Sample]) -> int | None:
    """The first row with a contradiction; the window holds the whole record."""
    observer = observer_of(case, 40)
    state = observer.init(0.0, lower=case.x0[0], upper=case.x0[1])
    for k, sample in enumerate(samples):
        state, estimate = observer.step(state, sample)
        if "crossed" in estimate.status:
            return k
    return None


def _empty(case: Case, samples: Sequence[Sample]) -> int | None:
    """The first row after which the exact program of the whole record is empty (HiGHS)."""
    program = Program(case, 4)
    for k, sample in enumerate(samples):
        program.add(sample)
        if k > 6 and program.is_empty():
            return k
    return None


@pytest.mark.parametrize(("rate", "row"), [(0.5, 13), (0.0, None)])
def test_a_drift_is_reported_at_the_row_at_which_no_state_is_left(
    rate: float, row: int | None
) -> None:
    """Generators that exceed the disturbance by 2 % leave the set that bounds come from nonempty."""
    case = random_case(3, 332, 2, -0.3, rows=30)
    samples = _drifting(case.record(extreme=True, seed=10).samples[:17], rate, 0, 0.05)
    assert _empty(case, samples) == row
    assert _reported(case, samples) == row


@pytest.mark.parametrize(("gap", "is_empty"), [(1e-4, True), (-1e-4, False)])
def test_multipliers_of_strips_that_hardly_exclude_each_other(gap: float, is_empty: bool) -> None:
    """xi_1 + xi_2 within 0.1 of 0 and of 0.2 + gap, among strips that exclude nothing."""
    rng = np.random.default_rng(3)
    H = np.vstack([[1.0, 1.0, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0], rng.normal(size=(6, 4))])
    residual, V = np.zeros(8), np.r_[0.1, 0.1, np.ones(6)]
    residual[1] = 0.2 + gap
    mu = propose_contradiction((H, residual, V), 20)
    value = np.abs(mu @ H).sum() + mu @ residual + np.abs(mu) @ V
    assert bool(value < 0.0) == is_empty
    assert bool(mu.any()) == is_empty
