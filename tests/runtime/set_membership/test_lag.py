"""Bounds of the state some rows ago: there on every row that has so many before it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from lmi.arithmetic.arrays import Matrix
from obsdesign.runtime import from_design
from obsdesign.runtime.base import Sample
from obsdesign.runtime.set_membership.observer import SetMembershipObserver
from tests.systems.designs import designed
from tests.systems.set_membership import flow_integral

LAG, ROWS, STEP = 3, 14, 0.25
A = np.array([[-1.0, 0.3], [0.2, 0.1]])
G = np.array([[0.9, 0.1], [-0.2, 0.8]])


def _observer(noise: float, *, window: int = 8, jump: bool = False) -> SetMembershipObserver:
    body: dict[str, Any] = {
        "flow": {"A": A.tolist(), "disturbance": {"lower": [-0.1] * 2, "upper": [0.1] * 2}},
        "output": {"C": [[1, 0], [0, 1]], "noise_bound": noise},
        "observer": {"kind": "set_membership", "fixed_lag": LAG, "window": window},
    }
    if jump:
        body["jump"] = {"G": G.tolist(), "dwell_time": [STEP, STEP]}
    observer = from_design(designed(body))
    assert isinstance(observer, SetMembershipObserver)
    return observer


def _lagged(
    observer: SetMembershipObserver, noise: float, *, jump: bool = False
) -> tuple[list[Any], Matrix]:
    """Estimates of a record that starts in zero, and the true states after its rows."""
    rng = np.random.default_rng(3)
    Phi, integral = flow_integral(A, STEP)
    x, state = np.zeros(2), observer.init(lower=[-1.0] * 2, upper=[1.0] * 2)
    estimates, truth = [], []
    for k in range(ROWS):
        x = Phi @ x + integral @ (0.1 * rng.choice([-1, 1], 2))
        y = x + noise * rng.uniform(-1, 1, 2)
        x = G @ x if jump else x
        state, estimate = observer.step(state, Sample(STEP * (k + 1), y=y, jump=jump))
        estimates.append(estimate)
        truth.append(x)
    return estimates, np.array(truth)


def _check(estimates: list[Any], truth: Matrix) -> None:
    rounding = 1e-13  # of the simulated truth
    for k in range(LAG, ROWS):
        lagged, then = estimates[k].lagged, estimates[k - LAG]
        assert (lagged[0] <= truth[k - LAG] + rounding).all()
        assert (truth[k - LAG] - rounding <= lagged[1]).all()
        assert (lagged[0] >= then.lower).all()  # never wider than what was known then
        assert (lagged[1] <= then.upper).all()
        assert estimates[k].status == "ok"
    assert all(np.isnan(estimate.lagged).all() for estimate in estimates[:LAG])


@pytest.mark.parametrize("noise", [0.0, 1e-12, 1e-9, 1e-3])
def test_where_almost_no_noise_makes_the_tape_begin_anew_in_every_row(noise: float) -> None:
    _check(*_lagged(_observer(noise), noise))


def test_where_the_window_holds_fewer_rows() -> None:
    """A row with a jump is two stages: a window of four holds two rows."""
    observer = _observer(0.05, window=4, jump=True)
    _check(*_lagged(observer, 0.05, jump=True))


def test_later_samples_narrow_the_bounds_of_then() -> None:
    estimates, _ = _lagged(_observer(0.05), 0.05)
    width = np.array([np.diff(e.lagged, axis=0)[0] for e in estimates[LAG:]])
    then = np.array([e.upper - e.lower for e in estimates[:-LAG]])
    assert width.mean() < 0.95 * then.mean()


def test_nothing_before_a_contradiction_is_used_after_it() -> None:
    observer = _observer(1e-12)
    state = observer.init(lower=[-1.0] * 2, upper=[1.0] * 2)
    for k, y in enumerate([0.0, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0]):
        state, estimate = observer.step(state, Sample(STEP * (k + 1), y=[y, y]))
        assert estimate.status.startswith("bounds crossed") == (k == 4)
        assert np.isnan(estimate.lagged).all() == (k < 3 or 4 <= k < 4 + LAG)
    ended = observer.reset(state, lower=[0.0] * 2, upper=[1.0] * 2)
    _, estimate = observer.step(ended, Sample(3.0, y=[0.5, 0.5]))
    assert np.isnan(estimate.lagged).all()
