"""Writing files: whole or not at all, and never over one that is read."""

from __future__ import annotations

import os
import signal
import stat
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from obsdesign.errors import InputError

# signals that end a program from outside; not every system has both
_ENDING = ("SIGTERM", "SIGHUP")


def refuse_overwriting(target: str | None, *sources: str | None) -> None:
    """InputError if a file to be written is one that is read, or cannot be a file at all."""
    if target is None:
        return
    if not target:
        raise InputError("an output file must have a name; got an empty one.")
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


def write_bytes(path: str | os.PathLike[str], content: bytes) -> None:
    """Write a whole file that is no text, or leave the old one."""
    with replacing(path) as file:
        file.buffer.write(content)


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[TextIO]:
    """A file that appears at `path` only when all of it is written.

    It keeps the mode of the file it replaces; a new one gets what the umask leaves. Links are
    followed; a device or a pipe is written to as it is. Whatever ends the block, SIGTERM and SIGHUP
    included, leaves no temporary file. InputError when it cannot be written.
    """
    target = _resolved(path)
    try:
        if os.path.exists(path) and not target.is_file():
            # a device or a pipe, whose resolved name may be none: /dev/stdout
            with open(path, "w", encoding="utf-8") as stream:
                yield stream
            return
        with _temporary_file(target) as file:
            yield file
    except BrokenPipeError:  # of another stream: who reads our output left
        raise
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}.") from None


@contextmanager
def _temporary_file(target: Path) -> Iterator[TextIO]:
    """A new file in the folder of `target`, which it replaces when the block ends well."""
    name = target.with_name(f".obsdesign-{os.urandom(8).hex()}")
    with unwinding_signals():
        try:
            # opened by name, not by `tempfile`: the system then applies umask and default rights
            with name.open("x", encoding="utf-8", newline="") as file:
                if target.exists():
                    os.chmod(name, stat.S_IMODE(target.stat().st_mode))
                yield file
            os.replace(name, target)
        except BaseException:
            name.unlink(missing_ok=True)
            raise


@contextmanager
def temporary_folder() -> Iterator[str]:
    """A folder that is gone when the block ends, by SIGTERM and SIGHUP too."""
    import tempfile  # slow to import, and rarely needed

    with unwinding_signals(), tempfile.TemporaryDirectory() as folder:
        yield folder


@contextmanager
def unwinding_signals() -> Iterator[None]:
    """SIGTERM and SIGHUP end the block as exceptions do, with exit code 143 or 129.

    Only where they would end the process at once: handlers of a caller are kept, and so is
    `nohup`. Without effect outside the main thread, which is the one that signals interrupt.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    numbers = [getattr(signal, name) for name in _ENDING if hasattr(signal, name)]
    ours = [number for number in numbers if signal.getsignal(number) is signal.SIG_DFL]
    for number in ours:
        signal.signal(number, _unwind)
    try:
        yield
    finally:
        for number in ours:
            signal.signal(number, signal.SIG_DFL)


def _unwind(number: int, frame: object) -> None:
    raise SystemExit(128 + number)
