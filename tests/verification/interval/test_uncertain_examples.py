"""Uncertain plants of practice: oral doses with uncertain rates, a ball with uncertain restitution.

The simulated means are of one schedule of doses and impacts; bounds are cut with the strip of each
sample, so that those of a measured state are no wider than its noise.
"""

from __future__ import annotations

import math
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg

import obsdesign
from lmi.arithmetic.balls import exact, inverse
from lmi.decide.stability import decide
from obsdesign.analysis.widened import absolute_plant
from obsdesign.data.simulation import simulate
from obsdesign.equations.interval.certain_bounds import without_state_bounds
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.equations.interval.sourced_width import SourcedWidth, sourced_width
from obsdesign.equations.parameters import NormalForm
from obsdesign.problem.problem import Problem
from obsdesign.runtime import Sample, from_design
from obsdesign.synthesis.interval.candidates import synthesize
from obsdesign.synthesis.interval.corrections import corrections
from tests.systems.parameters import Body, compartments, degue, rooms, spring

_ORAL = Path(__file__).parents[3] / "examples" / "oral_doses.toml"
# effects of a relative change of each rate, and how far it may change
_RATES = {
    "clearance": (0.3, [(4, 4, -0.2)]),
    "absorption": (0.2, [(3, 3, -1), (4, 3, 1)]),
    "transit": (0.1, [(0, 0, -3), (1, 0, 3), (1, 1, -3), (2, 1, 3), (2, 2, -3), (3, 2, 3)]),
}


def oral_doses(*rates: str) -> Body:
    """The example with L = 20 at plasma, and these rates uncertain."""
    body = tomllib.loads(_ORAL.read_text(encoding="utf-8"))
    body["observer"] = {"kind": "interval", "gains": {"L": [[0], [0], [0], [0], [20], [0]]}}
    for name in rates:
        half, entries = _RATES[name]
        A = np.zeros((6, 6))
        for i, j, value in entries:
            A[i, j] = value
        parameter = {"name": name, "range": [-half, half], "A": A.tolist()}
        body.setdefault("parameter", []).append(parameter)
    return body


def _growth(body: Body) -> float:
    """Spectral radius of e^(W h) |I - L C|, W for the worst parameters."""
    W = absolute_plant(Problem.from_dict(body).plant, lambda X: np.asarray(X, np.float64))[0]
    L, C = np.array(body["observer"]["gains"]["L"]), np.array(body["output"]["C"])
    step = scipy.linalg.expm(0.5 * np.asarray(W, np.float64)) @ np.abs(np.eye(6) - L @ C)
    return float(np.abs(np.linalg.eigvals(step)).max())


@pytest.mark.parametrize("rates", [(), ("clearance",), tuple(_RATES)])
def test_oral_doses_decay_between_samples_alike(rates: tuple[str, ...]) -> None:
    """What is uncertain of the measured plasma costs nothing, and absorption is a cascade."""
    assert _growth(oral_doses(*rates)) == pytest.approx(0.91137 if rates else 0.9113, abs=6e-6)


@pytest.mark.parametrize(
    ("rates", "radii"),
    [(("clearance",), (2.25, 2.04))],
)
def test_oral_doses(rates: tuple[str, ...], radii: tuple[float, float]) -> None:
    """Mean half-widths of plasma and tissue before a sample, with rates from end to end."""
    problem = Problem.from_dict(oral_doses(*rates))
    outcome = obsdesign.investigate(problem)
    assert outcome.verdict == "proved"
    assert ("state_box" in [claim.id for claim in outcome.claims]) == bool(rates)
    assert outcome.design is not None
    observer, more = from_design(outcome.design), {"parameters": "bang-bang"} if rates else {}
    run = simulate(problem.plant, until=80.0, step=0.5, initial=np.zeros(6),
                   rng=np.random.default_rng(0), **more)  # type: ignore[arg-type]  # fmt: skip
    y, jump, x = run.block("y"), run.columns["jump"].astype(bool), run.block("x")
    state, before = observer.init(0.0, lower=np.zeros(6), upper=np.zeros(6)), []
    for k, t in enumerate(run.t.tolist()):
        own = y[k] if np.isfinite(y[k]).all() else None
        if own is not None and k > 0:
            _, estimate = observer.step(state, Sample(t))
            before.append((estimate.upper - estimate.lower)[4:] / 2)
        state, estimate = observer.step(state, Sample(t, own, jump=bool(jump[k])))
        assert estimate.status == "ok"
        assert (estimate.lower <= x[k] + 1e-9).all()
        assert (estimate.upper >= x[k] - 1e-9).all()
    mean = np.mean(before[len(before) // 2 :], axis=0)
    np.testing.assert_allclose(mean, radii, rtol=0.15)


def ball(low: float, high: float) -> Body:
    """A ball that keeps .7 to .8 of its speed at impacts, scheduled; its height is measured."""
    return {
        "flow": {"A": [[0, 1], [0, 0]],
                 "disturbance": {"lower": [0, -10.31], "upper": [0, -9.31]}},
        "jump": {"G": [[1, 0], [0, 0]], "dwell_time": [low, high],
                 "disturbance": {"lower": [0, -0.1], "upper": [0, 0.1]}},
        "output": {"C": [[1, 0]], "noise_bound": [0.01]},
        "parameter": [{"name": "restitution", "range": [0.7, 0.8], "G": [[0, 0], [0, -1]]}],
        "observer": {"kind": "interval", "gains": {"L": [[3], [0]], "M": [[1], [0]]}},
    }  # fmt: skip


@pytest.mark.parametrize(
    ("high", "verdict"), [(1.0, "proved"), (4.0, "proved"), (math.inf, "refuted")]
)
def test_a_ball_needs_a_longest_time_between_impacts(high: float, verdict: str) -> None:
    """N = diag(0, 0.8), while its flow does not decay."""
    outcome = obsdesign.investigate(Problem.from_dict(ball(0.0, high)))
    assert outcome.verdict == verdict


def test_a_ball_that_bounces() -> None:
    problem = Problem.from_dict(ball(0.8, 1.2))
    observer = from_design(obsdesign.design(problem))
    run: Any = simulate(problem.plant, until=40.0, step=0.05, initial=[5, 0],
                        parameters="bang-bang", rng=np.random.default_rng(3))  # fmt: skip
    batch = observer.run_batch(run.t, run.block("y"), jump=run.columns["jump"].astype(bool),
                               lower=[4.9, -0.1], upper=[5.1, 0.1])  # fmt: skip
    x, late = run.block("x"), slice(len(run.t) // 2, None)
    assert set(batch.status) == {"ok"}
    assert np.minimum(batch.upper - x, x - batch.lower).min() > -1e-9
    radii = (batch.upper - batch.lower)[late] / 2
    assert radii[:, 0].max() <= 0.01 * (1 + 1e-9)
    assert 3.0 < radii[:, 1].mean() < 4.5
    assert radii[:, 1].max() < 5.0


def _damped() -> Body:
    """The spring with uncertain damping too."""
    body = spring()
    damping = {"name": "damping", "range": [-0.1, 0.1], "A": [[0, 0], [0, 1]]}
    return body | {"parameter": [*body["parameter"], damping]}


@pytest.mark.parametrize(
    ("body", "gains", "after", "before"),
    [
        (_damped(), None, (0.01, 1.5948), (0.6719, 1.2948)),
        (compartments(), {"L": [[40], [6]], "M": [[0], [0]]}, None, (4.448, 0.600)),
        (compartments(), {"L": [[4], [0]], "M": [[0], [0]]}, None, (26.42, 40.62)),
        (compartments(), {"L": [[0], [0]], "M": [[0], [0]]}, None, (53.2, 81.0)),
        (rooms(), {"L": [[10], [1]], "M": [[0.8], [0.2]]}, None, (0.570, 2.768)),
    ],
)
def test_widths_in_a_box(body: Body, gains: Any, after: Any, before: Any) -> None:
    """Claimed half-widths after and before jumps."""
    if gains is not None:
        body = body | {"observer": {"kind": "interval", "form": "split", "gains": gains}}
    outcome = obsdesign.investigate(Problem.from_dict(body))
    (width,) = (claim.evidence for claim in outcome.claims if claim.id == "width")
    np.testing.assert_allclose(np.array(width["before_jump"]) / 2, before, rtol=1e-3)
    if after is not None:
        np.testing.assert_allclose(np.array(width["after_jump"]) / 2, after, rtol=1e-3)


@pytest.mark.parametrize(
    ("share", "threshold"), [(0.01, 0.712795), (0.05, 0.794634), (0.1, 0.905258), (0.2, 1.162141)]
)
def test_gains_on_the_measured_part_shorten_the_dwell_time(share: float, threshold: float) -> None:
    """Without them example 4.1 needs longer times, up to 6 % of them."""
    for factor, outcome in ((0.999, "refuted"), (1.001, "proved")):
        width = _sourced(degue(share, (factor * threshold,) * 2), is_corrected=False)
        assert width.N is not None
        assert decide(width.W, width.N, *(factor * threshold,) * 2).outcome == outcome
    matched = _sourced(degue(share, (threshold,) * 2), is_corrected=True)
    assert matched.N is not None
    assert decide(matched.W, matched.N, 0.999 * threshold, 0.999 * threshold).outcome == "proved"


def test_an_uncertain_sensor_needs_a_longer_dwell_time() -> None:
    """Example 4.1 with a sensor gain of 1 +- 5 %: 0.70632, in place of ln 2."""
    body = degue(0.0)
    del body["flow"]["A_radius"], body["jump"]["G_radius"]
    body["output"]["C_radius"] = [[0, 0.05]]
    for dwell, outcome in ((0.999 * 0.70632, "refuted"), (1.001 * 0.70632, "proved")):
        body["jump"]["dwell_time"] = [dwell, dwell]
        width = _sourced(body, is_corrected=True)
        assert width.N is not None
        assert decide(width.W, width.N, dwell, dwell).outcome == outcome


def _sourced(body: Body, *, is_corrected: bool) -> SourcedWidth:
    """The pair of the radius of a plant whose state has no known bounds, with the given gains."""
    plant = Problem.from_dict(body).plant
    gains = IntervalGains.from_document(next(iter(synthesize(Problem.from_dict(body)))).document())
    boundless = without_state_bounds(gains)
    if is_corrected:
        own = corrections(boundless, "continuous", np.ones(gains.n), gains.noise_bound)
        boundless = replace(boundless, **own)
    else:
        boundless = replace(boundless, flow_correction=None, jump_correction=None)
    return sourced_width(boundless, NormalForm.from_plant(plant, exact), exact, inverse)
