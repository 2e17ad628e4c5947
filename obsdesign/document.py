"""A design, its claims and guarantees: what they hold, and how they are written and signed.

`design_file` reads what is written here. Numpy and the standard library only.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from lmi.arithmetic.arrays import Entries, NewEntries, Value
from obsdesign.html_table import html_table
from obsdesign.output_files import write_text

FORMAT = "obsdesign/design"
VERSION = 1


class Decision(Protocol):
    """A verdict: proved, refuted or undecided, and its evidence (`lmi.verdict.Verdict`)."""

    @property
    def outcome(self) -> str:
        """The word."""

    @property
    def evidence(self) -> Entries:
        """A certificate, a witness, or the worst place."""


@dataclass(frozen=True)
class Claim:
    """One hypothesis of the theorem behind a design.

    id: "dwell_stability", ...; statement: one sentence; source: paper, theorem, equation; verdict:
    proved | refuted | undecided; evidence: what shows it (a certificate, a witness, the worst
    place), JSON-ready.
    """

    id: str
    statement: str
    source: str
    verdict: str
    evidence: Entries

    @classmethod
    def from_verdict(cls, name: str, statement: str, source: str, verdict: Decision) -> Claim:
        """The claim that a verdict of `lmi` decides, with its evidence."""
        return cls(name, statement, source, verdict.outcome, verdict.evidence)

    def to_dict(self) -> NewEntries:
        """The claim as it stands in a file."""
        words = {name: getattr(self, name) for name in ("id", "statement", "source", "verdict")}
        return words | {"evidence": self.stated_evidence()}

    def stated_evidence(self) -> Entries:
        """The evidence as it stands in a file."""
        stated: Entries = jsonable(_without_nan(self.evidence))
        return stated


@dataclass(frozen=True)
class Guarantee:
    """A sentence that a user may rely on, or that an option requests and is not proved.

    claims: ids of the claims it rests on; given: are all of them proved? assumption: what the
    statement begins with, as others of the design do; "" of one that was read from a file.
    """

    statement: str
    claims: tuple[str, ...]
    given: bool = True
    assumption: str = field(default="", compare=False)

    @classmethod
    def from_verdicts(
        cls, statement: str, claims: Sequence[str], verdicts: Mapping[str, str]
    ) -> Guarantee:
        """The sentence, given where these claims are proved."""
        given = all(verdicts.get(name) == "proved" for name in claims)
        return cls(statement, tuple(claims), given)

    @classmethod
    def not_proved(cls, statement: str) -> Guarantee:
        """A sentence that rests on no claim and is not given."""
        return cls(statement, (), given=False)

    def under(self, assumption: str) -> Guarantee:
        """The same guarantee, which begins with an assumption."""
        statement = f"{assumption} {self.statement}"
        return replace(self, statement=statement, assumption=assumption)

    @property
    def conclusion(self) -> str:
        """The statement without its assumption."""
        return self.statement.removeprefix(self.assumption).lstrip()

    def to_dict(self) -> NewEntries:
        """The guarantee as it stands in a file."""
        return {"statement": self.statement, "given": self.given, "claims": list(self.claims)}


@dataclass(frozen=True)
class Design:
    """An observer with its proof: the problem it answers, its gains, claims and guarantees.

    problem: the normalised problem as a dict; gains: arrays and scalars under the names of
    `obsdesign.equations.<kind>.gains`, with shapes as there; guarantees: sentences with the claims
    they rest on; warnings: what is wrong or nearly so, one sentence each, None in files that were
    written before there were any; provenance: versions and solvers.
    """

    name: str
    kind: str
    problem: Entries
    gains: Entries
    claims: tuple[Claim, ...]
    guarantees: tuple[Guarantee, ...]
    warnings: tuple[str, ...] | None
    provenance: Entries

    def __repr__(self) -> str:
        proved = sum(claim.verdict == "proved" for claim in self.claims)
        return f"Design({self.name!r}, {self.kind}, {proved} of {len(self.claims)} claims proved)"

    def _repr_html_(self) -> str:
        rows = [(claim.id, claim.verdict, claim.statement) for claim in self.claims]
        return html_table((f"{self.name} · {self.kind}", "verdict", "claim"), rows)

    @property
    def digest(self) -> str:
        """The signature of the document."""
        return str(self.to_dict()["digest"])

    def to_dict(self) -> NewEntries:
        """The document, digest included."""
        body = {
            "format": FORMAT,
            "version": VERSION,
            "name": self.name,
            "kind": self.kind,
            "problem": jsonable(self.problem),
            "gains": jsonable(self.gains),
            "claims": [claim.to_dict() for claim in self.claims],
            "guarantees": [guarantee.to_dict() for guarantee in self.guarantees],
            "provenance": jsonable(self.provenance),
        }
        if self.warnings is not None:  # a file without them keeps its digest
            body["warnings"] = list(self.warnings)
        return body | {"digest": digest(body)}

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the document; an existing file is replaced whole or not at all.

        InputError where it cannot be written.
        """
        write_text(path, self.to_json())

    def to_json(self) -> str:
        """The text of the document as `save` writes it."""
        return json.dumps(self.to_dict(), indent=1, ensure_ascii=False, allow_nan=False)


def _without_nan(value: object) -> object:
    """Evidence whose floats overflowed has nothing to show there: null."""
    if isinstance(value, Mapping):
        return {key: _without_nan(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(item) for item in value]
    return None if isinstance(value, float) and math.isnan(value) else value


def jsonable(value: Value) -> Value:
    """Arrays as lists, infinity as "inf", -0.0 as 0.0; NaN is our bug and raises ValueError."""
    if isinstance(value, Mapping):
        return {str(key): jsonable(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return jsonable(value.tolist())
    if isinstance(value, list | tuple):
        return [jsonable(item) for item in value]
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, float | np.floating):
        number = float(value)
        if math.isnan(number):
            raise ValueError("NaN has no place in a design")
        if math.isinf(number):
            return "inf" if number > 0 else "-inf"
        return number + 0.0
    if isinstance(value, np.integer):
        return int(value)
    return value


def same(first: object, second: object) -> bool:
    """Are two JSON values equal? 1 is 1.0, and true is neither."""
    if isinstance(first, list) and isinstance(second, list):
        return len(first) == len(second) and all(map(same, first, second))
    if isinstance(first, dict) and isinstance(second, dict):
        return first.keys() == second.keys() and all(same(first[key], second[key]) for key in first)
    return bool(isinstance(first, bool) == isinstance(second, bool) and first == second)


def digest(body: Entries) -> str:
    """sha256 of the canonical text of everything but the digest."""
    signed = {key: value for key, value in body.items() if key != "digest"}
    text = json.dumps(
        signed, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False
    )
    return "sha256:" + hashlib.sha256(text.encode("utf-8")).hexdigest()
