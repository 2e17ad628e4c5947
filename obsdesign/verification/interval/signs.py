"""The signs on which the enclosure rests: Metzler and nonnegative matrices, and exact splits.

Everything is decided in rational numbers. A split that was stored rounded is accepted if it misses
what it splits by rounding alone; the observer carries the difference.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from lmi.arithmetic.balls import exact, to_float
from lmi.verdict import Verdict, proved, refuted
from obsdesign.document import Claim

# Decimal entries and a product of a few terms are stored to within a few units of 2**-53; a
# split that misses A - L C by more was not meant as one.
SPLIT_ROUNDING = 2.0**-46


def split_claim(
    part: str, form: str, name: str, X: Any, numbers: Mapping[str, Any], source: str
) -> Claim:
    """`part` (flow or jump): X itself has the signs (`cooperative`), or an exact split of it.

    X: exact, in the observer's coordinates; name: how a person writes it; source: the theorem.
    """
    flow = part == "flow"
    names = ("D0", "D1") if flow else ("Gp", "Gn")
    plus, minus = (numbers[key] for key in names)
    assumption = "Assumption 5"
    if form == "cooperative":
        property_ = "Metzler" if flow else "nonnegative"
        statement = f"{name} is {property_}; it is stored as {names[0]}, and {names[1]} is zero"
        assumption = "Assumption 2.ii" if flow else "Assumption 2.iii"
        verdict = signs(X, flow, f"{name} is not {property_}")
        if verdict.outcome == "proved":
            verdict = signs(-minus, False, f"{names[1]} is not zero")
    else:
        statement = (
            f"{name} equals {names[0]} - {names[1]} with {names[0]} "
            f"{'Metzler' if flow else '>= 0'} and {names[1]} >= 0"
        )
        verdict = proved()
    for half, metzler, key in ((plus, flow, names[0]), (minus, False, names[1])):
        if verdict.outcome == "proved":
            verdict = signs(half, metzler, f"{key} has the wrong sign")
    if verdict.outcome == "proved":
        verdict = _same(X, plus - minus, f"{names[0]} - {names[1]} misses the matrix it splits")
    return Claim(
        f"{part}_positive", statement, f"{source}, {assumption}", verdict.outcome, verdict.evidence
    )


def metzler_claim(R: Any, numbers: Mapping[str, Any], source: str) -> Claim:
    """R = S^-1 (A - L C) S of Theorem 7 is Metzler, up to rounding that is carried as D1."""
    limit = exact(SPLIT_ROUNDING).item() * np.max(np.abs(R))
    off_diagonal = ~np.eye(len(R), dtype=bool)
    verdict = signs(
        np.where(off_diagonal & (R < 0) & (-limit < R), 0 * R, R), True,
        "R = S^-1 (A - L C) S is not Metzler",
    )  # fmt: skip
    for half, metzler, key in ((numbers["D0"], True, "D0"), (numbers["D1"], False, "D1")):
        if verdict.outcome == "proved":
            verdict = signs(half, metzler, f"{key} has the wrong sign")
    if verdict.outcome == "proved":
        verdict = _same(R, numbers["D0"] - numbers["D1"], "D0 - D1 misses R")
    statement = (
        "R = S^-1 (A - L C) S is Metzler; it is stored as D0, and what rounding makes of it as D1"
    )
    return Claim(
        "flow_positive", statement, f"{source}, Assumption 4", verdict.outcome, verdict.evidence
    )


def nonnegative_claim(T: Any, H2: Any, source: str) -> Claim:
    """T >= 0 is S2^-1 H S2, up to rounding."""
    verdict = signs(T, False, "T is not nonnegative")
    if verdict.outcome == "proved":
        verdict = _same(H2, T, "T misses S2^-1 H S2")
    statement = "T equals S2^-1 H S2, H the jump matrix of the error, and is nonnegative"
    return Claim(
        "jump_positive", statement, f"{source}, Assumption 4", verdict.outcome, verdict.evidence
    )


def signs(X: Any, metzler: bool, complaint: str) -> Verdict:
    """Every entry (off the diagonal, for Metzler) is >= 0, exactly."""
    for (i, j), value in np.ndenumerate(X):
        if value < 0 and not (metzler and i == j):
            size = _number(value)
            hint = "; rounding of decimals, which form = split absorbs" if size > -1e-12 else ""
            reason = f"{complaint}: entry ({i + 1}, {j + 1}) is {size:.6g}{hint}"
            return refuted({"entry": [i + 1, j + 1], "value": size, "reason": reason})
    return proved(exact=True)


def _same(X: Any, stored: Any, complaint: str) -> Verdict:
    """Stored = X up to the rounding of stored decimals."""
    # a split that is many times larger than X itself would lose X in its own rounding
    limit = np.max(np.abs(X)) * exact(SPLIT_ROUNDING).item()
    largest = 0.0
    for (i, j), value in np.ndenumerate(stored - X):
        size = _number(value)
        if abs(value) > limit:
            reason = f"{complaint} at entry ({i + 1}, {j + 1}) by {size:.6g}"
            return refuted({"entry": [i + 1, j + 1], "value": size, "reason": reason})
        largest = max(largest, abs(size))
    return proved(exact=largest == 0.0, largest_remainder=largest)


def _number(value: Any) -> float:
    return float(to_float(np.array([value], dtype=object))[0])
