"""A folder for whoever must sign: a design, the programs that check it, and how to run them."""

from __future__ import annotations

import os
from pathlib import Path

from obsdesign.document import Design
from obsdesign.errors import InputError
from obsdesign.output_files import write_text
from obsdesign.verification.second_opinion import PROGRAMS, Answer, answers

_COMMAND = "python3 -I -S check_design.py design.json && python3 -I -S check_gains.py design.json"
_README = """\
{name}: observer of kind {kind}

design.json       problem, gains, claims with their certificates
check_design.py   proves from design.json alone that the error of the observer tends to zero
check_gains.py    compares the gains with the problem in the same file

Both programs need Python 3.8 or later and its standard library, nothing else, and are meant to be
read before they are trusted: about 500 and 230 lines of code, with the inequality of each step.

    {command}

Exit code 0: proved. 1: not proved. 2: a design that they do not read. What they do not check, they
say: widths, rates and all sentences of the file are proved by `obsdesign verify design.json`.

When this folder was written, they answered:

{answers}

digest of design.json: {digest}
"""


def write_bundle(design: Design, folder: str | os.PathLike[str]) -> tuple[Answer, ...]:
    """Write design, programs and README.txt into a folder; return what the programs answer.

    The folder is made where there is none. InputError where it cannot be written.
    """
    path = Path(folder)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror}.") from None
    design.save(path / "design.json")
    for program in PROGRAMS:
        write_text(path / program.name, program.read_text("utf-8"))
    opinions = answers(design)
    lines = [f"    {line}" for opinion in opinions for line in opinion.lines]
    text = _README.format(
        name=design.name, kind=design.kind, command=_COMMAND, answers="\n".join(lines),
        digest=design.digest,
    )  # fmt: skip
    write_text(path / "README.txt", text)
    return opinions
