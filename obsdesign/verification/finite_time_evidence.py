"""Finite-time estimation: numbers told as evidence are those that are proved again."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from obsdesign.document import Claim, jsonable

# ends of balls are rounded once, at whatever precision; what a singular value in floats is good for
_SAME, _SAME_RATIO = 1e-12, 1e-3


def altered(certificates: Mapping[str, Any], found: tuple[Claim, ...]) -> Iterator[Claim]:
    """The claims that were found; refuted where the file tells other numbers as their evidence."""
    for claim in found:
        name = None
        if claim.id in certificates and claim.verdict == "proved":
            name = _difference(jsonable(certificates[claim.id]), jsonable(claim.evidence))
        if name is None:
            yield claim
            continue
        reason = f"the evidence {name!r} in the file is not what is found again"
        witness = {"witness": {"entry": name, "reason": reason}}
        yield replace(claim, verdict="refuted", evidence=witness)


def _difference(stored: Any, found: Any) -> str | None:
    if not isinstance(stored, Mapping) or set(stored) != set(found):
        return "evidence"
    for name, value in found.items():
        if not _same(stored[name], value, _SAME_RATIO if name == "ratio" else _SAME):
            return str(name)
    return None


def _same(one: Any, other: Any, tolerance: float) -> bool:
    if isinstance(one, list) and isinstance(other, list):
        pairs = zip(one, other, strict=False)
        return len(one) == len(other) and all(_same(x, y, tolerance) for x, y in pairs)
    numbers = [isinstance(x, int | float) and not isinstance(x, bool) for x in (one, other)]
    if all(numbers):
        return one == other or math.isclose(one, other, rel_tol=tolerance)
    return bool(one == other)
