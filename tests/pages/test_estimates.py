"""A page about bounds: widths of each state, another observer of the plant, what is refused."""

from __future__ import annotations

import base64
import re
from pathlib import Path

import numpy as np
import pytest

import obsdesign
from obsdesign.data.csv_text import table_text
from obsdesign.data.simulation import simulate
from obsdesign.errors import InputError
from obsdesign.pages.estimates import DataSource
from obsdesign.pages.report import write_report
from obsdesign.problem.problem import Problem

BODY = {
    "name": "two tanks",
    "flow": {"A": [[-0.5, 0], [0.4, -0.3]], "disturbance": {"lower": [0.2, 0], "upper": [0.3, 0]}},
    "output": {"C": [[0, 1]], "noise_bound": 0.02, "measured": "periodic", "period": 0.5},
    "observer": {"kind": "set_membership", "window": 8},
}


def _saved(folder: Path, kind: str, **output: float) -> Path:
    body = BODY | {"output": BODY["output"] | output}
    problem = Problem.from_dict(body).for_kind(kind)[0]
    path = folder / f"{kind}.json"
    obsdesign.design(problem).save(path)
    return path


def _picture(page: str) -> str:
    image = re.search(r'src="data:image/svg\+xml;base64,([^"]*)"', page)
    assert image
    return base64.b64decode(image[1]).decode("utf-8")


@pytest.mark.parametrize("own", ["set_membership", "interval"])
def test_a_page_draws_both_observers_and_the_strip(own: str, tmp_path: Path) -> None:
    kinds = ("set_membership", "interval")
    paths = {kind: _saved(tmp_path, kind) for kind in kinds}
    (other,) = (paths[kind] for kind in kinds if kind != own)
    out, data = tmp_path / "page.html", tmp_path / "data.csv"
    run = simulate(Problem.from_dict(BODY).plant, until=8.0, rng=np.random.default_rng(5))
    data.write_text(table_text(run.columns))
    source = DataSource(str(data), [0.0, 3.0, 0.0, 3.0])
    assert write_report(str(paths[own]), str(out), source, str(other)).verdict == "proved"
    page = out.read_text("utf-8")
    drawn = _picture(page)
    for words in ("set membership", "interval", "sensor strip", "width of the bounds"):
        assert f"<!-- {words}" in drawn
    cells = [row for row in re.findall(r"<tr>(.*?)</tr>", page) if "µs" not in row]
    width = {
        row[0]: float(row[3])
        for row in (re.findall(r"<td>(.*?)</td>", line) for line in cells)
        if row and row[0] in ("set membership", "interval")
    }
    assert width["set membership"] <= width["interval"]
    assert ("best possible" in page) == (own == "set_membership")


def test_a_page_of_tight_bounds_has_the_interval_observer_by_itself(tmp_path: Path) -> None:
    path, out = _saved(tmp_path, "set_membership"), tmp_path / "page.html"
    result = write_report(str(path), str(out)).result
    page = out.read_text("utf-8")
    assert "<!-- interval -->" in _picture(page)
    for row in result["states"]:
        assert all(f"<td>{row[key]:.3g}</td>" in page for key in ("width", "best"))


def test_only_proved_bounds_of_the_same_plant_stand_beside(
    tmp_path: Path, academic_design: Path
) -> None:
    path, out = _saved(tmp_path, "set_membership"), tmp_path / "page.html"
    (tmp_path / "other").mkdir()
    noisier = _saved(tmp_path / "other", "interval", noise_bound=0.03)
    point = _saved(tmp_path, "finite_time")
    for other, words in (
        (noisier, "a design of the same plant is required"),
        (academic_design, "a design of the same plant is required"),
        (point, "got finite_time"),
    ):
        with pytest.raises(InputError, match=words):
            write_report(str(path), str(out), beside=str(other))
    assert not out.exists()


@pytest.mark.parametrize("title", ["b1", "v1"])
def test_columns_of_rows_mean_the_same_to_both_kinds(title: str, tmp_path: Path) -> None:
    """b1 is w of b = Bw w for either, so that both stand in one picture."""
    matrix = {"disturbance_matrix": [[3.0], [0.0]], "disturbance": {"lower": [0], "upper": [0.1]}}
    body = BODY | {"flow": {"A": BODY["flow"]["A"], **matrix}}
    design, data, out = (tmp_path / name for name in ("d.json", "data.csv", "page.html"))
    obsdesign.design(Problem.from_dict(body).for_kind("set_membership")[0]).save(design)
    data.write_text(
        f"t,y1,{title}_lo,{title}_hi\n" + "".join(f"{k / 2},1,0,0.01\n" for k in range(6))
    )
    write_report(str(design), str(out), DataSource(str(data), [0.0, 3.0, 0.0, 3.0]))
    assert "<!-- interval -->" in _picture(out.read_text("utf-8"))
