"""FMUs: valid descriptions, and answers of the Python runtime where fmpy runs them."""

from __future__ import annotations

import subprocess
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

from obsdesign import InputError
from obsdesign.cli.commands import cli
from obsdesign.design_file import load_design
from obsdesign.document import Design
from obsdesign.export.execution import Execution, Row
from obsdesign.export.fmu import VERSIONS, write_fmu
from obsdesign.export.manifest import Options
from obsdesign.export.programs import typed_gains
from obsdesign.export.record import record_of, rows_of
from obsdesign.export.timing import Steps
from obsdesign.runtime import Sample, from_design
from tests.export.plants import design_named
from tests.systems.compiled import STRICT, require
from tests.systems.fmu import Simulated

STEP, VOID, OVERFLOW = 64, 128, 32
# of the largest number: orders of sums, for bounds also errors of the runtime's time stamps
CLOSE = {"jumps": 1e-11, "periodic": 1e-11, "point": 1e-15, "unknown": 1e-14}


def exported(
    name: str, folder: Path, version: str = "3.0", precision: str = "double"
) -> tuple[Path, Design, Options]:
    """The FMU of a plant's design, written once; folder: of all FMUs."""
    design, steps = design_named(name)
    options = Options(precision, Steps(steps))
    path = folder / f"{name}-{version}-{precision}.fmu"
    require("cc")
    if not path.exists():
        assert write_fmu(design, path, options, version) is None
    return path, design, options


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fmus")


def simulated(
    name: str, fmus: Path, folder: Path, version: str = "3.0", precision: str = "double"
) -> Any:
    path, design, options = exported(name, fmus, version, precision)
    return Simulated(options.program(design), path, folder), design


@pytest.mark.parametrize(
    ("name", "version"),
    [("jumps", "3.0"), ("jumps", "2.0"), ("periodic", "3.0"), ("point", "3.0"), ("point", "2.0"),
     ("unknown", "2.0"), ("unknown", "3.0")],
)  # fmt: skip
def test_answers_are_those_of_the_runtime(
    name: str, version: str, fmus: Path, tmp_path: Path
) -> None:
    """Bit for bit those of the program, which is the runtime up to the order of its sums."""
    simulation, design = simulated(name, fmus, tmp_path, version)
    program = simulation.program
    record = record_of(design, program, typed_gains(design))
    size = 1.0 + np.abs(record.ends).max(axis=0)
    execution = Execution(program)
    lengths = [program.timing.lengths[row.step - 1] for row in record.rows[1:]] + [1.0]
    for _ in range(2):  # the second time after a reset
        simulation.begin(*record.initial)
        state = execution.start(*record.initial)
        for row, theirs, is_ok, length in zip(
            record.rows, record.ends, record.is_ok, lengths, strict=True
        ):
            simulation.put(row)
            simulation.step(length)
            ends, status = simulation.answer()
            state, wanted = execution.step(state, row)
            assert np.array_equal(ends, wanted)
            assert (np.abs(ends - theirs) <= CLOSE[name] * size).all()
            assert (status == 0) is is_ok
        simulation.fmu.reset()


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("name", ["jumps", "unknown"])
def test_descriptions_are_valid(name: str, version: str, fmus: Path, tmp_path: Path) -> None:
    validation = pytest.importorskip("fmpy.validation", reason="the extra `fmu` is not installed")
    path, design, _ = exported(name, fmus, version)
    assert validation.validate_fmu(str(path)) == []
    with zipfile.ZipFile(path) as archive:
        text = archive.read("modelDescription.xml").decode()
        archive.extractall(tmp_path)
    assert design.digest in text
    assert load_design(tmp_path / "resources" / "design.json").digest == design.digest
    words = [require("gcc"), *STRICT, "-O2", "-c", "sources/obs_fmu.c", "-o", "o.o"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("version", VERSIONS)
def test_a_description_with_a_missing_output_is_not_valid(
    version: str, fmus: Path, tmp_path: Path
) -> None:
    """The twin."""
    validation = pytest.importorskip("fmpy.validation", reason="the extra `fmu` is not installed")
    path, *_ = exported("point", fmus, version)
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path / "unzipped")
    description = tmp_path / "unzipped" / "modelDescription.xml"
    lines = description.read_text("utf-8").splitlines()
    places = [k for k, line in enumerate(lines) if "<Unknown" in line or "<Output" in line]
    description.write_text("\n".join(lines[: places[1]] + lines[places[1] + 1 :]), "utf-8")
    assert validation.validate_fmu(str(tmp_path / "unzipped"))


@pytest.mark.parametrize("version", VERSIONS)
def test_a_wrong_step_has_a_status(version: str, fmus: Path, tmp_path: Path) -> None:
    simulation, _ = simulated("point", fmus, tmp_path, version)
    row = Row(0, np.zeros(1), np.zeros(1))
    simulation.begin(np.zeros(2))
    for length, wanted in (
        (0.05, 0),
        (0.02, 0),
        (0.05 * (1 + 1e-8), 0),
        (0.02, STEP),
        (0.02, VOID),
    ):
        simulation.put(row)
        simulation.step(length)
        assert simulation.answer()[1] & (STEP | VOID) == wanted
    simulation.fmu.reset()
    simulation.begin(np.zeros(2))
    simulation.time = 1000.0  # where a difference of times is rounded
    for length in (0.02, 0.02, 0.05, 0.05):
        simulation.put(row)
        simulation.step(length)
        assert simulation.answer()[1] == 0


def test_bounds_that_nobody_gave_are_infinite(fmus: Path, tmp_path: Path) -> None:
    simulation, _ = simulated("jumps", fmus, tmp_path)
    simulation.fmu.enterInitializationMode()
    ends, status = simulation.answer()
    assert status == OVERFLOW
    assert (ends == -np.inf).all()
    simulation.fmu.exitInitializationMode()
    with pytest.raises(Exception, match="fmi3SetFloat64"):
        simulation.set("Number", {"x1_lo_start": 0.0})  # too late
    with pytest.raises(Exception, match="fmi3SetFloat64"):
        simulation.set("Number", {"x1_lo": 0.0})  # an output


def test_event_mode_gives_the_estimate_of_the_present_row(fmus: Path, tmp_path: Path) -> None:
    simulation, design = simulated("jumps", fmus, tmp_path)
    record = record_of(design, simulation.program, typed_gains(design))
    simulation.begin(*record.initial)
    for row, theirs in zip(record.rows, record.ends, strict=True):
        simulation.fmu.enterEventMode()
        simulation.put(row)
        simulation.fmu.updateDiscreteStates()
        ends, _ = simulation.answer()
        assert np.abs(ends - theirs).max() < 1e-11
        simulation.fmu.updateDiscreteStates()  # a master may ask again
        assert np.array_equal(simulation.answer()[0], ends)
        simulation.fmu.enterStepMode()
        simulation.step(0.05)


def test_float_encloses_double(fmus: Path, tmp_path: Path) -> None:
    simulation, design = simulated("jumps", fmus, tmp_path, precision="float")
    double = Execution(Options("double", Steps((0.05,))).program(design))
    rows = rows_of(simulation.program, typed_gains(design), np.random.default_rng(5), 100)
    initial = [-np.ones(2), np.ones(2)]
    simulation.begin(*initial)
    state = double.start(*initial)
    for row in rows:
        simulation.put(row)
        simulation.step(0.05)
        state, inner = double.step(state, row)
        outer, status = simulation.answer()
        assert status < 8
        assert (outer <= inner).all()
        assert (inner - outer < 1e-3).all()


def test_source_compiles_where_it_is_imported(fmus: Path, tmp_path: Path) -> None:
    build = pytest.importorskip("fmpy.build", reason="the extra `fmu` is not installed")
    require("cmake")
    path, *_ = exported("point", fmus)
    with zipfile.ZipFile(path) as archive:
        names = [name for name in archive.namelist() if not name.startswith("binaries")]
        archive.extractall(tmp_path / "unzipped", names)
    (tmp_path / "build").mkdir()
    build.build_platform_binary(tmp_path / "unzipped", tmp_path / "build", all_warnings=True)
    assert list((tmp_path / "unzipped" / "binaries").glob("*/obs.so"))


def test_fmpy_simulates_a_record(fmus: Path, tmp_path: Path) -> None:
    """Columns of the data are inputs by their names."""
    fmpy = pytest.importorskip("fmpy", reason="the extra `fmu` is not installed")
    path, design, _ = exported("point_smooth", fmus)
    times = 0.05 * np.arange(21)
    data = np.zeros(21, [("t", float), ("y1", float), ("u1", float), ("has_y", bool)])
    data["t"], data["y1"], data["u1"] = times, np.cos(times), np.sin(times)
    data["has_y"] = True
    results = fmpy.simulate_fmu(str(path), stop_time=1.0, output_interval=0.05, input=data)
    observer = from_design(design)
    state = observer.start(0.0, None)
    for k, t in enumerate(times[:-1]):
        sample = Sample(float(t), data["y1"][k : k + 1], data["u1"][k : k + 1])
        state, estimate = observer.step(state, sample)
        assert estimate.x is not None
        # a row is read one communication step later
        assert abs(results["x1"][k + 1] - estimate.x[0]) < 1e-14
    assert not results["status"].any()


def test_equal_designs_give_equal_bytes(fmus: Path, tmp_path: Path) -> None:
    path, design, options = exported("point", fmus)
    write_fmu(design, tmp_path / "again.fmu", options)
    assert (tmp_path / "again.fmu").read_bytes() == path.read_bytes()


def invoke(*words: object) -> Result:
    return CliRunner().invoke(cli, [str(word) for word in words], standalone_mode=False)


def test_the_command(academic_design: Path, tmp_path: Path) -> None:
    target = tmp_path / "a.fmu"
    words = ["export", academic_design, "--to", "fmu", "--steps", "0.05", "-o", target]
    done = invoke(*words)
    assert done.exception is None
    assert "FMI 3.0, kind interval in double" in done.stdout
    assert "a library for" in done.stdout
    assert "FMI 2.0" in invoke(*words, "--fmi", "2.0").stdout


def test_without_a_compiler_there_is_the_source(
    academic_design: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    target = tmp_path / "a.fmu"
    done = invoke("export", academic_design, "--to", "fmu", "--steps", "0.05", "-o", target)
    assert done.exception is None
    assert "with source alone" in done.stdout
    assert "no C compiler here (no-such-compiler)" in done.stdout
    with zipfile.ZipFile(target) as archive:
        assert not any(name.startswith("binaries") for name in archive.namelist())
        assert "sources/buildDescription.xml" in archive.namelist()
    monkeypatch.setenv("CC", "false")
    done = invoke("export", academic_design, "--to", "fmu", "--steps", "0.05", "-o", target)
    assert "cannot compile the source: no message" in done.stdout


@pytest.mark.parametrize(
    ("words", "part"),
    [
        (["--to", "fmu"], "--steps is missing"),
        (["--to", "fmu", "--steps", "0.1", "--fmi", "1.0"], "--fmi must be 3.0 or 2.0"),
        (["--to", "fmu", "--steps", "0.1", "--fmi", "2.0", "--precision", "float"], "double alone"),
        (["--to", "c", "--steps", "0.1", "--fmi", "2.0"], "--fmi belongs to --to fmu"),
        (["--fmi", "2.0"], "--fmi belongs to --to fmu"),
        (["--to", "fmu", "--steps", "0.1", "-o", "x.zip"], "ends in .fmu"),
    ],
)
def test_refusals(academic_design: Path, words: list[str], part: str, tmp_path: Path) -> None:
    target = tmp_path / "x.fmu"
    done = invoke("export", academic_design, "-o", target, *words)
    assert isinstance(done.exception, InputError)
    assert part in str(done.exception)
    assert not target.exists()
