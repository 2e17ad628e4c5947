"""Problem, synthesise, verify, design: the steps in one place, without mathematics."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from typing import TypeVar

from lmi.arithmetic.arrays import Entries
from lmi.memory import OversizeError
from lmi.time_budget import UNLIMITED, Remark, TimeBudget, remark_end
from lmi.time_budget import sentences as budget_sentences
from lmi.verdict import overall
from obsdesign.candidate_choice import answers_of_forms, best_candidate, tried_candidates
from obsdesign.document import Claim, Design, Guarantee
from obsdesign.errors import InputError, naming
from obsdesign.html_table import html_table
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.kind import Constraints
from obsdesign.verification.answers import is_ended, reason, with_untried
from obsdesign.verification.document import Sentences, document_claim, sentences_from, state_rows
from obsdesign.verification.kind import verification_for, verification_of
from obsdesign.verification.second_opinion import checker_claims
from obsdesign.version import provenance

_Key = TypeVar("_Key", bound=Hashable)


@dataclass(frozen=True)
class Outcome:
    """The verdict of the claims of a command, and a design where there is one.

    verdict: "proved", "refuted" if any claim is, else "undecided"; result: further entries of the
    answer in --json. guarantees, warnings: sentences that follow from these claims, never those
    that stand in a file; none where a file's own statements were not confirmed. headline: these
    guarantees in phrases of a few words.
    """

    verdict: str
    kind: str
    claims: tuple[Claim, ...]
    result: Entries
    design: Design | None
    guarantees: tuple[Guarantee, ...] = ()
    warnings: tuple[str, ...] = ()
    headline: tuple[str, ...] = ()

    def with_claims(self, claims: tuple[Claim, ...]) -> Outcome:
        """The outcome of these claims besides."""
        every = (*self.claims, *claims)
        return replace(self, claims=every, verdict=overall(claim.verdict for claim in every))

    def __repr__(self) -> str:
        proved = sum(claim.verdict == "proved" for claim in self.claims)
        return f"Outcome({self.kind}: {self.verdict}, {proved} of {len(self.claims)} claims proved)"

    def _repr_html_(self) -> str:
        rows = [(claim.id, claim.verdict, "" if claim.verdict == "proved" else reason(claim))
                for claim in self.claims]  # fmt: skip
        text = html_table((f"{self.kind}: {self.verdict}", "verdict", "why"), rows)
        return text + "".join(f"<p>{escape(phrase)}</p>" for phrase in self.headline)


_UNUSED_BOX = Remark(
    "no claim uses [state]: it bounds effects of parameters, and there are none; `simulate` "
    "starts in its middle"
)


def investigate(
    problem: Problem, *, seconds: float | None = None, constraints: Constraints | None = None
) -> Outcome:
    """Synthesise candidates and prove them: the first proved one, else the nearest to a proof.

    seconds: of processor time that searches may take in all; None for their own budgets, which a
    larger total stretches (`investigate_each`). An undecided claim that a budget ended holds what
    `TimeBudget.ended` has of it in its evidence. result["remarks"] holds sentences of searches
    that ended early or settled for less, if there are any.
    constraints: for kinds luenberger and interval, a function of `GainVariables` that returns a
    list of CVXPY constraints on an open gain; called for L and for M. They restrict the search,
    and nothing is claimed of them; undecided where no gains are found.

    InputError when the kind does not serve the problem (an entry is missing, a form does not fit),
    or for constraints that are not convex or belong to another kind.
    """
    budget = TimeBudget.from_seconds(seconds)
    outcome = investigate_each({None: problem}, budget, constraints=constraints)[None]
    if isinstance(outcome, InputError):
        raise outcome
    return outcome


def investigate_each(
    problems: Mapping[_Key, Problem],
    budget: TimeBudget = UNLIMITED,
    *,
    first: bool = False,
    done: Callable[[_Key], None] = lambda key: None,
    constraints: Constraints | None = None,
) -> dict[_Key, Outcome | InputError]:
    """The outcome of each problem, or the refusal of one that its kind does not serve.

    Every problem is tried with the searches' own budgets; while a total lasts, those that a budget
    ended are tried again, with ever longer ones. So more time never makes less of a problem.
    first: the first proved candidate ends an attempt. done: called with what is settled.
    constraints: as for `investigate`.
    """
    outcomes: dict[_Key, _Attempt | InputError] = {}
    todo = dict(problems)
    for stretched in budget.attempts():
        for key, problem in list(todo.items()):
            attempt = _attempted(problem, first, stretched, constraints)
            outcomes[key] = _better(outcomes.get(key), attempt)
            if isinstance(attempt, InputError) or not attempt.is_open(first):
                done(key)
                del todo[key]
        if not todo:
            break
    return {
        key: entry if isinstance(entry, InputError) else entry.outcome
        for key, entry in outcomes.items()
    }


@dataclass(frozen=True)
class _Attempt:
    """An outcome, the cost of its design, and the searches that a budget ended."""

    outcome: Outcome
    cost: float | None
    ended: Sequence[Remark]

    def is_open(self, first: bool) -> bool:
        """May longer searches decide it, or where not the first design will do make it better?"""
        if self.outcome.verdict == "proved":
            return not first and any(entry.matters for entry in self.ended)
        return self.outcome.verdict == "undecided" and any(map(is_ended, self.outcome.claims))


def _better(
    before: _Attempt | InputError | None, now: _Attempt | InputError
) -> _Attempt | InputError:
    """What decides; of two designs the one of least cost, of equals the later."""
    if before is None or isinstance(before, InputError):
        return now
    if isinstance(now, InputError):
        return before
    order = ("proved", "refuted", "undecided")
    ranks = [order.index(one.outcome.verdict) for one in (before, now)]
    if ranks[0] != ranks[1]:
        return before if ranks[0] < ranks[1] else now
    costs = [0.0 if one.cost is None else one.cost for one in (before, now)]
    return before if costs[0] < costs[1] else now


def _attempted(
    problem: Problem, first: bool, budget: TimeBudget, constraints: Constraints | None
) -> _Attempt | InputError:
    try:
        tried, untried = tried_candidates(problem, first, budget, constraints)
    except InputError as error:
        return error
    except OversizeError as error:
        return InputError(str(error))
    remarks = [remark for one in tried for remark in one.candidate.remarks]
    if problem.plant.state is not None and not problem.plant.parameters:
        remarks.append(_UNUSED_BOX)
    best = best_candidate(tried)
    claims = best.claims
    if untried is not None:
        remarks += untried.remarks
        claims = tuple(with_untried(claim, budget.ended()) for claim in claims)
    verdict = overall(claim.verdict for claim in claims)
    if verdict == "proved" and not first and not any(one.evidence for one in remarks):
        remarks += remark_end("a better design", budget.ended())
    result = answers_of_forms(problem, best.candidate.label, tried) | {
        "seconds": round(best.seconds, 6)
    }
    if rows := state_rows(problem, claims):
        result |= {"states": rows}
    better = verdict == "proved"
    listed = [one for one in remarks if not one.evidence or (better and one.matters)]
    if texts := budget_sentences(listed):
        result |= {"remarks": texts}
    sentences = sentences_from(problem, claims)
    design = _document(problem, best.candidate, claims, sentences)
    outcome = Outcome(
        verdict, design.kind, claims, result, design, sentences.guarantees, sentences.warnings,
        sentences.headline,
    )  # fmt: skip
    return _Attempt(outcome, best.candidate.cost, [one for one in remarks if one.evidence])


def _document(
    problem: Problem, candidate: Candidate, claims: tuple[Claim, ...], sentences: Sentences
) -> Design:
    """The design of a candidate; nothing in it differs from run to run."""
    kind = problem.require_kind()
    return Design(
        name=problem.name,
        kind=kind,
        problem=problem.to_dict(),
        gains=candidate.document(),
        claims=claims,
        guarantees=sentences.guarantees,
        warnings=sentences.warnings,
        provenance=provenance(candidate.solvers, candidate.label),
    )


def design(
    problem: Problem,
    *,
    kind: str | None = None,
    allow_undecided: bool = False,
    seconds: float | None = None,
    constraints: Constraints | None = None,
) -> Design:
    """Return a proved design for a problem; seconds, constraints: as for `investigate`.

    kind: another than that of the problem, whose gains and options are then left out. Each claim of
    the design names the theorem that it is a hypothesis of. InputError as for `investigate`;
    NotProved where a claim is refuted (or, unless `allow_undecided`, undecided).
    """
    if kind is not None:
        problem = problem.for_kind(kind)[0]
    outcome = investigate(problem, seconds=seconds, constraints=constraints)
    accepted = ("proved", "undecided") if allow_undecided else ("proved",)
    if outcome.verdict not in accepted or outcome.design is None:
        raise NotProved(outcome)
    return outcome.design


class NotProved(Exception):
    """The problem has no proved design; `.outcome` holds the claims and their witnesses."""

    def __init__(self, outcome: Outcome) -> None:
        failed = [claim for claim in outcome.claims if claim.verdict == outcome.verdict]
        reasons = dict.fromkeys(reason(claim) for claim in failed)  # claims may share one
        super().__init__(f"{outcome.verdict}: " + "; ".join(reasons))
        self.outcome = outcome


def verify(design: Design, *, paranoid: bool = False) -> Outcome:
    """Prove all claims again from the design alone; no optimisation solver is used.

    paranoid: prove a second time by an independent method where there is one, and by the programs
    of `obsdesign/checker`, claim `checker`, where they read the design (docs/proofs.md). The claim
    `document` compares what the design states with what was proved. InputError where
    problem and kind of the design do not agree.
    """
    verification_of(design.kind)  # is it a kind?
    with naming("the problem inside the design"):
        problem = Problem.from_dict(design.problem)
        if problem.require_kind() != design.kind:
            raise InputError(f"problem.observer.kind is {problem.kind!r}, kind is {design.kind!r}.")
        verification = verification_for(problem)
    certificates = {claim.id: claim.evidence for claim in design.claims}
    try:
        claims = verification.claims(problem, design.gains, certificates, paranoid=paranoid)
    except OversizeError as error:
        raise InputError(str(error)) from None
    document, sentences = document_claim(problem, design, claims)
    rows = state_rows(problem, claims)
    claims = (*claims, *(checker_claims(design) if paranoid else ()), document)
    verdict = overall(claim.verdict for claim in claims)
    result = {"states": rows} if rows else {}
    return Outcome(
        verdict, design.kind, claims, result, design, sentences.guarantees, sentences.warnings,
        sentences.headline,
    )  # fmt: skip
