"""The multiplier observer of a problem: its window, and multipliers of the nominal pattern."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from lmi.arithmetic.arrays import Entries
from lmi.decide.stability import decide
from lmi.solvers import Solvers, merged
from lmi.time_budget import UNLIMITED, Remark, TimeBudget, ended_by_count, remark_end
from obsdesign.analysis.nominal import NominalProblem
from obsdesign.analysis.set_membership.observable_window import determines_state
from obsdesign.analysis.set_membership.parameters import in_box, with_all_noise
from obsdesign.analysis.set_membership.requirements import (
    pattern_of,
    reason_against,
    shortest_window,
    unobservable_part,
)
from obsdesign.equations.set_membership.gains import SetMembershipGains
from obsdesign.equations.set_membership.pattern import Pattern
from obsdesign.errors import DoesNotApply
from obsdesign.problem.options import SetMembershipOptions
from obsdesign.problem.plant import Plant
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.set_membership.tube import WORK, Search, Tube, Witness
from obsdesign.synthesis.state_box import known_state_box

# stages by number of states: a window that is exact to a few percent on random plants
_WINDOWS = ((2, 8), (4, 16))
_LONGEST_DEFAULT = 30
# windows that are tried; the shortest one serves whose width is at most so many times the least
# possible one, or the one of the longest window
_TRIED = (8, 16, _LONGEST_DEFAULT)
_NEAR = 1.1


def synthesize(problem: Problem, budget: TimeBudget = UNLIMITED) -> Iterator[Candidate]:
    """Yield the observer of the problem; DoesNotApply where its bounds need what is missing."""
    box = known_state_box(problem.plant) if problem.plant.parameters else None
    nominal = in_box(problem, None if box is None else box.bounds)
    problem = nominal.problem
    problem.require_noise_bound()
    if reason := reason_against(problem):
        raise DoesNotApply(reason)
    options = problem.options_as(SetMembershipOptions)
    chosen = _chosen(nominal, budget)
    gains = _gains(nominal, chosen.window)
    certificates: dict[str, Entries] = _decay(problem, budget) if nominal.is_bounded else {}
    if chosen.tube is not None:
        gains = replace(gains, multipliers=chosen.tube.multipliers)
        certificates["width"] = {"tube": chosen.tube.radii.tolist()}
    if chosen.witness is not None and not nominal.entries:  # its disturbances are free ones
        certificates["optimal"] = {"trajectories": chosen.witness.to_document()}
    solvers: Solvers = () if chosen.tube is None else ("HiGHS",)
    if box is not None:
        certificates |= box.certificates
        solvers = merged(solvers, box.solvers)
    yield Candidate(
        f"window of {chosen.window} stages", gains, certificates, options.window is None,
        remarks=chosen.remarks, solvers=solvers,
    )  # fmt: skip


def default_window(n: int) -> int:
    """Stages of a window for n states where no width is proved."""
    return next((stages for most, stages in _WINDOWS if n <= most), _LONGEST_DEFAULT)


@dataclass(frozen=True)
class _Window:
    """A length of the window, and what is proposed for it."""

    window: int
    tube: Tube | None = None
    witness: Witness | None = None
    remarks: tuple[Remark, ...] = ()


def _chosen(nominal: NominalProblem, budget: TimeBudget) -> _Window:
    """The window of the problem, or the shortest one that loses little."""
    problem = nominal.problem
    options, plant = problem.options_as(SetMembershipOptions), problem.plant
    least = max(2 * (options.fixed_lag or 0), shortest_window(plant))
    default = options.window or max(default_window(plant.n), least)
    pattern = pattern_of(plant)
    if isinstance(pattern, str) or not nominal.is_bounded:
        return _Window(default)
    gains = with_all_noise(_gains(nominal, default))
    search = Search(gains, pattern, budget.scaled(WORK))
    lengths = [options.window] if options.window else _lengths(plant, gains, pattern, least)
    default = max(default, lengths[0])
    tubes, witness = dict[int, Tube](), None
    for count in lengths:
        tube = search.tube(count)
        if tube is None:
            continue
        tubes[count] = tube
        witness = witness or search.witness(tube.radii)
        if witness is not None and (tube.width <= _NEAR * witness.least).all():
            break
    if not tubes:
        text = "no width is proved: no multipliers were found that hold one on the nominal pattern"
        return _Window(default, remarks=(Remark(text),))
    ended = ended_by_count("multiplications", int(budget.scaled(WORK))) if search.work < 0 else {}
    remarks = remark_end("narrow widths", ended, matters=False)
    limit = _NEAR * tubes[max(tubes)].width
    window = next(count for count, tube in tubes.items() if (tube.width <= limit).all())
    return _Window(window, tubes[window], witness, remarks)


def _lengths(plant: Plant, gains: SetMembershipGains, pattern: Pattern, least: int) -> list[int]:
    """Windows to try, of `least` stages or more; where they can, such that determine the state.

    A longer window does where a shorter one does. The longest is tried in any case.
    """
    lengths = sorted({max(count, least) for count in _TRIED})
    if unobservable_part(plant) is not None:
        return lengths
    while len(lengths) > 1 and not determines_state(gains, pattern, lengths[0]):
        lengths = lengths[1:]
    return lengths


def _gains(nominal: NominalProblem, window: int) -> SetMembershipGains:
    problem = nominal.problem
    options = problem.options_as(SetMembershipOptions)
    return SetMembershipGains.from_plant(
        problem.plant, window=window, steps=options.steps, fixed_lag=options.fixed_lag,
        directions=None if options.directions is None else np.array(options.directions),
        **nominal.entries,
    )  # fmt: skip


def _decay(problem: Problem, budget: TimeBudget) -> dict[str, Entries]:
    """A certificate that the part which no sample sees contracts over the dwell times."""
    hidden, events = unobservable_part(problem.plant), problem.plant.events
    is_flow = problem.plant.flow.dt is None
    if hidden is None or len(events) != 1 or events[0].dwell_time is None or not is_flow:
        return {}
    low, high = problem.require_dwell_time()
    F, H = hidden.maps
    verdict = decide(F, H, low, high, jitter=events[0].dwell_jitter, budget=budget)
    return {"attainable": dict(verdict.evidence)}
