"""Changes of a proof's source: what `mutations` turns, and comparisons, roundings, terms, checks."""

from __future__ import annotations

import ast

from tests.long.mutations import turned

_BOUNDARY = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt}
_OTHERS = {
    ast.LShift: ast.RShift, ast.BitOr: ast.BitAnd, ast.BitAnd: ast.BitOr, ast.Pow: ast.Mult,
}  # fmt: skip
_CALLED = {"max": "min", "min": "max", "any": "all", "all": "any", "ceil": "floor"}
_DROPPED = ("abs", "bounded", "absolute", "transposed", "upper_ends")


def changes(node: ast.expr) -> list[str]:
    """The source of the node with each change: an operator, a rounding, a number, a check less."""
    changed = turned(node) if not isinstance(node, ast.Compare) else []
    match node:
        case ast.Compare(left, operators, rights):
            changed += ["True", "False"]
            for k, op in enumerate(operators):
                for table in (_TURNED_COMPARISONS, _BOUNDARY):
                    if other := table.get(type(op)):
                        new = [*operators[:k], other(), *operators[k + 1 :]]
                        changed.append(ast.unparse(ast.Compare(left, new, rights)))
        case ast.BinOp(left, ast.Add(), right):
            changed += [ast.unparse(left), ast.unparse(right)]
        case ast.BinOp(left, ast.Sub(), right):
            changed.append(ast.unparse(left))
        case ast.BinOp(left, (ast.FloorDiv() | ast.RShift()) as op, right):  # up, not down
            minus = ast.UnaryOp(ast.USub(), left)
            changed.append(ast.unparse(ast.UnaryOp(ast.USub(), ast.BinOp(minus, op, right))))
        case ast.BinOp(left, op, right) if other := _OTHERS.get(type(op)):
            changed.append(ast.unparse(ast.BinOp(left, other(), right)))
        case ast.BoolOp(_, values):
            changed += [_without(node, k) for k in range(len(values))]
        case ast.Constant(int(value)) if not isinstance(value, bool):
            changed.append(str(value - 1))
        case ast.Call():
            changed += _of_call(node)
    return changed


_TURNED_COMPARISONS = {
    ast.Lt: ast.GtE, ast.GtE: ast.Lt, ast.Gt: ast.LtE, ast.LtE: ast.Gt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip


def _without(node: ast.BoolOp, k: int) -> str:
    values = [*node.values[:k], *node.values[k + 1 :]]
    return ast.unparse(values[0] if len(values) == 1 else ast.BoolOp(node.op, values))


def _of_call(node: ast.Call) -> list[str]:
    """A check that is dropped, a function that is another one, a map that is left out."""
    name = node.func.attr if isinstance(node.func, ast.Attribute) else ""
    name = node.func.id if isinstance(node.func, ast.Name) else name
    if name == "demand":
        return ["None"]
    if name in _CALLED:
        return [ast.unparse(node).replace(name, _CALLED[name], 1)]
    if name in _DROPPED and len(node.args) == 1:
        return [ast.unparse(node.args[0])]
    if name == "transpose" and isinstance(node.func, ast.Attribute):
        return [ast.unparse(node.func.value)]
    return []
