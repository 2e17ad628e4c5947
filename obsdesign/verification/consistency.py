"""Does a design answer the problem it carries? Entry by entry, exactly."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from lmi.arithmetic.arrays import Entries
from lmi.verdict import Verdict, proved, refuted
from obsdesign.document import Claim, jsonable, same

GainsType = TypeVar("GainsType")


def consistent_gains(
    objection: str | None,
    stored: Entries,
    expected: Entries,
    read: Callable[[Entries], GainsType],
) -> tuple[Claim, GainsType | None]:
    """Claim that `stored` holds exactly the expected gains; the typed gains where it is proved.

    objection: why the kind cannot serve the problem, if so; expected: by name, the value itself, a
    tuple (required shape) or a set (allowed words); read: makes typed gains, ValueError if they do
    not fit each other.
    """
    verdict, gains = _compare(stored, expected), None
    if objection is not None:
        verdict = refuted({"entry": "problem", "reason": objection})
    elif verdict.outcome == "proved":
        try:
            gains = read(stored)
        except ValueError as error:
            verdict = refuted({"entry": "gains", "reason": str(error)})
    return _claim(verdict), gains


def inconsistent(objection: str) -> Claim:
    """The claim where the kind cannot serve the problem, or the gains are none."""
    return _claim(refuted({"entry": "problem", "reason": objection}))


def _claim(verdict: Verdict) -> Claim:
    return Claim.from_verdict(
        "consistent",
        "the stored gains are those of the stored problem",
        "format of a design file",
        verdict,
    )


def _compare(gains: Entries, expected: Entries) -> Verdict:
    for name in sorted(set(gains) ^ set(expected)):
        reason = "is missing" if name in expected else "is not a gain of this kind"
        return refuted({"entry": f"gains.{name}", "reason": f"gains.{name} {reason}"})
    for name, value in expected.items():
        if objection := _objection(gains[name], value):
            return refuted({"entry": f"gains.{name}", "reason": f"gains.{name} {objection}"})
    return proved(entries=len(expected))


def _objection(stored: object, required: object) -> str | None:
    if isinstance(required, set):
        fits = isinstance(stored, str) and stored in required
        return None if fits else f"must be one of {', '.join(sorted(required))}"
    if isinstance(required, tuple):
        if not isinstance(stored, np.ndarray) or stored.shape != required:
            return f"must be {'x'.join(map(str, required))}"
        return None if np.isfinite(stored).all() else "must be finite"
    equal = same(jsonable(stored), jsonable(required))
    return None if equal else "differs from what the problem says"
