"""Bounds of whole records: they contain the truth and the exact set, and are nearly as narrow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import obsdesign
from lmi.arithmetic.arrays import Matrix
from obsdesign.equations.set_membership.gains import SetMembershipGains
from obsdesign.runtime.base import Sample
from obsdesign.runtime.set_membership.evaluation import upper_bounds
from obsdesign.runtime.set_membership.model import observer_model
from obsdesign.runtime.set_membership.observer import SetMembershipObserver
from obsdesign.runtime.set_membership.stages import Targets, window_of
from obsdesign.runtime.set_membership.tables import Tables
from tests.systems.feasible_set import exact_bounds
from tests.systems.set_membership import ROW_SUMS, Case, bounds_of, cases, observer_of, random_case

CASES = cases()
# the solver of the oracle is exact to this part of a width
_ORACLE = 3e-7
# last boxes of whole records, by linear programs over the whole history; row, lower, upper
EXACT = {
    "degue": (149, [-0.0980775, -0.0111454], [0.00902988, -0.0003915]),
    "rand2_21": (60, [0.529393, -4.85242], [0.861974, -4.69712]),
    "rand3_31": (60, [-0.137588, -1.25907, -0.590371], [0.483788, 0.60648, 1.19735]),
    "rand4_42": (
        60, [-10.485, -1.71336, -10.1033, 0.788209], [-10.1188, -1.17547, -9.77754, 1.26376],
    ),
    "sampled": (40, [0.0441771, -0.0305734, 0.0441771], [0.0617692, 0.0681786, 0.0617692]),
}  # fmt: skip


def _contain(bounds: Matrix, truth: Matrix) -> bool:
    return bool(((bounds[:, 0] <= truth) & (truth <= bounds[:, 1])).all())


@pytest.mark.parametrize("name", sorted(ROW_SUMS))
def test_the_records_are_the_recorded_ones(name: str) -> None:
    record = CASES[name].record()
    first = float(np.sum(np.asarray(record.samples[0].y)))
    assert record.y_sum - first == pytest.approx(ROW_SUMS[name], rel=1e-8)


@pytest.mark.parametrize("name", sorted(EXACT))
def test_last_boxes_are_the_exact_ones(name: str) -> None:
    """A window of 30 stages has lost little; the printed numbers have six digits."""
    case, (row, lower, upper) = CASES[name], EXACT[name]
    record = case.record()
    bounds = bounds_of(observer_of(case, 30), case, record.samples)
    assert _contain(bounds, record.truth)
    width = np.subtract(upper, lower)
    assert (bounds[row, 0] <= lower + 2e-5 * np.abs(lower) + 1e-3 * width).all()
    assert (bounds[row, 1] >= upper - 2e-5 * np.abs(upper) - 1e-3 * width).all()
    assert ((bounds[row, 1] - bounds[row, 0]) <= 1.05 * width).all()


@pytest.mark.parametrize(
    ("name", "window", "mean"), [("degue", 8, 1.005), ("rand2_21", 16, 1.01), ("sampled", 8, 1.02)]
)
def test_bounds_contain_the_exact_set_and_are_near_it(name: str, window: int, mean: float) -> None:
    case = CASES[name]
    samples = case.record().samples[:28]
    bounds = bounds_of(observer_of(case, window), case, samples)[9:]
    exact = exact_bounds(case, samples, 4, 9)
    inside = np.array([each.inside for each in exact])
    outside = np.array([each.outside for each in exact])
    slack = _ORACLE * (bounds[:, 1] - bounds[:, 0])
    assert (bounds[:, 0] <= inside[:, 0] + slack).all()
    assert (bounds[:, 1] >= inside[:, 1] - slack).all()
    ratio = (bounds[:, 1] - bounds[:, 0]) / (outside[:, 1] - outside[:, 0])
    assert ratio.mean() <= mean


@pytest.mark.parametrize("seed", range(6))
def test_extreme_disturbances_stay_inside(seed: int) -> None:
    case = random_case(2 + seed % 3, 100 + seed, 1 + seed % 2, 0.3, 40)
    record = case.record(extreme=True)
    observer = observer_of(case, 8)
    state = observer.init(0.0, lower=case.x0[0], upper=case.x0[1])
    estimates = list(observer.run(state, record.samples))
    assert {e.status for e in estimates} <= {"ok", "missing sample"}
    assert _contain(np.array([[e.lower, e.upper] for e in estimates]), record.truth)


def test_bounds_are_within_prediction_and_strip() -> None:
    case = CASES["rand4_42"]
    samples = case.record().samples
    bounds = bounds_of(observer_of(case, 6), case, samples)
    predicted = bounds_of(
        observer_of(case, 1, steps=1), case, [s._replace(y=None) for s in samples]
    )
    assert (bounds[:, 0] >= predicted[:, 0]).all()
    assert (bounds[:, 1] <= predicted[:, 1]).all()
    degue = CASES["degue"]
    rows = degue.record().samples[:40]
    bounds = bounds_of(observer_of(degue, 2, steps=1), degue, rows)
    y = np.array([float(np.asarray(s.y)[0]) for s in rows])
    assert (bounds[:, 0, 1] >= y - degue.V - 1e-12).all()
    assert (bounds[:, 1, 1] <= y + degue.V + 1e-12).all()


@pytest.mark.parametrize("what", ["V", "b", "start"])
def test_less_information_never_gives_a_smaller_dual_sum(what: str) -> None:
    """For the same multipliers, exactly; those that are proposed differ by little."""
    case = CASES["rand3_31"]
    samples = case.record().samples[:12]
    wide = {
        "V": replace(case, V=1.5 * case.V),
        "b": replace(case, b=case.b * [[1.0], [1.5]]),
        "start": replace(case, x0=1.5 * case.x0),
    }[what]
    values, widths = [], []
    for own in (case, wide):
        observer = observer_of(own, 30)
        state = observer.init(0.0, lower=own.x0[0], upper=own.x0[1])
        for sample in samples:
            state, estimate = observer.step(state, sample)
        model = observer_model(observer.gains)
        size = np.abs(state.box).max(axis=0)
        window = window_of(model, Tables(model), state.start, state.stages, size)
        rng = np.random.default_rng(1)
        mu = rng.normal(size=(50, len(window), 1)) * window.sampled
        targets = Targets(rng.normal(size=(50, 3)), np.full(50, len(window) - 1))
        values.append(upper_bounds(window, targets, mu))
        widths.append(np.subtract(estimate.upper, estimate.lower))
    assert (values[1] >= values[0]).all()
    assert (widths[1] >= widths[0] * (1 - 1e-3)).all()


def test_a_sample_that_is_dropped_narrows_nothing() -> None:
    case = CASES["rand2_21"]
    samples = case.record().samples[:14]
    whole = bounds_of(observer_of(case, 40), case, samples)[-1]
    for k in range(5, 13):
        fewer = [s._replace(y=None) if i == k else s for i, s in enumerate(samples)]
        part = bounds_of(observer_of(case, 40), case, fewer)[-1]
        assert (part[1] - part[0] >= (whole[1] - whole[0]) * (1 - 1e-3)).all()


@pytest.mark.parametrize("name", ["degue", "crane"])
def test_late_time_stamps_cost_their_resolution_alone(name: str) -> None:
    """At 1.7e9 s a stamp is known to 2.4e-7: wider by that, and the truth stays inside."""
    case, start = CASES[name], 1.7e9
    record = case.record()
    observer = observer_of(case, 8)
    state = observer.init(start, lower=case.x0[0], upper=case.x0[1])
    shifted = [s._replace(t=start + s.t) for s in record.samples]
    late = np.array([[e.lower, e.upper] for e in observer.run(state, shifted)])
    here = bounds_of(observer, case, record.samples)
    assert _contain(late, record.truth)
    wider = (late[:, 1] - late[:, 0]) / (here[:, 1] - here[:, 0])
    assert wider.mean() < 1.001
    assert wider.max() < 1.05


def _in_units(case: Case, units: Matrix) -> Case:
    """The same plant with its state in other units."""
    column = units[:, None]
    return replace(
        case, A=case.A * column / units, G=case.G * column / units, C=case.C / units,
        b=case.b * units, c=case.c * units, x0=case.x0 * units,
    )  # fmt: skip


@pytest.mark.parametrize("name", ["crane", "rand3_31"])
def test_units_of_the_states_do_not_matter(name: str) -> None:
    case = CASES[name]
    units = 10.0 ** np.array([6.0, -7.0, 3.0, -2.0])[: case.n]
    samples = case.record().samples[:30]
    own = bounds_of(observer_of(case, 8), case, samples)
    scaled = _in_units(case, units)
    other = bounds_of(observer_of(scaled, 8), scaled, samples) / units
    width = own[:, 1] - own[:, 0]
    assert np.median(np.abs(other - own).max(axis=1) / width) < 2e-3
    assert ((other[:, 1] - other[:, 0]) / width).mean() == pytest.approx(1.0, abs=5e-3)


def test_a_plant_without_any_disturbance_or_noise_is_known_exactly() -> None:
    zero = np.zeros((2, 2))
    case = replace(CASES["degue"], b=zero, c=zero, V=np.zeros(1))
    record = case.record()
    bounds = bounds_of(observer_of(case, 8), case, record.samples)
    size = np.abs(record.truth) + 1.0
    assert (bounds[:, 0] <= record.truth + 1e-12 * size).all()
    assert (bounds[:, 1] >= record.truth - 1e-12 * size).all()
    assert (bounds[5:, 1] - bounds[5:, 0]).max() < 1e-4


def test_a_record_in_pieces_is_the_record() -> None:
    case = CASES["rand2_21"]
    samples = case.record().samples
    observer = observer_of(case, 8)
    state = observer.init(0.0, lower=case.x0[0], upper=case.x0[1])
    t = np.array([s.t for s in samples])
    y = np.array([[np.nan] if s.y is None else s.y for s in samples], dtype=float)
    batch = observer.run_batch(
        t, y, jump=[s.jump for s in samples], lower=case.x0[0], upper=case.x0[1]
    )
    whole = list(observer.run(state, samples))
    assert batch.lower is not None
    assert np.array_equal(batch.lower, [e.lower for e in whole])
    assert batch.status == tuple(e.status for e in whole)


def test_a_step_has_no_effect_but_its_result() -> None:
    case = CASES["degue"]
    observer = observer_of(case, 4)
    state = observer.init(0.0, lower=case.x0[0], upper=case.x0[1])
    samples = [*case.record().samples[:6], Sample(3.0)]
    first = [e.lower for e in observer.run(state, samples)]
    assert np.array_equal(first, [e.lower for e in observer.run(state, samples)])


@pytest.mark.parametrize("h", [1.0, 20.0])
def test_steps_that_are_long_for_the_plant_keep_the_steady_state(h: float) -> None:
    """A fast mode between samples far apart: Taylor terms of its flow overflow, its bound not."""
    case = replace(
        CASES["degue"], A=np.array([[-1000.0, 400.0], [0.0, -1.0]]), b=np.array([[0, 0], [5, 0.1]]),
        times=h * np.arange(1, 8), jumps=(),
    )  # fmt: skip
    record = case.record(extreme=True)
    bounds = bounds_of(observer_of(case, 4), case, record.samples)
    assert _contain(bounds, record.truth)
    # |x2| <= V or what b leaves, |x1| <= (400 |x2| + 5) / 1000 up to the last instants
    least = min(2 * 0.03, 2 * 0.1)
    assert (np.ptp(bounds[2:], axis=1)[:, 1] <= least * (1 + 1e-9)).all()
    assert (np.ptp(bounds[2:], axis=1)[:, 0] <= 1.2 * (0.4 * 2 * 0.1 + 2 * 0.005)).all()


@pytest.mark.parametrize(("y", "status"), [(0.099, "ok"), (0.101, "contradict")])
def test_an_output_of_nothing_is_its_noise(y: float, status: str) -> None:
    body = {
        "flow": {"A": [[0.0]], "disturbance": {"lower": [-0.1], "upper": [0.1]}},
        "output": {"C": [[0.0]], "noise_bound": [0.1]},
        "observer": {"kind": "set_membership", "window": 4},
    }
    plant = obsdesign.Problem.from_dict(body).plant
    observer = SetMembershipObserver(SetMembershipGains.from_plant(plant, window=4, steps=8))
    state = observer.init(0.0, lower=[-1.0], upper=[1.0])
    assert status in observer.step(state, Sample(1.0, y=np.array([y])))[1].status
