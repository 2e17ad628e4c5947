"""What may enter: magnitudes, nesting, sizes, truth values; and how failures of our own end."""

from __future__ import annotations

import contextlib
import json
import math
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flint import arb

import obsdesign
from lmi.arithmetic.balls import exact
from lmi.arithmetic.norms import well_ranked
from lmi.rank.stack import Stack, state_basis
from obsdesign import workflow
from obsdesign.cli import commands as cli
from obsdesign.design_file import from_dict, load_design
from obsdesign.document import digest
from obsdesign.equations.unknown_input.smoothing import smoothed
from obsdesign.errors import InputError
from obsdesign.input_files import MOST_BYTES
from obsdesign.problem.flow import Flow
from obsdesign.problem.output import Output
from obsdesign.problem.plant import Plant
from obsdesign.runtime import from_design
from obsdesign.runtime.base import Sample
from obsdesign.runtime.step_cache import shared_length
from obsdesign.studies.comparison.kalman import kalman_filter
from tests.fuzz.cases import design_text
from tests.fuzz.harness import Case, call
from tests.fuzz.plants import PROBLEMS
from tests.systems.command_line import command

ROOT = Path(__file__).parent.parent


def changed(body: Any, path: tuple[Any, ...], value: Any) -> Any:
    """A copy with another entry."""
    body = json.loads(json.dumps(body))
    place = body
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    return body


# --- problems -------------------------------------------------------------------------------------

UNITS = "must be 0 or of magnitude 1e-150 to 1e+150; got"
OUTSIDE = [
    ("interval", ("flow", "A", 0, 1), 1e160, f"flow.A, row 1, column 2 {UNITS} 1e+160."),
    ("interval", ("flow", "A", 0, 1), 1e-310, f"flow.A, row 1, column 2 {UNITS} 1e-310."),
    ("interval", ("jump", "G", 0, 0), 5e-324, f"jump.G, row 1, column 1 {UNITS} 5e-324."),
    ("luenberger", ("output", "C", 0, 0), 1e308, f"output.C, row 1, column 1 {UNITS} 1e+308."),
    ("luenberger", ("output", "noise_std"), [1e308], f"output.noise_std, entry 1 {UNITS} 1e+308."),
    ("luenberger", ("output", "noise_std"), 1e308, f"output.noise_std {UNITS} 1e+308."),
    ("luenberger", ("jump", "dwell_time"), [1e-200, 1], f"jump.dwell_time {UNITS} 1e-200."),
    ("sampled", ("output", "period"), 1e200, f"output.period {UNITS} 1e+200."),
    ("impulsive_input", ("observer", "exponents", 1), -1e308,
     f"observer.exponents, entry 2 {UNITS} -1e+308."),
    ("interval", ("observer", "gains", "L", 0, 0), -1e151,
     f"observer.gains.L, row 1, column 1 {UNITS} -1e+151."),
]  # fmt: skip


@pytest.mark.parametrize(("name", "path", "value", "line"), OUTSIDE)
def test_entries_outside_the_range_are_refused(
    name: str, path: tuple[Any, ...], value: Any, line: str
) -> None:
    with pytest.raises(InputError) as refusal:
        obsdesign.Problem.from_dict(changed(PROBLEMS[name], path, value))
    assert str(refusal.value) == f"{line} Choose other units."


@pytest.mark.parametrize("value", [1e150, -1e150, 1e-150, -1e-150, 0.0, -0.0])
def test_the_ends_of_the_range_are_inside(value: float) -> None:
    body = changed(PROBLEMS["luenberger"], ("flow", "A", 0, 1), value)
    assert obsdesign.Problem.from_dict(body).plant.flow.A[0, 1] == value
    beyond = value * 1.0001 if abs(value) > 1 else value * 0.9999 or 1e-151
    with pytest.raises(InputError, match=r"flow\.A, row 1, column 2"):
        obsdesign.Problem.from_dict(changed(body, ("flow", "A", 0, 1), beyond))


@pytest.mark.parametrize("path", [("flow", "A", 0, 0), ("output", "noise_bound"),
                                  ("jump", "dwell_time", 0), ("observer", "gains", "L", 0, 0)])  # fmt: skip
def test_truth_is_no_number_in_a_problem(path: tuple[Any, ...]) -> None:
    with pytest.raises(InputError, match="must"):
        obsdesign.Problem.from_dict(changed(PROBLEMS["interval"], path, True))


@pytest.mark.parametrize("name", ["p.json", "p.toml", "d.json"])
@pytest.mark.parametrize("depth", [51, 700, 3000])
def test_deep_nesting_is_refused(name: str, depth: int, tmp_path: Path) -> None:
    deep = "[" * depth + "1" + "]" * depth
    text = {
        "p.json": '{"flow": {"A": [[1]]}, "output": {"C": ' + deep + "}}",
        "p.toml": f"flow.A = [[1]]\noutput.C = {deep}\n",
        "d.json": design_text("luenberger").replace('"gains": {', '"gains": {"X": ' + deep + ", "),
    }[name]
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=r"nested|recursion") as refusal:
        load_design(tmp_path / name) if name[0] == "d" else obsdesign.load_problem(tmp_path / name)
    assert str(refusal.value).startswith(str(tmp_path / name))
    assert len(str(refusal.value)) - len(str(tmp_path)) < 150


@pytest.mark.parametrize("load", [obsdesign.load_problem, load_design])
def test_files_beyond_64_mib_are_refused(load: Callable[..., Any], tmp_path: Path) -> None:
    path = tmp_path / "large.json"
    with path.open("wb") as file:
        file.truncate(MOST_BYTES + 1)
    with pytest.raises(InputError, match="at most 64 MiB are read; it is larger"):
        load(path)


# --- data -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", PROBLEMS)
@pytest.mark.parametrize("t", ["1e308", "-1e308", "1e151", "1e150", "-1e150", "1e100", "-1e17"])
def test_huge_time_stamps_end_well(name: str, t: str, tmp_path: Path) -> None:
    from tests.fuzz.cases import data_text

    header, *rows = data_text(name).splitlines()
    far = t + rows[0][rows[0].index(",") :]
    rows = [far, *rows] if t[0] == "-" else [*rows, far]
    (tmp_path / "d.json").write_text(design_text(name))
    (tmp_path / "x.csv").write_text("\n".join([header, *rows, ""]))
    initial = ["--initial", "0,1,0,1"] if name in ("interval", "sampled") else []
    outcome = call(Case("", {}, ["run", "d.json", "x.csv", "-o", "e.csv", *initial]), tmp_path)
    assert outcome.code in (0, 2), outcome.err
    if abs(float(t)) > 1e150:
        assert "t must be at most 1e+150 in size; got" in outcome.err
        assert not (tmp_path / "e.csv").exists()


# --- designs --------------------------------------------------------------------------------------

FORGED: list[tuple[str, tuple[Any, ...], Any, str]] = [
    ("interval", ("gains", "dwell_time"), ["a", 2], "gains.dwell_time must hold numbers; got 'a'."),
    ("interval", ("gains", "L"), [[True], [1.0]], "gains.L must hold numbers; got True."),
    ("interval", ("gains", "L"), [[1.0], [1.0, 2.0]],
     "gains.L must be a matrix; its rows differ in length."),
    ("sampled", ("gains", "period"), True, "gains.period must hold numbers; got True."),
    ("impulsive_input", ("gains", "operator"), [[1]], "gains.operator must be a word; got [[1]]."),
    ("interval", ("provenance", "versions"), True, "provenance.versions must be a table; got True."),
    ("interval", ("guarantees", 0), 3, "guarantees[0] must have exactly statement, given, claims."),
    ("interval", ("claims", 0, "verdict"), "sure",
     "claims[0].verdict must be one of proved, refuted, undecided; got 'sure'."),
    ("luenberger", ("claims", 1, "evidence"), {"P": [[True, 0], [0, 1]]},
     "claims[1].evidence: numbers are due in [True, 0]."),
]  # fmt: skip


def signed(body: dict[str, Any], folder: Path) -> Path:
    path = folder / "d.json"
    path.write_text(json.dumps(body | {"digest": digest(body)}))
    return path


@pytest.mark.parametrize(("name", "path", "value", "line"), FORGED)
def test_designs_that_hold_no_numbers_are_refused(
    name: str, path: tuple[Any, ...], value: Any, line: str, tmp_path: Path
) -> None:
    file = signed(changed(json.loads(design_text(name)), path, value), tmp_path)
    with pytest.raises(InputError) as refusal:
        load_design(file)
    assert str(refusal.value) == f"{file}: {line}"


def reshaped(value: Any) -> list[Any]:
    """Arrays of shapes that contradict those of the other gains."""
    a = np.asarray(value)
    if not a.ndim or a.dtype.kind not in "fi" or not a.size:
        return []
    found = [a[:-1], np.concatenate([a, a[:1]]), a[None], np.zeros(0)]
    if a.ndim == 2:
        found += [a[:, :-1], np.hstack([a, a[:, :1]]), a.reshape(-1)]
        found += [a.T] if a.shape[0] != a.shape[1] else []
    return [one.tolist() for one in found]


@pytest.mark.parametrize(
    "name", ["interval", "impulsive", "impulsive_input", "luenberger", "finite_time", "sampled"]
)
def test_gains_of_shapes_that_contradict_each_other_are_refused(name: str, tmp_path: Path) -> None:
    body = json.loads(design_text(name))
    forged = [changed(body, ("gains", gain), value)
              for gain, old in body["gains"].items() for value in reshaped(old)]  # fmt: skip
    # all square gains smaller by one, but for one of them
    n = len(body["gains"]["A"])
    square = [gain for gain, X in body["gains"].items() if np.shape(X) == (n, n)]
    for kept in square[1:]:
        smaller = {gain: np.array(body["gains"][gain])[1:, 1:].tolist() for gain in square}
        smaller[kept] = body["gains"][kept]
        forged.append(changed(body, ("gains",), body["gains"] | smaller))
    assert len(forged) > 10
    for one in forged:
        with contextlib.suppress(InputError):
            outcome = workflow.verify(load_design(signed(one, tmp_path)))
            assert outcome.verdict == "refuted"
        with contextlib.suppress(InputError):  # or it runs without the entry
            obsdesign.runtime.load(tmp_path / "d.json")


@pytest.mark.parametrize("window", [4000, 4096])
def test_a_forged_long_window_is_refused_by_its_memory(window: int, tmp_path: Path) -> None:
    n = 24
    problem = obsdesign.Problem(
        flow={"A": (-0.1 * np.eye(n)).tolist()},
        jump={"G": np.eye(n).tolist(), "dwell_time": [0.5, 1.0]},
        output={"C": np.eye(n).tolist(), "measured": "at_jumps", "jump_measurement": "before"},
        observer={"kind": "impulsive", "strategy": "full"},
    )
    body = obsdesign.design(problem).to_dict()
    assert workflow.verify(load_design(signed(body, tmp_path))).verdict == "proved"
    forged = changed(body, ("gains", "window"), window)
    with pytest.raises(InputError, match=f"^a window of {window} impulses and {n} states.* needs"):
        workflow.verify(load_design(signed(forged, tmp_path)))


def test_integers_beyond_binary64_are_refused(tmp_path: Path) -> None:
    body = changed(json.loads(design_text("interval")), ("gains", "L", 0, 0), 10**400)
    with pytest.raises(InputError, match="is beyond binary64") as refusal:
        load_design(signed(body, tmp_path))
    assert len(str(refusal.value)) < 300


@pytest.mark.parametrize("value", [[[]], ["a"], [None, 1], {"a": 1}, [1e308], [1], "a"])
def test_evidence_of_any_shape_is_read(value: Any, tmp_path: Path) -> None:
    body = json.loads(design_text("impulsive"))
    k = next(k for k, claim in enumerate(body["claims"]) if "approx_worst" in claim["evidence"])
    body["claims"][k]["evidence"]["approx_worst"] = value
    assert workflow.verify(load_design(signed(body, tmp_path))).verdict != "proved"


def test_a_number_is_no_flag_and_truth_no_number(tmp_path: Path) -> None:
    good = json.loads(design_text("impulsive_input"))
    assert workflow.verify(load_design(signed(good, tmp_path))).verdict == "proved"
    forged = changed(good, ("gains", "nonnegative"), 0)
    assert workflow.verify(load_design(signed(forged, tmp_path))).verdict == "refuted"


@pytest.mark.parametrize("window", [4097, 1e8, 1e308, 0])
def test_windows_that_no_design_has_do_not_run(window: float, tmp_path: Path) -> None:
    body = changed(json.loads(design_text("impulsive")), ("gains", "window"), window)
    file = signed(body, tmp_path)
    words = "hold numbers of magnitude at most" if window > 1e150 else "be a whole number"
    with pytest.raises(InputError, match=rf"gains\.window must {words}"):
        obsdesign.runtime.load(file)
    if window < 1e150:
        assert workflow.verify(load_design(file)).verdict == "refuted"


# --- the program's own failures -------------------------------------------------------------------


@pytest.mark.parametrize(
    "error", [ZeroDivisionError("x / 0"), MemoryError(), RecursionError("deep"), KeyError("L\nM")]
)
@pytest.mark.parametrize("verbose", [False, True])
def test_an_internal_error_is_no_verdict(
    error: Exception, verbose: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise error

    monkeypatch.setattr(workflow, "investigate", fail)
    (tmp_path / "p.json").write_text(json.dumps(PROBLEMS["luenberger"]))
    (tmp_path / "old.json").write_text("kept")
    arguments = ["--verbose"] * verbose + ["design", "p.json", "-o", "old.json"]
    outcome = call(Case("", {}, arguments), tmp_path)
    assert (outcome.code, outcome.out) == (cli.INTERNAL_ERROR, "") == (70, "")
    *trace, line = outcome.err.splitlines()
    reason = " ".join(f"{type(error).__name__} {error}".split())
    assert line == (f"obsdesign: internal error: {reason}, please report, --verbose for the trace")
    assert ("Traceback (most recent call last):" in trace) == verbose
    assert bool(trace) == verbose
    assert (tmp_path / "old.json").read_text() == "kept"
    assert len(list(tmp_path.iterdir())) == 2


def shell(script: str, cwd: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    text = script.replace("obsdesign", f"{sys.executable} -m obsdesign")
    path = os.pathsep.join(filter(None, [environment.pop("PYTHONPATH", ""), str(ROOT)]))
    return subprocess.run(
        ["sh", "-c", text], cwd=cwd, capture_output=True, text=True, check=False, timeout=120,
        env={**os.environ, **environment, "PYTHONPATH": path},
    )  # fmt: skip


def test_streams_that_are_closed(tmp_path: Path) -> None:
    (tmp_path / "d.json").write_text(design_text("luenberger"))
    (tmp_path / "p.json").write_text(json.dumps(PROBLEMS["luenberger"]))
    done = shell("obsdesign run d.json <&-", tmp_path)
    assert done.returncode == 2
    assert done.stderr == (
        "obsdesign: standard input: a header line with column 't', ... is required; the file is "
        "empty.\n"
    )
    done = shell("obsdesign design p.json -o out.json >&-", tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith("obsdesign: standard output is closed")
    assert not (tmp_path / "out.json").exists()
    done = shell("obsdesign design p.json -o out.json 2>&-", tmp_path)
    assert done.returncode == 0
    json.loads((tmp_path / "out.json").read_text())  # no file got the number of a closed stream


def test_links_in_a_circle(tmp_path: Path) -> None:
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "p.json").write_text(json.dumps(PROBLEMS["luenberger"]))
    for arguments in (["design", "loop"], ["design", "p.json", "-o", "loop"], ["verify", "loop"]):
        done = command(*arguments, cwd=tmp_path)
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr.startswith("obsdesign: loop: cannot be ")
        assert len(done.stderr.splitlines()) == 1
        assert (tmp_path / "loop").is_symlink()


@pytest.mark.parametrize("module", ["click", "numpy"])
def test_an_interrupted_import_is_no_traceback(module: str, tmp_path: Path) -> None:
    (tmp_path / f"{module}.py").write_text("raise KeyboardInterrupt\n")
    (tmp_path / "p.json").write_text(json.dumps(PROBLEMS["luenberger"]))
    done = shell("obsdesign design p.json", tmp_path, PYTHONPATH=str(tmp_path))
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")


# --- what the fuzzers found -----------------------------------------------------------------------


def test_a_step_below_the_unit_of_its_stamps_keeps_its_length() -> None:
    h = math.ulp(2.2)
    length, half = shared_length(h, 2.2)
    assert abs(length - h) <= half
    assert length > 0
    assert shared_length(0.0, 2.2)[0] == 0.0


def test_a_rank_without_midpoints_is_undecided() -> None:
    X = np.array([[arb("nan"), arb(0)], [arb(0), arb(1)]], dtype=object)
    assert well_ranked(X, 1e-3).outcome == "undecided"
    X[0, 0] = arb(1)
    assert well_ranked(X, 1e-3).outcome == "proved"


def test_coordinates_beyond_floats_are_none() -> None:
    C, right = np.array([[1.0, 0.0]]), np.array([[1.0], [0.0]])
    F, H = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[1.0, 0.0], [0.0, 0.0]])
    stack = Stack(*map(exact, (F, H, C, right)), 1)
    assert np.isfinite(state_basis(stack, np.eye(1))).all()
    with pytest.raises(np.linalg.LinAlgError):
        state_basis(stack, np.array([[5e-324]]))


def test_steps_of_all_sizes_are_not_smoothed() -> None:
    t = np.array([0.0, 1e-3, 2e-3, 3e-3, 1e113])
    y = np.array([[1.0], [2.0], [1.0], [2.0], [1.0]])
    np.testing.assert_array_equal(smoothed(t, y, np.array([10.0])), y)
    # the twin: alike, they are
    assert np.ptp(smoothed(np.arange(5.0), y, np.array([10.0]))) < 0.9


def test_a_filter_outlives_outputs_that_rounding_makes_alike() -> None:
    plant = Plant(Flow(-np.eye(1)), None, Output(np.array([[1.0], [1.0]])))
    rows = [Sample(float(t), [1.0, 1.0 + 1e-9 * t]) for t in range(5)]
    estimates = kalman_filter(plant, rows, initial_variance=1e30)
    assert np.isfinite(estimates.x).all()


def test_time_stamps_must_resolve_the_window() -> None:
    observer: Any = obsdesign.runtime.from_design(
        obsdesign.design(obsdesign.Problem.from_dict(PROBLEMS["impulsive_input"]))
    )
    with pytest.raises(
        InputError, match=r"t must resolve the window of 1 into 16 parts; got t = 1e\+16"
    ):
        observer.run_batch([0.0, 1e16], [[1.0], [1.0]])
    state = observer.init(0.0)
    with pytest.raises(InputError, match="t must resolve the window of 1"):
        observer.step(state, Sample(1e16, [1.0]))
    assert len(observer.run_batch([0.0, 1e9], [[1.0], [1.0]]).t) == 2


def test_time_stamps_must_resolve_the_period_between_whose_samples_onsets_are_looked_for() -> None:
    """Microseconds since 1970, in seconds, are stamps of four ulps."""
    body = PROBLEMS["impulsive_input"] | {
        "output": PROBLEMS["impulsive_input"]["output"]
        | {"measured": "periodic", "period": 0.125, "noise_std": [0.01]},
        "observer": {"kind": "impulsive_input", "operator": "samples"},
    }
    observer: Any = obsdesign.runtime.from_design(
        obsdesign.design(obsdesign.Problem.from_dict(body))
    )
    fine = 0.125 / 128  # the ulp of 2^42 ... 2^43
    assert len(observer.run_batch([fine * 2.0**52], [[1.0]]).t) == 1
    with pytest.raises(InputError, match=r"t must resolve the period of 0\.125 into 100 parts"):
        observer.run_batch([fine * 2.0**53], [[1.0]])


@pytest.mark.parametrize("value", [1e151, -1.7e308])
def test_gains_beyond_the_range_are_refused(value: float) -> None:
    body = json.loads(design_text("luenberger"))
    body["gains"]["L"][0][0] = value
    body["digest"] = digest(body)
    with pytest.raises(
        InputError, match=r"gains\.L must hold numbers of magnitude at most 1e\+150"
    ):
        from_dict(body)
    body["gains"]["L"][0][0] = 1e149  # within the range, and not the gain that was proved
    body["digest"] = digest(body)
    assert obsdesign.verify(from_dict(body)).verdict == "refuted"


def test_gains_that_do_not_fit_each_other_are_refuted() -> None:
    """Shapes and words are those of the problem, and yet no observer can be made of them."""
    body = json.loads(design_text("impulsive_input"))
    body["gains"]["exponents"][-1] = 1e3 / body["gains"]["window"]
    body["digest"] = digest(body)
    design = from_dict(body)
    claim = obsdesign.verify(design).claims[0]
    assert (claim.id, claim.verdict) == ("consistent", "refuted")
    with pytest.raises(InputError, match=r"gains\.exponents times gains\.window must be below 300"):
        from_design(design)


@pytest.mark.parametrize(("kind", "gain"), [("unknown_input", "F"), ("impulsive_input", "K")])
def test_infinite_gains_do_not_run(kind: str, gain: str, tmp_path: Path) -> None:
    body = json.loads(design_text(kind))
    body["gains"][gain] = [["inf" for _ in row] for row in body["gains"][gain]]
    with pytest.raises(InputError, match=rf"gains\.{gain} must be finite"):
        obsdesign.runtime.load(signed(body, tmp_path))
