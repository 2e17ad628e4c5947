"""Exported code as a shared library, and the compilers that tests know."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from obsdesign.document import Design
from obsdesign.export.execution import Row
from obsdesign.export.folder import write_code
from obsdesign.export.manifest import Options
from obsdesign.export.program import Program

STRICT = (
    "-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Wshadow", "-pedantic",
    "-Werror",
)  # fmt: skip
SANITIZED = ("-fsanitize=undefined,address", "-fno-sanitize-recover")


def require(compiler: str) -> str:
    """The path of a compiler; the test is skipped where there is none."""
    path = shutil.which(compiler)
    if path is None:
        pytest.skip(f"{compiler} is not installed")
    return path


def compiled(folder: Path, compiler: str, *flags: str, output: str = "a.out") -> Path:
    """A program from the source and the self-test of a folder."""
    words = [require(compiler), *flags, "obs.c", "obs_test.c", "-o", output]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder / output


class Library:
    """The observer of a folder, without fused multiplication unless flags say so."""

    def __init__(self, folder: Path, design: Design, options: Options, *flags: str) -> None:
        write_code(design, folder, options)
        self.program = options.program(design)
        words = flags or ("-O2", "-ffp-contract=off")
        subprocess.run(
            [require("gcc"), *STRICT, *words, "-shared", "-fPIC", "obs.c", "-o", "obs.so"],
            cwd=folder, check=True,
        )  # fmt: skip
        self._library = ctypes.CDLL(str(folder / "obs.so"))
        self._state = ctypes.create_string_buffer(4096)
        self.real: Any = ctypes.c_float if options.precision == "float" else ctypes.c_double
        self._sample = _sample_type(self.program, self.real)
        self._estimate = _estimate_type(self.program, self.real)

    @property
    def digest(self) -> str:
        """What the object file says of its design."""
        return ctypes.string_at(
            ctypes.addressof(ctypes.c_char.in_dll(self._library, "obs_digest"))
        ).decode()

    def start(self, *initial: Any) -> None:
        """Begin with bounds, or with an estimate."""
        n = self.program.sizes.n
        self._library.obs_init(self._state, *((self.real * n)(*each) for each in initial))

    def step(self, row: Row, *, h: float | None = None) -> tuple[Any, int]:
        """[lower; -upper] or x after a row, and its status; h: another length than the listed."""
        program = self.program
        length = program.timing.lengths[row.step - 1] if row.step else 0.0
        sample = self._sample(h=length if h is None else h, has_y=row.y is not None)
        for name in ("y", "u", "w"):
            values = getattr(row, name)
            if values is not None and len(values):
                getattr(sample, name)[:] = values.tolist()
        if program.jumps:
            sample.jump = row.jump
        estimate = self._estimate()
        self._library.obs_step(self._state, ctypes.byref(sample), ctypes.byref(estimate))
        if not program.has_bounds:
            return np.array([*estimate.x, *(estimate.d if program.q else ())]), estimate.status
        return np.concatenate([estimate.lower, -np.array(estimate.upper)]), estimate.status


def _sample_type(program: Program, real: Any) -> Any:
    sizes = program.sizes
    fields: list[Any] = [("h", real), ("y", real * sizes.p)]
    fields += [("u", real * sizes.m)] if sizes.m else []
    fields += [("w", real * sizes.l)] if program.jumps and sizes.l else []
    fields += [("has_y", ctypes.c_bool)]
    fields += [("jump", ctypes.c_bool)] if program.jumps else []
    return type("Sample", (ctypes.Structure,), {"_fields_": fields})


def _estimate_type(program: Program, real: Any) -> Any:
    names = ("lower", "upper") if program.has_bounds else ("x",)
    fields = [(name, real * program.sizes.n) for name in names]
    fields += [("d", real * program.q), ("has_d", ctypes.c_bool)] if program.q else []
    return type(
        "Estimate", (ctypes.Structure,), {"_fields_": [*fields, ("status", ctypes.c_uint32)]}
    )
