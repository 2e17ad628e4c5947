"""Gains, estimators and estimates in the hands of other packages say what they say here."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat

import obsdesign
from obsdesign import InputError
from obsdesign.data.csv_lines import read_columns
from obsdesign.data.simulation import simulate
from obsdesign.interop import control_estimator, save_mat, to_columns, to_frame
from obsdesign.runtime import Sample, from_design
from tests.cli.test_commands import ROOT, command

EXAMPLES = ("degue_4_1", "ahn_2", "mattsson_medvedev", "mazenc_4", "medina_spline", "sampled_data")


@pytest.fixture(scope="module")
def designs() -> dict[str, obsdesign.Design]:
    return {
        name: obsdesign.design(obsdesign.load_problem(ROOT / "examples" / f"{name}.toml"))
        for name in EXAMPLES
    }


def smooth(**flow: Any) -> obsdesign.Design:
    """A point observer of a plant that never jumps."""
    known = {"A": [[0, 1, 0], [-2, -0.3, 1], [0, 0, -1]], "B": [[0], [1], [2]]}
    problem = obsdesign.Problem(
        flow=known | flow, output={"C": [[1, 0, 0], [0, 0, 1]]}, observer={"kind": "luenberger"}
    )
    return obsdesign.design(problem)


@pytest.mark.parametrize("name", EXAMPLES)
def test_every_gain_is_in_the_file_as_it_is(
    designs: dict[str, obsdesign.Design], name: str, tmp_path: Path
) -> None:
    design = designs[name]
    save_mat(design, tmp_path / "gains.mat")
    stored = loadmat(tmp_path / "gains.mat", chars_as_strings=True)
    for key, value in design.gains.items():
        if isinstance(value, str):
            assert stored[key].item() == value
            continue
        wanted = np.asarray(value, dtype=np.float64)
        shape = (wanted.size, 1) if wanted.ndim == 1 else wanted.shape or (1, 1)
        assert stored[key].shape == shape, key
        assert np.array_equal(stored[key].reshape(wanted.shape), wanted), key
    assert stored["digest"].item() == design.to_dict()["digest"]
    plain = loadmat(tmp_path / "gains.mat", simplify_cells=True)
    assert plain["kind"] == design.kind
    assert np.array_equal(plain["problem"]["flow"]["A"], design.gains["A"])
    if "dwell_time" in design.gains:
        assert np.array_equal(
            plain["problem"]["jump"]["dwell_time"], np.array(design.gains["dwell_time"])
        )


def test_export_from_the_command_line(academic_design: Path, tmp_path: Path) -> None:
    done = command("export", academic_design, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (0, "written: gains.mat, 17 gains of kind interval\n")
    assert loadmat(tmp_path / "gains.mat")["M"].tolist() == [[1.0], [2.8]]
    (tmp_path / "gains.mat").unlink()
    wrong = command("export", academic_design, "-o", "gains.txt", cwd=tmp_path)
    assert wrong.returncode == 2
    assert wrong.stderr == (
        "obsdesign: gains.txt: gains are exported to a file that ends in .mat.\n"
    )
    none = command("export", ROOT / "pyproject.toml", cwd=tmp_path)
    assert (none.returncode, none.stdout) == (2, "")
    assert not list(tmp_path.iterdir())


def test_the_estimator_of_control_gives_the_same_estimate() -> None:
    control = pytest.importorskip("control", reason="the extra `interop` is not installed")
    design = smooth()
    estimator = control_estimator(design)
    assert (estimator.ninputs, estimator.noutputs, estimator.dt) == (3, 3, 0)
    assert estimator.input_labels == ["y1", "y2", "u1"]
    assert np.all(estimator.poles().real < 0)
    problem = obsdesign.Problem.from_dict(design.problem)
    record = simulate(problem.plant, until=4.0, step=0.05, rng=np.random.default_rng(1))
    t, y = record.t, record.block("y")
    u = np.full((len(t), 1), 0.7)  # held by one, interpolated by the other: the same if constant
    ours = from_design(design).run_batch(t, y, u)
    theirs = control.forced_response(estimator, t, np.hstack([y, u]).T).states.T
    assert ours.x is not None
    assert np.abs(ours.x - theirs).max() < 1e-9 * max(np.abs(theirs).max(), 1.0)
    assert np.abs(theirs).max() > 0.1


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("degue_4_1", "kind 'interval': it answers with bounds, which follow its jumps and the noise bounds"),
        ("sampled_data", "kind 'luenberger': its estimate jumps with the plant; a state-space model does not"),
        ("mazenc_4", "kind 'finite_time': it works on the samples of a sliding window"),
        ("ahn_2", "kind 'unknown_input': it differentiates y, which no proper state-space model does"),
    ],
)  # fmt: skip
def test_designs_without_an_estimator(
    designs: dict[str, obsdesign.Design], name: str, why: str
) -> None:
    with pytest.raises(InputError) as error:
        control_estimator(designs[name])
    assert str(error.value) == (
        "a control estimator exists for kind 'luenberger' without jumps; this design is of "
        f"{why}. Run it with obsdesign.runtime."
    )


def test_a_constant_disturbance_has_no_estimator() -> None:
    off = {"lower": [0, 0, 0], "upper": [1, 0, 0]}
    with pytest.raises(InputError, match=r"needs flow\.disturbance with its middle at 0"):
        control_estimator(smooth(disturbance=off))


def test_tables_have_the_columns_of_an_estimate_file(academic_design: Path, tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas", reason="the extra `interop` is not installed")
    made = command("simulate", academic_design, "--until", 6, "-o", "data.csv", cwd=tmp_path)
    assert made.returncode == 0
    command(
        "run", academic_design, "data.csv", "--initial", "0,2,0,2", "-o", "est.csv", cwd=tmp_path
    )
    design = obsdesign.load_design(academic_design)
    data = {
        name: list(map(float, column))
        for name, column in read_columns(str(tmp_path / "data.csv")).items()
    }
    observer: Any = from_design(design)
    batch = observer.run_batch(
        data["t"], np.array(data["y1"])[:, None], jump=data["jump"], lower=[0, 0], upper=[2, 2]
    )
    frame = to_frame(batch)
    expected = pandas.read_csv(tmp_path / "est.csv")
    assert (
        list(frame.columns)
        == list(expected.columns)
        == ["t", "x1_lo", "x1_hi", "x2_lo", "x2_hi", "status"]
    )
    for name in frame.columns[:-1]:
        assert np.allclose(frame[name], expected[name], rtol=1e-12, atol=1e-12), name
    assert list(frame["status"]) == list(expected["status"])


def test_tables_of_estimates_one_by_one() -> None:
    observer: Any = from_design(smooth())
    state, estimates = observer.init(t=0.0), []
    for k in range(4):
        state, estimate = observer.step(state, Sample(k / 10, y=[1.0, 0.5], u=[0.0]))
        estimates.append(estimate)
    columns = to_columns(iter(estimates))
    assert list(columns) == ["t", "x1", "x2", "x3", "status"]
    assert columns["x3"].tolist() == [estimate.x[2] for estimate in estimates]
    assert columns["status"].tolist() == ["ok"] * 4


def test_packages_that_are_missing_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "control", None)
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(InputError) as error:
        control_estimator(smooth())
    assert str(error.value) == (
        "a control estimator requires the package `control`; it is missing: "
        "pip install 'obsdesign[interop]'."
    )
    with pytest.raises(InputError, match=r"pip install 'obsdesign\[interop\]'"):
        to_frame([])
