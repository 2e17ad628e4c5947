"""Claims that the constraints on the gains hold: norm, structure, eigenvalues; as stored.

Where a gain is given, or a part of the error that no allowed entry changes is outside the region,
the witness holds for all gains.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from lmi.arithmetic.arrays import Array, NewEntries
from lmi.arithmetic.balls import Exact, exact
from lmi.prove.hurwitz import prove_hurwitz
from lmi.prove.regions import prove_disc, prove_half_plane, prove_norm, prove_sector
from lmi.refute.spectral import refute_spectral
from lmi.verdict import Verdict, overall, proved, refuted
from obsdesign.analysis.hidden_modes import fixed_parts
from obsdesign.document import Claim
from obsdesign.equations.estimation_error import (
    flow_error_matrix,
    idle_gains,
    jump_error_matrix,
    seen_before_jump,
)
from obsdesign.equations.gains import PlantGains
from obsdesign.problem.gain_constraints import ConstrainedGains, GainConstraints
from obsdesign.problem.problem import Problem
from obsdesign.verification.choices import mark_witness

_SOURCES = {
    "gain_norm": "exact characteristic polynomial of norm^2 I - K'K",
    "structure": "entries of the file",
    "region": "Lyapunov's theorem and Routh's test",
}
IDS = tuple(_SOURCES)


def constraint_claims(
    problem: Problem, gains: PlantGains, stored: Mapping[str, Array]
) -> tuple[Claim, ...]:
    """Claims `gain_norm`, `structure` and `region`, where the problem states them.

    stored: by name every gain (n, p) of the design: "L", "M", and others at jumps, "M...".
    """
    options = problem.options_as(ConstrainedGains)
    stated = {gain: options.gain_constraints(gain) for gain in ("L", "M")}
    verdicts: dict[str, dict[str, Verdict]] = {name: {} for name in IDS}
    for name, K in stored.items():
        gain = name[0]
        constraints = stated[gain]
        if constraints.norm is not None:
            verdicts["gain_norm"][name] = prove_norm(exact(K), constraints.norm)
        if constraints.pattern is not None:
            verdicts["structure"][name] = _structure(K, np.array(constraints.pattern))
        if constraints.has_region():
            verdicts["region"][name] = prove_region(error_matrix(gains, gain, K), constraints)
    return tuple(
        _claim(problem, name, _statement(name, stated), parts)
        for name, parts in verdicts.items()
        if parts
    )


def error_matrix(gains: PlantGains, gain: str, K: Array) -> Exact:
    """The matrix of the error that a gain moves: A - L C, or that at jumps, exact."""
    if gain == "L":
        return flow_error_matrix(exact(gains.A), exact(K), exact(gains.C))
    G, M, C = (exact(matrix) for matrix in (gains.jump_matrix, K, gains.C))
    return jump_error_matrix(G, M, C, gains.jump_measurement)


def prove_region(F: Exact, constraints: GainConstraints) -> Verdict:
    """Decide whether the eigenvalues of F lie in all stated regions."""
    verdicts = []
    if constraints.decay is not None:
        verdicts.append(prove_half_plane(F, constraints.decay))
    if constraints.sector is not None:
        verdicts.append(prove_sector(F, constraints.sector))
    if constraints.disc is not None:
        verdicts.append(prove_disc(F, constraints.disc.centre, constraints.disc.radius))
    return _worst(verdicts)


def stated_pattern(problem: Problem, *names: str) -> Array:
    """Entries, (n, p), that may differ from zero in one of the gains."""
    plant, options = problem.plant, problem.options_as(ConstrainedGains)
    if options.structure is None:
        return np.ones((plant.n, plant.p), dtype=bool)
    free = np.zeros((plant.n, plant.p), dtype=bool)
    for name in set(names) - set(idle_gains(plant)):
        pattern = options.gain_constraints(name).pattern
        free |= True if pattern is None else np.array(pattern) != 0
    return free


def _structure(K: Array, pattern: Array) -> Verdict:
    """Decide whether all entries outside of a pattern are zero."""
    for i, j in np.argwhere((K != 0) & (pattern == 0)):
        value = float(K[i, j])
        reason = f"row {i + 1}, column {j + 1} is {value!r}, where the structure has a zero"
        return refuted({"row": int(i) + 1, "column": int(j) + 1, "value": value, "reason": reason})
    return proved(zeros=int((pattern == 0).sum()))


def _worst(verdicts: Sequence[Verdict]) -> Verdict:
    """The first verdict of the gravest outcome; where all are proved the first."""
    outcome = overall(verdict.outcome for verdict in verdicts)
    return next(verdict for verdict in verdicts if verdict.outcome == outcome)


def _claim(problem: Problem, name: str, statement: str, parts: Mapping[str, Verdict]) -> Claim:
    """The claim that several gains meet a constraint."""
    outcome = overall(verdict.outcome for verdict in parts.values())
    if outcome == "proved":
        evidence: NewEntries = {gain: dict(part.evidence) for gain, part in parts.items()}
        return Claim(name, statement, _SOURCES[name], outcome, evidence)
    gain, part = next((g, v) for g, v in parts.items() if v.outcome == outcome)
    evidence = dict(part.evidence)
    if outcome == "refuted":
        evidence["witness"] = {"gain": gain, **part.evidence["witness"]}
    claim = Claim(name, statement, _SOURCES[name], outcome, evidence)
    letter = gain[0]
    if letter in {*problem.gains, *idle_gains(problem.plant)}:
        return mark_witness(claim)
    return _with_fixed_part(problem, claim, letter) if name == "region" else claim


def _with_fixed_part(problem: Problem, claim: Claim, gain: str) -> Claim:
    """The claim, its witness that of a part of the error which no allowed gain changes, if any."""
    plant, options = problem.plant, problem.options_as(ConstrainedGains)
    X, C = plant.flow.A, plant.output.C
    if gain == "M":
        assert plant.jump is not None
        X, C = plant.jump.G, seen_before_jump(plant.jump.G, C, plant.output.jump_measurement)
    for (part,) in fixed_parts([X], C, stated_pattern(problem, gain)):
        verdict = prove_region(part, options.gain_constraints(gain))
        if claim.verdict == "refuted" and verdict.outcome == "refuted":
            witness = verdict.evidence["witness"]
            reason = f"{witness['reason']}, and no {gain}{within_structure(problem, gain)} moves it"
            evidence = {"witness": {"gain": gain, **witness, "reason": reason}}
            return mark_witness(Claim(claim.id, claim.statement, claim.source, "refuted", evidence))
    return claim


def witness_within_structure(problem: Problem, rate: float = 0.0) -> NewEntries | None:
    """Witness that no gain within the structure makes the error decay faster than e^(-rate t).

    Exact: a part of the error that no allowed entry changes does not shrink. None without one.
    """
    plant = problem.plant
    A, C = plant.flow.A, plant.output.C

    def faster(flow: Exact) -> Exact:
        shifted: Exact = flow + exact(rate * np.eye(len(flow)))
        return shifted

    ends = None if plant.jump is None else problem.require_dwell_time()
    verdicts: list[Verdict] = []
    if ends is None or math.isinf(ends[1]):
        parts = fixed_parts([A], C, stated_pattern(problem, "L"))
        verdicts += [prove_hurwitz(faster(flow)) for (flow,) in parts]
    if ends is not None:
        assert plant.jump is not None
        pairs = fixed_parts([A, plant.jump.G], C, stated_pattern(problem, "L", "M"))
        verdicts += [refute_spectral(faster(flow), jump, *ends) for flow, jump in pairs]
    for verdict in verdicts:
        if verdict.outcome == "refuted":
            witness = verdict.evidence["witness"]
            scope = within_structure(problem, "L", "M")
            reason = f"{witness['reason']}; no gain{scope} changes that part of the error"
            return {**witness, "reason": reason}
    return None


def within_structure(problem: Problem, *gains: str) -> str:
    """Return " within observer.structure" where a pattern is stated for one of the gains."""
    options = problem.options_as(ConstrainedGains)
    stated = any(options.gain_constraints(gain).pattern is not None for gain in gains)
    return " within observer.structure" if stated else ""


def _statement(name: str, stated: Mapping[str, GainConstraints]) -> str:
    return " and ".join(text for text in (_text(name, *item) for item in stated.items()) if text)


def _text(name: str, gain: str, constraints: GainConstraints) -> str:
    """The statement about one gain; empty where it has none."""
    if name == "gain_norm" and constraints.norm is not None:
        return f"the spectral norm of {gain} is at most {constraints.norm!r}"
    if name == "structure" and constraints.pattern is not None:
        rows = [[int(value) for value in row] for row in constraints.pattern]
        return f"{gain} is zero where {rows} is"
    if name != "region" or not constraints.has_region():
        return ""
    matrix = "A - L C" if gain == "L" else "the error's matrix at jumps"
    places = []
    if constraints.decay is not None:
        places.append(f"have real parts below {-constraints.decay + 0.0!r}")
    if constraints.sector is not None:
        places.append(f"lie within {constraints.sector!r} rad of the negative real axis")
    if constraints.disc is not None:
        centre, radius = constraints.disc.centre, constraints.disc.radius
        places.append(f"lie in the open disc of radius {radius!r} around {centre!r}")
    return f"all eigenvalues of {matrix} {' and '.join(places)}"


def constraint_sentences(claims: Iterable[Claim]) -> list[tuple[str, list[str]]]:
    """Sentences of the claims on the constraints, each with the claim that it rests on."""
    return [
        (f"{claim.statement[0].upper()}{claim.statement[1:]}.", [claim.id])
        for claim in claims
        if claim.id in IDS
    ]
