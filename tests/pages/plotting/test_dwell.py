"""The picture of what a search proved, and of the windows of a proof."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread

from obsdesign.errors import InputError
from obsdesign.pages.plotting.dwell import plot_dwell

GREEN, BLUE, VERMILION = (0, 158, 115), (0, 114, 178), (213, 94, 0)
WINDOWS = [{"dwell": {"-1": [0.4, 1.0]}, "P": [[1.0]]}, {"dwell": {"-1": [1.0, 1.9]}, "P": [[1.0]]}]


def answer(**changes: Any) -> dict[str, Any]:
    result = {"kept": 0.4, "proved": 1.8, "common_P": 1.5, "not_proved": 1.9,
              "not_proved_verdict": "refuted"} | changes  # fmt: skip
    return {"command": "search", "result": result, "claims": []}


def has_colour(path: Path, colour: tuple[int, int, int]) -> bool:
    """Drawn at three quarters of its strength on white."""
    wanted = 1 - 0.75 * (1 - np.array(colour) / 255)
    return bool((np.abs(imread(path)[..., :3] - wanted).max(axis=2) < 0.02).sum() > 200)


@pytest.mark.parametrize(
    ("changes", "there", "absent"),
    [
        ({}, (GREEN, BLUE, VERMILION), ()),
        ({"common_P": None}, (GREEN, VERMILION), (BLUE,)),
        ({"not_proved_verdict": "undecided"}, (GREEN, BLUE), (VERMILION,)),
        ({"not_proved": None, "not_proved_verdict": None, "common_P": None, "proved": "inf"},
         (GREEN,), (BLUE, VERMILION)),
        ({"kept": "inf", "proved": 0.7, "common_P": 0.8, "not_proved": 0.69},
         (GREEN, BLUE, VERMILION), ()),
    ],
)  # fmt: skip
def test_each_part_of_the_range_has_its_colour(
    tmp_path: Path, changes: Any, there: Any, absent: Any
) -> None:
    plot_dwell(answer(**changes), str(tmp_path / "range.png"), "answer.json")
    assert all(has_colour(tmp_path / "range.png", colour) for colour in there)
    assert not any(has_colour(tmp_path / "range.png", colour) for colour in absent)


def test_windows_alone(tmp_path: Path) -> None:
    design = {"claims": [{"evidence": {"windows": WINDOWS}}]}
    plot_dwell(design, str(tmp_path / "tree.png"), "design.json")
    assert has_colour(tmp_path / "tree.png", BLUE)
    endless = [{"dwell": {"0": [1.0, "inf"], "-2": [0.4, 0.9]}}, {"dwell": {}}]
    plot_dwell({"claims": [{"evidence": {"windows": endless}}]}, str(tmp_path / "t.svg"), "d.json")
    assert (tmp_path / "t.svg").read_text("utf-8").lstrip().startswith("<?xml")


@pytest.mark.parametrize("body", [{}, {"result": {"proved": None}}, json.loads('{"claims": []}')])
def test_other_answers_are_refused(tmp_path: Path, body: dict[str, Any]) -> None:
    with pytest.raises(InputError) as caught:
        plot_dwell(body, str(tmp_path / "none.png"), "other.json")
    assert str(caught.value) == (
        "other.json: the answer of a search for dwell times, or a design with windows of dwell "
        "times, is required; it is neither."
    )
    assert not (tmp_path / "none.png").exists()
