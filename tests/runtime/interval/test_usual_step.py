"""The short way of a usual step: the numbers of the general one, for streams side by side too."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from obsdesign.problem.flow import Flow
from obsdesign.problem.output import Output
from obsdesign.problem.plant import Plant
from obsdesign.runtime import Sample
from obsdesign.runtime.interval.observer import IntervalObserver
from tests.runtime.interval.test_samples import sampled_observer
from tests.systems.interval_runs import observer_for

PERIOD, NOISE, ROWS = 0.05, 0.05, 200
A = np.diag([-1.0, -2.0, -3.0]) + np.diag([0.5, 0.5], 1) + np.diag([0.3, 0.3], -1)
OBSERVERS = [(mode, with_S) for mode in ("periodic", "continuous") for with_S in (False, True)]


def case(
    mode: str, with_S: bool, *, B: Any = None, C: Any = ((1.0, 0.0, 0.0),)
) -> IntervalObserver:
    plant = Plant(
        Flow(A, B=B, lower=[-0.1] * 3, upper=[0.1] * 3), None,
        Output(np.array(C), noise_bound=[NOISE] * len(C), measured=mode, period=PERIOD),
    )  # fmt: skip
    S = np.eye(3) + 0.2 * np.random.default_rng(3).standard_normal((3, 3))
    L = np.full((3, len(C)), 0.3)
    make = sampled_observer if mode == "periodic" else observer_for
    observer = make(plant, L, 0 * L)
    if not with_S:
        return observer
    return IntervalObserver.from_gains(
        observer.gains.to_document() | {"form": "coordinates", "S": S}
    )


def samples(seed: int, start: float = 0.0, inputs: int = 0, outputs: int = 1) -> list[Sample]:
    """A plant at rest, seen with noise inside its bounds, in decimal times."""
    rng = np.random.default_rng(seed)
    return [
        Sample(round(start + PERIOD * k, 2), rng.uniform(-NOISE, NOISE, outputs) / 3,
               rng.uniform(-0.01, 0.01, inputs) if inputs else None)
        for k in range(ROWS)
    ]  # fmt: skip


def initial(observer: IntervalObserver, t: float = 0.0) -> Any:
    return observer.init(t, lower=-np.ones(3), upper=np.ones(3))


def assert_same(left: Any, right: Any) -> None:
    """Equal numbers, bit for bit, but for the mark of a usual state."""
    for a, b in zip(left, right, strict=True):
        if isinstance(a, tuple):
            assert_same(a, b)
        else:
            assert (
                np.array_equal(a, b, equal_nan=True)
                if isinstance(a, np.ndarray)
                else a == b or a != a
            )


def run_beside_general(observer: IntervalObserver, rows: list[Sample]) -> int:
    """Number of usual steps; each step gives what the general way gives from the same state."""
    state, usual = initial(observer, rows[0].t), 0
    for sample in rows:
        usual += state.is_usual and observer._usual(state, sample) is not None
        general = observer.step(state._replace(is_usual=False), sample)
        state, estimate = observer.step(state, sample)
        assert_same(state._replace(is_usual=False), general[0]._replace(is_usual=False))
        assert_same(estimate, general[1])
    return usual


@pytest.mark.parametrize(("mode", "with_S"), OBSERVERS)
def test_a_usual_step_is_the_general_step_bit_for_bit(mode: str, with_S: bool) -> None:
    assert run_beside_general(case(mode, with_S), samples(1)) > ROWS // 2


@pytest.mark.parametrize("mode", ["periodic", "continuous"])
@pytest.mark.parametrize("inputs", [1, 2])
def test_inputs_take_the_usual_step(mode: str, inputs: int) -> None:
    observer = case(mode, False, B=np.array([[1.0, 0.2], [0.0, -1.0], [0.5, 0.0]])[:, :inputs])
    rows = samples(2, inputs=inputs)
    held = [row._replace(u=None) if k % 3 else row for k, row in enumerate(rows)]
    uneven = [row._replace(t=row.t + 0.01 * (k % 7) ** 0.5) for k, row in enumerate(rows)]
    for record in (rows, held, uneven if mode == "continuous" else rows):
        assert run_beside_general(observer, record) > ROWS // 2


@pytest.mark.parametrize("u", [[np.nan], [np.inf], [1e200]])
def test_inputs_that_are_no_numbers_take_the_general_step(u: list[float]) -> None:
    rows = samples(2, inputs=1)
    rows[-2] = rows[-2]._replace(u=np.array(u))
    run_beside_general(case("continuous", False, B=np.array([[1.0], [0.0], [0.5]])), rows)


@pytest.mark.parametrize("inputs", [0, 1])
def test_a_row_with_too_many_inputs_is_refused(inputs: int) -> None:
    observer = case("continuous", False, B=np.ones((3, inputs)) if inputs else None)
    state, rows = initial(observer), samples(2, inputs=inputs)
    for row in rows[:5]:
        state, _ = observer.step(state, row)
    assert state.is_usual
    with pytest.raises(ValueError, match=f"u must have {inputs} entries; got 2"):
        observer.step(state, rows[5]._replace(u=np.zeros(2)))


@pytest.mark.parametrize("mode", ["periodic", "continuous"])
def test_several_outputs_take_the_general_step(mode: str) -> None:
    two = case(mode, False, C=((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
    assert run_beside_general(two, samples(3, outputs=2)) == 0


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e200, 5.0])
def test_a_value_that_is_no_measurement_takes_the_general_step(value: float) -> None:
    observer, rows = case("periodic", False), samples(4)
    rows[-1] = rows[-1]._replace(y=np.array([value]))
    run_beside_general(observer, rows)


@pytest.mark.parametrize(("mode", "with_S"), OBSERVERS)
def test_streams_at_times_of_other_magnitudes_share_an_observer(mode: str, with_S: bool) -> None:
    """Equal steps, another unit in the last place: one kernel for each, and none for the other."""
    starts = (64.0, 4096.0, 262144.0)
    rows = [samples(5, start) for start in starts]
    own = []
    for stream in rows:
        observer = case(mode, with_S)
        own.append(list(observer.run(initial(observer, stream[0].t), stream)))
    observer = case(mode, with_S)
    states, usual = [initial(observer, t) for t in starts], 0
    for k in range(ROWS):
        for i, stream in enumerate(rows):
            usual += states[i].is_usual and observer._usual(states[i], stream[k]) is not None
            states[i], estimate = observer.step(states[i], stream[k])
            assert_same(estimate, own[i][k])
    assert usual > 3 * ROWS // 2
    widths = [np.mean([e.upper - e.lower for e in estimates]) for estimates in own]
    assert widths[0] < widths[1] < widths[2]  # the error of time stamps is in the kernel


def test_the_last_time_of_all_floats_has_a_kernel() -> None:
    observer = case("periodic", False)
    parts = observer.kernels.with_sample(PERIOD, 1.0, True).in_parts(1024)
    assert parts.begins == 2.0**1023
    assert parts.ends == np.inf
