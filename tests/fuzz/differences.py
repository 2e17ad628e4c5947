"""Whether a changed design differs from the one that was proved, in its gains or its claims."""

from __future__ import annotations

import json
from typing import Any

from obsdesign.equations.interval.gains import CORRECTIONS
from obsdesign.kinds import GAINS


def differs(base: Any, body: Any) -> bool:
    """Has a gain or a claim changed, other than in how a number is written?"""
    if not isinstance(body, dict):
        return True
    keys = ("id", "statement", "source", "verdict")

    def words(design: dict[str, Any]) -> Any:
        claims = design.get("claims")
        if not isinstance(claims, list) or not all(isinstance(claim, dict) for claim in claims):
            return None
        return sorted(json.dumps([claim.get(key) for key in keys]) for claim in claims)

    free = {"state_error", "radius", *CORRECTIONS, *_open_gains(base)}
    return not equal(_exact_gains(base, free), _exact_gains(body, free)) or words(base) != words(
        body
    )


def _open_gains(design: dict[str, Any]) -> set[str]:
    """Names of the gains that the problem leaves open: any for which the claims hold will do."""
    observer = design["problem"]["observer"]
    if "poles" in observer or "weights" in observer:
        return set()
    return set(GAINS[observer["kind"]]) - set(observer.get("gains", ()))


def _exact_gains(body: dict[str, Any], free: set[str]) -> Any:
    """Gains but for free ones: open ones, and bounds, of which a wider one is no false statement.

    Nor is an entry of 1e-100 for 0 where gains are proved to within rounding.
    """
    gains = body.get("gains")
    if not isinstance(gains, dict):
        return None
    return _without_traces({name: value for name, value in gains.items() if name not in free})


def _without_traces(value: Any) -> Any:
    """The same with 0 for numbers far below the rounding of any gain."""
    if isinstance(value, dict):
        return {name: _without_traces(item) for name, item in value.items()}
    if isinstance(value, list):
        return [_without_traces(item) for item in value]
    return 0 if isinstance(value, float) and abs(value) < 1e-50 else value


def equal(one: Any, other: Any) -> bool:
    """Equal as JSON values: 1 is 1.0, true is not."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(equal(one[key], other[key]) for key in one)
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(equal, one, other))
    return isinstance(one, bool) == isinstance(other, bool) and one == other
