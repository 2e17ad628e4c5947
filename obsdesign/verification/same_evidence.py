"""Comparison of the evidence in a document with that of a new proof, entry by entry.

Three sorts of entries. Numbers that are proved, and certificates, must be equal. Entries named as
estimates (`approx_...`, everything inside `estimated`) are floats that prove nothing: they may
differ as libraries do. Boxes, steps and bits may differ between machines: only their type is
compared. Bounds whose value depends on how their proof was cut into boxes are unconfirmed where
they differ, not false. An unknown entry is refused.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from lmi.arithmetic.arrays import Value
from obsdesign.document import Claim
from obsdesign.verification import stated_poles, stated_weights

# course of a proof: depends on the floats that steer it
_COURSE = ("bits", "boxes", "method", "periods", "smallest_box", "steps",
           "tail_from")  # fmt: skip
# of these, what is counted
_COUNTS = ("bits", "boxes", "periods", "steps")
# what a second proof adds, and a file need not have
_ADDED = ("confirmed_by", "time_std", "weight_std")
# marks in evidence that designs of earlier releases do not have, nor the warnings that follow
_ADDED_MARKS = ("zero_gains",)
# other libraries round otherwise: less than this, relatively, is not a false statement
_LAST_DIGITS = 1e-9
_ESTIMATE, _ESTIMATE_FLOOR = 1e-2, 1e-9


# a sentence of interval observers that designs of before do not have: it guarantees no width
ROUNDED_WIDTHS = (
    "Widths are those of exact arithmetic and exact time stamps: what rounding and half an ulp of "
    "a time stamp add is inside the bounds, and widens them."
)

# by claim: bounds that are as sharp as the boxes of their proof, and what follows from them
_BOUNDS = {
    "strongly_observable": ("sigma_min", "margin", "spread", "largest", "recalled"),
    "rate": ("per_impulse", "constant", "in_time"),
}


# by claim: a phrase of its statement, and what designs of earlier releases have in its place
OLDER_WORDING = {
    "strongly_observable": (
        "in units of its rows and of usual spacings",
        "of that at usual spacings",
    ),
}


# claims that designs of earlier releases do not have
ADDED_CLAIMS = (stated_poles.ID, stated_weights.ID, "shortest_spacing")


# where earlier releases found what a source now names
_OLDER_SOURCES = dict.fromkeys(
    ("(lmi/windows_proof.py)", "(lmi/prove/windows_proof.py)"), "(docs/windows.md)"
)


def current_source(source: str) -> str:
    """A source as it is named today."""
    for before, now in _OLDER_SOURCES.items():
        source = source.replace(before, now)
    return source


# words of claims, guarantees and warnings of earlier releases, with the same meaning; expressions
_OLDER_STATEMENTS = {
    "what the rounding of the stored matrices leaves of the estimates for ever is": (
        "the steady-state error of the estimates from rounding the stored matrices is"
    ),
    "no bounds depend on the start for ever": "in steady state no bounds depend on the start",
    "The samples do not bound all of that, modes that die within a period: the bounds that run "
    "are infinite": (
        "The samples do not bound modes that decay within one period, so that the bounds at run "
        "time are infinite"
    ),
    "The plant by itself does not tend to zero for all its parameters, nor need the estimation "
    "error then:": (
        "The plant by itself is not stable for all its parameters, so that the estimation error "
        "need not tend to zero:"
    ),
    "It is not proved that the plant by itself tends to zero for all its parameters, on which it "
    "depends whether the estimation error does": (
        "The plant by itself is not proved stable for all its parameters; where it is not, the "
        "estimation error need not tend to zero"
    ),
    r"the bounds contain both\.$": "the bounds contain the states of both cases.",
    "the evidence of `uniqueness` tells the weights": (
        "the evidence of `uniqueness` states the weights"
    ),
    "Negative weights are not looked for": "Negative weights are excluded",
    r"the rate (\S+) was asked for": r"decay_rate = \1 is required",
    "along flow and jumps no part of the state stays unseen: samples of a window determine the "
    "state, spacings apart at which modes alias": (
        "the state is observable along flow and jumps: the samples of a window determine it, "
        "except at spacings at which modes alias"
    ),
}


def current_statement(statement: str) -> str:
    """A statement in the words of today."""
    for before, now in _OLDER_STATEMENTS.items():
        statement = re.sub(before, now, statement)
    return statement


def is_older_wording(claim: str, stored: str, statement: str) -> bool:
    """Whether a stored statement is that of an earlier release for the same claim."""
    now, before = OLDER_WORDING.get(claim, ("", ""))
    return bool(now) and now in statement and stored == statement.replace(now, before)


def as_marked(claim: Claim, stored: Claim | None) -> Claim:
    """The claim without marks in its evidence that the stored one, of an earlier release, lacks."""
    before = {} if stored is None else stored.evidence
    evidence = {
        key: value
        for key, value in claim.evidence.items()
        if key in before or key not in _ADDED_MARKS
    }
    return replace(claim, evidence=evidence)


@dataclass(frozen=True)
class Difference:
    """Place where document and new proof differ, `claim.entry`; false, or only unconfirmed."""

    entry: str
    false: bool


def difference(claim: str, stored: object, proved: object) -> Difference | None:
    """The gravest difference between the stored JSON evidence of a claim and the proved one."""
    every = list(_differences(claim, stored, proved, False))
    return next((one for one in every if one.false), every[0] if every else None)


def _differences(path: str, stored: Value, proved: Value, estimate: bool) -> Iterator[Difference]:
    if isinstance(stored, Mapping) and isinstance(proved, Mapping):
        for key in sorted({*stored, *proved}):
            place = f"{path}.{key}"
            if key not in stored and key in (*_ADDED, *_ADDED_MARKS):
                continue
            if key not in stored or key not in proved:
                yield Difference(place, True)
            elif key in _COURSE:
                if not _alike(key, stored[key], proved[key]):
                    yield Difference(place, True)
            else:
                named = key == "estimated" or key.startswith("approx_")
                gaps = _differences(place, stored[key], proved[key], estimate or named)
                yield from _unconfirmed(gaps) if key in _BOUNDS.get(path, ()) else gaps
    elif isinstance(stored, list) and isinstance(proved, list):
        if len(stored) != len(proved):
            yield Difference(path, True)
        for i, pair in enumerate(zip(stored, proved, strict=False)):
            yield from _differences(f"{path}[{i}]", *pair, estimate)
    elif _is_number(stored) and _is_number(proved):
        yield from _number_difference(path, float(stored), float(proved), estimate)
    elif type(stored) is not type(proved) or stored != proved:
        yield Difference(path, True)


def _unconfirmed(gaps: Iterator[Difference]) -> Iterator[Difference]:
    return (Difference(gap.entry, False) for gap in gaps)


def _number_difference(
    path: str, stored: float, proved: float, estimate: bool
) -> Iterator[Difference]:
    size, gap = max(abs(stored), abs(proved)), abs(stored - proved)
    if estimate:
        if gap > _ESTIMATE * size + _ESTIMATE_FLOOR:
            yield Difference(path, False)
    elif stored != proved:
        yield Difference(path, gap > _LAST_DIGITS * size)


def _is_number(value: object) -> bool:
    """JSON numbers; the word for infinity is compared as a word."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(float(value))
    except OverflowError:
        return False


def _alike(key: str, stored: Value, proved: Value) -> bool:
    """The same sort of scalar: the same word, a count for a count, never below zero."""
    if isinstance(proved, str):
        return bool(stored == proved)
    if not _is_number(proved):
        return not _is_number(stored) and not isinstance(stored, Mapping | list | str)
    whole = key not in _COUNTS or isinstance(stored, int)
    return _is_number(stored) and whole and stored >= 0
