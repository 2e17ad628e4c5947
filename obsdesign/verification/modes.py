"""Claims about observers of modes that the kinds share: consistency and stability."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from lmi.arithmetic.arrays import Entries, NewEntries, Value
from lmi.modes import Modes, StayWord
from lmi.prove.modes_proof import prove_modes
from lmi.refute.stays import refute_endless_stay, refute_stays
from lmi.verdict import Verdict, overall, undecided
from obsdesign.analysis.modes import reason_against_modes
from obsdesign.document import Claim, jsonable, same
from obsdesign.equations.clocks import events_of
from obsdesign.equations.modes import ModeGains, SwitchedGains, event_entries, mode_entries
from obsdesign.problem.modes import spans_of
from obsdesign.problem.problem import Problem
from obsdesign.verification.consistency import consistent_gains, inconsistent
from obsdesign.verification.second_proof import confirmed

STABILITY = "mode_stability"
SOURCE = (
    "one P for each mode, or for each cell of the stay before it, that falls at changes of mode "
    "(docs/modes.md)"
)
# of a mode, and whatever gains it stores -> its expected gains without stays and successors
Expected = Callable[[Problem, int, Entries], Entries]


def consistent_modes(
    problem: Problem, stored: Entries, expected: Expected, kind: type[ModeGains]
) -> tuple[Claim, SwitchedGains[ModeGains] | None]:
    """Claim that `stored` holds the gains of the problem's modes; typed where it is proved."""
    if objection := reason_against_modes(problem):
        return inconsistent(objection), None
    spans, events = spans_of(problem.plant.modes), events_of(problem.plant)
    spacing = problem.plant.timing.spacing or None
    names = {"modes"} | ({"events"} if events else set()) | ({"spacing"} if spacing else set())
    try:
        listed, stated = mode_entries(stored), event_entries(stored)
        if set(stored) != names or len(listed) != len(spans):
            raise ValueError(
                f"gains must hold {len(spans)} modes, {', '.join(sorted(names))} alone"
            )
    except ValueError as error:
        return inconsistent(str(error)), None
    wanted = {"events": [event.to_document() for event in events], "spacing": spacing}
    for name, value in {"events": stated, "spacing": stored.get("spacing")}.items():
        if not same(jsonable(value), jsonable(wanted[name])):
            return inconsistent(f"gains.{name} differ from what the problem says"), None
    claim: Claim | None = None
    for k, (span, own) in enumerate(zip(spans, listed, strict=True)):
        entries = {name: _as_array(value) for name, value in own.items()}
        wanted = span.to_document() | dict(expected(problem, k, entries))
        each, _ = consistent_gains(None, entries, wanted, kind.from_document)
        if claim is None or each.verdict != "proved":
            claim = each if each.verdict == "proved" else _in_mode(each, span.name)
        if claim.verdict != "proved":
            return claim, None
    assert claim is not None
    claim = replace(claim, evidence={"modes": len(spans)})
    try:
        return claim, SwitchedGains.from_document(stored, kind)
    except ValueError as error:
        return inconsistent(str(error)), None


def _as_array(value: Value) -> Value:
    return np.array(value, dtype=np.float64) if isinstance(value, list | tuple) else value


def _in_mode(claim: Claim, name: str) -> Claim:
    """The claim with the name of a mode before the reason of its witness."""
    witness = claim.evidence.get("witness", {})
    reason = f"in mode {name}: {witness.get('reason', '')}"
    return replace(claim, evidence={**claim.evidence, "witness": {**witness, "reason": reason}})


def in_all_modes(names: Sequence[str], claims: Sequence[Claim]) -> Claim:
    """One claim for all modes, from the same claim of each."""
    verdict = overall(claim.verdict for claim in claims)
    evidence: NewEntries = {}
    for name, claim in zip(names, claims, strict=True):
        if claim.verdict == verdict != "proved":
            evidence = dict(_in_mode(claim, name).evidence) if verdict == "refuted" else dict(
                claim.evidence
            )  # fmt: skip
            break
    return replace(
        claims[0], statement=f"in every mode, {claims[0].statement}", verdict=verdict,
        evidence=evidence,
    )  # fmt: skip


def stability_claim(
    verdict: Verdict, what: str, source: str = SOURCE, name: str = STABILITY
) -> Claim:  # fmt: skip
    """Claim that `what` tends to zero along all paths of the modes."""
    return Claim.from_verdict(
        name,
        f"{what} tends to zero for all sequences of modes and stays that the problem allows",
        source,
        verdict,
    )


def mode_stability(modes: Modes, certificate: Entries, paranoid: bool) -> Verdict:
    """Decide stability by a proposed certificate, or by a proposed cycle of stays.

    certificate: {"cells": ...} or {"witness": {"stays": [[name, theta], ...]}}; it is checked here,
    or not used.
    """
    endless = refute_endless_stay(modes)
    if endless.outcome == "refuted":
        return endless
    attempt = undecided("no certificate was given or found")
    if "cells" in certificate:
        attempt = prove_modes(modes, certificate)
        if attempt.outcome == "proved":
            cells = {"cells": certificate["cells"]}
            proof = Verdict("proved", {**cells, **attempt.evidence})
            if not paranoid:
                return proof
            return confirmed(proof, lambda: prove_modes(modes, certificate, method="chords"))
    word = _word(modes, certificate.get("witness"))
    if word:
        counter = refute_stays(modes, word)
        if counter.outcome == "refuted":
            return counter
    if "cells" not in certificate and "reason" in certificate:
        return undecided(str(certificate["reason"]))
    return attempt


def _word(modes: Modes, witness: Value) -> StayWord:
    """The cycle of a witness, in places of modes; () where it is none."""
    stays = witness.get("stays") if isinstance(witness, Mapping) else None
    places = {name: k for k, name in enumerate(modes.names)}
    try:
        return tuple((places[name], float(theta)) for name, theta in stays or ())
    except (TypeError, ValueError, KeyError):
        return ()
