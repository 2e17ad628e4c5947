"""Candidates whose open gains are searched for the least bound of the error in a box of x."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from lmi.solvers import merged
from lmi.time_budget import TimeBudget, remark_end
from obsdesign.analysis.nominal import stability_dwell
from obsdesign.equations.luenberger.gains import LuenbergerGains
from obsdesign.equations.parameters import NormalForm
from obsdesign.problem.options import LuenbergerOptions
from obsdesign.problem.plant import Plant
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.convex_gain import UserConstraints, convex_gains
from obsdesign.synthesis.given_gains import given_gain
from obsdesign.synthesis.luenberger.driven_plant import DrivenPlant, GainPair
from obsdesign.synthesis.luenberger.gain_candidates import with_gains, with_jump_gain
from obsdesign.synthesis.luenberger.peak_gains import GainSearch
from obsdesign.synthesis.state_box import KnownBox

# candidates that a search of gains may start from, and the part of the time left that it takes
_STARTS, _SHARE = 3, 0.3
# least noise that searches count with, in parts of the range of y: without any the fastest gain
# would be the best
_LEAST_NOISE = 2.0**-20


def gain_search(
    problem: Problem, nominal: Problem, box: KnownBox, constraints: UserConstraints | None
) -> GainSearch | None:
    """The search of the gains that are open; None where none is, or nothing limits L.

    What `constraints` of a user say of gains is known with their P alone.
    """
    if constraints is not None or not is_L_limited(problem, nominal):
        return None
    options = nominal.options_as(LuenbergerOptions)
    free = ["L"] if _is_L_open(nominal) else []
    free += ["M"] if given_gain(nominal, "M") is None else []
    if not free:
        return None
    driven = DrivenPlant.from_box(problem.plant, nominal.plant, box, stability_dwell(problem))
    noise = 0.0 if _is_L_held(nominal) else _LEAST_NOISE
    return GainSearch(driven.with_noise(noise), convex_gains(options, None), tuple(free))


def is_L_limited(problem: Problem, nominal: Problem) -> bool:
    """Is there a limit to L: a choice, noise that is stated, a largest norm or a disc?

    Or parameters on all outputs, which gains amplify as they do noise. Without any the fastest
    gain would always have the least bound.
    """
    is_noise_stated = nominal.plant.output.noise_radius is not None
    return is_noise_stated or _is_L_held(nominal) or _are_outputs_uncertain(problem.plant)


def _are_outputs_uncertain(plant: Plant) -> bool:
    effects = NormalForm.from_plant(plant).on("C")
    return bool(np.any([X.any(axis=1) for X in effects], axis=0).all()) if effects else False


def _is_L_held(problem: Problem) -> bool:
    """Is there a limit to L that the noise does not matter for?"""
    stated = problem.options_as(LuenbergerOptions).gain_constraints("L")
    return stated.norm is not None or stated.disc is not None or not _is_L_open(problem)


def _is_L_open(problem: Problem) -> bool:
    """Do neither poles nor weights nor the problem itself choose L?"""
    options = problem.options_as(LuenbergerOptions)
    is_chosen = options.poles is not None or bool(options.weights)
    return given_gain(problem, "L") is None and not is_chosen


def searched_candidates(
    problem: Problem, search: GainSearch, candidates: Iterator[Candidate], budget: TimeBudget
) -> Iterator[Candidate]:
    """Gains searched from the best of several, those of the inequality, then the candidates.

    problem: of the nominal plant. An M that is open may start at zero too: it contracts less at
    jumps, and adds no noise there.
    """
    others = list(itertools.islice(candidates, _STARTS))
    peak = list(_peak_candidates(problem, search, budget))
    first = [*peak, *others]
    starts = [each.gains for each in first if isinstance(each.gains, LuenbergerGains)]
    pairs = [GainPair(own.L, own.M) for own in starts]
    if "M" in search.free:
        pairs += [GainPair(own.L, 0 * own.M) for own in starts]
    in_time = budget.part(_SHARE)
    gains = search.improved(pairs, in_time)
    if gains is not None:
        label = f"{' and '.join(search.free)} searched for the least bound"
        candidate = with_gains(problem, label, gains, budget)
        solvers = functools.reduce(merged, (each.solvers for each in first), candidate.solvers)
        remarks = remark_end("gains for the least bound", in_time.ended())
        yield replace(candidate, searched=True, solvers=solvers,
                      remarks=(*remarks, *candidate.remarks))  # fmt: skip
    yield from peak
    yield from others
    yield from candidates


def _peak_candidates(
    problem: Problem, search: GainSearch, budget: TimeBudget
) -> Iterator[Candidate]:
    """Candidates with L of the matrix inequality; with jumps that L searched, jumps left out."""
    in_time = budget.part(_SHARE)
    L = search.first_flow_gain(in_time)
    if L is None:
        return
    remarks = remark_end("a first L", in_time.ended())
    label = "peak-to-peak L"
    if problem.plant.jump is not None:
        label, L = f"{label}, then searched", search.improved_flow_gain(L, budget.part(_SHARE))
    peak = with_jump_gain(problem, label, L, search.wanted["M"], budget)
    choices = [peak]
    if "M" in search.free:
        choices.append(with_gains(problem, f"{label}, M = 0", GainPair(L, 0 * L), budget))
    for each in choices:
        yield replace(each, searched=True, solvers=merged(("Clarabel",), each.solvers),
                      remarks=(*remarks, *each.remarks))  # fmt: skip
