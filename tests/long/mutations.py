"""Mutants of a Python file: one operator turned or one number changed, inside of functions."""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

_TURNED = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
    ast.Lt: ast.GtE, ast.GtE: ast.Lt, ast.Gt: ast.LtE, ast.LtE: ast.Gt,
    ast.Eq: ast.NotEq, ast.NotEq: ast.Eq, ast.And: ast.Or, ast.Or: ast.And,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip


@dataclass(frozen=True)
class Mutant:
    """One changed expression: the file with it, its statement, and its lines before and after."""

    path: str
    function: str
    was: str
    now: str
    source: bytes
    statement: range
    copy: int = 0

    @property
    def expression(self) -> tuple[str, str, str, str]:
        """Its file, its function, and its lines before and after."""
        return self.path, self.function, self.was, self.now

    @property
    def key(self) -> str:
        """What stays when lines are added above it."""
        return "\n".join((*self.expression, str(self.copy)))


def turned(node: ast.expr) -> list[str]:
    """The source of the node with its operator turned or its number changed; [] if it has none."""
    return [changed] if (changed := _turned(node)) else []


def mutants_of(
    path: str, source: bytes, changes: Callable[[ast.expr], list[str]] = turned
) -> list[Mutant]:
    """Every mutant of one file inside of its functions, by the changes of each expression."""
    starts = [0]
    for text in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(text))
    copies: Counter[str] = Counter()
    mutants = []
    every = [
        (*place, node, changed)
        for *place, node in _expressions(ast.parse(source), "", None)
        for changed in changes(node)
    ]
    for function, statement, node, changed in every:
        first, last = node.lineno - 1, node.end_lineno or node.lineno
        begin = starts[first] + node.col_offset
        end = starts[last - 1] + (node.end_col_offset or 0)
        if not _is(source[begin:end], node):
            continue  # parts of f-strings have no place of their own before Python 3.12
        with_it = source[:begin] + f"({changed})".encode() + source[end:]
        was, now = source[starts[first] : starts[last]], with_it[starts[first] :]
        now = now[: len(now) - len(source) + starts[last]]
        texts = [" ".join(text.decode().split()) for text in (was, now)]
        one = Mutant(path, function, texts[0], texts[1], with_it, statement)
        mutants.append(replace(one, copy=copies[one.key]))
        copies[one.key] += 1
    return mutants


def _expressions(
    node: ast.AST, function: str, statement: range | None
) -> Iterator[tuple[str, range, ast.expr]]:
    """(function, lines of the statement or of its head, expression) inside of functions."""
    for child in ast.iter_child_nodes(node):
        name, lines = function, statement
        if isinstance(child, ast.FunctionDef | ast.ClassDef):
            name = f"{function}.{child.name}".lstrip(".")
        inside = isinstance(node, ast.FunctionDef) and child in node.body
        if isinstance(child, ast.stmt) and (inside or statement is not None):
            body = getattr(child, "body", None)
            last = body[0].lineno - 1 if body else child.end_lineno or child.lineno
            lines = range(child.lineno, max(last, child.lineno) + 1)
        if isinstance(child, ast.expr) and lines is not None and not _is_annotation(node, child):
            yield name, lines, child
        yield from _expressions(child, name, lines)


def _is_annotation(node: ast.AST, child: ast.expr) -> bool:
    return child in (getattr(node, "annotation", None), getattr(node, "returns", None))


def _is(text: bytes, node: ast.expr) -> bool:
    try:
        return ast.unparse(ast.parse(b"(" + text + b")", mode="eval")) == ast.unparse(node)
    except SyntaxError:
        return False


def _turned(node: ast.expr) -> str:
    match node:
        case ast.BinOp(left, op, right) if type(op) in _TURNED:
            return ast.unparse(ast.BinOp(left, _TURNED[type(op)](), right))
        case ast.Compare(left, [op], [right]) if type(op) in _TURNED:
            return ast.unparse(ast.Compare(left, [_TURNED[type(op)]()], [right]))
        case ast.BoolOp(op, values):
            return ast.unparse(ast.BoolOp(_TURNED[type(op)](), values))
        case ast.UnaryOp(ast.Not() | ast.USub(), operand):
            return ast.unparse(operand)
        case ast.Constant(bool(value)):
            return str(not value)
        case ast.Constant(int(value) | float(value)):
            return str(value + 1) if isinstance(value, int) else str(5.0 * value or 1.0)
    return ""
