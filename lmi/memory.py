"""Budget of memory for sizes that a user or a file gives.

Code that builds arrays of such a size calls `require_memory` first. The refusal is one line: what
is needed, what the budget is, what to change.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

BUDGET_BYTES = 512 * 2**20
FLOAT_BYTES = 8
# numbers that Clarabel keeps for each entry of the dense blocks of its matrix, 12 to 15 at
# sides 16 to 60: the matrix with its indices, the factor with its own, and copies in another order
_NUMBERS_PER_ENTRY = 15


class OversizeError(ValueError):
    """Arrays beyond the budget of memory would be needed; it implies no verdict about the plant."""


def require_memory(what: str, count: float, change: str) -> None:
    """OversizeError where `count` floats exceed the budget.

    what: noun phrase, "the window matrices of 4000 impulses"; change: what would make it fit.
    """
    if not count * FLOAT_BYTES <= BUDGET_BYTES:
        raise OversizeError(
            f"{what} needs {_size(count * FLOAT_BYTES)} of memory, and the budget is "
            f"{_size(BUDGET_BYTES)}: {change}."
        )


def require_cones(what: str, sides: Sequence[int], change: str) -> None:
    """OversizeError where an interior-point method with semidefinite constraints is too large.

    sides: of the constraints (m, m), each of which is a dense block of m (m + 1) / 2 rows. The
    largest programs that fit take about ten seconds.
    """
    entries = sum((m * (m + 1) / 2) ** 2 for m in sides)
    require_memory(what, _NUMBERS_PER_ENTRY * entries, change)


def _size(count: float) -> str:
    """Bytes in the largest of the units MiB, GiB, TiB that leaves at least 1."""
    if not math.isfinite(count):
        return "more than 1 TiB"
    for unit, name in ((2**40, "TiB"), (2**30, "GiB")):
        if count >= unit:
            return f"{count / unit:.3g} {name}"
    return f"{count / 2**20:.4g} MiB"
