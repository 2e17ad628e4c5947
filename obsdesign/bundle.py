"""A folder for whoever must sign: a design, the programs that check it, and how to run them."""

from __future__ import annotations

import os
from pathlib import Path

from obsdesign.document import Design
from obsdesign.errors import InputError
from obsdesign.output_files import write_text
from obsdesign.verification.second_opinion import Answer, answers

_PURPOSE = {
    "check_design.py": "proves from design.json alone that the error of the observer tends to zero",
    "check_widths.py": "proves from design.json alone how narrow the bounds become",
    "check_gains.py": "compares the gains with the problem in the same file",
    "check_uncertain.py": "proves that the plant is stable for all its parameters",
    "check_events.py": "proves for events and sensors on clocks of their own that widths decay",
    "check_sets.py": "proves how narrow set-membership bounds become on their nominal pattern",
}
_README = """\
{name}: observer of kind {kind}

{files}

These programs need Python 3.8 or later and its standard library, nothing else, and are meant to be
read before they are trusted: at most 500 lines of code each, with the inequality of each step.

    {command}

Exit code 0: proved. 1: not proved. 2: a design that they do not read. What they do not check, they
say; `obsdesign verify design.json` proves all claims and sentences of the file.

When this folder was written, they answered:

{answers}

digest of design.json: {digest}
"""


def write_bundle(design: Design, folder: str | os.PathLike[str]) -> tuple[Answer, ...]:
    """Write a design, the programs that read it and README.txt; return what these answer.

    All programs where none reads it. The folder is made where there is none. InputError where it
    cannot be written.
    """
    path = Path(folder)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror}.") from None
    every = answers(design)
    opinions = tuple(opinion for opinion in every if opinion.code != 2) or every
    design.save(path / "design.json")
    for opinion in opinions:
        write_text(path / opinion.program.name, opinion.program.read_text("utf-8"))
    write_text(path / "README.txt", _readme(design, opinions))
    return opinions


def _readme(design: Design, opinions: tuple[Answer, ...]) -> str:
    names = [opinion.program.name for opinion in opinions]
    purpose = {"design.json": "problem, gains, claims with their certificates"} | _PURPOSE
    return _README.format(
        name=design.name,
        kind=design.kind,
        files="\n".join(f"{name:20}{purpose[name]}" for name in ("design.json", *names)),
        command=" && ".join(f"python3 -I -S {name} design.json" for name in names),
        answers="\n".join(f"    {line}" for opinion in opinions for line in opinion.lines),
        digest=design.digest,
    )
