"""What the programs of the checker are: small, of the standard library, and used by nobody."""

from __future__ import annotations

import ast
import copy
import io
import json
import re
import subprocess
import sys
import tokenize
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

import obsdesign
from obsdesign.checker import check_design
from tests.systems.checked import (
    CHECK_DESIGN,
    CHECK_EVENTS,
    CHECK_GAINS,
    CHECK_SETS,
    CHECK_WIDTHS,
    FOLDER,
    answer,
    body,
    changed,
    evidence,
    exit_code,
)

PROGRAMS = (
    CHECK_DESIGN, CHECK_WIDTHS, CHECK_GAINS, FOLDER / "check_uncertain.py", CHECK_EVENTS,
    CHECK_SETS,
)  # fmt: skip
MOST_LINES = 500


def code_lines(text: str) -> int:
    """Lines that hold code: neither blank nor comment nor docstring."""
    prose: set[int] = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(
            node
        ):
            prose |= set(range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1))
    silent = (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT,
              tokenize.ENDMARKER)  # fmt: skip
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in silent:
            lines |= set(range(token.start[0], token.end[0] + 1))
    return len(lines - prose)


def test_lines_of_code_are_counted() -> None:
    text = '"""Text.\n\nMore."""\n\n# why\nx = (\n    1,\n)\n\n\ndef f():\n    """Text."""\n    return x\n'
    assert code_lines(text) == 5


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda path: path.stem)
def test_it_can_be_read_before_lunch(program: Path) -> None:
    text = program.read_text("utf-8")
    assert code_lines(text) <= MOST_LINES
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef):
            assert ast.get_docstring(node) or node.name == "__init__", node.name


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda path: path.stem)
def test_it_needs_python_3_8_and_its_standard_library_alone(program: Path) -> None:
    tree = ast.parse(program.read_text("utf-8"), feature_version=(3, 8))
    since_3_8 = {"hashlib", "itertools", "json", "math", "sys", "fractions", "operator", "typing"}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            assert {alias.name for alias in node.names} <= since_3_8
        assert not isinstance(node, ast.ImportFrom) or node.module in since_3_8
        assert not isinstance(node, ast.Assert)  # python -O would drop it


def test_the_circles_of_trust_are_as_large_as_their_page_says(tmp_path: Path) -> None:
    root = FOLDER.parents[1]
    page = (root / "docs" / "proofs.md").read_text("utf-8")
    rows = re.findall(r"^\| [123]\. .*? \| ([\d ,]+) \|", page, re.MULTILINE)
    stated = [int(number.replace(" ", "")) for row in rows for number in row.split(",")]
    path = tmp_path / "design.json"
    path.write_text(json.dumps(body("cooperative")), "utf-8")
    program = (
        "import sys, obsdesign\nfrom obsdesign.design_file import load_design\n"
        f"obsdesign.verify(load_design({str(path)!r}))\n"
        "print(*(m.__file__ for m in list(sys.modules.values()) if getattr(m, '__name__', '')"
        ".split('.')[0] in ('obsdesign', 'lmi') and m.__file__), sep='\\n')"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    everything = [*(root / "lmi").rglob("*.py"), *(root / "obsdesign").rglob("*.py")]
    counted = [code_lines(path.read_text("utf-8")) for path in PROGRAMS]
    for paths in (map(Path, done.stdout.splitlines()), everything):
        counted.append(sum(code_lines(path.read_text("utf-8")) for path in paths))
    assert len(stated) == len(counted) == 8
    for line_count, page_count in zip(counted, stated, strict=True):
        assert abs(line_count - page_count) <= 0.1 * page_count


def test_the_numbers_of_the_coq_proof_prove_a_design() -> None:
    """docs/coq/degue_4_2.v is about the example: its P serves the example's design."""
    root = FOLDER.parents[1]
    text = (root / "docs" / "coq" / "degue_4_2.v").read_text("utf-8")
    stated = dict(re.findall(r"Definition (p\d\d|n22) := (\d+ / \d+)\.", text))
    number = {name: Fraction(value.replace(" ", "")) for name, value in stated.items()}
    problem = obsdesign.load_problem(root / "examples" / "degue_4_2.toml")
    document = copy.deepcopy(obsdesign.design(problem).to_dict())
    gains = {name: np.array(value) for name, value in document["gains"].items()}
    assert (gains["Gp"] + gains["Gn"]).tolist() == [[0.0, 0.0], [0.0, float(number["n22"])]]
    assert (gains["D0"] + gains["D1"]).tolist() == [[-3.0, 1.0], [0.0, 0.0]]
    P = [[number["p11"], number["p12"]], [number["p12"], number["p22"]]]
    floats = [[float(entry) for entry in row] for row in P]
    assert [[Fraction(entry) for entry in row] for row in floats] == P
    changes = changed(document, lambda d: evidence(d).update(P=floats))
    assert exit_code(changes, check_design) == 0


def test_nobody_imports_it() -> None:
    root = FOLDER.parents[1]
    for path in (*(root / "lmi").rglob("*.py"), *(root / "obsdesign").rglob("*.py")):
        text = path.read_text("utf-8")
        for node in ast.walk(ast.parse(text)) if "checker" in text else ():
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not any(name.startswith("obsdesign.checker") for name in names), path


def test_optimised_python_checks_the_digest_too(tmp_path: Path) -> None:
    path = tmp_path / "design.json"
    document = body("cooperative")
    document["name"] = "another"
    assert answer(document) == (2, "not read: the digest is not that of the content\n")
    path.write_text(json.dumps(document), "utf-8")
    for program in PROGRAMS:
        done = subprocess.run(
            [sys.executable, "-O", "-I", "-S", str(program), str(path)], check=False
        )
        assert done.returncode == 2


def test_usage_and_files_that_cannot_be_read(tmp_path: Path) -> None:
    for program in PROGRAMS:
        command = [sys.executable, "-I", "-S", str(program)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 2
        assert "python3 -I -S" in done.stdout
        missing = str(tmp_path / "missing.json")
        done = subprocess.run([*command, missing], capture_output=True, text=True, check=False)
        assert done.returncode == 2
        assert "Traceback" not in done.stderr
