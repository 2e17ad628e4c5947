"""What the certified bounds rest on: enclosures and rounding, against ball arithmetic."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from flint import arb, arb_mat, ctx

from lmi.arithmetic.arrays import Matrix
from obsdesign.runtime.base import Sample
from obsdesign.runtime.set_membership.evaluation import support, upper_bounds
from obsdesign.runtime.set_membership.model import observer_model
from obsdesign.runtime.set_membership.series import FlowSeries
from obsdesign.runtime.set_membership.stages import Targets, Window, sampled_strip, window_of
from obsdesign.runtime.set_membership.state import SetMembershipState
from obsdesign.runtime.set_membership.tables import Tables
from tests.systems.feasible_set import Program
from tests.systems.set_membership import Case, cases, observer_of, random_case, window_after

BITS = 170  # more than 50 decimal digits


@pytest.fixture(autouse=True)
def _precision() -> None:
    ctx.prec = BITS


def _ball(values: Matrix) -> arb_mat:
    return arb_mat([[arb(float(x)) for x in row] for row in values])


def _exp_integral(A: Matrix, t: arb) -> tuple[arb_mat, arb_mat]:
    n = len(A)
    block = np.zeros((2 * n, 2 * n))
    block[:n, :n], block[:n, n:] = A, np.eye(n)
    whole = (_ball(block) * t).exp()
    parts = [
        arb_mat([[whole[i, first + j] for j in range(n)] for i in range(n)]) for first in (0, n)
    ]
    return parts[0], parts[1]


def _holds(mid: Matrix, rad: Matrix, exact: arb_mat) -> bool:
    return all(
        abs(arb(float(mid[i, j])) - exact[i, j]) <= arb(float(rad[i, j]))
        for i in range(mid.shape[0])
        for j in range(mid.shape[1])
    )


@pytest.mark.parametrize("t", [1e-6, 0.013, 0.11, 0.7, 4.0, 30.0])
@pytest.mark.parametrize("name", ["crane", "degue", "rand6_61"])
def test_the_series_encloses_the_exponential_and_its_integral(name: str, t: float) -> None:
    A = cases()[name].A
    error = 2.0**-24 * t
    Phi, integral = FlowSeries(A).flow(t, error)
    for end in (arb(t) - arb(error), arb(t), arb(t) + arb(error)):
        exact = _exp_integral(A, end)
        assert _holds(Phi.mid, Phi.rad, exact[0])
        assert _holds(integral.mid, integral.rad, exact[1])
    assert (Phi.rad < 1e-5 * np.exp(min(np.abs(A).sum(axis=0).max() * t, 700.0))).all()


def test_growth_is_above_the_exponential_of_the_size() -> None:
    A = cases()["crane"].A
    for t in (0.01, 0.3, 2.0):
        exact, _ = _exp_integral(np.abs(A), arb(t))
        upper = FlowSeries(A).growth(t)
        assert all(exact[i, j] <= arb(float(upper[i, j])) for i in range(4) for j in range(4))
        longer, _ = _exp_integral(np.abs(A), arb(t * (1 + 1 / 256)))
        assert upper.max() < 1.001 * float(max(longer.entries(), key=float))


def _one_step(case: Case, h: float) -> tuple[Window, Matrix]:
    """A window of one step, and the scales of its state."""
    observer = observer_of(case, 4)
    state = observer.init(0.0, lower=case.x0[0], upper=case.x0[1])
    after, _ = observer.step(state, Sample(h))
    model = observer_model(observer.gains)
    return window_of(model, Tables(model), state.box, after.stages, None), model.scales


@pytest.mark.parametrize("h", [0.06, 0.11, 0.24, 1.5])
def test_generators_and_their_box_contain_what_the_disturbance_adds(h: float) -> None:
    """What the search for multipliers works with is no narrower than the certified support."""
    case = cases()["crane"]
    window, scales = _one_step(case, h)
    (table,), radius = window.tables, window.radius[0, 0, 0]
    rng = np.random.default_rng(1)
    rows = rng.normal(size=(40, 4)) * np.exp(rng.normal(size=(40, 4))) / scales
    along = np.abs(rows @ table.generators) @ radius[table.units]
    value = along + np.abs(rows) @ table.remainder @ radius
    pieces = 64 * table.pieces
    step, integral = _exp_integral(case.A, arb(h) / pieces)
    for row, bound in zip(rows * scales, value, strict=True):
        p, below = _ball(row[None]), 0.0
        for _ in range(pieces):
            pulled = p * integral
            for j in np.flatnonzero(case.b[1]):
                below += abs(float(pulled[0, int(j)])) * float(case.b[1][j])
            p = p * step
        assert below * (1 - 1e-9) <= bound <= 2.0 * below + 1e-3


@pytest.mark.parametrize("h", [0.06, 0.11, 0.24, 1.5])
def test_the_support_function_is_never_below_the_integral_and_near_it(h: float) -> None:
    """int |p' e^{A s} e_j| b_j ds is at least the sum over pieces of the integrals' sizes."""
    case = cases()["crane"]
    window, scales = _one_step(case, h)
    rng = np.random.default_rng(1)
    rows = rng.normal(size=(40, 4)) * np.exp(rng.normal(size=(40, 4)))
    value = support(window, (rows / scales)[None])
    pieces = 256
    step, integral = _exp_integral(case.A, arb(h) / pieces)
    for row, bound in zip(rows, value, strict=True):
        p, below = _ball(row[None]), arb(0)
        for _ in range(pieces):
            pulled = p * integral
            for j in np.flatnonzero(case.b[1]):
                below += abs(pulled[0, int(j)]) * arb(float(case.b[1][j]))
            p = p * step
        assert arb(float(bound)) >= below
        assert float(bound) <= (1.01 if h < 1 else 1.05) * float(below)


def _exact_value(
    case: Case, start: Matrix, state: SetMembershipState, mu: Matrix, row: Matrix
) -> arb:
    """The dual sum in balls, in the plant's units, for a plant without disturbances."""
    p, total = _ball(row[None]), arb(0)
    times = [0.0, *(stage.t for stage in state.stages)]
    for k in range(len(state.stages) - 1, -1, -1):
        stage = state.stages[k]
        if stage.strip is not None:
            ends = np.where(mu[k] > 0, stage.strip[1], stage.strip[0])
            total += (_ball(mu[k][None]) * _ball(ends[:, None]))[0, 0]
            p = p - _ball(mu[k][None]) * _ball(case.C)
        if stage.jump:
            total += (p * _ball(case.c[0][:, None]))[0, 0]
            p = p * _ball(case.G)
        else:
            Phi, integral = _exp_integral(case.A, arb(times[k + 1]) - arb(times[k]))
            total += (p * integral * _ball(case.b[0][:, None]))[0, 0]
            p = p * Phi
    for i, (low, high) in enumerate(start.T):
        total += p[0, i] * arb(float(high if p[0, i] > 0 else low))
    return total


def test_many_stages_of_one_state_have_room_for_every_rounding() -> None:
    """Of an output that hardly shows it, so that the sums of the strips alone are rounded."""
    plant = Case(
        "one", np.array([[-0.1]]), np.array([[1e-6]]), np.eye(1), np.array([[-1.0], [1.0]]),
        np.array([[0.1], [0.0]]), np.zeros((2, 1)), np.full(1, 1.0), (0.05, 0.15, 60),
    )  # fmt: skip
    window, state, scales = window_after(plant, 38)
    assert len(window) > 35
    rng = np.random.default_rng(3)
    rows = rng.normal(size=(24, 1))
    mu = rng.normal(size=(24, len(window), 1)) * window.sampled
    upper = upper_bounds(window, Targets(rows / scales, np.full(24, len(window) - 1)), mu)
    for own, row, bound in zip(mu, rows, upper, strict=True):
        assert arb(float(bound)) >= _exact_value(plant, state.start / scales, state, own, row)


@pytest.mark.parametrize("name", ["degue", "rand4_42", "ball"])
def test_rounding_never_lowers_a_bound_and_hardly_raises_it(name: str) -> None:
    """Without disturbances the dual sum is linear: what is added covers rounding alone."""
    case = cases()[name]
    n = case.n
    case = replace(case, b=case.b * [[1.0], [0.0]], c=case.c * [[1.0], [0.0]], missing=0.0)
    window, state, scales = window_after(case, 14)
    rng = np.random.default_rng(3)
    B = 24
    rows = rng.normal(size=(B, n)) * np.exp(2 * rng.normal(size=(B, n)))
    shape = (B, len(window), len(case.C))
    mu = rng.normal(size=shape) * np.exp(rng.normal(size=shape)) * window.sampled
    targets = Targets(rows / scales, np.full(B, len(window) - 1))
    upper = upper_bounds(window, targets, mu)
    for own, row, bound in zip(mu, rows, upper, strict=True):
        exact = _exact_value(case, state.start / scales, state, own, row)
        assert arb(float(bound)) >= exact
        size = np.abs(own).sum() + np.abs(row).sum()
        assert float(bound) - float(exact) <= 1e-11 * size * max(np.abs(state.box).max(), 1.0)


def test_no_multipliers_give_less_than_the_linear_program() -> None:
    """Any multipliers give a bound: at least the largest value of l'x over inner disturbances."""
    for case in (cases()["degue"], random_case(3, 31, 1, 0.2)):
        program = Program(case, 3)
        for sample in case.record().samples[:12]:
            program.add(sample)
        inside = program.bounds().inside
        assert inside is not None
        window, _, scales = window_after(case, 12)
        rng, n = np.random.default_rng(5), case.n
        rows = np.repeat(np.vstack([-np.eye(n), np.eye(n)]), 200, axis=0)
        shape = (len(rows), len(window), len(case.C))
        mu = rng.normal(size=shape) * np.exp(3 * rng.normal(size=shape)) * window.sampled
        targets = Targets(rows / scales, np.full(len(rows), len(window) - 1))
        upper = upper_bounds(window, targets, mu).reshape(2, n, 200).min(axis=2)
        assert (-upper[0] <= inside[0]).all()
        assert (upper[1] >= inside[1]).all()


@pytest.mark.parametrize("y", [0.1, -3e5, 1e-12])
def test_strips_contain_every_exact_difference(y: float) -> None:
    rng = np.random.default_rng(2)
    for _ in range(200):
        ends = np.sort(rng.normal(size=2) * 10.0 ** rng.integers(-12, 6))
        strip = sampled_strip(np.array([y]), ends[:1], ends[1:])
        assert Fraction(strip[0, 0]) <= Fraction(y) - Fraction(ends[1])
        assert Fraction(strip[1, 0]) >= Fraction(y) - Fraction(ends[0])
