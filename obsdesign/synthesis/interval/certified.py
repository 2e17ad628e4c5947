"""Finished gains of an interval observer as a candidate: its certificates, its cost."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from lmi.arithmetic.arrays import Entries
from lmi.arithmetic.balls import exact, inverse
from lmi.decide.dwell_search import dwell_bracket
from lmi.solvers import Solvers, merged
from lmi.time_budget import Remark, TimeBudget
from obsdesign.analysis.interval.requirements import objective_of
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.equations.interval.width import WidthSystem
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate, Certificates
from obsdesign.synthesis.dwell import dwell_certificates, stability_options
from obsdesign.synthesis.interval.forms import gains_of_form
from obsdesign.synthesis.interval.goals import mean_width
from obsdesign.synthesis.interval.sampled_width import propose_spacing
from obsdesign.synthesis.interval.task import Task
from obsdesign.synthesis.tails import with_tails
from obsdesign.synthesis.tube import proved_width, solvers_of_tube


def plain_frame(problem: Problem, form: str) -> Entries:
    """Return the plant's own coordinates, for a form that needs some."""
    return {"S": np.eye(problem.plant.n)} if form == "coordinates" else {}


def with_zero_gains(problem: Problem, form: str, given: Entries, frame: Entries) -> Candidate:
    """The candidate of a form whose open gains are zero."""
    zero = np.zeros((problem.plant.n, problem.plant.p))
    gains = gains_of_form(problem, form, given.get("L", zero), given.get("M", zero), frame)
    return Candidate(form, gains, searched=True)


def with_solvers(candidate: Candidate, first: Solvers) -> Candidate:
    """The candidate with the solvers of its gains before those of its certificates."""
    return replace(candidate, solvers=merged(first, candidate.solvers))


def certified(
    problem: Problem,
    gains: IntervalGains,
    budget: TimeBudget,
    *,
    searched: bool,
    goes_on: bool = True,
    remarks: tuple[Remark, ...] = (),
) -> Candidate:
    """The candidate of finished gains, with what may help to prove it."""
    system = WidthSystem.from_gains(gains, exact, inverse)
    objective = objective_of(problem)
    cost = _cost(problem, gains) if objective == "narrowest" else None
    certificates = Certificates()
    if system.N is not None:
        low, high = gains.dwell_ends
        if objective == "shortest_dwell":
            low, certificates = _widest_range(problem, system, (low, high), budget)
            gains, cost = replace(gains, dwell_time=np.array([low, high])), low
        if not certificates.evidence:
            certificates = dwell_certificates(
                system.W, system.N, low, high, **stability_options(problem, budget)
            )
        certificates = with_tails(certificates, {"dwell_stability": system.W}, system.N)
    if budget.remaining() > 0:
        widths = _widths(problem, gains, system)
        certificates = certificates.joined(widths)
        # where a spacing was named, the observer watches it
        if "sampled_width" in widths.evidence and problem.plant.output.period is not None:
            gains = replace(gains, step_limit=widths.evidence["sampled_width"]["step_limit"])
    return Candidate(
        gains.form, gains, certificates.evidence, searched, cost, goes_on, remarks,
        certificates.solvers,
    )  # fmt: skip


def _widths(problem: Problem, gains: IntervalGains, system: WidthSystem) -> Certificates:
    """Return certificates of the width with a continuous y, and with samples of it."""
    certificates: dict[str, Entries] = {}
    width = proved_width(system, *gains.dwell_ends)
    if width is not None:
        certificates["width"] = width
    if problem.plant.output.measured == "continuous":
        period = problem.plant.output.period
        spacing = propose_spacing(gains, system, *gains.dwell_ends, period)
        if spacing is not None:
            certificates["sampled_width"] = spacing
    return Certificates(certificates, solvers_of_tube(system.N is not None) if certificates else ())


def _cost(problem: Problem, gains: IntervalGains) -> float:
    """Return the mean width of x, summed over the states, of finished gains."""
    given = {"L": gains.L, "M": gains.M}
    task = Task.from_problem(problem, gains.form == "cooperative", gains.S, given)
    return mean_width(task, 0 * gains.L, 0 * gains.M)


def _widest_range(
    problem: Problem, system: WidthSystem, ends: tuple[float, float], budget: TimeBudget
) -> tuple[float, Certificates]:
    """Return (shortest dwell time, certificates): the proved range if it holds the required one."""
    (N, _), (low, high) = system.at_jumps, ends
    bracket = dwell_bracket(system.W, N, "shortest", high, **stability_options(problem, budget))
    if bracket.proved is None or not bracket.proved <= low or math.isinf(bracket.proved):
        return low, Certificates()
    evidence = {"dwell_stability": bracket.certificate}
    return bracket.proved, Certificates({**evidence}, bracket.solvers)
