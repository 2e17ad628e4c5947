"""Simulated records are exact solutions, inside every bound, with admissible jumps."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from obsdesign.column_names import BOUNDED, JUMP, SIGNALS, TIME, numbered, pairs
from obsdesign.data.layout import Layout
from obsdesign.data.simulation import Simulation, simulate
from obsdesign.equations.gains import PlantGains
from obsdesign.errors import InputError
from obsdesign.problem.flow import Flow
from obsdesign.problem.output import Output
from obsdesign.problem.plant import Jump, Plant

ROOT = Path(__file__).parents[3]
ODE_TOLERANCE = 1e-8  # of the integrator that checks us; ours is exact to rounding


def plant(**changes: object) -> Plant:
    A = np.array([[-0.4, 2.0], [-2.0, -0.1]])
    jump = {"dwell_time": (0.5, 1.5), "lower": [-0.3, 0.1], "upper": [0.3, 0.2]} | changes
    return Plant(
        Flow(A, B=np.array([[1.0], [0.5]]), lower=[-0.2, 0.5], upper=[0.2, 0.9]),
        Jump(np.array([[0.5, 1.0], [0.0, 0.8]]), **jump),
        Output(np.array([[1.0, 0.0]]), noise_bound=[0.05]),
    )


@pytest.mark.parametrize("disturbance", ["zero", "extreme", "sine"])
def test_the_flow_solves_the_differential_equation(disturbance: str) -> None:
    flow = plant().flow
    still = Plant(Flow(flow.A, B=flow.B, lower=flow.lower, upper=flow.upper), None, plant().output)
    record = simulate(still, until=3.0, step=0.1, disturbance=disturbance, initial=[1, -1],
                      rng=np.random.default_rng(7))  # fmt: skip
    again = simulate(still, until=3.0, step=0.05, disturbance=disturbance, initial=[1, -1],
                     rng=np.random.default_rng(7))  # fmt: skip
    assert record.t[-1] == again.t[-1] == 3.0
    u, x = record.block("u"), record.block("x")
    from obsdesign.data.simulation.signals import signals

    source = signals(still, disturbance, len(record.t), np.random.default_rng(7))

    def rate(t: float, state: np.ndarray) -> np.ndarray:
        k = min(int(t / 0.1 + 1e-9), len(u) - 1)
        return flow.A @ state + flow.B @ u[k] + source.flow.value(min(k + 1, len(u) - 1), t)

    state = np.array([1.0, -1.0])
    for k in range(1, len(record.t)):
        span = (record.t[k - 1], record.t[k])
        state = solve_ivp(rate, span, state, rtol=1e-11, atol=1e-12, max_step=0.02).y[:, -1]
        np.testing.assert_allclose(x[k], state, atol=ODE_TOLERANCE)


@pytest.mark.parametrize("disturbance", ["zero", "extreme", "random", "sine"])
def test_everything_stays_inside_its_bounds(disturbance: str) -> None:
    subject = plant()
    record = simulate(subject, until=30.0, step=0.05, disturbance=disturbance,
                      rng=np.random.default_rng(2))  # fmt: skip
    x, t, u = record.block("x"), record.t, record.block("u")
    jump = record.columns["jump"] == 1
    spacing = np.diff(t[jump])
    assert spacing.min() > 0.5 - 1e-9
    assert spacing.max() < 1.5 + 1e-9
    from lmi.arithmetic.exponential import flow_integrals

    for k in range(1, len(t)):
        Phi, Gamma = flow_integrals(subject.flow.A, t[k] - t[k - 1])
        before = x[k] if not jump[k] else None
        if before is None:
            continue
        # the mean of b over the step lies in its bounds, as every b does (sine: to curvature)
        b = np.linalg.solve(Gamma, before - Phi @ x[k - 1]) - subject.flow.B @ u[k - 1]
        slack = 1e-2 if disturbance == "sine" else 1e-9
        assert np.all(b >= subject.flow.lower - slack)
        assert np.all(b <= subject.flow.upper + slack)
    noise = record.block("y")[~jump, 0] - x[~jump, 0]
    assert np.abs(noise).max() <= 0.05 + 1e-12
    if disturbance == "zero":
        assert np.abs(noise).max() < 1e-12


def test_a_jump_is_the_map_of_the_plant() -> None:
    subject = plant(lower=[0.0, 0.0], upper=[0.0, 0.0], E=np.array([[1.0], [2.0]]))
    record = simulate(subject, until=5.0, step=0.1, disturbance="zero", dwell=0.7)
    jumps = np.flatnonzero(record.columns["jump"])
    np.testing.assert_allclose(record.t[jumps], 0.7 * np.arange(1, 8), atol=1e-12)
    from lmi.arithmetic.exponential import flow_integrals

    x, w, u = (record.block(letter) for letter in "xwu")
    middle = (subject.flow.lower + subject.flow.upper) / 2
    for k in jumps:
        Phi, Gamma = flow_integrals(subject.flow.A, record.t[k] - record.t[k - 1])
        before = Phi @ x[k - 1] + Gamma @ (subject.flow.B @ u[k - 1] + middle)
        np.testing.assert_allclose(
            x[k], subject.jump.G @ before + subject.jump.E @ w[k], rtol=1e-10
        )
        np.testing.assert_allclose(record.block("y")[k], before[:1], rtol=1e-10)


def test_measurements_come_when_they_are_taken() -> None:
    base = plant()
    periodic = Plant(base.flow, base.jump, Output(base.output.C, measured="periodic", period=0.2))
    record = simulate(periodic, until=4.0, dwell=0.5)
    measured = ~np.isnan(record.block("y")[:, 0])
    on_grid = np.abs(record.t / 0.2 - np.round(record.t / 0.2)) < 1e-9
    assert np.array_equal(measured, on_grid)
    at_jumps = Plant(base.flow, base.jump, Output(base.output.C, measured="at_jumps"))
    record = simulate(at_jumps, until=4.0, dwell=0.5)
    np.testing.assert_allclose(record.t, 0.5 * np.arange(1, 9), atol=1e-12)
    assert np.all(record.columns["jump"] == 1)
    blind = Plant(base.flow, base.jump, Output(base.output.C, jump_measurement="none"))
    record = simulate(blind, until=4.0, step=0.1, dwell=0.5)
    assert np.array_equal(np.isnan(record.block("y")[:, 0]), record.columns["jump"] == 1)


def test_impulses_of_unknown_weight_come_unannounced() -> None:
    base = plant()
    hidden = Plant(base.flow, Jump(H=np.array([[1.0], [0.0]]), dwell_time=(1.0, 2.0)), base.output)
    record: Simulation = simulate(hidden, until=10.0)
    assert "jump" not in record.columns
    assert record.events.shape[1] == 2
    assert len(record.events) >= 5


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ({"dwell": "shortest"}, "dwell = shortest needs jump.dwell_time[0] > 0; it is 0. Give a number."),
        ({"dwell": "long"}, "dwell must be shortest, random or a positive number; got 'long'."),
        ({"dwell": -1.0}, "dwell must be a positive finite number; got -1.0."),
        ({"step": math.nan}, "step must be a positive finite number; got nan."),
        ({"initial": [1.0]}, "initial must have 2 finite entries, one per state; got [1.0]."),
        ({"disturbance": "loud"}, "disturbance must be one of zero, extreme, random, sine; got 'loud'."),
        ({"step": 1e-9}, "step = 1e-09 makes 7.5e+09 rows until 7.5; 1e+07 is the limit."),
        ({"until": 1e149}, "until = 1e+149 makes more than 100000 jumps; shorten it."),
        ({"until": 1e300}, "until must be 0 or of magnitude 1e-150 to 1e+150; got 1e+300. Choose other units."),
        ({"dwell": 1e-9, "until": 7.5}, "dwell = 1e-09 makes 7.5e+09 jumps until 7.5; 100000 is the limit."),
    ],
)  # fmt: skip
def test_options_that_make_no_sense(options: dict, line: str) -> None:
    with pytest.raises(InputError) as error:
        simulate(plant(dwell_time=(0.0, 1.5)), **options)
    assert str(error.value) == line


def test_a_state_that_jumps_with_its_impulses_announces_them() -> None:
    base = plant()
    jump = Jump(base.jump.G, H=np.array([[1.0], [0.0]]), dwell_time=(1.0, 2.0))
    record = simulate(Plant(base.flow, jump, base.output), until=10.0)
    assert record.columns["jump"].sum() == len(record.events)


def test_noise_with_a_bound_keeps_it_whatever_else_is_added() -> None:
    flow = Flow(np.array([[-1.0]]))
    noise = {"noise_bound": [0.1], "noise_std": [0.2], "noise_cv": [0.5]}
    for kind in ("random", "extreme", "sine"):
        record = simulate(Plant(flow, None, Output(np.array([[1.0]]), **noise)), disturbance=kind)
        off = np.abs(record.block("y") - record.block("x")).max()
        assert 0.09 < off <= 0.1 + 1e-15
    free = Plant(flow, None, Output(np.array([[1.0]]), noise_std=[0.2]))
    record = simulate(free, disturbance="random")
    assert np.abs(record.block("y") - record.block("x")).max() > 0.3


def test_rows_between_samples_take_none_away() -> None:
    output = Output(np.array([[1.0]]), measured="periodic", period=2.0)
    record = simulate(Plant(Flow(np.array([[-0.1]])), None, output), until=12.0, step=1.5)
    np.testing.assert_array_equal(record.t, [0, 1.5, 2, 3, 4, 4.5, 6, 7.5, 8, 9, 10, 10.5, 12])
    measured = np.isfinite(record.block("y")[:, 0])
    np.testing.assert_array_equal(record.t[measured], np.arange(0, 13, 2))


@pytest.mark.parametrize("pace", [1e-6, 1.0, 1e5])
def test_a_simulation_lasts_as_long_as_its_plant_takes(pace: float) -> None:
    A = pace * np.array([[-1.0, 0.0], [0.0, -20.0]])
    continuous = simulate(Plant(Flow(A), None, Output(np.array([[1.0, 1.0]]))))
    assert continuous.t[-1] * pace == pytest.approx(10, rel=0.05)
    output = Output(np.array([[1.0, 1.0]]), measured="periodic", period=0.1 / pace)
    assert len(simulate(Plant(Flow(A), None, output)).t) == 201
    grows = simulate(Plant(Flow(-A), None, Output(np.array([[1.0, 1.0]]))))
    assert np.abs(grows.block("x")).max() < 1e3


def test_a_record_has_the_columns_that_observers_read_and_the_truth() -> None:
    """One list of names: what is written, and what is read."""
    jumps = plant(E=np.ones((2, 2)))
    for given in (jumps, Plant(jumps.flow, None, jumps.output)):
        columns = tuple(simulate(given, until=3.0, step=0.1).columns)
        read = Layout.from_reads(PlantGains.from_plant(given).columns).columns()
        assert columns == (*read, *numbered("x", 2))
        assert ("jump" in read, "w2" in read) == (given is jumps, given is jumps)


def test_the_docs_name_every_column_of_data() -> None:
    page = (ROOT / "docs" / "problem_file.md").read_text("utf-8")
    section = page.split("## Data file (CSV)")[1].split("\n## ")[0]
    names = [TIME, JUMP, *(f"{letter}1" for letter in (*SIGNALS, "x"))]
    names += pairs(f"{letter}1" for letter in BOUNDED)[::2]
    assert [name for name in names if f"`{name}" not in section] == []
