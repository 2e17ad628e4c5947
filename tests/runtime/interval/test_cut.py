"""What is carried on is cut with prediction and strip: never wider, never without the state."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from obsdesign.problem.flow import Flow
from obsdesign.problem.output import Output
from obsdesign.problem.plant import Plant
from obsdesign.runtime import Sample
from obsdesign.runtime.interval.kernel import Kernel
from obsdesign.runtime.interval.kernel_rows import Cuts
from obsdesign.runtime.interval.maps import BoxMap
from obsdesign.runtime.interval.model import Model
from obsdesign.runtime.interval.observer import IntervalObserver
from obsdesign.runtime.interval.step_kernels import StepKernels
from obsdesign.runtime.set_membership.tape import strip_cut
from tests.runtime.interval.test_row_bounds import MODES, case, record, run, violation
from tests.runtime.interval.test_samples import sampled_observer, sampled_run
from tests.systems.interval_runs import SIMULATION_ROUNDING, observer_for, random_plant

SLACK = 1e-9


class UncutKernels(StepKernels):
    """The box of the observer alone, of each length by itself."""

    cells = None

    def _with_cuts(self, model: Model, step: BoxMap, cuts: Cuts) -> Kernel:
        del cuts
        return super()._with_cuts(model, step, Cuts())


class Uncut(IntervalObserver):
    @cached_property
    def kernels(self) -> StepKernels:
        return UncutKernels(self.gains)


def in_coordinates(mode: str, seed: int) -> tuple[IntervalObserver, Any, tuple[Any, Any]]:
    """A plant of two or three states with gains and coordinates without any sense."""
    rng = np.random.default_rng([len(mode), seed])
    n = int(rng.integers(2, 4))
    plant = random_plant(rng, n=n)
    L, M = 0.5 * rng.standard_normal((2, n, plant.p))
    if plant.output.jump_measurement == "none":
        M = 0 * M
    S = np.eye(n) + 0.5 * rng.standard_normal((n, n))
    make = sampled_observer if mode == "periodic" else observer_for
    plain = make(plant, L, M).gains.to_document()
    observer = IntervalObserver.from_gains(plain | {"form": "coordinates", "S": S})
    x = rng.standard_normal(n)
    return observer, record(plant, rng, x, mode), (x - 0.5, x + 0.5)


CASES = [pytest.param(case, mode, id=mode) for mode in MODES]
CASES += [pytest.param(in_coordinates, mode, id=f"{mode}, S") for mode in MODES]


@pytest.mark.parametrize(("make", "mode"), CASES)
def test_bounds_are_inside_those_without_the_cut(make: Any, mode: str) -> None:
    narrower = 0
    for seed in range(3):
        observer, samples, start = make(mode, seed)
        rows = samples.without_bounds()
        lower, upper, status = run(observer, rows, start)
        low, high, _ = run(Uncut(observer.gains), rows, start)
        slack = SLACK * np.maximum(np.abs(low), np.abs(high)).max(axis=1, keepdims=True)
        assert not any("void" in text for text in status)
        assert np.all(low - slack <= lower)
        assert np.all(upper <= high + slack)
        assert violation((lower, upper, status), samples.x) <= SIMULATION_ROUNDING
        narrower += np.sum(upper - lower < 0.9 * (high - low))
    assert narrower > 20


@pytest.mark.parametrize("mode", ["continuous", "periodic", "at_jumps"])
def test_bounds_are_inside_prediction_and_strip_of_the_bounds_before(mode: str) -> None:
    checked = 0
    for seed in range(3):
        observer, samples, start = case(mode, seed)
        gains, rows = observer.gains, samples.without_bounds()
        lower, upper, _ = run(observer, rows, start)
        b = (gains.flow_lower + gains.flow_upper) / 2, (gains.flow_upper - gains.flow_lower) / 2
        u: Any = np.zeros(0)
        for k in range(1, len(rows)):
            u = rows[k - 1].u if rows[k - 1].u is not None else u
            if rows[k].jump:
                continue
            h, n = rows[k].t - rows[k - 1].t, gains.n
            block = np.zeros((2 * n, 2 * n))
            block[:n, :n], block[:n, n:] = gains.A, np.eye(n)
            known = b[0] + (gains.B @ u if len(u) else 0.0)
            middle = (expm(block * h) @ np.concatenate([(lower + upper)[k - 1] / 2, known]))[:n]
            pieces = [np.abs(expm(gains.A * s)) @ b[1] for s in np.linspace(0, h, 17)]
            reach = np.trapezoid(pieces, dx=h / 16, axis=0)
            radius = np.abs(expm(gains.A * h)) @ (upper - lower)[k - 1] / 2 + 1.001 * reach
            box = np.array([middle - radius, middle + radius])
            if rows[k].y is not None:
                y, V = np.asarray(rows[k].y), gains.noise_bound
                cut = strip_cut(box, gains.C, np.array([y - V, y + V]))
                assert cut is not None
                box = cut
            slack = 5e-3 * reach.max() + SLACK * np.abs(box).max()
            assert np.all(box[0] - slack <= lower[k])
            assert np.all(upper[k] <= box[1] + slack)
            checked += 1
    assert checked > 25 or mode == "at_jumps"


def still(measured: str) -> IntervalObserver:
    """A state at rest, x' = 0, measured with noise up to 0.1; no gains."""
    plant = Plant(Flow(np.zeros((1, 1))), None, Output(np.eye(1), noise_bound=[0.1],
                  measured=measured, period=1.0))  # fmt: skip
    if measured == "periodic":
        return sampled_observer(plant, np.zeros((1, 1)), np.zeros((1, 1)))
    return observer_for(plant, np.zeros((1, 1)), np.zeros((1, 1)))


@pytest.mark.parametrize("measured", ["periodic", "continuous"])
def test_samples_that_contradict_an_earlier_one_refute_the_bounds(measured: str) -> None:
    observer = still(measured)
    rows = [Sample(0.0, np.array([0.09])), Sample(1.0, np.array([-0.09])), Sample(2.0, np.array([-0.12]))]  # fmt: skip
    estimates = list(observer.run(observer.init(0.0, lower=[-1], upper=[1]), rows))
    np.testing.assert_allclose(
        [np.concatenate([e.lower, e.upper]) for e in estimates[:2]],
        [[-0.01, 0.19], [-0.01, 0.01]], atol=1e-12,
    )  # fmt: skip
    assert [e.status for e in estimates] == ["ok", "ok", "y1 outside its bounds"]


def test_the_twin_within_the_noise_is_ok() -> None:
    observer = still("periodic")
    rows = [Sample(float(k), np.array([y])) for k, y in enumerate([0.09, -0.09, -0.1])]
    estimates = observer.run(observer.init(0.0, lower=[-1], upper=[1]), rows)
    assert {e.status for e in estimates} == {"ok"}


@pytest.mark.parametrize("seed", [21849, 21850])
def test_a_late_sample_ends_a_course_with_the_state_inside(seed: int) -> None:
    # the centre of a course and its radius must come from one map: one output, missing samples
    assert sampled_run(seed) <= SIMULATION_ROUNDING
