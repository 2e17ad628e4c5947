"""Candidates whose open gains are searched for the least bound of the error in a box of x."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterator
from dataclasses import replace

from lmi.solvers import merged
from lmi.time_budget import TimeBudget
from obsdesign.analysis.nominal import stability_dwell
from obsdesign.equations.luenberger.gains import LuenbergerGains
from obsdesign.problem.options import LuenbergerOptions
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.convex_gain import UserConstraints, convex_gains
from obsdesign.synthesis.given_gains import given_gain
from obsdesign.synthesis.luenberger.driven_plant import DrivenPlant, GainPair
from obsdesign.synthesis.luenberger.gain_candidates import with_gains, with_jump_gain
from obsdesign.synthesis.luenberger.peak_gains import GainSearch
from obsdesign.synthesis.state_box import KnownBox

# candidates that a search of gains may start from
_STARTS = 3


def gain_search(
    problem: Problem, nominal: Problem, box: KnownBox, constraints: UserConstraints | None
) -> GainSearch | None:
    """The search of the gains that are open; None where none is, or nothing limits L.

    What `constraints` of a user say of gains is known with their P alone.
    """
    if constraints is not None or not is_L_limited(nominal):
        return None
    options = nominal.options_as(LuenbergerOptions)
    free = ["L"] if _is_L_open(nominal) else []
    free += ["M"] if given_gain(nominal, "M") is None else []
    ends = stability_dwell(problem)
    driven = DrivenPlant.from_box(problem.plant, nominal.plant, box, ends)
    return GainSearch(driven, convex_gains(options, None), tuple(free)) if free else None


def is_L_limited(problem: Problem) -> bool:
    """Is there a limit to L: a choice, noise on every output, a largest norm or a disc?

    Without any the fastest gain would always have the least bound.
    """
    radius = problem.plant.output.noise_radius
    is_noisy = radius is not None and bool((radius > 0).all())
    stated = problem.options_as(LuenbergerOptions).gain_constraints("L")
    is_held = stated.norm is not None or stated.disc is not None
    return is_noisy or is_held or not _is_L_open(problem)


def _is_L_open(problem: Problem) -> bool:
    """Do neither poles nor weights nor the problem itself choose L?"""
    options = problem.options_as(LuenbergerOptions)
    is_chosen = options.poles is not None or bool(options.weights)
    return given_gain(problem, "L") is None and not is_chosen


def searched_candidates(
    problem: Problem, search: GainSearch, candidates: Iterator[Candidate], budget: TimeBudget
) -> Iterator[Candidate]:
    """Gains searched from the best of the first few candidates, then these; without parameters.

    problem: of the nominal plant. An M that is open may start at zero too: it contracts less at
    jumps, and adds no noise there.
    """
    first = [
        *_peak_candidates(problem, search, budget), *itertools.islice(candidates, _STARTS)
    ]  # fmt: skip
    starts = [each.gains for each in first if isinstance(each.gains, LuenbergerGains)]
    pairs = [GainPair(own.L, own.M) for own in starts]
    if "M" in search.free:
        pairs += [GainPair(own.L, 0 * own.M) for own in starts]
    gains = search.improved(pairs)
    if gains is not None:
        label = f"{' and '.join(search.free)} searched for the least bound"
        candidate = with_gains(problem, label, gains, budget)
        solvers = functools.reduce(merged, (each.solvers for each in first), candidate.solvers)
        yield replace(candidate, searched=True, solvers=solvers)
    yield from first
    yield from candidates


def _peak_candidates(
    problem: Problem, search: GainSearch, budget: TimeBudget
) -> Iterator[Candidate]:
    """Candidates with L of the matrix inequality; with jumps that L searched, jumps left out."""
    L = search.first_flow_gain()
    if L is None:
        return
    label = "peak-to-peak L"
    if problem.plant.jump is not None:
        label, L = f"{label}, then searched", search.improved_flow_gain(L)
    peak = with_jump_gain(problem, label, L, search.wanted["M"], budget)
    choices = [peak]
    if "M" in search.free:
        choices.append(with_gains(problem, f"{label}, M = 0", GainPair(L, 0 * L), budget))
    for each in choices:
        yield replace(each, searched=True, solvers=merged(("Clarabel",), each.solvers))
