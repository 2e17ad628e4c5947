"""Numbers on sliders: which there are, what they change, and the file that is saved."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import pytest

from obsdesign import InputError, Problem, load_problem
from obsdesign.explore.settings import (
    first_settings,
    labels_of,
    save,
    settings_of,
    with_values,
)
from obsdesign.studies.sweep.axes import entry, path_of

EXAMPLES = sorted(Path("examples").glob("*.toml"))


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_every_number_has_a_slider_around_its_value(path: Path) -> None:
    problem = load_problem(path)
    settings = settings_of(problem)
    for key, setting in settings.items():
        assert setting.value == entry(problem.to_dict(), path_of(key))
        assert setting.value in setting.stops
        assert list(setting.stops) == sorted(set(setting.stops))
    labels = labels_of(problem, settings)
    assert len(set(labels.values())) == len(labels)
    assert 0 < len(first_settings(settings)) <= 6
    present = {key: setting.value for key, setting in settings.items()}
    assert with_values(problem, present) == problem


def test_tables_are_called_by_their_names() -> None:
    problem = load_problem("examples/motor_encoders.toml")
    labels = labels_of(problem, ["sensor[0].every", "flow.A[0][0]"])
    assert labels == {
        "sensor[0].every": f"sensor.{problem.plant.sensors[0].name}.every",
        "flow.A[0][0]": "flow.A[0][0]",
    }


def test_labels_are_in_words_with_units() -> None:
    body = load_problem("examples/degue_4_2.toml").to_dict()
    outputs = len(body["output"]["C"])
    names = [f"meter {i}" for i in range(outputs)]
    body["output"]["noise_bound"] = [0.1] * outputs
    body["names"] = {"outputs": names, "units": {names[0]: "m"}, "time_unit": "s"}
    keys = ["jump.dwell_time[0]", "output.noise_bound[0]", "flow.A[0][0]"]
    labels = labels_of(Problem.from_dict(body), keys)
    assert list(labels.values()) == [
        "shortest dwell time [s]",
        "noise bound of meter 0 [m]",
        keys[2],
    ]
    # the twin: without units and names
    del body["names"]
    labels = labels_of(Problem.from_dict(body), keys)
    assert list(labels.values()) == ["shortest dwell time", "noise bound of y1", keys[2]]


def test_whole_numbers_have_whole_stops() -> None:
    body = load_problem("examples/degue_4_2.toml").for_kind("set_membership")[0].to_dict()
    body["observer"]["window"] = 8
    settings = settings_of(Problem.from_dict(body))
    assert all(isinstance(x, int) and x > 0 for x in settings["observer.window"].stops)


def test_numbers_that_do_not_go_together_are_refused() -> None:
    problem = load_problem("examples/degue_4_2.toml")
    with pytest.raises(InputError, match=r"jump.dwell_time"):
        with_values(problem, {"jump.dwell_time[0]": 100.0})


@pytest.mark.parametrize("suffix", ["toml", "json"])
@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_a_saved_problem_is_the_one_on_the_page(path: Path, suffix: str, tmp_path: Path) -> None:
    problem = load_problem(path)
    chosen = first_settings(settings_of(problem))[:1]
    stops = {key: settings_of(problem)[key].stops for key in chosen}
    values = {key: each[19 if each[0] else 5] for key, each in stops.items()}
    target = tmp_path / f"saved.{suffix}"
    save(problem, values, str(path), str(target))
    assert load_problem(target) == with_values(problem, values) != problem


def test_the_rest_of_a_file_stays_as_it_is(tmp_path: Path) -> None:
    source = Path("examples/degue_4_1.toml")
    target = tmp_path / "saved.toml"
    save(load_problem(source), {"jump.dwell_time[0]": 0.8}, str(source), str(target))
    before, after = (each.read_text("utf-8").splitlines() for each in (source, target))
    differing = [new for old, new in zip(before, after, strict=True) if old != new]
    assert len(differing) == 1
    assert "dwell_time" in differing[0]
    assert "0.8" in differing[0]


def test_what_the_file_leaves_to_its_default_is_put_in(tmp_path: Path) -> None:
    body = {
        "flow": {"A": [[-1.0]]},
        "output": {"C": [[1.0]], "noise_bound": 0.1},
        "observer": {"kind": "interval"},
    }
    source, target = tmp_path / "plant.json", tmp_path / "saved.toml"
    source.write_text(json.dumps(body))
    problem = Problem.from_dict(body)
    defaults = [key for key in settings_of(problem) if key.startswith("flow.")]
    values = {
        key: settings_of(problem)[key].stops[3] for key in (*defaults, "output.noise_bound[0]")
    }
    save(problem, values, str(source), str(target))
    assert load_problem(target) == with_values(problem, values)
    text = (
        'flow.A = [[-1.0]]\noutput = {C = [[1.0]], noise_bound = 0.1}\nobserver.kind = "interval"\n'
    )
    (tmp_path / "plant.toml").write_text(text)
    save(problem, values, str(tmp_path / "plant.toml"), str(target))
    assert load_problem(target) == with_values(problem, values)
    assert tomllib.loads(target.read_text())["output"]["noise_bound"] == [
        values["output.noise_bound[0]"]
    ]
