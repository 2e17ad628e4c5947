"""Three answers: proved, refuted with a witness, undecided with the worst place."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from lmi.arithmetic.arrays import Entries, Value
from lmi.solvers import Solvers

OUTCOMES = ("proved", "refuted", "undecided")


@dataclass(frozen=True, slots=True)
class Verdict:
    """An outcome and what shows it; evidence is JSON-ready (infinity as "inf").

    solvers: those whose results the evidence holds; none of what a prover alone decided.
    """

    outcome: str
    evidence: Entries
    solvers: Solvers = ()

    def __post_init__(self) -> None:
        if self.outcome not in OUTCOMES:
            raise ValueError(f"outcome must be one of {', '.join(OUTCOMES)}; got {self.outcome!r}")

    @property
    def witness(self) -> Entries:
        """The witness of a refutation; {} where there is none."""
        witness: Entries = self.evidence.get("witness", {})
        return witness

    @property
    def reason(self) -> str:
        """Reason for which it is refuted or undecided, a sentence; "" where none is given."""
        stated = self.witness if self.outcome == "refuted" else self.evidence
        return str(stated.get("reason", ""))

    def __bool__(self) -> bool:
        raise TypeError("a verdict has three values: compare .outcome")


def proved(**evidence: Value) -> Verdict:
    """The claim holds; evidence: by which means."""
    return Verdict("proved", evidence)


def refuted(witness: Entries, **evidence: Value) -> Verdict:
    """The claim is false; the witness was checked against the claim itself."""
    return Verdict("refuted", {"witness": dict(witness), **evidence})


def undecided(reason: str, **evidence: Value) -> Verdict:
    """Neither could be shown; `reason` in words, and the worst place where there is one."""
    return Verdict("undecided", {"reason": reason, **evidence})


def overall(outcomes: Iterable[str]) -> str:
    """Refuted if any is, else undecided if any is, else proved."""
    distinct = set(outcomes)
    return next((word for word in ("refuted", "undecided") if word in distinct), "proved")
