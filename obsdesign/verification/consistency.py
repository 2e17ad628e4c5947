"""Does a design answer the problem it carries? Entry by entry, exactly."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from lmi.verdict import Verdict, proved, refuted
from obsdesign.document import Claim, jsonable, same


def consistency(
    objection: str | None, gains: Mapping[str, Any], expected: Mapping[str, Any]
) -> Claim:
    """Claim that `gains` holds exactly the expected entries, for a problem the kind can serve.

    objection: why it cannot, if so; expected: by name, the value itself, a tuple (required shape)
    or a set (allowed words).
    """
    verdict = _compare(gains, expected)
    if objection is not None:
        verdict = refuted({"entry": "problem", "reason": objection})
    return Claim(
        "consistent",
        "the stored gains are those of the stored problem",
        "format of a design file",
        verdict.outcome,
        verdict.evidence,
    )


def _compare(gains: Mapping[str, Any], expected: Mapping[str, Any]) -> Verdict:
    for name in sorted(set(gains) ^ set(expected)):
        reason = "is missing" if name in expected else "is not a gain of this kind"
        return refuted({"entry": f"gains.{name}", "reason": f"gains.{name} {reason}"})
    for name, value in expected.items():
        if objection := _objection(gains[name], value):
            return refuted({"entry": f"gains.{name}", "reason": f"gains.{name} {objection}"})
    return proved(entries=len(expected))


def _objection(stored: Any, required: Any) -> str | None:
    if isinstance(required, set):
        fits = isinstance(stored, str) and stored in required
        return None if fits else f"must be one of {', '.join(sorted(required))}"
    if isinstance(required, tuple):
        shape = np.shape(stored) if isinstance(stored, np.ndarray) else None
        if shape != required:
            return f"must be {'x'.join(map(str, required))}"
        return None if np.isfinite(stored).all() else "must be finite"
    equal = same(jsonable(stored), jsonable(required))
    return None if equal else "differs from what the problem says"
