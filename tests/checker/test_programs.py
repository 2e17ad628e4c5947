"""What the programs of the checker are: small, of the standard library, and used by nobody."""

from __future__ import annotations

import ast
import io
import subprocess
import sys
import tokenize
from pathlib import Path

import pytest

from tests.systems.checked import CHECK_DESIGN, CHECK_GAINS, FOLDER, answer, body

PROGRAMS = (CHECK_DESIGN, CHECK_GAINS)
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
    since_3_8 = {"hashlib", "json", "math", "sys", "fractions", "operator", "typing"}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            assert {alias.name for alias in node.names} <= since_3_8
        assert not isinstance(node, ast.ImportFrom) or node.module in since_3_8
        assert not isinstance(node, ast.Assert)  # python -O would drop it


def test_nobody_imports_it() -> None:
    root = FOLDER.parents[1]
    for path in (*(root / "lmi").rglob("*.py"), *(root / "obsdesign").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not any(name.startswith("obsdesign.checker") for name in names), path


def test_optimised_python_checks_the_digest_too(tmp_path: Path) -> None:
    path = tmp_path / "design.json"
    document = body("cooperative")
    document["name"] = "another"
    assert answer(document) == (2, "not read: the digest is not that of the content\n")
    path.write_text(__import__("json").dumps(document), "utf-8")
    for program in PROGRAMS:
        done = subprocess.run(
            [sys.executable, "-O", "-I", "-S", str(program), str(path)], check=False
        )
        assert done.returncode == 2


def test_usage_and_files_that_cannot_be_read(tmp_path: Path) -> None:
    for program in PROGRAMS:
        command = [sys.executable, "-I", "-S", str(program)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 1
        assert "python3 -I -S" in done.stderr
        missing = str(tmp_path / "missing.json")
        done = subprocess.run([*command, missing], capture_output=True, text=True, check=False)
        assert done.returncode == 2
        assert "Traceback" not in done.stderr
