"""A folder of code: what the commands write, and what verify says of a changed one."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

import obsdesign
from obsdesign import InputError
from obsdesign.cli.commands import cli
from obsdesign.export.folder import code_claim, write_code
from obsdesign.export.manifest import Options
from obsdesign.export.timing import Steps, timing_of
from tests.export.plants import PROBLEMS, design_named
from tests.systems.compiled import STRICT, compiled
from tests.systems.designs import designed

ROOT = Path(__file__).parents[2]


def invoke(*words: object) -> Result:
    return CliRunner().invoke(cli, [str(word) for word in words], standalone_mode=False)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, academic_design: Path) -> Path:
    path = tmp_path_factory.mktemp("export") / "code"
    done = invoke("export", academic_design, "--to", "c", "--steps", "0.05", "--precision", "float",
                  "-o", path)  # fmt: skip
    assert done.exception is None
    assert "7 files of kind interval in float" in done.stdout
    return path


def test_the_printed_command_compiles(folder: Path) -> None:
    compiled(folder, "gcc", *STRICT, "-O2")
    (folder / "a.out").unlink()


def test_verify_takes_the_folder(folder: Path) -> None:
    done = invoke("verify", folder, "--json")
    answer = json.loads(done.stdout)
    assert answer["verdict"] == "proved"
    code = next(claim for claim in answer["claims"] if claim["id"] == "code")
    assert code["verdict"] == "proved"
    assert code["evidence"]["smallest_margin"] >= 1.0


@pytest.mark.parametrize(
    ("name", "old", "new", "verdict"),
    [
        ("obs.c", "0x1.e7078cp-1f", "0x1.e7078ap-1f", "undecided"),
        ("obs.c", "0x1.e7078cp-1f", "0x1.d7078cp-1f", "refuted"),
        ("obs.c", "total += row[i] * v[i];", "total -= row[i] * v[i];", "refuted"),
        ("obs.h", "OBS_DWELL_TIME = 2,", "OBS_DWELL_TIME = 3,", "refuted"),
        ("manifest.json", '"products": 6', '"products": 7', "refuted"),
        ("README.md", "lower <= x", "lower < x", "refuted"),
    ],
)
def test_a_changed_digit_is_not_proved(
    folder: Path, name: str, old: str, new: str, verdict: str
) -> None:
    path = folder / name
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    try:
        claim = code_claim(folder)[1]
    finally:
        path.write_text(text)
    assert claim.verdict == verdict
    assert claim.evidence["file"] == name
    assert code_claim(folder)[1].verdict == "proved"


def test_a_missing_file_and_another_design(folder: Path, tmp_path: Path) -> None:
    text = (folder / "obs.c").read_text()
    (folder / "obs.c").unlink()
    assert code_claim(folder)[1].verdict == "refuted"
    (folder / "obs.c").write_text(text)
    design, steps = design_named("jumps")
    write_code(design, tmp_path, Options("double", Steps(steps)))
    manifest = (tmp_path / "manifest.json").read_text()
    (tmp_path / "manifest.json").write_text(manifest.replace(design.digest, "sha256:0"))
    with pytest.raises(InputError, match="digest"):
        code_claim(tmp_path)
    (tmp_path / "manifest.json").unlink()
    with pytest.raises(InputError, match="cannot be read"):
        code_claim(tmp_path)


@pytest.mark.parametrize(
    ("key", "value", "part"),
    [
        ("precision", ["double"], "precision must be"),
        ("prefix", 3, "prefix must be a text"),
        ("steps", [10**400], "positive numbers"),
        ("steps", [True], "list of numbers"),
        ("step_error", None, "step_error must be"),
        ("step_error", 3, "--step-error must be"),
        ("format", "obsdesign/design", "not a manifest"),
        ("version", 2, "version must be 1"),
    ],
)
def test_a_manifest_that_is_none(folder: Path, key: str, value: Any, part: str) -> None:
    path = folder / "manifest.json"
    text = path.read_text()
    try:
        path.write_text(json.dumps(json.loads(text) | {key: value}))
        with pytest.raises(InputError, match=part):
            code_claim(folder)
        path.write_text(text[:-3])
        with pytest.raises(InputError, match="not JSON"):
            code_claim(folder)
    finally:
        path.write_text(text)


@pytest.mark.parametrize(
    ("words", "part"),
    [
        (["--to", "c"], "--steps is missing"),
        (["--to", "c", "--steps", "0"], "positive"),
        (["--to", "c", "--steps", "0.1,x"], "numbers separated by commas"),
        (["--to", "c", "--steps", "0.1", "--precision", "half"], "double or float"),
        (["--to", "c", "--steps", "0.1", "--prefix", "9"], "--prefix"),
        (["--to", "c", "--steps", "1,1e-11"], "largest common unit"),
        (["--to", "c", "--steps", "0.1", "--step-error", "0.2"], "--step-error must be"),
        (["--steps", "0.1"], "belongs to --to c"),
        (["--step-error", "0.1"], "belongs to --to c"),
    ],
)
def test_refusals(academic_design: Path, words: list[str], part: str, tmp_path: Path) -> None:
    target = tmp_path / "x"
    done = invoke("export", academic_design, *words, "-o", target)
    assert isinstance(done.exception, InputError)
    assert part in str(done.exception)
    assert not target.exists()


@pytest.mark.parametrize("name", ["mattsson_medvedev", "thermometer", "spring_damper"])
def test_designs_without_code(name: str) -> None:
    outcome = obsdesign.investigate(obsdesign.load_problem(ROOT / "examples" / f"{name}.toml"))
    assert outcome.design is not None
    with pytest.raises(InputError, match="cannot be exported"):
        Options("double", Steps((0.05,))).program(outcome.design)


def test_windows_with_too_many_gains() -> None:
    body, _ = PROBLEMS["impulses"]
    design = designed(body)
    with pytest.raises(InputError, match="too many gains"):
        Options("double", Steps((0.001,))).program(design)
    assert Options("double", Steps((0.05,))).program(design).jumps


@pytest.mark.parametrize(
    ("name", "more", "steps", "part"),
    [
        ("window", {}, (0.2,), "every 0.1, no others"),
        ("window", {"window": 25.0}, (), "carries 254 numbers"),
        (
            "window",
            {"method": "approximate", "half_sample_correction": False},
            (),
            "half_sample_correction",
        ),
    ],
)
def test_windows_without_code(
    name: str, more: dict[str, Any], steps: tuple[float, ...], part: str
) -> None:
    body, _ = PROBLEMS[name]
    observer = body["observer"] | more
    design = designed(body | {"observer": observer}, allow_undecided=True)
    with pytest.raises(InputError, match=part):
        Options("double", Steps(steps)).program(design)


def test_numbers_beyond_a_float_are_refused() -> None:
    flow: dict[str, Any] = {"A": [[-1.0, 0.0], [1e60, -1.0]]}
    body = {"flow": flow, "output": {"C": [[1, 1]], "noise_bound": [0.1]},
            "observer": {"kind": "luenberger"}}  # fmt: skip
    design = designed(body, allow_undecided=True)
    with pytest.raises(InputError, match="use double"):
        Options("float", Steps((0.1,))).program(design)
    assert Options("double", Steps((0.1,))).program(design).products


def test_times_are_whole_ticks() -> None:
    timing = timing_of(Steps((0.05, 0.125)), (0.3, 0.31), 0.024, period=0.1)
    assert [timing.ticks, timing.period, timing.shortest] == [[2, 5], 4, 12]
    assert (timing.longest, timing.jitter) == (12, 0)
    assert float(timing.tick) == 0.025
    assert timing_of(Steps((0.1,)), (0.3, float("inf")), None).longest is None
    assert timing_of(Steps((0.1,)), (0.3, 0.3), 0.3).jitter == 3
