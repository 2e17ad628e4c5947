"""Bounds of the error of observer (14) along a record: the paper's numbers, and their law."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import obsdesign
from obsdesign.equations.finite_time.error_integrals import period_integrals
from obsdesign.equations.finite_time.gains import FiniteTimeGains
from obsdesign.pages.error_bounds import error_table
from obsdesign.pages.estimates import DataSource
from obsdesign.pages.report import write_report
from obsdesign.runtime import from_design
from obsdesign.runtime.base import rows_of
from obsdesign.studies.comparison.record import ComparisonRecord
from obsdesign.studies.error_bounds import ErrorBounds, error_bounds
from tests.papers.test_mazenc import A, C, motion, problem

ROWS = 601
DESIGN = obsdesign.design(problem("approximate"))


def bounds_of(design: Any, t: Any, y: Any, u: Any, x: Any) -> ErrorBounds | None:
    """What the report shows of a run of the design."""
    record = ComparisonRecord(tuple(rows_of(t, y, u=u)), x)
    batch = from_design(design).run_batch(t, y, u)
    return error_bounds(design, record, batch.x, list(batch.status))


@pytest.mark.parametrize(
    ("change", "first", "low", "high"),
    [(0.0, 16630.732, 16274.77, 16802.80), (None, 446.15131, 70.5477, 1035.268)],
)
def test_the_numbers_of_the_paper(
    change: float | None, first: float, low: float, high: float
) -> None:
    t, d, x = motion(0.05, ROWS, change)
    bounds = bounds_of(DESIGN, t, x @ C.T, d[:, None], x)
    assert bounds is not None
    theorem = bounds.series["Theorem 1"]
    assert bounds.t[0] == 6.0
    assert len(bounds.t) == ROWS - 120
    assert theorem[0] == pytest.approx(first, rel=1e-6)
    assert (theorem.min(), theorem.max()) == (
        pytest.approx(low, rel=1e-6),
        pytest.approx(high, rel=1e-6),
    )
    titles, lines = error_table(bounds)
    assert titles == ["|x̂ − x|", "at t = 6", "least", "largest"]
    assert [line[0] for line in lines] == list(bounds.series)
    assert lines[0][1] == f"{theorem[0]:.6g}"


def finer(seed: int, rows: int, parts: int) -> tuple[Any, Any, Any, Any]:
    """A run with rows between the samples, where the known input changes too."""
    rng = np.random.default_rng(seed)
    t = np.round(0.05 / parts * np.arange(rows), 10)
    u = np.where(rng.random((rows, 1)) < 0.1, rng.normal(size=(rows, 1)), 0.0).cumsum(axis=0)
    block = np.zeros((3, 3))
    block[:2, :2], block[0, 2] = A, 1.0
    step, x = expm(block * 0.05 / parts)[:2], [rng.normal(size=2)]
    for held in u[:-1]:
        x.append(step @ np.append(x[-1], held))
    y = np.where(np.arange(rows) % parts, np.nan, (np.array(x) @ C.T)[:, 0])[:, None]
    return t, y, u, np.array(x)


@given(seed=st.integers(0, 10**6), parts=st.sampled_from([1, 2, 3]))
@settings(max_examples=4, deadline=None)
def test_no_undisturbed_error_exceeds_its_bounds(seed: int, parts: int) -> None:
    t, y, u, x = finer(seed, 140 * parts, parts)
    bounds = bounds_of(DESIGN, t, y, u, x)
    assert bounds is not None
    error = bounds.series["true error"]
    assert set(bounds.series) == {
        "Theorem 1", "Theorem 1, tighter Lemma 2", "error identity", "true error",
    }  # fmt: skip
    assert all((values >= error).all() for values in bounds.series.values())
    assert (bounds.series["Theorem 1, tighter Lemma 2"] <= bounds.series["Theorem 1"]).all()


def test_a_measurement_that_is_wrong_leaves_the_identity() -> None:
    """The twin: the bounds are of undisturbed records, and the identity is not empty."""
    t, d, x = motion(0.05, 200, None)
    bounds = bounds_of(DESIGN, t, x @ C.T + 0.3, d[:, None], x)
    assert bounds is not None
    assert (bounds.series["true error"] > bounds.series["error identity"]).all()


def test_windows_with_a_missing_sample_are_left_out() -> None:
    t, d, x = motion(0.05, 400, None)
    y = x @ C.T
    y[150] = np.nan
    bounds = bounds_of(DESIGN, t, y, d[:, None], x)
    assert bounds is not None
    np.testing.assert_allclose(bounds.t, [*t[120:151], *t[271:]])


def test_without_the_truth_theorem_1_alone_is_shown() -> None:
    t, d, x = motion(0.05, 200, 0.0)
    bounds = bounds_of(DESIGN, t, x @ C.T, d[:, None], None)
    assert bounds is not None
    assert set(bounds.series) == {"Theorem 1", "Theorem 1, tighter Lemma 2"}


@pytest.mark.parametrize(
    "other", [problem("exact"), problem("approximate", half_sample_correction=True)]
)
def test_no_bounds_of_another_observer(other: Any) -> None:
    t, d, x = motion(0.05, 200, 0.0)
    assert bounds_of(obsdesign.design(other), t, x @ C.T, d[:, None], x) is None


@pytest.mark.parametrize(("period", "names"), [(0.1, 1), (0.2, 0)])
def test_only_proved_constants_are_used(period: float, names: int) -> None:
    """(13) is false at 0.1, with a tighter Lemma 2 at 0.2 too."""
    t, d, x = motion(period, 150, 0.0)
    design = obsdesign.design(problem("approximate", period=period))
    bounds = bounds_of(design, t, x @ C.T, d[:, None], x)
    assert bounds is not None
    assert sum(name.startswith("Theorem 1") for name in bounds.series) == names
    assert {"error identity", "true error"} < {*bounds.series, ""}


def test_integrals_of_a_period_by_another_method() -> None:
    """Three states, two outputs, an input that jumps inside the period: an ODE by DOP853."""
    rng = np.random.default_rng(3)
    n, p, nu = 3, 2, 0.7
    X, Y, gain = rng.normal(size=(n, n)), rng.normal(size=(p, n)), rng.normal(size=(n, p))
    body = {
        "flow": {"A": X, "B": np.eye(n)},
        "output": {"C": Y, "measured": "periodic", "period": nu},
        "observer": {"kind": "finite_time", "method": "approximate", "window": 4 * nu,
                     "gains": {"L": gain}},
    }  # fmt: skip
    design = obsdesign.design(obsdesign.Problem(**body), allow_undecided=True)
    typed = FiniteTimeGains.from_document(design.gains)
    y = rng.normal(size=p)
    inputs = [(0.0, rng.normal(size=n)), (0.31, rng.normal(size=n))]
    F, LC = X + gain @ Y, gain @ Y

    def right(s: float, z: Any) -> Any:
        delta = inputs[int(s >= 0.31)][1]
        q, onwards = z[:n], z[n : 2 * n]
        value = delta - LC @ q - gain @ y
        size = np.linalg.norm(value)
        back = expm(-X * s) @ delta
        return np.concatenate([back, F @ onwards + value, [size]])

    z = np.zeros(2 * n + 1)
    for a, b in ((0.0, 0.31), (0.31, nu)):
        inside = (a + 1e-15, b - 1e-13)
        z = solve_ivp(right, inside, z, method="DOP853", rtol=1e-11, atol=1e-13).y[:, -1]
    integrals = period_integrals(typed, y, inputs)
    np.testing.assert_allclose(integrals.forced, z[:n], rtol=1e-8)
    np.testing.assert_allclose(integrals.onwards, z[n : 2 * n], rtol=1e-8)
    # a norm has a kink where it is zero: Gauss's rule is less exact there
    assert integrals.size == pytest.approx(z[-1], rel=1e-5)


def test_the_report_shows_them_first_as_numbers(tmp_path: Any) -> None:
    t, d, x = motion(0.05, 200, None)
    data, page = tmp_path / "data.csv", tmp_path / "report.html"
    rows = zip(t, x @ C.T, d, x, strict=True)
    lines = [",".join(map(repr, map(float, [a, *y, u, *z]))) for a, y, u, z in rows]
    data.write_text("\n".join(["t,y1,u1,x1,x2", *lines]) + "\n", "utf-8")
    for name, design in (("14", DESIGN), ("exact", obsdesign.design(problem("exact")))):
        path = tmp_path / f"{name}.json"
        design.save(path)
        write_report(str(path), str(page), DataSource(str(data)))
        html = page.read_text("utf-8")
        assert ("Bounds of the error along the record" in html) == (name == "14")
        assert ("<td>446.151</td>" in html) == (name == "14")
