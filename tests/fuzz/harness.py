"""The command line in one process, and what must hold of every call whatever the input."""

from __future__ import annotations

import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.systems.command_line import command

_MOST_ERROR_LINES = 2
_SKIPPED = " skipped."  # how a remark on a row that is left out ends
SECONDS = 20.0


@dataclass(frozen=True)
class Case:
    """Input files, one call of the command line, and the files that it may write."""

    name: str
    files: Mapping[str, bytes]
    arguments: Sequence[str]
    stdin: str = ""
    outputs: tuple[str, ...] = ()
    # the call must not end in "proved" (exit code 0)
    never_proved: bool = False


@dataclass(frozen=True)
class Outcome:
    """How a call ended."""

    code: int
    out: str
    err: str
    seconds: float


def call(case: Case, folder: Path) -> Outcome:
    """Run the command line in a folder; exceptions that leave it are not caught."""
    start = time.process_time()
    done = command(*case.arguments, cwd=folder, stdin=case.stdin)
    seconds = time.process_time() - start
    return Outcome(done.returncode, done.stdout, done.stderr, seconds)


def judged(case: Case, folder: Path) -> tuple[int, list[str]]:
    """(exit code, what is wrong with it, one line each). The folder is empty before and after."""
    for name, content in case.files.items():
        (folder / name).write_bytes(content)
    outcome = call(case, folder)
    faults = [line for line in outcome.err.splitlines() if "Warning" in line]
    if outcome.code not in ((0, 1, 2, 3, 4) if "--strict" in case.arguments else (0, 1, 2, 3)):
        faults.append(f"exit code {outcome.code}: {outcome.err.strip()[-300:]}")
    if "Traceback" in outcome.err or "Traceback" in outcome.out:
        faults.append("traceback")
    if outcome.code == 2:
        faults += refusal_faults(case, outcome)
    if case.never_proved and outcome.code == 0:
        faults.append("proved, although it differs")
    if outcome.seconds > SECONDS:
        faults.append(f"{outcome.seconds:.0f} s of processor time")
    faults += _files(case, folder, outcome.code)
    for path in folder.iterdir():
        path.unlink()
    return outcome.code, faults


def refusal_faults(case: Case, outcome: Outcome) -> list[str]:
    """What is wrong with a call that ended with exit code 2: one line of a message, no output."""
    faults = []
    lines = [line for line in outcome.err.splitlines() if "still " not in line]
    # rows that were left out before the error: a line for each
    errors = [line for line in lines if not line.endswith(_SKIPPED)]
    if outcome.out and not case.stdin:  # a pipe is answered row by row
        faults.append(f"exit code 2 with output: {outcome.out[:80]!r}")
    if not 1 <= len(errors) <= _MOST_ERROR_LINES:
        faults.append(f"exit code 2 with {len(errors)} lines on standard error")
    if any(not line.startswith("obsdesign: ") or len(line) > 2000 for line in lines):
        faults.append(f"not one line of a message: {outcome.err[:200]!r}")
    return faults


def _files(case: Case, folder: Path, code: int) -> list[str]:
    """Inputs are untouched, nothing is left over, outputs are whole."""
    faults = []
    for path in folder.iterdir():
        if path.name in case.files:
            if path.read_bytes() != case.files[path.name]:
                faults.append(f"{path.name} was changed")
        elif path.name not in case.outputs:
            faults.append(f"left over: {path.name}")
        elif code == 2:
            faults.append(f"{path.name} was written with exit code 2")
        elif path.suffix in (".csv", ".json") and not path.read_bytes().endswith(b"\n"):
            faults.append(f"{path.name} is not whole")
    return faults


def shape(fault: str) -> str:
    """A fault without its numbers: what is counted as one."""
    return re.sub(r"[-+]?\d[\d.e+-]*", "#", fault)[:160]
