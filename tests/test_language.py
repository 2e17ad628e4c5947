"""Names are nouns of the field, and a docstring begins with one short line."""

from __future__ import annotations

import ast
import functools
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
# participles that name no thing: what is it that was found?
BANNED = frozenset({"found", "told", "asked", "seen", "moved"})
# words that stand for a thing: of what, which, where? As loop variables of comprehensions they may
BANNED_OUTSIDE_COMPREHENSIONS = frozenset({"rest", "one", "here"})
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


def in_comprehensions(tree: ast.AST) -> frozenset[tuple[int, str]]:
    """(line, name) of the loop variables of comprehensions."""
    loops = [
        loop.target
        for node in ast.walk(tree)
        if isinstance(node, ast.ListComp | ast.SetComp | ast.DictComp | ast.GeneratorExp)
        for loop in node.generators
    ]
    return frozenset(
        (node.lineno, node.id)
        for target in loops
        for node in ast.walk(target)
        if isinstance(node, ast.Name)
    )


def first_lines(tree: ast.AST) -> Iterator[tuple[str, str]]:
    """(name, first line) of every docstring in a file."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            text = ast.get_docstring(node)
            if text:
                yield getattr(node, "name", "module"), text.splitlines()[0]


@functools.cache
def trees(folder: str) -> list[tuple[str, ast.AST]]:
    """(name, syntax tree) of the files of a folder."""
    paths = sorted((ROOT / folder).glob("*.py"))
    return [(path.name, ast.parse(path.read_text("utf-8"))) for path in paths]


@pytest.mark.parametrize("folder", FOLDERS)
def test_names_are_nouns_of_the_field(folder: str) -> None:
    wrong = [
        f"{file}:{line} {name}"
        for file, tree in trees(folder)
        for loops in [in_comprehensions(tree)]
        for line, name in names(tree)
        if name in BANNED or (name in BANNED_OUTSIDE_COMPREHENSIONS and (line, name) not in loops)
    ]
    assert wrong == []


def test_words_that_stand_for_a_thing_are_names_in_comprehensions_alone() -> None:
    tree = ast.parse("a = [one.x for one in b]\nrest = a\nfor one in a: pass\n")
    assert in_comprehensions(tree) == {(1, "one")}
    stores = set(names(tree)) - in_comprehensions(tree)
    assert {(2, "rest"), (3, "one")} <= stores


@pytest.mark.parametrize("folder", FOLDERS)
def test_docstrings_begin_with_one_short_line(folder: str) -> None:
    wrong = [
        f"{file} {name}: {line}"
        for file, tree in trees(folder)
        for name, line in first_lines(tree)
        if len(line) > LONGEST_FIRST_LINE
    ]
    assert wrong == []


def only_underscored(tree: ast.AST) -> set[str]:
    """Constants of a file, its own or imported, beside which another is called `_` and the same."""
    used = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    imported = [
        alias for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) for alias in node.names
    ]
    used |= {alias.asname or alias.name for alias in imported}
    return {name for name in used if name.isupper() and f"_{name}" in used}


@pytest.mark.parametrize("folder", FOLDERS)
def test_no_two_constants_of_a_file_differ_by_an_underscore(folder: str) -> None:
    assert [(file, own) for file, tree in trees(folder) if (own := only_underscored(tree))] == []


def test_an_underscore_alone_is_recognised() -> None:
    """The twin."""
    assert only_underscored(ast.parse("from a import MOST\n_MOST = min(MOST, 3)\n")) == {"MOST"}
    assert not only_underscored(ast.parse("from a import MOST\n_LEAST = min(MOST, 3)\n"))
