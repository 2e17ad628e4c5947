"""Writing files: whole or not at all, and never over one that is read."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from obsdesign.errors import InputError


def refuse_overwriting(target: str | None, *sources: str | None) -> None:
    """InputError if a file to be written is one that is read, or cannot be a file at all."""
    if target is None:
        return
    path = Path(target)
    if path.is_dir() or not path.absolute().parent.is_dir():
        raise InputError(f"{target}: cannot be written: no such folder, or a folder itself.")
    for source in sources:
        if source is not None and _resolved(path) == _resolved(source):
            raise InputError(f"{target}: cannot be written: it is one of the files that are read.")


def _resolved(path: str | os.PathLike[str]) -> Path:
    """The file behind links; InputError where they lead in a circle."""
    try:
        return Path(path).resolve()
    except (RuntimeError, OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be written: {error}.") from None


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write a whole file or leave the old one."""
    with replacing(path) as file:
        file.write(text if text.endswith("\n") else text + "\n")


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[TextIO]:
    """A file that appears at `path` only when all of it is written.

    Links are followed; a device or a pipe is written to as it is. InputError when it cannot be.
    """
    target = _resolved(path)
    try:
        if target.exists() and not target.is_file():
            with target.open("w", encoding="utf-8") as stream:
                yield stream
            return
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}.") from None
    try:
        with os.fdopen(handle, "w", encoding="utf-8", newline="") as file:
            yield file
        os.chmod(name, 0o644)
        os.replace(name, target)
    except BaseException as error:
        Path(name).unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise InputError(f"{path}: cannot be written: {error.strerror}.") from None
        raise
