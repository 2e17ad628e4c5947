"""Parts of a short step from their series: against balls, and against the doubled flow."""

from __future__ import annotations

import numpy as np
import pytest
from flint import arb, arb_mat, ctx

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import Enclosure
from obsdesign.runtime.set_membership.model import Disturbance, Model
from obsdesign.runtime.set_membership.series import FlowSeries
from obsdesign.runtime.set_membership.short_steps import _TERMS, ShortSteps, StepParts
from obsdesign.runtime.set_membership.tables import Tables

BITS = 200
COUNTS = (1, 2, 4, 8)


@pytest.fixture(autouse=True)
def _precision() -> None:
    ctx.prec = BITS


def model_of(n: int, unit: float = 1.0) -> Model:
    """A plant with zeros in A, two columns of b, of which the second is a known point, and B."""
    rng = np.random.default_rng(n)
    A = unit * rng.standard_normal((n, n)) * ((rng.random((n, n)) < 0.7) | (np.eye(n) > 0))
    b = Disturbance(
        rng.standard_normal((n, 3)), np.array([-1.0, 2.0, -0.5]), np.array([1.0, 2.0, 0.5]),
        np.array([0, 2]),
    )  # fmt: skip
    return Model(np.ones(n), A, np.eye(1, n), rng.standard_normal((n, 1)), b, ())


def short(model: Model, count: int, argument: float = 0.25) -> tuple[ShortSteps, float]:
    """The series, and a step of so many pieces with ||A|| times a piece = argument."""
    flow = FlowSeries(model.A)
    return ShortSteps(model, flow, count), argument * count / flow.norm


def ball(values: Matrix) -> arb_mat:
    return arb_mat([[arb(float(x)) for x in row] for row in values])


def exp_integral(A: Matrix, t: arb) -> tuple[arb_mat, arb_mat]:
    """(e^{A t}, int_0^t e^{A s} ds)."""
    n = len(A)
    block = np.block([[A, np.eye(n)], [np.zeros((n, 2 * n))]])
    whole = (ball(block) * t).exp()
    cells = [[[whole[i, first + j] for j in range(n)] for i in range(n)] for first in (0, n)]
    return arb_mat(cells[0]), arb_mat(cells[1])


def is_inside(X: Enclosure, exact: arb_mat) -> bool:
    return all(
        abs(arb(float(X.mid[i, j])) - exact[i, j]) <= arb(float(X.rad[i, j]))
        for i in range(X.mid.shape[0])
        for j in range(X.mid.shape[1])
    )


def size(X: arb_mat) -> arb_mat:
    return arb_mat([[abs(x) for x in row] for row in X.tolist()])


def is_above(upper: Matrix, exact: arb_mat) -> bool:
    return all(
        arb(float(upper[i, j])) >= exact[i, j]
        for i in range(upper.shape[0])
        for j in range(upper.shape[1])
    )


def hold(model: Model, parts: StepParts, h: arb) -> bool:
    """Are the exact parts of a step of length h inside?"""
    A, b = model.A, model.flow
    W, count = b.matrix[:, b.active], parts.columns.mid.shape[2]
    d, exact_A = h / count, ball(A)
    mz = np.where(np.eye(len(A)) > 0, A, np.abs(A))
    growth, _ = exp_integral(np.abs(A), d / 2)
    _, spread = exp_integral(mz, d)
    grown, pushed = growth * ball(np.abs(W)), spread * ball(np.abs(W))
    Phi, integral = exp_integral(A, h)
    good = is_inside(parts.Phi, Phi)
    good &= is_inside(parts.forced, integral * ball(np.hstack([model.inputs, b.matrix])))
    for i in range(count):
        start, before = exp_integral(A, i * d)
        middle, _ = exp_integral(A, (i + arb(0.5)) * d)
        FM = middle * ball(W)
        exact = [(exp_integral(A, (i + 1) * d)[1] - before) * ball(W), FM, exact_A * FM]
        for k, X in enumerate(exact):
            mid, rad = (v[:, k, i] for v in (parts.columns.mid, parts.columns.rad))
            good &= is_inside(Enclosure(mid, rad), X)
        good &= is_above(parts.sizes[:, 0, i], size(exact_A * exact_A * middle) * grown)
        good &= is_above(parts.sizes[:, 1, i], size(start) * pushed)
    return good


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("n", [1, 3, 6])
def test_the_parts_of_a_short_step_are_enclosed(n: int, count: int) -> None:
    model = model_of(n)
    series, h = short(model, count)
    for error in (0.0, 1e-9 * h):
        parts = series.parts(h, error)
        for end in (arb(h) - arb(error), arb(h), arb(h) + arb(error)):
            assert hold(model, parts, end)
    assert parts.Phi.rad.max() < 1e-7


def test_the_twin_a_length_beyond_the_error_is_not_enclosed() -> None:
    model = model_of(3)
    series, h = short(model, 2)
    assert not hold(model, series.parts(h, 1e-9 * h), arb(h) * (1 + arb(2e-9)))
    assert not hold(model, series.parts(h, 0.0), arb(h) * (1 + arb(1e-13)))


@pytest.mark.parametrize("count", COUNTS)
def test_short_and_doubled_steps_agree(count: int) -> None:
    """Two ways to one table: near each other, and the series no wider."""
    model = model_of(4)
    series, h = short(model, count)
    parts, doubled = series.parts(h, 0.0), Tables(model)._long(h, 0.0, count)
    assert parts.columns.mid.shape == doubled.columns.mid.shape
    for name in ("Phi", "forced", "columns"):
        mine, other = getattr(parts, name), getattr(doubled, name)
        assert (np.abs(mine.mid - other.mid) <= mine.rad + other.rad).all()
        assert mine.rad.max() <= 2.0 * other.rad.max()
    assert (parts.sizes <= doubled.sizes * (1 + 1e-9) + 1e-290).all()
    assert (parts.sizes >= doubled.sizes * (1 - 1e-9) - 1e-290).all()


def test_a_state_that_only_the_terms_left_out_reach_is_not_zero() -> None:
    """A chain longer than the series: the last states are reached by later powers alone."""
    n = _TERMS + 4
    A = 0.5 * np.diag(np.ones(n - 1), 1)
    b = Disturbance(np.eye(n)[:, -1:], np.array([-1.0]), np.array([1.0]), np.array([0]))
    model = Model(np.ones(n), A, np.eye(1, n), np.zeros((n, 0)), b, ())
    parts = ShortSteps(model, FlowSeries(A), 1).parts(0.5, 0.0)
    assert hold(model, parts, arb(0.5))
    assert parts.Phi.rad[0, -1] > 0
    assert (parts.Phi.rad[np.tril_indices(n, -1)] == 0).all()  # no state is reached from these


@pytest.mark.parametrize("unit", [0.0, 1e-120, 1e-30, 1e30, 1e120])
def test_units_of_time_do_not_matter(unit: float) -> None:
    ctx.prec = 1600  # the balls of e^{A t} and of its integral share their errors
    model, plain = model_of(3, unit), model_of(3)
    _, h = short(plain, 2)
    h = h / unit if unit else h
    parts = ShortSteps(model, FlowSeries(model.A), 2).parts(h, 0.0)
    for values in (parts.Phi.rad, parts.forced.rad, parts.columns.rad, parts.sizes):
        assert np.isfinite(values).all()
    assert hold(model, parts, arb(h))
    assert parts.Phi.rad.max() < 1e-13


def test_a_step_too_long_for_the_series_is_unknown() -> None:
    series, h = short(model_of(3), 2, argument=20.0)
    with np.errstate(invalid="ignore"):
        assert not np.isfinite(np.diag(series.parts(h, 0.0).Phi.rad)).any()
