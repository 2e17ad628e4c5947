"""The command line in this process: what a shell starts, without the start of an interpreter."""

from __future__ import annotations

import io
import sys
from contextlib import chdir
from pathlib import Path
from subprocess import CompletedProcess
from unittest import mock

from obsdesign.cli.commands import main


def command(*arguments: object, cwd: Path, stdin: str | bytes = "") -> CompletedProcess[str]:
    """Exit code and streams of `obsdesign ARGUMENTS` in a folder; internal errors have a code.

    Streams are those of a pipe. That a process answers in the same way is seen in
    `tests/test_site.py` and `tests/test_readme.py`.
    """
    words = [*map(str, arguments)]
    data = stdin.encode() if isinstance(stdin, str) else stdin
    out, err = (_stream(errors) for errors in ("strict", "backslashreplace"))
    code: object = None
    with (
        chdir(cwd),
        mock.patch.object(sys, "argv", ["obsdesign", *words]),
        mock.patch.object(sys, "stdin", io.TextIOWrapper(io.BytesIO(data), encoding="utf-8")),
        mock.patch.object(sys, "stdout", out),
        mock.patch.object(sys, "stderr", err),
    ):
        try:
            main()
        except SystemExit as leaving:
            code = leaving.code
    assert isinstance(code, int)
    return CompletedProcess(words, code, _text(out), _text(err))


def _stream(errors: str) -> io.TextIOWrapper:
    return io.TextIOWrapper(io.BytesIO(), encoding="utf-8", errors=errors)


def _text(stream: io.TextIOWrapper) -> str:
    stream.seek(0)
    stream.reconfigure(newline=None)
    return stream.read()
