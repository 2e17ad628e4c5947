"""Certificates of a plant with parameters whose state has no known bounds."""

from __future__ import annotations

from dataclasses import replace

from lmi.arithmetic.arrays import Entries
from lmi.arithmetic.balls import exact, inverse
from lmi.solvers import merged
from lmi.time_budget import TimeBudget
from obsdesign.equations.interval.gains import CORRECTIONS, IntervalGains
from obsdesign.equations.interval.sourced_width import sourced_width
from obsdesign.equations.uncertain import NormalForm
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate, Certificates
from obsdesign.synthesis.dwell import dwell_certificates, stability_options
from obsdesign.synthesis.tube import proved_width, solvers_of_tube


def with_sources(
    candidate: Candidate, gains: IntervalGains, problem: Problem, budget: TimeBudget
) -> Candidate:
    """The candidate with these gains, and with certificates of its radius under parameters."""
    form = NormalForm.from_plant(problem.plant, exact)
    width = sourced_width(gains, form, exact, inverse)
    low, high = gains.dwell_ends
    certificates = Certificates()
    if width.N is not None:
        certificates = dwell_certificates(
            width.W, width.N, low, high, **stability_options(problem, budget)
        )
    tubes: dict[str, Entries] = {}
    for source, system in width.systems.items():
        if budget.remaining() > 0:
            tube = proved_width(system, low, high, vanishing=True)
            tubes |= {} if tube is None else {source: tube}
    if len(tubes) == len(width.systems):
        solvers = solvers_of_tube(next(iter(width.systems.values())).N is not None)
        certificates = certificates.joined(Certificates({"source_width": tubes}, solvers))
    corrected = any(getattr(gains, name) is not None for name in CORRECTIONS)
    return replace(
        candidate, gains=replace(gains, step_limit=None), certificates=certificates.evidence,
        searched=candidate.searched or corrected,
        solvers=merged(candidate.solvers, certificates.solvers),
    )  # fmt: skip
