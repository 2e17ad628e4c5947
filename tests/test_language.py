"""Names are nouns of the field, and a docstring begins with one short line."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
# participles that name no thing: what is it that was found?
BANNED = frozenset({"found", "told", "asked", "seen", "moved"})
LONGEST_FIRST_LINE = 90

FOLDERS = sorted(
    {
        str(path.parent.relative_to(ROOT))
        for package in ("obsdesign", "lmi")
        for path in (ROOT / package).rglob("*.py")
    }
)


def names(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """(line, name) of everything that a file binds or reads from an object."""
    for node in ast.walk(tree):
        match node:
            case ast.Name(id=name, ctx=ast.Store()) | ast.Attribute(attr=name):
                yield node.lineno, name
            case ast.arg(arg=name) | ast.FunctionDef(name=name) | ast.ClassDef(name=name):
                yield node.lineno, name
            case ast.alias(asname=str(name)) | ast.keyword(arg=str(name)):
                yield node.lineno, name
            case _:
                pass


def first_lines(tree: ast.AST) -> Iterator[tuple[str, str]]:
    """(name, first line) of every docstring in a file."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            text = ast.get_docstring(node)
            if text:
                yield getattr(node, "name", "module"), text.splitlines()[0]


def trees(folder: str) -> Iterator[tuple[str, ast.AST]]:
    """(name, syntax tree) of the files of a folder."""
    for path in sorted((ROOT / folder).glob("*.py")):
        yield path.name, ast.parse(path.read_text("utf-8"))


@pytest.mark.parametrize("folder", FOLDERS)
def test_names_are_nouns_of_the_field(folder: str) -> None:
    wrong = [
        f"{file}:{line} {name}"
        for file, tree in trees(folder)
        for line, name in names(tree)
        if name in BANNED
    ]
    assert wrong == []


@pytest.mark.parametrize("folder", FOLDERS)
def test_docstrings_begin_with_one_short_line(folder: str) -> None:
    wrong = [
        f"{file} {name}: {line}"
        for file, tree in trees(folder)
        for name, line in first_lines(tree)
        if len(line) > LONGEST_FIRST_LINE
    ]
    assert wrong == []
