"""The source compiles without a warning anywhere, and its self-test agrees with the runtime."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

from obsdesign.export.execution import Execution
from obsdesign.export.folder import write_code
from obsdesign.export.manifest import Options
from obsdesign.export.programs import typed_gains
from obsdesign.export.record import record_of, rows_of
from obsdesign.export.self_test import answers
from obsdesign.export.source import Export
from obsdesign.export.timing import Steps
from obsdesign.runtime import Sample, from_design
from tests.export.plants import PROBLEMS, design_named
from tests.systems.compiled import SANITIZED, STRICT, Library, compiled, require

PRECISIONS = ("double", "float")
ARM = ("-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard")


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("name", PROBLEMS)
def test_self_test_agrees(name: str, precision: str, tmp_path: Path) -> None:
    design, steps = design_named(name)
    write_code(design, tmp_path, Options(precision, Steps(steps)))
    program = compiled(tmp_path, "gcc", *STRICT, "-O1", *SANITIZED)
    done = subprocess.run([program], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "40 rows, 0 failures" in done.stdout


@pytest.mark.parametrize("name", ["jumps", "periodic", "point"])
def test_self_test_notices_another_table(name: str, tmp_path: Path) -> None:
    """The twin: the first number of every row is another one."""
    design, steps = design_named(name)
    write_code(design, tmp_path, Options("double", Steps(steps)))
    source = tmp_path / "obs.c"
    changed = re.sub(r"(?m)^    \{ (-?)0x1", r"    { \g<1>0x3", source.read_text())
    assert changed != source.read_text()
    source.write_text(changed)
    done = subprocess.run([compiled(tmp_path, "gcc", "-std=c99", "-O1")], capture_output=True)
    assert done.returncode == 1


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("name", ["jumps", "periodic_after", "point", "impulses"])
def test_c_is_the_program_bit_for_bit(name: str, precision: str, tmp_path: Path) -> None:
    design, steps = design_named(name)
    library = Library(tmp_path, design, Options(precision, Steps(steps)))
    assert library.digest == design.digest
    program = library.program
    execution = Execution(program)
    record = record_of(design, program, typed_gains(design))
    library.start(*record.initial)
    state = execution.start(*record.initial)
    for row, is_ok in zip(record.rows, record.is_ok, strict=True):
        ends, status = library.step(row)
        state, wanted = execution.step(state, row)
        assert np.array_equal(ends, wanted.astype(np.float64))
        assert (status == 0) is is_ok


@pytest.mark.parametrize(
    "name",
    ["point", "point_after", "impulses", "impulses_equal", "window_driven", "window_jumps"],
)
def test_point_estimates_are_those_of_the_runtime(name: str) -> None:
    design, steps = design_named(name)
    program, observer = Options("double", Steps(steps)).program(design), from_design(design)
    rows = rows_of(program, typed_gains(design), np.random.default_rng(7), 300)
    execution, ticks = Execution(program), 0
    state, theirs = execution.start(np.zeros(program.sizes.n)), observer.start(0.0, None)
    for row in rows:
        ticks += program.timing.ticks[row.step - 1] if row.step else 0
        t = float(ticks * program.timing.tick)
        state, x = execution.step(state, row)
        theirs, estimate = observer.step(theirs, Sample(t, row.y, row.u, row.w, row.jump))
        assert estimate.x is not None
        assert np.abs(x - estimate.x).max() < 1e-10 * (1 + np.abs(estimate.x).max())


@pytest.mark.parametrize(
    "name", ["continuous", "jumps", "jumps_after", "periodic", "periodic_jumps"]
)
def test_float_encloses_double(name: str) -> None:
    design, steps = design_named(name)
    single, double = (
        Options(precision, Steps(steps)).program(design) for precision in ("float", "double")
    )
    rows = rows_of(single, typed_gains(design), np.random.default_rng(5), 300)
    narrow, wide = Execution(double), Execution(single)
    initial = [-np.ones(2), np.ones(2)]
    first, second = narrow.start(*initial), wide.start(*initial)
    for row in rows:
        first, inner = narrow.step(first, row)
        second, outer = wide.step(second, row)
        assert (outer <= inner).all()
        assert (inner - outer < 1e-3).all()


@pytest.mark.parametrize("name", PROBLEMS)
def test_double_is_the_runtime_up_to_rounding(name: str) -> None:
    """Bounds are wider by rounding alone, and narrower by errors of time stamps alone."""
    design, steps = design_named(name)
    program = Options("double", Steps(steps)).program(design)
    record = record_of(design, program, typed_gains(design))
    ours = answers(Export(program, "", design.digest, "obs", {}), record)
    size = 1.0 + np.abs(record.ends).max(axis=0)
    assert ((record.ends - ours) / size).max() < 1e-13
    assert ((ours - record.ends) / size).max() < 1e-11


@pytest.mark.parametrize("flag", ["-ffast-math", "-ffinite-math-only", "-Ofast"])
def test_fast_math_does_not_compile(flag: str, tmp_path: Path) -> None:
    design, steps = design_named("jumps")
    write_code(design, tmp_path, Options("double", Steps(steps)))
    words = [require("gcc"), "-std=c99", flag, "-c", "obs.c", "-o", "o.o"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode != 0
    assert "guarantee" in done.stderr
    assert subprocess.run([*words[:2], "-O3", *words[3:]], cwd=tmp_path).returncode == 0


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("name", ["jumps_after", "periodic_unseen", "point"])
def test_other_compilers_and_checkers(name: str, precision: str, tmp_path: Path) -> None:
    design, steps = design_named(name)
    write_code(design, tmp_path, Options(precision, Steps(steps)))
    done = subprocess.run([compiled(tmp_path, "clang", *STRICT, "-O2", "-ffp-contract=fast")])
    assert done.returncode == 0


def test_cortex_m4(tmp_path: Path) -> None:
    compiler = require("arm-none-eabi-gcc")
    design, steps = design_named("periodic")
    write_code(design, tmp_path, Options("float", Steps(steps)))
    words = [compiler, *STRICT, *ARM, "-Os", "-c", "obs.c", "-o", "o.o"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_on_arm_in_an_emulator(tmp_path: Path) -> None:
    emulator = require("qemu-arm")
    design, steps = design_named("jumps")
    write_code(design, tmp_path, Options("float", Steps(steps)))
    program = compiled(
        tmp_path, "arm-linux-gnueabihf-gcc", *STRICT, "-O2", "-static", "-mfpu=neon-vfpv4"
    )
    assert subprocess.run([emulator, program], capture_output=True).returncode == 0


def test_static_checker_has_no_objection(tmp_path: Path) -> None:
    checker = require("cppcheck")
    design, steps = design_named("periodic_unseen")
    write_code(design, tmp_path, Options("double", Steps(steps)))
    words = [checker, "--std=c99", "--enable=warning,performance,portability", "--error-exitcode=1",
             "-DFLT_RADIX=2", "-DDBL_MANT_DIG=53", "--quiet", "obs.c"]  # fmt: skip
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
