"""Unknown-input observers: existence, the observer's equations and its stability, proved.

It exists if and only if C D has full column rank and every invariant zero of (A, D, C), a number s
where [[sI - A, -D], [C, 0]] loses rank, lies in Re s < 0 (docs/papers.md: the paper's own
conditions, p >= q and observability, are refuted). Both are decided on the exact numbers.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from lmi.arithmetic.arrays import Array, Entries, EntriesByClaim, Matrix, NewEntries
from lmi.arithmetic.balls import Exact, exact, to_float
from lmi.arithmetic.spectrum import spectral_radius
from lmi.prove.hurwitz import prove_hurwitz
from lmi.time_budget import UNLIMITED, TimeBudget
from lmi.verdict import proved, refuted
from obsdesign.analysis.balancing import balancing_units
from obsdesign.analysis.invariant_zeros import NearZero, shows_every_input, zeros_decay
from obsdesign.document import Claim
from obsdesign.equations.unknown_input import formulas as equations
from obsdesign.equations.unknown_input.formulas import ObserverMatrices, PlantMatrices
from obsdesign.equations.unknown_input.gains import (
    DIFFERENTIATORS,
    UnknownInputGains,
    shapes,
    without_empty,
)
from obsdesign.equations.unknown_input.options import REASON_AGAINST_JUMPS, differentiation
from obsdesign.problem.options import UnknownInputOptions
from obsdesign.problem.problem import Problem
from obsdesign.verification import stated_poles
from obsdesign.verification.consistency import consistent_gains, inconsistent
from obsdesign.verification.unknown_input.discrete_time import step_input_claims
from obsdesign.verification.unknown_input.steady_state_error import steady_state_error

PAPER = "Ahn (2002)"
EXISTENCE = "Hautus (1983), strong* detectability"

# the stored matrices are rounded: what must vanish may be this part of its terms
ROUNDING = 1e-9
# the reduced state at the first sample is compared in floats, of a pseudo-inverse
FIRST_STATE = 1e-6


def claims(
    problem: Problem,
    stored: Entries,
    certificates: EntriesByClaim,
    *,
    paranoid: bool = False,
    budget: TimeBudget = UNLIMITED,
) -> tuple[Claim, ...]:
    """All hypotheses of the design, each with its verdict; of existence alone if there is none.

    stored: gains as a design file states them.
    """
    if problem.plant.flow.dt is not None:
        return step_input_claims(problem, stored, paranoid)
    del certificates, paranoid, budget  # nothing is searched for: every claim is decided exactly
    if problem.plant.jump is not None:
        return (inconsistent(REASON_AGAINST_JUMPS),)
    if reason := problem.reason_without("flow.D"):
        return (inconsistent(reason),)
    existence = _existence(problem)
    if any(claim.verdict != "proved" for claim in existence):
        return existence  # no gains to speak of
    beyond = None if stored else "the gains are beyond binary64; choose other units for y, d or x"
    agreement, gains = consistent_gains(
        beyond, stored, _expected(problem, stored), UnknownInputGains.from_document
    )
    if gains is None:
        return (agreement, *existence)
    if text := _reason_against_first_state(gains):
        agreement = inconsistent(text)
    plant, matrices, pace = _in_balancing_units(problem, gains)
    stable = _stable(gains.F, NearZero.from_evidence(existence[-1].evidence))
    steady = steady_state_error(plant, matrices, pace, stable.verdict == "proved")
    chosen = _choice_of_L(problem, gains.F)
    return agreement, *existence, _equations(plant, matrices), stable, steady, *chosen


def _choice_of_L(problem: Problem, F: Matrix) -> tuple[Claim, ...]:
    """The claim that F (k, k) has the stated poles, where there are any."""
    poles = problem.options_as(UnknownInputOptions).poles
    if poles is None:
        return ()
    changes = stated_poles.rounding_of_entries(F)
    claim = stated_poles.poles_claim(exact(F), poles, name="F", changes=changes, has_others=True)
    return (claim,)


def _expected(problem: Problem, stored: Entries) -> NewEntries:
    flow, output = problem.plant.flow, problem.plant.output
    assert flow.D is not None
    m = 0 if flow.B is None else flow.B.shape[1]
    plant = {"A": flow.A, "C": output.C, "D": flow.D} | ({} if flow.B is None else {"B": flow.B})
    (n, q), p = flow.D.shape, len(output.C)
    computed = {name: shape for name, shape in shapes(n, p, q, m).items() if 0 not in shape}
    given = without_empty(problem.gains)
    options = problem.options_as(UnknownInputOptions)
    chosen = options.differentiator or stored.get("differentiator")
    if chosen not in DIFFERENTIATORS:  # any will do where the problem names none
        return plant | computed | given | {"differentiator": set(DIFFERENTIATORS)}
    choice = differentiation(chosen, output.noise_std, output.noise_centre, options.lag)
    return plant | computed | given | choice


def _reason_against_first_state(gains: UnknownInputGains) -> str | None:
    """Return why `first` does not give the reduced state of least norm, or None.

    In floats: it decides about a transient alone, and about no error that lasts.
    """
    Ta = gains.T1[:, : gains.k]
    sizes = np.linalg.norm(np.abs(gains.Z) @ np.abs(gains.C) @ np.abs(Ta), axis=1)
    expected = equations.first_state(gains.Z @ gains.C @ Ta, gains.Z, sizes)
    columns = np.abs(expected).max(axis=0, initial=0.0)
    room = FIRST_STATE * np.broadcast_to(columns, expected.shape)
    if np.all(np.abs(gains.first - expected) <= room):
        return None
    return "gains.first is not what gives the reduced state of least norm at the first sample"


def _existence(problem: Problem) -> tuple[Claim, Claim] | tuple[Claim]:
    C, D = problem.plant.output.C, problem.plant.flow.D
    assert D is not None
    rank = shows_every_input(C, D)
    first = Claim.from_verdict(
        "rank",
        f"y' shows every unknown input: |C D v| > {equations.RANK_MARGIN:g} |M| |v| for all v, "
        "where M = |C| |D| entry by entry and rows and columns are scaled to even sizes",
        EXISTENCE,
        rank,
    )
    if rank.outcome != "proved":
        return (first,)
    zeros = zeros_decay(problem.plant.flow.A, C, D)
    second = Claim.from_verdict(
        "zeros",
        "every invariant zero of (A, D, C) has a negative real part",
        EXISTENCE,
        zeros,
    )
    return first, second


def _equations(plant: PlantMatrices, matrices: ObserverMatrices) -> Claim:
    """Every condition of `equations.conditions` in exact arithmetic, up to the stored rounding."""
    condition, relative, scaled = "", 0.0, 0.0
    for name, (residual, sizes) in equations.conditions(plant, matrices).items():
        if not residual.size:
            continue
        off, room = max(abs(residual).flat), max(sizes.flat)
        part, whole = to_float(np.array([off / room if off else off, off], object)).tolist()
        if part >= relative:
            condition, relative, scaled = name, part, whole
    worst = {"condition": condition, "relative": relative, "scaled": scaled}
    verdict = proved(largest_residual=worst)
    if relative > ROUNDING:
        reason = (
            f"{condition} fails by {relative:.3g} of its terms; "
            f"rounding would leave less than {ROUNDING:g}"
        )
        verdict = refuted({**worst, "reason": reason})
    return Claim.from_verdict(
        "observer_equations",
        f"the stored matrices follow from the plant by the observer's formulas, up to {ROUNDING:g} "
        "of their terms, all signals scaled to unit size",
        f"{PAPER}, (21)-(33)",
        verdict,
    )


def _in_balancing_units(
    problem: Problem, gains: UnknownInputGains
) -> tuple[PlantMatrices, ObserverMatrices, float]:
    """Plant, observer with all signals of about unit size, exactly, so that sizes compare; pace."""
    flow, C = problem.plant.flow, problem.plant.output.C
    B = equations.known_inputs(flow.B, *flow.disturbance_box())
    assert flow.D is not None
    sizes, pace = balancing_units(flow.A, C, flow.D)
    plant = PlantMatrices(flow.A, B, C, flow.D)
    units = equations.units(plant, sizes, gains.T, gains.Z)
    exact_units = {signal: exact(values) for signal, values in units.items()}

    def scaled(name: str, matrix: Array) -> Exact:
        rows, columns = (exact_units[signal] for signal in equations.UNITS[name])
        return np.asarray(exact(matrix) * columns / rows[:, None])

    names = [entry.name for entry in dataclasses.fields(ObserverMatrices)]
    matrices = {name: scaled(name, getattr(gains, name)) for name in names}
    scaled_plant = {name: scaled(name, matrix) for name, matrix in plant._asdict().items()}
    return PlantMatrices(**scaled_plant), ObserverMatrices(**matrices), pace


def _stable(F: Matrix, near: NearZero | None) -> Claim:
    verdict = proved(method="nothing is left to be observed")
    if F.size:
        verdict = prove_hurwitz(exact(F))
        if verdict.outcome == "refuted" and near is not None:
            why = (
                f"{verdict.reason}; s = {near.real:.6g} is within {near.margin:.1g} of "
                "being an invariant zero, so that hardly any gain reaches it"
            )
            verdict = refuted({**verdict.witness, "reason": why})
    return Claim(
        "hurwitz",
        "the error of the reduced state decays (F is Hurwitz), and so it does in steps of any "
        "lengths between two positive bounds",
        f"{PAPER}, (27); Lyapunov's theorem",
        verdict.outcome,
        {**verdict.evidence, "approx_fastest": spectral_radius(F)},
    )
