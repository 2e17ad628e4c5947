"""The C compiler of this machine: shared libraries from exported source."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

from obsdesign.errors import InputError
from obsdesign.output_files import temporary_folder, write_text

# names of compilers on the path, the first that is there
_COMPILERS = ("cc", "gcc", "clang")
# the last flag keeps the results those of `execution.py`, bit for bit
_FLAGS = ("-std=c99", "-O2", "-fPIC", "-shared", "-ffp-contract=off")
_SUFFIXES = {"linux": ".so", "darwin": ".dylib", "windows": ".dll"}
_MACHINES = {"x86_64": "x86_64", "amd64": "x86_64", "aarch64": "aarch64", "arm64": "aarch64"}


def compiler() -> str:
    """The compiler: $CC, or the first that is there; InputError where there is none."""
    stated = os.environ.get("CC")
    names = (stated,) if stated else _COMPILERS
    for name in names:
        path = shutil.which(name)
        if path is not None:
            return path
    raise InputError(f"no C compiler here ({', '.join(names)}); install one, or set CC.")


def machine() -> tuple[str, str]:
    """Processor and system as FMI 3.0 names them, ("x86_64", "linux")."""
    name = platform.machine().lower()
    system = "windows" if sys.platform == "win32" else sys.platform
    return _MACHINES.get(name, name), system


def library_suffix() -> str:
    """How names of shared libraries end here."""
    return _SUFFIXES.get(machine()[1], ".so")


def shared_library(texts: Mapping[str, str], *flags: str) -> bytes:
    """A shared library of source files and headers by name; InputError where none is built."""
    program = compiler()
    with temporary_folder() as folder:
        for name, text in texts.items():
            write_text(Path(folder) / name, text)
        sources = [name for name in texts if name.endswith(".c")]
        words = [program, *_FLAGS, *flags, *sources, "-o", "library"]
        try:
            done = subprocess.run(words, cwd=folder, capture_output=True, text=True)
        except OSError as error:
            raise InputError(f"{program} cannot be run: {error.strerror}.") from None
        if done.returncode != 0:
            reason = (done.stderr.strip().splitlines() or ["no message"])[0]
            raise InputError(f"{program} cannot compile the source: {reason}")
        return (Path(folder) / "library").read_bytes()
