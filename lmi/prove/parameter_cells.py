"""Constant parameters, cell by cell: each half of the box has a certificate of its own.

A constant parameter never leaves its cell. Cells are halves of halves of the box: a tree of
{"parameter", "halves"} whose leaves are certificates of `lmi.prove.clock_matrix`, each checked for
the family of its cell, which is computed from the problem again.
"""

from __future__ import annotations

from collections.abc import Iterator

from lmi.arithmetic.arrays import Entries, NewEntries, Value
from lmi.parameters import AffineFamily
from lmi.prove.clock_matrix import prove_clock_matrix
from lmi.verdict import Verdict, proved, undecided

# entries of a certificate: of a cell, or of one that is cut
_ENTRIES = ("nodes", "R", "parameter", "halves")
# halves of halves: a cell is no smaller than this power of 1/2 of the box, and files that hold a
# tree are not nested deeper than they may be
DEEPEST = 16


def certificate_of(evidence: Entries) -> NewEntries:
    """The certificate in the evidence of a search that proved, {"certificate": tree}."""
    return {"certificate": {key: evidence[key] for key in _ENTRIES if key in evidence}}


def prove_cells(family: AffineFamily, low: float, high: float, certificate: Entries) -> Verdict:
    """Prove stability for every constant p in the box, all others varying, and all dwell times.

    Evidence: the number of cells and of matrices. Undecided evidence is that of the cell that
    fails, with "cell", the halves that lead to it.
    """
    cells = matrices = 0
    for path, cell, leaf in _leaves(family, certificate):
        if cell is None:
            return undecided("cells are halves of constant parameters", cell=path)
        verdict = prove_clock_matrix(cell, low, high, leaf)
        if verdict.outcome != "proved":
            return Verdict("undecided", {**verdict.evidence, "cell": path})
        cells, matrices = cells + 1, matrices + verdict.evidence["matrices"]
    return proved(method="matrices of the time since a jump, exact", matrices=matrices, cells=cells)


def _leaves(
    family: AffineFamily, certificate: Entries
) -> Iterator[tuple[list[list[int]], AffineFamily | None, Entries]]:
    """(halves that lead to it, its family, its certificate) of each cell; None if it is none."""
    stack: list[tuple[list[list[int]], AffineFamily, Entries]] = [([], family, certificate)]
    while stack:
        path, cell, node = stack.pop()
        if not isinstance(node, dict) or "halves" not in node:
            yield path, cell, node if isinstance(node, dict) else {}
            continue
        i: Value = node.get("parameter")
        halves: Value = node["halves"]
        if not (_is_cut(cell, i, halves) and len(path) < DEEPEST):
            yield path, None, {}
            return
        for side, (half, own) in enumerate(zip(cell.halves(i), halves, strict=True)):
            stack.append(([*path, [i, side]], half, own))


def _is_cut(cell: AffineFamily, i: Value, halves: Value) -> bool:
    """Is this a constant parameter, and a certificate for each half?"""
    is_parameter = isinstance(i, int) and 0 <= i < cell.count and cell.is_constant[i]
    return is_parameter and isinstance(halves, list) and len(halves) == 2
