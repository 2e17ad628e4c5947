"""Signs on which the enclosure rests: Metzler and nonnegative matrices, and exact splits.

Everything is decided in rational numbers. A split that was stored rounded is accepted if it misses
its matrix by rounding alone; the observer carries the difference.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Array
from lmi.arithmetic.balls import exact, to_float
from lmi.verdict import Verdict, proved, refuted
from obsdesign.document import Claim

# Decimal entries and a product of a few terms are stored to within a few units of 2**-53; a
# split that misses A - L C by more was not meant as one.
SPLIT_ROUNDING = 2.0**-46


@dataclass(frozen=True)
class SplitPart:
    """Flow or jump: its claim, the names of the halves of its split, and their required signs."""

    claim: str
    names: tuple[str, str]
    is_metzler: bool
    assumption: str  # of form `cooperative`


FLOW = SplitPart("flow_positive", ("D0", "D1"), True, "Assumption 2.ii")
JUMP = SplitPart("jump_positive", ("Gp", "Gn"), False, "Assumption 2.iii")


@dataclass(frozen=True)
class SplitMatrix:
    """X in the observer's coordinates and its stored split X = plus - minus, exact."""

    X: Array
    plus: Array
    minus: Array


def split_claim(part: SplitPart, form: str, name: str, matrix: SplitMatrix, source: str) -> Claim:
    """Claim that the matrix has the signs itself (`cooperative`), or an exact split of it has.

    name: how a person writes the matrix; source: the theorem.
    """
    plus, minus = part.names
    assumption = "Assumption 5"
    if form == "cooperative":
        property_ = "Metzler" if part.is_metzler else "nonnegative"
        statement = f"{name} is {property_}; it is stored as {plus}, and {minus} is zero"
        assumption = part.assumption
        verdict = signs(matrix.X, part.is_metzler, f"{name} is not {property_}")
        if verdict.outcome == "proved":
            verdict = signs(-matrix.minus, False, f"{minus} is not zero")
    else:
        statement = (
            f"{name} equals {plus} - {minus} with {plus} "
            f"{'Metzler' if part.is_metzler else '>= 0'} and {minus} >= 0"
        )
        verdict = proved()
    if verdict.outcome == "proved":
        verdict = signs(matrix.plus, part.is_metzler, f"{plus} has the wrong sign")
    if verdict.outcome == "proved":
        verdict = signs(matrix.minus, False, f"{minus} has the wrong sign")
    if verdict.outcome == "proved":
        difference = matrix.plus - matrix.minus
        verdict = _same(matrix.X, difference, f"{plus} - {minus} misses the matrix it splits")
    return Claim.from_verdict(part.claim, statement, f"{source}, {assumption}", verdict)


def metzler_claim(R: Array, D0: Array, D1: Array, source: str) -> Claim:
    """Claim that R = S^-1 (A - L C) S of Theorem 7 is Metzler, up to rounding, stored as D1."""
    limit = exact(SPLIT_ROUNDING).item() * np.max(np.abs(R))
    off_diagonal = ~np.eye(len(R), dtype=bool)
    verdict = signs(
        np.where(off_diagonal & (R < 0) & (-limit < R), 0 * R, R), True,
        "R = S^-1 (A - L C) S is not Metzler",
    )  # fmt: skip
    for half, metzler, key in ((D0, True, "D0"), (D1, False, "D1")):
        if verdict.outcome == "proved":
            verdict = signs(half, metzler, f"{key} has the wrong sign")
    if verdict.outcome == "proved":
        verdict = _same(R, D0 - D1, "D0 - D1 misses R")
    statement = (
        "R = S^-1 (A - L C) S is Metzler; it is stored as D0, and what rounding makes of it as D1"
    )
    return Claim.from_verdict("flow_positive", statement, f"{source}, Assumption 4", verdict)


def nonnegative_claim(T: Array, H2: Array, source: str) -> Claim:
    """Claim that T >= 0 is S2^-1 H S2, up to rounding."""
    verdict = signs(T, False, "T is not nonnegative")
    if verdict.outcome == "proved":
        verdict = _same(H2, T, "T misses S2^-1 H S2")
    statement = "T equals S2^-1 H S2, H the jump matrix of the error, and is nonnegative"
    return Claim.from_verdict("jump_positive", statement, f"{source}, Assumption 4", verdict)


def signs(X: Array, metzler: bool, failure: str) -> Verdict:
    """Decide whether every entry (off the diagonal, for Metzler) is >= 0, exactly."""
    for (i, j), value in np.ndenumerate(X):
        if value < 0 and not (metzler and i == j):
            size = _number(value)
            hint = "; rounding of decimals, which form = split absorbs" if size > -1e-12 else ""
            reason = f"{failure}: entry ({i + 1}, {j + 1}) is {size:.6g}{hint}"
            return refuted({"entry": [i + 1, j + 1], "value": size, "reason": reason})
    return proved(exact=True)


def _same(X: Array, stored: Array, failure: str) -> Verdict:
    """Decide whether stored = X up to the rounding of stored decimals."""
    # a split that is many times larger than X itself would lose X in its own rounding
    limit = np.max(np.abs(X)) * exact(SPLIT_ROUNDING).item()
    largest = 0.0
    for (i, j), value in np.ndenumerate(stored - X):
        size = _number(value)
        if abs(value) > limit:
            reason = f"{failure} at entry ({i + 1}, {j + 1}) by {size:.6g}"
            return refuted({"entry": [i + 1, j + 1], "value": size, "reason": reason})
        largest = max(largest, abs(size))
    return proved(exact=largest == 0.0, largest_remainder=largest)


def _number(value: object) -> float:
    return float(to_float(np.array([value], dtype=object))[0])
