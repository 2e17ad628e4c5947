"""Files appear whole or not at all, with the rights a shell would give them, and nothing beside them."""

from __future__ import annotations

import ast
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

import obsdesign
from obsdesign.document import digest
from obsdesign.interop import save_mat
from obsdesign.output_files import replacing, temporary_folder, unwinding_signals, write_text
from obsdesign.pages.plotting.style import picture
from tests.systems.command_line import command
from tests.test_architecture import FILES, module


@contextmanager
def umask(mask: int) -> Iterator[None]:
    before = os.umask(mask)
    try:
        yield
    finally:
        os.umask(before)


def draw(path: str) -> None:
    with picture(2.0, 2.0, path) as figure:
        figure.subplots().plot([0, 1])


def rights(path: Path) -> int:
    return path.stat().st_mode & 0o7777


@pytest.mark.parametrize("name", ["text.csv", "picture.png", "picture.svg", "gains.mat"])
def test_rights_are_those_of_the_umask_or_of_the_old_file(
    name: str, academic_design: Path, tmp_path: Path
) -> None:
    path = tmp_path / name
    design = obsdesign.load_design(academic_design)
    write: Any = {
        ".csv": lambda: write_text(path, "t\n"),
        ".mat": lambda: save_mat(design, path),
    }.get(path.suffix, lambda: draw(str(path)))
    for mask, expected in ((0o022, 0o644), (0o077, 0o600), (0o002, 0o664)):
        path.unlink(missing_ok=True)
        with umask(mask):
            write()
        assert rights(path) == expected
    for mode in (0o600, 0o640, 0o755):
        path.chmod(mode)
        write()
        assert rights(path) == mode
    assert [entry.name for entry in tmp_path.iterdir()] == [name]


def test_a_picture_that_fails_leaves_the_old_one(tmp_path: Path) -> None:
    path = tmp_path / "old.png"
    path.write_text("old")
    with pytest.raises(ZeroDivisionError), picture(2.0, 2.0, str(path)):
        raise ZeroDivisionError
    with pytest.raises(ZeroDivisionError), replacing(path) as file:
        raise ZeroDivisionError(file.write("half"))
    assert path.read_text() == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["old.png"]


@pytest.fixture(autouse=True)
def hangup_ends() -> Iterator[None]:
    """SIGHUP ends a process, also where the tests were started by `nohup`."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGHUP])
def test_a_run_that_is_ended_leaves_nothing(
    how: signal.Signals, academic_design: Path, tmp_path: Path
) -> None:
    (tmp_path / "est.csv").write_text("old")
    arguments = ("run", str(academic_design), "--initial", "0,2,0,2", "-o", "est.csv")
    code = "from obsdesign.cli.main import main; main()"
    with subprocess.Popen(
        [sys.executable, "-c", code, *arguments], cwd=tmp_path, stdin=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True,
    ) as run:  # fmt: skip
        run.stdin.write("t,y1,jump\n0,1,0\n")
        run.stdin.flush()
        while len(list(tmp_path.iterdir())) < 2:
            assert run.poll() is None
            time.sleep(0.01)
        run.send_signal(how)
        err = run.stderr.read()
    assert (run.returncode, err) == (128 + how, "")
    assert [entry.name for entry in tmp_path.iterdir()] == ["est.csv"]
    assert (tmp_path / "est.csv").read_text() == "old"


def test_a_folder_goes_with_the_block_that_a_signal_ends() -> None:
    for how in (signal.SIGTERM, signal.SIGHUP):
        with pytest.raises(SystemExit) as end, temporary_folder() as folder:
            os.kill(os.getpid(), how)
        assert end.value.code == 128 + how
        assert not Path(folder).exists()
        assert signal.getsignal(how) is signal.SIG_DFL


def test_handlers_of_a_caller_are_kept() -> None:
    """`nohup` ignores SIGHUP, and goes on doing so."""
    for handler in (signal.SIG_IGN, lambda *_: None):
        before = signal.signal(signal.SIGHUP, handler)
        try:
            with unwinding_signals():
                assert signal.getsignal(signal.SIGHUP) is handler
                os.kill(os.getpid(), signal.SIGHUP)
            assert signal.getsignal(signal.SIGHUP) is handler
        finally:
            signal.signal(signal.SIGHUP, before)


def test_there_is_one_writer() -> None:
    """A sweep grows line by line; every other file goes through `output_files`."""
    for path in FILES:
        if module(path) in ("obsdesign.output_files", "obsdesign.studies.sweep.record"):
            continue
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if not isinstance(node, ast.Call):
                continue
            name = getattr(node.func, "attr", getattr(node.func, "id", ""))
            own = isinstance(node.func, ast.Attribute)
            assert not (own and name in ("write_text", "write_bytes", "mkstemp")), module(path)
            modes = [a.value for a in node.args[1:2] if isinstance(a, ast.Constant)]
            assert not (name == "open" and set("wax+") & set("".join(modes))), module(path)


def test_a_changed_design_is_not_drawn(tmp_path: Path) -> None:
    body = windowed()
    (tmp_path / "d.json").write_text(json.dumps(body))
    done = command("plot", "d.json", "-o", "d.png", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (0, "written: d.png\n")
    (tmp_path / "d.png").unlink()
    for change in ({"name": "x"}, {"format": "x"}):
        (tmp_path / "d.json").write_text(json.dumps(body | change))
        done = command("plot", "d.json", "-o", "d.png", cwd=tmp_path)
        assert (done.returncode, done.stdout) == (2, "")
        assert len(done.stderr.splitlines()) == 1
        assert done.stderr.startswith("obsdesign: d.json: ")
        assert not (tmp_path / "d.png").exists()


def windowed() -> dict[str, Any]:
    """A signed design with windows of dwell times; nothing in it has to be true."""
    evidence = {"windows": [{"dwell": {"-1": [0.4, 1.0]}, "P": [[1.0]]}]}
    claim = {"id": "a", "statement": "", "source": "", "verdict": "proved", "evidence": evidence}
    body: dict[str, Any] = {
        "format": "obsdesign/design", "version": 1, "name": "", "kind": "interval", "problem": {},
        "gains": {}, "claims": [claim], "guarantees": [], "provenance": {},
    }  # fmt: skip
    return body | {"digest": digest(body)}
