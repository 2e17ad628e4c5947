"""Noise in a window, directly and through K: coefficients by simulation, deviations by errors."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from obsdesign.equations.impulsive_input.features import window_taps
from obsdesign.equations.impulsive_input.gains import IntegralGains
from obsdesign.runtime.impulsive_input.event import MISFIT, Event
from obsdesign.runtime.impulsive_input.integral.addition import compared
from obsdesign.runtime.impulsive_input.integral.evaluate import Decision, Window
from obsdesign.runtime.impulsive_input.integral.free_run import FreeRun, Track
from obsdesign.runtime.impulsive_input.integral.window_noise import Responses
from obsdesign.runtime.impulsive_input.whitening import raw_taps
from tests.runtime.impulsive_input.test_onsets import errors_of
from tests.systems.designs import designed

# a default K that colours the noise of a window, and one that does as stated poles have it
COLOURED: dict[str, Any] = {
    "flow": {"A": [[-0.67, 0.99, 1.01], [-0.31, 0.19, 1.19], [-0.06, 0.15, -0.13]]},
    "jump": {"H": [[0.78], [-0.24], [-0.35]], "dwell_time": [8.0, "inf"]},
    "output": {
        "C": [[-0.72, -0.88, -1.01], [0.28, -0.35, 0.87]],
        "noise_std": [0.1, 0.1],
        "measured": "periodic",
        "period": 0.125,
    },
    "observer": {"kind": "impulsive_input", "operator": "integral"},
}
FAST: dict[str, Any] = {
    "flow": {"A": [[-0.7, 0.0], [1.0, -2.0]]},
    "jump": {"H": [[1.0], [0.0]], "dwell_time": [8.0, "inf"]},
    "output": {"C": [[0.0, 1.0]], "noise_std": [0.01], "measured": "periodic", "period": 0.1},
    "observer": {"kind": "impulsive_input", "operator": "integral", "poles": [-3.0, -4.0]},
}
TIMES = np.array([0.0, 0.125, 0.25, 0.375, 0.625, 0.75, 0.875, 1.0])
LAMBDAS = np.array([-1.5, -0.4])


def run_of(body: dict[str, Any]) -> FreeRun:
    gains = designed(body).gains
    return FreeRun.from_gains(IntegralGains.from_document(gains))


@pytest.fixture(scope="module")
def run() -> FreeRun:
    return run_of(COLOURED)


def features_of(run: FreeRun, track: Track, first: int) -> np.ndarray:
    """What the residuals from a row on leave, output by output, TIMES its times."""
    return np.asarray((window_taps(LAMBDAS, TIMES).T @ run.residual(track, first)).T.reshape(-1))


def track_of(run: FreeRun, times: Any, x: Any, y: Any) -> Track:
    none = np.zeros((len(times), run.gains.n))
    return run.extended(run.begin(times[0], y[0], none[0], x), times[1:], y[1:], none[1:])


def test_coefficients_are_those_of_the_observer_that_runs(run: FreeRun) -> None:
    taps = raw_taps(window_taps(LAMBDAS, TIMES), run.gains.p)
    responses = Responses.from_run(run, TIMES, taps)
    n, p, rows = run.gains.n, run.gains.p, len(TIMES)
    still = np.zeros((rows + 1, p))
    for i, unit in enumerate(np.eye(n)):
        track = track_of(run, TIMES, -unit, still[1:])
        np.testing.assert_allclose(responses.V[:, i], features_of(run, track, 0), atol=1e-12)
        np.testing.assert_allclose(responses.flow[:, i], -track.x[-1], atol=1e-12)
        for c in range(1, rows):
            error = run.impulse_error(TIMES, TIMES[c], unit)
            left = (window_taps(LAMBDAS, TIMES).T @ error @ run.gains.C.T).T.reshape(-1)
            np.testing.assert_allclose(responses.onsets[c, :, i], left, atol=1e-12)
            np.testing.assert_allclose(responses.states[c, :, i], error[-1], atol=1e-12)
    before = np.append(TIMES[0] - 0.125, TIMES)
    for k in range(rows):
        for j in range(p):
            y = still.copy()
            y[k + 1, j] = 1.0
            track = track_of(run, before, np.zeros(n), y)
            left = features_of(run, track, 1)
            np.testing.assert_allclose(responses.noise[k, j], left, atol=1e-12)
            end = -track.x[-1] if k < rows - 1 else np.zeros(n)
            np.testing.assert_allclose(responses.ends[k, j], end, atol=1e-12)


def test_a_smoothed_record_is_run_again_without_its_noise(run: FreeRun) -> None:
    """The estimates change as if the observer had begun right and had read samples without noise."""
    rng, n, p = np.random.default_rng(3), run.gains.n, run.gains.p
    y, noise, start = (rng.standard_normal((len(TIMES), p)) for _ in range(3))
    start = start.reshape(-1)[:n]
    noise[-1] = 0.0
    x = rng.standard_normal(n)
    newer = run.maps(run.runs(TIMES)[0][2]).newer
    cleaned = track_of(run, TIMES, x + start - newer @ noise[0], y - noise)
    change = cleaned.x - track_of(run, TIMES, x, y).x
    np.testing.assert_allclose(run.smoothing(TIMES, start, noise), change, atol=1e-12)


@pytest.mark.parametrize("body", [COLOURED, FAST], ids=["default K", "fast poles"])
@pytest.mark.parametrize(
    "options", [{}, {"state_correction": False}, {"weighting": "plain"}], ids=str
)
def test_deviations_count_noise_through_the_gain(
    body: dict[str, Any], options: dict[str, Any]
) -> None:
    """Errors of the default design were 1.7 (times) and 2.5 (weights) times their deviations."""
    body = {**body, "observer": body["observer"] | options}
    scores, events, operator = errors_of(body, 25)
    assert operator == "integral"
    size = np.sqrt((scores**2).mean(axis=0))
    assert (size > 0.6).all()
    assert (size < 1.3).all()
    # and a right plant with the noise that is stated is not said to leave more than that
    fits = sum(event.status == "ok" for event in events)
    assert fits >= (18 if "weighting" in options else 24)


@pytest.mark.parametrize("weight", [0.0, 1.0])
def test_residuals_are_noise_or_an_impulse_that_does_not_fit(weight: float) -> None:
    """chi-squared of coloured residuals; the twin holds a second impulse."""
    run = run_of(FAST)
    rng, times, n = np.random.default_rng(5), 0.1 * np.arange(60), 2
    root, spread = np.diag([0.02, 0.05]), np.full((60, 1), 0.01)
    none, event = np.zeros(n), Event(t=4.0, weights=np.zeros(1), t_std=0.0, weights_std=np.zeros(1))
    doubts = 0
    for _ in range(100):
        y = 0.01 * rng.standard_normal((60, 1))
        track = track_of(run, times, none - root @ rng.standard_normal(n), y)
        error = track.y - track.x @ run.gains.C.T
        error += run.impulse_error(times, 2.0, weight * run.gains.H[:, 0]) @ run.gains.C.T
        window = Window(t=times, y=y, error=error, taps=y, spread=spread)
        doubts += compared(run, Decision(event=event, fit=event), window, root @ root).doubts == (
            MISFIT,
        )
    assert doubts <= 1 if weight == 0 else doubts == 100


def test_without_noise_every_misfit_counts(run: FreeRun) -> None:
    event = Event(t=0.5, weights=np.zeros(1))
    error = np.full((len(TIMES), 2), 1e-9)
    for rest, doubted in ((error, True), (0 * error, False)):
        window = Window(t=TIMES, y=error, error=rest, taps=error, spread=0 * error)
        decision = Decision(event=event, fit=event)
        assert bool(compared(run, decision, window, np.zeros((3, 3))).doubts) is doubted
