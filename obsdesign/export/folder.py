"""A folder with a design as C: written, and compared with what the design gives."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from lmi.arithmetic.arrays import NewEntries, Value
from obsdesign.design_file import load_design
from obsdesign.document import Claim, Design
from obsdesign.errors import InputError, naming
from obsdesign.export.manifest import Options, claim_of, manifest_of, options_of
from obsdesign.export.programs import typed_gains
from obsdesign.export.record import record_of
from obsdesign.export.self_test import self_test_words
from obsdesign.export.source import rendered
from obsdesign.input_files import parse_json, read_text
from obsdesign.output_files import write_text

DESIGN, MANIFEST = "design.json", "manifest.json"
# numbers of a file, in C and in JSON
_NUMBER = re.compile(r"-?(?:0x[0-9a-f.]+p[+-]?\d+|\d+\.?\d*(?:e[+-]?\d+)?)f?", re.ASCII)
# parts of themselves by which numbers of another machine differ: its sums have another order
_OTHER_MACHINE = 1e-6


def write_code(design: Design, folder: str | os.PathLike[str], options: Options) -> list[str]:
    """Write a design as C with its manifest and self-test; return the names of the files.

    The folder is made where there is none. InputError for a design that cannot be exported, and
    where the folder cannot be written.
    """
    texts, _ = _texts(design, options)
    path = Path(folder)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror}.") from None
    design.save(path / DESIGN)
    for name, text in texts.items():
        write_text(path / name, text)
    return [DESIGN, *texts]


def _texts(design: Design, options: Options) -> tuple[dict[str, str], Claim]:
    """Texts of all files but the design, by name, and the claim about them."""
    export = options.export(design)
    program = export.program
    record = record_of(design, program, typed_gains(design))
    manifest = manifest_of(export, record, options, design)
    claim = claim_of(program, manifest)
    manifest["claims"] = [claim.to_dict()]
    words = {
        "rows": len(record.rows), "cost": f"{100.0 * manifest['width_cost']:.2g} %",
        "rounding": f"{manifest['rounding_of_a_step']:.2g}",
    }  # fmt: skip
    p = options.prefix
    texts = {
        f"{p}.h": rendered("observer.h.j2", export),
        f"{p}.c": rendered("observer.c.j2", export),
        f"{p}_test.c": rendered("observer_test.c.j2", export, **self_test_words(export, record)),
        "README.md": rendered("README.md.j2", export, **words),
        "CMakeLists.txt": rendered("CMakeLists.txt.j2", export),
        MANIFEST: json.dumps(manifest, indent=1, ensure_ascii=False, allow_nan=False),
    }
    return texts, claim


def code_claim(folder: str | os.PathLike[str]) -> tuple[Design, Claim]:
    """The design of a folder, and the claim that its files are what the design gives.

    InputError where the folder has no design or no manifest.
    """
    path = Path(folder)
    design = load_design(path / DESIGN)
    with naming(path / MANIFEST):
        options = options_of(_manifest(path / MANIFEST), design)
        texts, claim = _texts(design, options)
    worst: NewEntries = {}
    for name, text in texts.items():
        difference = _difference(path / name, text)
        if difference is not None and (not worst or not difference["numbers_only"]):
            worst = {"file": name, **difference}
    return design, _claim(worst, claim)


def _claim(worst: Mapping[str, Value], stated: Claim) -> Claim:
    """The claim of the manifest, for the files that are there."""
    if not worst:
        return stated
    verdict = "undecided" if worst["numbers_only"] else "refuted"
    return replace(stated, verdict=verdict, evidence=dict(worst))


def _manifest(path: Path) -> Value:
    try:
        return parse_json(read_text(path))
    except (ValueError, RecursionError) as error:
        raise InputError(f"not JSON: {error}.") from None


def _difference(path: Path, text: str) -> NewEntries | None:
    """The first line in which a file is not `text`; None where there is none.

    Numbers in their last digits count where nothing else differs.
    """
    try:
        lines = read_text(path).splitlines()
    except InputError as error:
        return {"line": 0, "reason": str(error), "numbers_only": False}
    pairs = _padded(lines, text.splitlines())
    differing = [k for k, (stated, wanted) in enumerate(pairs) if stated != wanted]
    if not differing:
        return None
    others = [k for k in differing if not _differs_in_numbers(*pairs[k])]
    place = (others or differing)[0]
    stated, wanted = map(_short, pairs[place])
    reason = f"{path.name} line {place + 1} has {stated} where the design gives {wanted}"
    if not others:
        reason += "; last digits alone: another machine may sum in another order. Export again here"
    return {"line": place + 1, "reason": reason, "numbers_only": not others}


def _padded(first: Sequence[str], second: Sequence[str]) -> list[tuple[str, str]]:
    length = max(len(first), len(second))
    return [
        (first[k] if k < len(first) else "", second[k] if k < len(second) else "")
        for k in range(length)
    ]


def _differs_in_numbers(first: str, second: str) -> bool:
    """Are two lines equal but for the last digits of their numbers?"""
    if first == second:
        return True
    if _NUMBER.sub("#", first) != _NUMBER.sub("#", second):
        return False
    pairs = zip(_NUMBER.findall(first), _NUMBER.findall(second), strict=True)
    return all(
        abs(a - b) <= _OTHER_MACHINE * abs(b) for a, b in (map(_value, pair) for pair in pairs)
    )


def _value(number: str) -> float:
    text = number.removesuffix("f") if "x" not in number or "p" in number else number
    return float.fromhex(text) if "x" in text else float(text)


def _short(line: str) -> str:
    text = line.strip()
    return repr(text if len(text) <= 60 else text[:57] + "...")
