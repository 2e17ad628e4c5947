"""Disturbances b = Bw w, c = W w of the interval observer: each coordinate of them is used."""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.document import Design
from obsdesign.equations.interval.width import WidthSystem
from obsdesign.runtime import Sample
from obsdesign.runtime.bounds import Bounds
from obsdesign.runtime.interval.observer import IntervalObserver
from tests.systems.set_membership import flow_integral

# (A, directions, width of the box of all states that the disturbance reaches)
DIRECTIONS = [
    ([[-0.5, 0.2], [0.3, -0.4]], [[1], [-1]], [2.857143, 2.857143]),
    ([[0, 1], [-2, -3]], [[1], [-1]], [2.0, 2.0]),
    (
        [[-1, 1, 0], [0, -2, 1], [0, 0, -3]],
        [[1, 0], [-1, 1], [0, -1]],
        [2.333333, 1.666667, 0.666667],
    ),
]
JUMPS: dict[str, Any] = {
    "G": [[0.5, 0.1], [0, 0.8]],
    "dwell_time": [0.5, 2],
    "disturbance_matrix": [[1], [0.5]],
    "disturbance": {"lower": [-1], "upper": [2]},
}


def problem(A: Any, columns: Any, form: str, **more: Any) -> dict[str, Any]:
    """Stated in coordinates of its own, with samples that say nothing."""
    n, q = np.shape(columns)
    ends = {"lower": [-1.0] * q, "upper": [1.0] * q}
    shape = (
        {"D": columns, "d_bounds": ends} if form == "d_bounds"
        else {"disturbance_matrix": columns, "disturbance": ends}
    )  # fmt: skip
    return {
        "flow": {"A": A} | shape,
        "output": {"C": np.eye(n)[:1].tolist(), "noise_bound": 1e3},
        "observer": {"kind": "interval", "form": "coordinates", "gains": {"L": [[0]] * n}},
    } | more


def designed(body: dict[str, Any]) -> Design:
    return obsdesign.design(obsdesign.Problem.from_dict(body))


def boxed(design: Design) -> IntervalObserver:
    """The observer of the design's gains that knows the boxes around b and c alone."""
    gains = {name: value for name, value in design.gains.items() if "disturbance" not in name}
    return IntervalObserver.from_gains(gains)


@pytest.mark.parametrize("form", ["d_bounds", "disturbance_matrix"])
@pytest.mark.parametrize(("A", "columns", "widths"), DIRECTIONS)
def test_in_eigencoordinates_the_width_is_that_of_the_reachable_set(
    A: Any, columns: Any, widths: Any, form: str
) -> None:
    design = designed(problem(A, columns, form))
    proved = next(claim for claim in design.claims if claim.id == "width").evidence["always"]
    assert proved == pytest.approx(widths, rel=1e-5)
    observer = IntervalObserver.from_gains(design.gains)
    state = observer.init(lower=[-9.0] * len(A), upper=[9.0] * len(A))
    for k in range(1, 121):
        state, estimate = observer.step(state, Sample(0.5 * k, y=[0.0]))
    assert estimate.upper - estimate.lower == pytest.approx(widths, rel=1e-3)


@pytest.mark.parametrize("seed", range(4))
def test_the_state_stays_inside_bounds_that_a_box_never_narrows(seed: int) -> None:
    """w at its ends, jumps with w of their own; against the box around b and c."""
    rng = np.random.default_rng(seed)
    A, columns, _ = DIRECTIONS[seed % 2]
    body = problem(A, columns, "disturbance_matrix", jump=JUMPS)
    body["observer"]["gains"]["S"] = np.linalg.eig(np.array(A, dtype=float))[1].tolist()
    design = designed(body)
    observers = (IntervalObserver.from_gains(design.gains), boxed(design))
    states = [each.init(lower=[-2.0, -2.0], upper=[2.0, 2.0]) for each in observers]
    x, t, narrower = rng.uniform(-2, 2, 2), 0.0, 0
    for k in range(80):
        h = float(rng.choice([0.25, 0.5]))
        w, t, jump = rng.choice([-1.0, 1.0]), t + h, k % 4 == 3
        flow, integral = flow_integral(np.array(A, dtype=float), h)
        x = flow @ x + integral @ (np.array(columns)[:, 0] * w)
        y = x[:1]
        if jump:
            x = np.array(JUMPS["G"]) @ x + np.array([1.0, 0.5]) * rng.choice([-1.0, 2.0])
        sample, ends = Sample(t, y=y, jump=jump), []
        for i, observer in enumerate(observers):
            states[i], estimate = observer.step(states[i], sample)
            assert (estimate.lower <= x + 1e-12).all()
            assert (x - 1e-12 <= estimate.upper).all()
            ends.append((estimate.lower, estimate.upper))
        (low, high), (box_low, box_high) = ends
        assert (box_low <= low + 1e-12).all()
        assert (high <= box_high + 1e-12).all()
        narrower += bool(((high - low) < 0.99 * (box_high - box_low)).any())
    assert narrower > 40


def test_an_older_design_that_stores_the_box_verifies() -> None:
    """Its claims are those of the box; the twin below states less than the problem."""
    body = problem(*DIRECTIONS[0][:2], "disturbance_matrix")
    design = designed(body)
    entries = {name: value for name, value in design.gains.items() if "disturbance" not in name}
    older = obsdesign.verify(replace(design, gains=entries))
    verdicts = {claim.id: claim.verdict for claim in older.claims}
    assert verdicts["consistent"] == "proved"
    assert verdicts["width"] != "proved"  # the stored tube is that of the segment


@pytest.mark.parametrize(
    ("name", "value"),
    [("disturbance_matrix", [[1], [-0.5]]), ("disturbance_upper", [0.5])],
)
def test_a_smaller_disturbance_in_a_design_is_refuted(name: str, value: Any) -> None:
    design = designed(problem(*DIRECTIONS[0][:2], "disturbance_matrix"))
    forged = replace(design, gains={**design.gains, name: np.array(value, dtype=float)})
    first = obsdesign.verify(forged).claims[0]
    assert (first.id, first.verdict) == ("consistent", "refuted")


def test_bounds_of_rows_are_those_of_w() -> None:
    """Known w = 0.5 with and without jumps in the plant: inside, and narrower than declared."""
    A, columns, _ = DIRECTIONS[0]
    for more in ({}, {"jump": JUMPS}):
        observer = IntervalObserver.from_gains(
            designed(problem(A, columns, "disturbance_matrix", **more)).gains
        )
        state = declared = observer.init(lower=[-1.0, -1.0], upper=[1.0, 1.0])
        x, (flow, integral) = np.zeros(2), flow_integral(np.array(A), 0.5)
        for k in range(1, 9):
            own = Bounds(b=([0.5], [0.5]))
            state, estimate = observer.step(state, Sample(0.5 * k, y=x[:1], bounds=own))
            declared, wider = observer.step(declared, Sample(0.5 * k, y=x[:1]))
            x = flow @ x + integral @ (0.5 * np.array(columns)[:, 0]) if k > 1 else x
            if k > 1:
                assert (estimate.lower <= x).all()
                assert (x <= estimate.upper).all()
        assert (estimate.upper - estimate.lower < wider.upper - wider.lower).all()


@pytest.mark.parametrize("scale", [2.0**20, 2.0**-20])
def test_units_of_w_do_not_matter(scale: float) -> None:
    """Bw / s and s w are the same disturbance."""
    A, columns, _ = DIRECTIONS[1]
    body = problem(A, columns, "disturbance_matrix")
    other = copy.deepcopy(body)
    other["flow"]["disturbance_matrix"] = (np.array(columns) / scale).tolist()
    other["flow"]["disturbance"] = {"lower": [-scale], "upper": [scale]}
    gains = designed(body).gains
    systems = [
        WidthSystem.from_gains(IntervalObserver.from_gains(own).gains)
        for own in (gains, designed(other).gains)
    ]
    assert systems[0].f == pytest.approx(systems[1].f, rel=1e-9, abs=1e-12)
