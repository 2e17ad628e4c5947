"""Unknown-input observers: existence, the observer's equations and its stability, proved.

It exists if and only if C D has full column rank and every invariant zero of (A, D, C), a number s
where [[sI - A, -D], [C, 0]] loses rank, lies in Re s < 0 (docs/papers.md: the paper's own
conditions, p >= q and observability, are refuted). Both are decided on the exact numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from lmi.arithmetic.balls import exact, to_float
from lmi.prove.hurwitz import prove_hurwitz
from lmi.verdict import proved, refuted
from obsdesign.analysis.invariant_zeros import shows_every_input, zeros_decay
from obsdesign.analysis.units import own_units
from obsdesign.document import Claim
from obsdesign.equations.unknown_input import matrices as equations
from obsdesign.problem.problem import Problem
from obsdesign.verification.consistency import consistency
from obsdesign.verification.unknown_input.guarantees import sentences
from obsdesign.verification.unknown_input.lasting_error import lasting_error

PAPER = "Ahn (2002)"
EXISTENCE = "Hautus (1983), strong* detectability"

# the stored matrices are rounded: what must vanish may be this part of its terms
ROUNDING = 1e-9
# the reduced state at the first sample is compared in floats, of a pseudo-inverse
FIRST_STATE = 1e-6


def claims(
    problem: Problem,
    gains: Mapping[str, Any],
    certificates: Mapping[str, Mapping[str, Any]],
    *,
    paranoid: bool = False,
) -> tuple[Claim, ...]:
    """All hypotheses of the design, each with its verdict; of existence alone if there is none."""
    del certificates, paranoid  # nothing is searched for: every claim is decided exactly
    text = equations.objection(problem.plant)
    if text is None and problem.plant.flow.D is None:
        text = "flow.D is required by kind 'unknown_input'; it is missing."
    if text is not None:
        return (consistency(text, gains, {}),)
    existence = _existence(problem)
    if any(claim.verdict != "proved" for claim in existence):
        return existence  # no gains to speak of
    beyond = None if gains else "the gains are beyond binary64; choose other units for y, d or x"
    agreement = consistency(beyond, gains, _expected(problem, gains))
    if agreement.verdict != "proved":
        return (agreement, *existence)
    if text := _false_first_state(gains):
        agreement = consistency(text, gains, _expected(problem, gains))
    numbers = _exact_gains(problem, gains)
    plant, moved, pace = _in_own_units(problem, numbers)
    stable = _stable(numbers["F"], existence[-1].evidence)
    lasting = lasting_error(plant, moved, pace, stable.verdict == "proved")
    return agreement, *existence, _equations(plant, moved), stable, lasting


def guarantees(problem: Problem, found: tuple[Claim, ...]) -> tuple[dict[str, Any], ...]:
    """The sentences a user may rely on, and those that do not hold here."""
    return sentences(problem, found)


def _expected(problem: Problem, gains: Mapping[str, Any]) -> dict[str, Any]:
    flow, C = problem.plant.flow, problem.plant.output.C
    shapes = _shapes(problem)
    stated = {"A": flow.A, "C": C, "D": flow.D} | ({} if flow.B is None else {"B": flow.B})
    computed = {name: shape for name, shape in shapes.items() if 0 not in shape}
    given = equations.without_empty(problem.gains)
    chosen = problem.options.get("differentiator", gains.get("differentiator"))
    if chosen not in equations.DIFFERENTIATORS:  # any will do where the problem names none
        return stated | computed | given | {"differentiator": set(equations.DIFFERENTIATORS)}
    return stated | computed | given | equations.differentiation(problem, chosen)


def _false_first_state(gains: Mapping[str, Any]) -> str | None:
    """Why `first` is not what gives the reduced state of least norm at the first sample, or None.

    In floats: it decides about a transient alone, and about no error that lasts.
    """
    if "first" not in gains:
        return None
    T1, Z, C = gains["T1"], gains.get("Z"), gains["C"]
    k, p = gains["first"].shape
    expected = np.zeros((k, p))
    if Z is not None:
        Ta = T1[:, :k]
        sizes = np.linalg.norm(np.abs(Z) @ np.abs(C) @ np.abs(Ta), axis=1)
        expected = equations.first_state(Z @ C @ Ta, Z, sizes)
    columns = np.abs(expected).max(axis=0, initial=0.0)
    room = FIRST_STATE * np.broadcast_to(columns, expected.shape)
    if np.all(np.abs(gains["first"] - expected) <= room):
        return None
    return "gains.first is not what gives the reduced state of least norm at the first sample"


def _exact_gains(problem: Problem, gains: Mapping[str, Any]) -> dict[str, Any]:
    shapes = _shapes(problem)
    return {name: exact(gains.get(name, np.zeros(shape))) for name, shape in shapes.items()}


def _shapes(problem: Problem) -> dict[str, tuple[int, int]]:
    """Of everything that a design stores."""
    flow = problem.plant.flow
    assert flow.D is not None
    n, q = flow.D.shape
    m = 0 if flow.B is None else flow.B.shape[1]
    return equations.shapes(n, problem.plant.p, q, m)


def _existence(problem: Problem) -> tuple[Claim, Claim] | tuple[Claim]:
    C, D = problem.plant.output.C, problem.plant.flow.D
    assert D is not None
    rank = shows_every_input(C, D)
    first = Claim(
        "rank",
        f"y' shows every unknown input: |C D v| > {equations.RANK_MARGIN:g} |M| |v| for all v, "
        "where M = |C| |D| entry by entry and rows and columns are scaled to even sizes",
        EXISTENCE,
        rank.outcome,
        rank.evidence,
    )
    if rank.outcome != "proved":
        return (first,)
    zeros = zeros_decay(problem.plant.flow.A, C, D)
    second = Claim(
        "zeros",
        "every invariant zero of (A, D, C) has a negative real part",
        EXISTENCE,
        zeros.outcome,
        zeros.evidence,
    )
    return first, second


def _equations(plant: tuple[Any, Any, Any, Any], gains: Mapping[str, Any]) -> Claim:
    """Every condition of `equations.conditions` in exact arithmetic, up to the stored rounding."""
    worst: dict[str, Any] = {"condition": "", "relative": 0.0, "scaled": 0.0}
    for name, (residual, sizes) in equations.conditions(plant, gains).items():
        if not residual.size:
            continue
        off, room = max(abs(residual).flat), max(sizes.flat)
        relative = float(to_float(np.array([off / room]))[0]) if off != 0 else 0.0
        if relative >= worst["relative"]:
            scaled = float(to_float(np.array([off], dtype=object))[0])
            worst = {"condition": name, "relative": relative, "scaled": scaled}
    verdict = proved(largest_residual=worst)
    if worst["relative"] > ROUNDING:
        reason = (
            f"{worst['condition']} fails by {worst['relative']:.3g} of its terms; "
            f"rounding would leave less than {ROUNDING:g}"
        )
        verdict = refuted({**worst, "reason": reason})
    return Claim(
        "observer_equations",
        f"the stored matrices follow from the plant by the observer's formulas, up to {ROUNDING:g} "
        "of their terms, all signals scaled to unit size",
        f"{PAPER}, (21)-(33)",
        verdict.outcome,
        verdict.evidence,
    )


def _in_own_units(
    problem: Problem, gains: Mapping[str, Any]
) -> tuple[tuple[Any, Any, Any, Any], dict[str, Any], float]:
    """Plant, gains with all signals of about unit size, exactly: only then sizes compare; pace."""
    flow, C = problem.plant.flow, problem.plant.output.C
    B = equations.inputs(flow.B, flow.lower, flow.upper)
    assert flow.D is not None
    T, Z = to_float(gains["T"]), to_float(gains["Z"])
    sizes, pace = own_units(flow.A, C, flow.D)
    units = equations.units((flow.A, B, C, flow.D), sizes, T, Z)
    exactly = {name: exact(values) for name, values in units.items()}
    everything = {"A": exact(flow.A), "B": exact(B), "C": exact(C), "D": exact(flow.D), **gains}
    moved = {
        name: value * exactly[equations.UNITS[name][1]] / exactly[equations.UNITS[name][0]][:, None]
        for name, value in everything.items()
    }
    return (moved["A"], moved["B"], moved["C"], moved["D"]), moved, pace


def _stable(F: Any, zeros: Mapping[str, Any]) -> Claim:
    if F.size:
        verdict = prove_hurwitz(F)
        if verdict.outcome == "refuted" and "nearly" in zeros:
            mode, witness = zeros["nearly"], verdict.evidence["witness"]
            why = (
                f"{witness['reason']}; s = {mode['real']:.6g} is within {mode['margin']:.1g} of "
                "being an invariant zero, so that hardly any gain reaches it"
            )
            verdict = refuted({**witness, "reason": why})
        approx = to_float(F)
        fastest = (
            float(np.abs(np.linalg.eigvals(approx)).max()) if np.isfinite(approx).all() else 0.0
        )
    else:
        verdict, fastest = proved(method="nothing is left to be observed"), 0.0
    return Claim(
        "hurwitz",
        "the error of the reduced state decays (F is Hurwitz), and so it does in steps of any "
        "lengths between two positive bounds",
        f"{PAPER}, (27); Lyapunov's theorem",
        verdict.outcome,
        {**verdict.evidence, "approx_fastest": fastest},
    )
