"""Sensor strips hold the measured state; bounds that are compared have their widths beside."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.figure import Figure

from obsdesign.cli.commands import cli
from obsdesign.data.csv_text import table_text
from obsdesign.data.simulation import simulate
from obsdesign.errors import InputError
from obsdesign.pages.plotting.bounds import draw_bounds, draw_widths
from obsdesign.pages.plotting.estimate import Comparison, plot_estimate
from obsdesign.pages.plotting.estimate_record import EstimateRecord, Table
from obsdesign.pages.plotting.strips import strips_of
from obsdesign.problem.problem import Problem
from tests.systems.clocks import DOSES

BODY = {
    "flow": {
        "A": [[-1, 0.2], [1, -2]],
        "disturbance": {"lower": [-0.1, -0.1], "upper": [0.1, 0.1]},
    },
    "output": {
        "C": [[0, -2], [0, 1], [1, 1]],
        "noise_bound": [[-0.1, 0.3], [-0.5, 0.5], [-0.1, 0.1]],
        "measured": "periodic",
        "period": 0.1,
    },
}


def _data(folder: Path) -> tuple[Problem, str]:
    problem = Problem.from_dict(BODY)
    path = folder / "data.csv"
    rng = np.random.default_rng(3)
    path.write_text(table_text(simulate(problem.plant, until=6.0, rng=rng).columns))
    return problem, str(path)


def test_the_narrowest_strip_holds_the_state_at_every_sample(tmp_path: Path) -> None:
    problem, path = _data(tmp_path)
    table = Table.from_file(path)
    strips = strips_of(problem.plant, table)
    assert list(strips) == ["x2"]  # the third output is no state alone
    strip, x = strips["x2"], table.numbers("x2")
    assert strip.width == pytest.approx(0.2)  # that of the first output: 0.4 / 2; the second's is 1
    assert np.allclose(strip.upper - strip.lower, strip.width)
    assert (strip.lower <= x + 1e-12).all()
    assert (x <= strip.upper + 1e-12).all()
    ends = (x - strip.lower) / strip.width
    assert (
        ends.min() < 0.1
    )  # noise reaches both ends, so that the strip is no wider than it has to be
    assert ends.max() > 0.9


def test_a_missing_sample_and_unknown_noise_have_no_strip(tmp_path: Path) -> None:
    problem, path = _data(tmp_path)
    rows = Path(path).read_text("utf-8").splitlines()
    column = rows[0].split(",").index("y1")
    cells = rows[3].split(",")
    cells[column] = ""
    rows[3] = ",".join(cells)
    Path(path).write_text("\n".join(rows) + "\n")
    lower = strips_of(problem.plant, Table.from_file(path))["x2"].lower
    assert np.flatnonzero(np.isnan(lower)).tolist() == [2]
    body = {**BODY, "output": {key: x for key, x in BODY["output"].items() if key != "noise_bound"}}
    assert not strips_of(Problem.from_dict(body).plant, Table.from_file(path))


def test_every_event_is_drawn_by_its_name_and_samples_as_dots(tmp_path: Path) -> None:
    problem = Problem.from_dict(DOSES)
    plant = problem.plant
    run = simulate(plant, until=60.0, rng=np.random.default_rng(1))
    data, estimate = tmp_path / "data.csv", str(tmp_path / "e.csv")
    data.write_text(table_text(run.columns))
    bounds = {f"x{i + 1}_{end}": run.block("x")[:, i] + shift
              for i in range(3) for end, shift in (("lo", -1.0), ("hi", 1.0))}  # fmt: skip
    Path(estimate).write_text(table_text({"t": run.t, **bounds}))
    compared = Comparison(problem=problem)
    record = EstimateRecord.from_files(estimate, str(data), None, clocks=compared.clocks)
    assert run.happened is not None
    assert {name: list(times) for name, times in record.happened.items()} == {
        name: list(run.t[run.happened[:, k]]) for k, name in enumerate(("dose", "bolus"))
    }
    assert len(record.jumps) == run.happened.any(axis=1).sum()
    axis = Figure().subplots()
    draw_bounds(axis, "x3", record, strips_of(plant, record.data)["x3"])
    (dots,) = (line for line in axis.get_lines() if line.get_label() == "sample")
    drawn = np.isfinite(np.asarray(dots.get_ydata()))
    assert np.array_equal(drawn, np.isfinite(record.data.numbers("tissue")))
    plot_estimate(estimate, str(data), str(tmp_path / "p.svg"), None, compared)
    assert "bolus" in (tmp_path / "p.svg").read_text("utf-8")


@pytest.mark.parametrize("narrow", [0.0, 1e-300, 1e-9])
def test_an_axis_of_widths_shows_the_widest_and_six_decades_at_most(narrow: float) -> None:
    """A state that is known exactly at the start, to rounding, hides no other width."""
    t, width = np.arange(5.0), np.array([narrow, 1e-3, 0.2, 0.5, 1.0])
    columns = {"t": t, "x1_lo": -width / 2, "x1_hi": width / 2}
    table = Table("e.csv", {name: list(map(repr, x.tolist())) for name, x in columns.items()})
    record = EstimateRecord.from_tables(table, Table("", {}), Table("", {}), Table("", {}))
    axis = Figure().subplots()
    draw_widths(axis, "x1", record, None)
    low, high = np.log10(axis.get_ylim())
    assert 0.0 < high < 0.5
    assert -7.0 < low < -3.0


def _estimates(folder: Path, name: str, half: float, path: str) -> str:
    table = Table.from_file(path)
    columns = {"t": table.numbers("t")}
    for state in ("x1", "x2"):
        columns |= {f"{state}_lo": table.numbers(state) - half}
        columns |= {f"{state}_hi": table.numbers(state) + half}
    (folder / name).write_text(table_text(columns))
    return str(folder / name)


def test_two_observers_and_the_sensor_stand_in_one_picture(tmp_path: Path) -> None:
    problem, data = _data(tmp_path)
    own = _estimates(tmp_path, "set_membership.csv", 0.05, data)
    other = _estimates(tmp_path, "interval.csv", 5.0, data)
    picture = tmp_path / "both.svg"
    plot_estimate(own, data, str(picture), None, Comparison(other, problem))
    words = ("set membership", "interval", "sensor strip", "true state", "width of the bounds")
    text = picture.read_text("utf-8")
    assert all(f"<!-- {word}" in text for word in words)
    plot_estimate(own, data, str(picture))  # alone: one panel for each state, as ever
    text = picture.read_text("utf-8")
    assert "<!-- bounds -->" in text
    assert not any(f"<!-- {word}" in text for word in words if word != "true state")


def test_plot_takes_a_second_estimate_and_a_design(tmp_path: Path, academic_design: Path) -> None:
    _, data = _data(tmp_path)
    own = _estimates(tmp_path, "narrow.csv", 0.05, data)
    other = _estimates(tmp_path, "wide.csv", 0.5, data)
    words = ["plot", own, data, "--beside", other, "--design", str(academic_design)]
    done = CliRunner().invoke(
        cli, [*words, "-o", str(tmp_path / "both.svg")], standalone_mode=False
    )
    assert done.return_value == 0, done.exception
    text = (tmp_path / "both.svg").read_text("utf-8")
    assert all(f"<!-- {word} -->" in text for word in ("narrow", "wide", "sensor strip"))


def test_an_estimate_without_bounds_is_not_compared(tmp_path: Path) -> None:
    _, data = _data(tmp_path)
    own = _estimates(tmp_path, "narrow.csv", 0.05, data)
    point = tmp_path / "point.csv"
    point.write_text("t,x1,x2\n0,1,1\n1,1,1\n")
    for first, second in ((own, str(point)), (str(point), own)):
        with pytest.raises(InputError, match=r"point.csv: bounds x1_lo, x1_hi are required"):
            plot_estimate(first, data, str(tmp_path / "no.png"), None, Comparison(second))
    assert not (tmp_path / "no.png").exists()
