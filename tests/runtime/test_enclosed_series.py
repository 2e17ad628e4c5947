"""Series over a cell of lengths enclose exponentials and their products in many digits."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import exact, exp_times, middle, precision
from lmi.arithmetic.enclosure import Enclosure
from obsdesign.runtime.enclosed_series import REACH, Cell, Flow, Series
from obsdesign.runtime.interval.cell_kernels import shortened
from obsdesign.runtime.length_cells import LengthCells

PLACES = (-1.0, -0.3, 0.0, 0.7, 1.0, -1.06, 1.06)


def flow(rng: np.random.Generator) -> Flow:
    """1 to 6 states in any units, some entries zero."""
    n = int(rng.integers(1, 7))
    N = rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.8)
    units = np.exp2(rng.integers(-20, 21, n).astype(float))
    return Flow(Enclosure.exactly(units[:, None] * N / units * 2.0 ** float(rng.integers(-30, 31))))


def cell(rng: np.random.Generator, own: Flow) -> Cell:
    norm = max(own.norm, 1e-9)
    cells = LengthCells(norm * REACH * 1.001)
    place = cells.place(math.exp(rng.uniform(-8, 3)) / norm)
    assert place is not None
    return Cell(*cells.ends(place[0]))


def exponential(N: Matrix, h: float) -> Matrix:
    with precision(300):
        return middle(exp_times(exact(N), h))


def misses(got: Enclosure, true: Matrix, rounding: Matrix) -> float:
    """Largest error in parts of the radius; rounding: of the truth as it is compared."""
    return float((np.abs(got.mid - true) / (got.rad + rounding + 1e-300)).max())


def test_exponentials_and_products_are_enclosed() -> None:
    largest, least = 0.0, math.inf
    for seed in range(25):
        rng = np.random.default_rng(seed)
        own = flow(rng)
        N, at = own.N.mid, cell(rng, own)
        series, pieces = own.exponential(at), own.exponentials(at, 16)
        twice = series.times(series)
        for s in PLACES:
            h = at.middle + s * at.half
            rounding = 3e-16 * h * (np.abs(N) @ exponential(np.abs(N), h)) + 1e-16 * exponential(
                np.abs(N), h
            )
            of_one = series.enclosure(s)
            largest = max(largest, misses(of_one, exponential(N, h), rounding))
            largest = max(largest, misses(twice.enclosure(s), exponential(N, 2 * h),
                                          2 * rounding @ exponential(np.abs(N), h)))  # fmt: skip
            for j in (0, 5, 15):
                part = Enclosure(pieces.enclosure(s).mid[j], pieces.enclosure(s).rad[j])
                largest = max(largest, misses(part, exponential(N, h * j / 16), rounding))
            size = exponential(np.abs(N), h)
            least = min(least, float((size[size > 0] / of_one.rad[size > 0]).min()))
    assert largest <= 1.0
    assert least > 1e10  # radii are rounding, not slack


def test_one_coefficient_less_is_outside_the_radius() -> None:
    own = flow(np.random.default_rng(3))
    at = cell(np.random.default_rng(3), own)
    series = own.exponential(at)
    mid = series.mid.copy()
    mid[4] = 0.0
    h = at.middle + at.half
    true = exponential(own.N.mid, h)
    assert misses(Series(mid, series.rad).enclosure(1.0), true, 1e-13 * np.abs(true)) > 1.0


@pytest.mark.parametrize("seed", range(5))
def test_signs_hold_all_over_the_cell(seed: int) -> None:
    rng = np.random.default_rng(seed)
    A = np.array([[-0.2, 3.0, 0.0], [-3.0, -0.2, 1.0], [0.0, 0.0, -1.0]])
    at = Cell(rng.uniform(0.2, 3.0), 0.125)
    series = Flow(Enclosure.exactly(A)).exponential(at)
    signs = series.signs()
    values = np.sign([series.enclosure(s).mid for s in np.linspace(-1.06, 1.06, 41)])
    assert (np.isnan(signs) | (values == signs)).all()
    changes = (values != values[0]).any(axis=0)
    assert np.isnan(signs[changes]).all()
    assert np.isnan(signs).sum() <= changes.sum() + 1


def test_what_is_at_most_a_place_away_is_included() -> None:
    own = Flow(Enclosure.exactly([[-1.0, 2.0], [-2.0, -1.0]]))
    at, reach = Cell(0.4, 0.125), 0.01
    series = own.exponential(at)
    for s in np.linspace(-1, 1, 9):
        got = series.enclosure(float(s), reach)
        for off in (-reach, reach):
            true = exponential(own.N.mid, at.middle + (s + off) * at.half)
            assert misses(got, true, 1e-15 * np.ones((2, 2))) <= 1.0
        assert got.rad.max() < 3 * reach * at.half * 3


def test_short_polynomials_are_close_by_what_they_say() -> None:
    rng = np.random.default_rng(2)
    mid = rng.normal(size=(17, 40)) * rng.uniform(0.05, 0.5, 40) ** np.arange(17)[:, None]
    mid /= np.array([float(math.factorial(k)) for k in range(17)])[:, None]
    mid[3:, :5] = 0.0
    short, lost, spread = shortened(mid)
    assert len(short) < 17
    for s in np.linspace(-1, 1, 33):
        x = 0.5 * (s + 1)
        gap = np.abs(x ** np.arange(len(short)) @ short - s ** np.arange(17) @ mid)
        assert np.all(gap <= lost + 20 * 2.0**-53 * spread)
    assert np.all(lost <= 1e-12 * np.abs(mid).sum(axis=0) + 1e-190)
