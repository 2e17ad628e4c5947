"""The story in one place: problem, synthesise, verify, design. No mathematics.

(The plan called this file design.py; the name is taken by the function `obsdesign.design`.)
"""

from __future__ import annotations

import importlib
import platform
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from lmi.patience import hurried, left, listening
from lmi.verdict import overall
from obsdesign import __version__
from obsdesign.document import Claim, Design
from obsdesign.errors import InputError
from obsdesign.kinds import KINDS
from obsdesign.problem import Problem
from obsdesign.told_truly import guarantees_of, told_truly


@dataclass(frozen=True)
class Outcome:
    """What a command has to say: the verdict of its claims, and a design where there is one.

    guarantees: sentences {"statement", "given", "claims"} that follow from these claims, never
    those that stand in a file; none where a file's own statements were not confirmed.
    """

    verdict: str
    kind: str
    claims: tuple[Claim, ...]
    result: Mapping[str, Any]
    design: Design | None
    guarantees: tuple[Mapping[str, Any], ...] = ()


def layer(name: str, kind: str) -> Any:
    """The module of a kind in a layer: `equations`, `synthesis`, `verification`.

    InputError for what is no kind: a design file may name anything.
    """
    if kind not in KINDS:
        raise InputError(f"kind must be one of {', '.join(KINDS)}; got {kind!r}.")
    return importlib.import_module(f"obsdesign.{name}.{kind}")


def investigate(problem: Problem) -> Outcome:
    """Synthesise candidates and prove them: the first proved one, else the most hopeful.

    Within `lmi.patience.at_most` searches end early, the first proved candidate is the answer, and
    claims of how well it does are left out; what was not found stays undecided. result["remarks"]
    holds sentences of searches that ended early or settled for less, if there are any.

    InputError when the problem cannot be read as asked (a block is missing, a form does not fit).
    """
    with listening() as remarks:
        outcome = _investigated(problem)
    if remarks:
        outcome = replace(outcome, result={**outcome.result, "remarks": remarks})
    return outcome


def _investigated(problem: Problem) -> Outcome:
    started = time.perf_counter()
    kind = problem.require_kind()
    synthesis, verification = layer("synthesis", kind), layer("verification", kind)
    tried: list[_Attempt] = []
    for candidate, claims in _attempts(problem, synthesis, verification):
        verdict = overall(claim.verdict for claim in claims)
        design = _document(problem, kind, candidate, claims)
        tried.append(_Attempt(candidate.label, verdict, candidate.cost, design))
        enough = hurried() or not candidate.goes_on
        if left() < 0 or (enough and any(one.verdict == "proved" for one in tried)):
            break
    best = _best(tried)
    forms = {one.label: _summary(one.verdict, one.design.claims) for one in tried}
    untried = synthesis.untried(problem) if hasattr(synthesis, "untried") else {}
    forms |= {name: {"verdict": "undecided", "reasons": [why]} for name, why in untried.items()}
    design, seconds = best.design, round(time.perf_counter() - started, 6)
    result = {"form": best.label, "forms": forms, "seconds": seconds}
    return Outcome(best.verdict, kind, design.claims, result, design, design.guarantees)


@dataclass(frozen=True)
class _Attempt:
    """A candidate and what was proved of it."""

    label: str
    verdict: str
    cost: float | None
    design: Design


def _best(tried: list[_Attempt]) -> _Attempt:
    """The first proved one, or the proved one of least cost; else the most hopeful.

    An undecided form may still be true, a refuted one is not; the last form asks for least.
    """
    proved = [one for one in tried if one.verdict == "proved"]
    if proved:
        return min(proved, key=lambda one: 0.0 if one.cost is None else one.cost)
    return min(reversed(tried), key=lambda one: ("undecided", "refuted").index(one.verdict))


def _attempts(
    problem: Problem, synthesis: Any, verification: Any
) -> Iterator[tuple[Any, tuple[Claim, ...]]]:
    for candidate in synthesis.synthesize(problem):
        claims = verification.claims(problem, candidate.gains, candidate.certificates)
        yield candidate, of_what_is_open(candidate, claims)


def of_what_is_open(candidate: Any, claims: tuple[Claim, ...]) -> tuple[Claim, ...]:
    """Claims about a candidate as answers to its problem: a search that fails refutes nothing."""
    if not candidate.searched or any(_of_all_gains(claim) for claim in claims):
        return claims
    return tuple(_of_these_gains_only(claim) for claim in claims)


def _of_all_gains(claim: Claim) -> bool:
    """A witness that speaks about every gain that the problem leaves open."""
    return bool(claim.evidence.get("witness", {}).get("of_all_gains"))


def _of_these_gains_only(claim: Claim) -> Claim:
    """What refutes gains that were searched for does not refute the problem."""
    if claim.verdict != "refuted":
        return claim
    why = f"no gains were found for which it holds; for the last ones tried, {reason(claim)}"
    kept = {name: value for name, value in claim.evidence.items() if name != "witness"}
    kept["these_gains"] = {"witness": claim.evidence.get("witness")}
    return replace(claim, verdict="undecided", evidence={**kept, "reason": why})


def _summary(verdict: str, claims: tuple[Claim, ...]) -> dict[str, Any]:
    return {
        "verdict": verdict,
        "reasons": [f"{c.id}: {reason(c)}" for c in claims if c.verdict != "proved"],
    }


def reason(claim: Claim) -> str:
    """Why a claim is refuted or undecided, in one sentence from its evidence."""
    evidence = claim.evidence
    witness = evidence.get("witness", {})
    return str(evidence.get("reason") or witness.get("reason") or claim.statement)


def _document(problem: Problem, kind: str, candidate: Any, claims: tuple[Claim, ...]) -> Design:
    """The design of a candidate; nothing in it differs from run to run."""
    verification = layer("verification", kind)
    return Design(
        name=problem.name,
        kind=kind,
        problem=problem.to_dict(),
        gains=dict(candidate.gains),
        claims=claims,
        guarantees=guarantees_of(problem, claims, verification),
        provenance={
            "versions": {"obsdesign": __version__}
            | {name: version(name) for name in ("numpy", "python-flint")}
            | {"python": platform.python_version()},
            "solver": {"name": "clarabel", "version": version("clarabel")},
            "options": {"label": candidate.label},
        },
    )


# distribution -> the module that states its version; asking the module is faster than the installer
_MODULES = {"numpy": "numpy", "python-flint": "flint", "clarabel": "clarabel"}


def version(distribution: str) -> str:
    """Version of a distribution as it runs here, or "not installed"."""
    module = sys.modules.get(_MODULES.get(distribution, ""))
    stated = getattr(module, "__version__", None)
    if isinstance(stated, str):
        return stated
    from importlib import metadata  # slow to import

    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return "not installed"


def design(problem: Problem, *, allow_undecided: bool = False) -> Design:
    """A proved design for a problem.

    Raises InputError for a problem that cannot be read as asked, and NotProved when the answer
    is no (or, unless `allow_undecided`, not known); its `.outcome` holds claims and witnesses.
    """
    outcome = investigate(problem)
    accepted = ("proved", "undecided") if allow_undecided else ("proved",)
    if outcome.verdict not in accepted or outcome.design is None:
        raise NotProved(outcome)
    return outcome.design


class NotProved(Exception):
    """The problem has no proved design: refuted (with a witness) or undecided."""

    def __init__(self, outcome: Outcome) -> None:
        failed = [claim for claim in outcome.claims if claim.verdict == outcome.verdict]
        super().__init__(f"{outcome.verdict}: " + "; ".join(reason(claim) for claim in failed))
        self.outcome = outcome


def verify(design: Design, *, paranoid: bool = False) -> Outcome:
    """Prove everything again from the design alone; no optimisation solver is used.

    paranoid: prove a second time by an independent method where there is one. Also checks that
    problem, gains, claims and guarantees of the document agree.
    """
    verification = layer("verification", design.kind)
    try:
        problem = Problem.from_dict(design.problem)
        if problem.require_kind() != design.kind:
            raise InputError(f"problem.observer.kind is {problem.kind!r}, kind is {design.kind!r}.")
    except InputError as error:
        raise InputError(f"the problem inside the design: {error}") from None
    certificates = {claim.id: claim.evidence for claim in design.claims}
    claims = verification.claims(problem, design.gains, certificates, paranoid=paranoid)
    document, guarantees = told_truly(problem, design, claims, verification)
    claims = (*claims, document)
    verdict = overall(claim.verdict for claim in claims)
    return Outcome(verdict, design.kind, claims, {}, design, guarantees)
