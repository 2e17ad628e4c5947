"""Point observers of plants with modes: a gain L for each mode, then one joint certificate."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import exact
from lmi.time_budget import UNLIMITED, TimeBudget
from obsdesign.analysis.modes import graph_of
from obsdesign.analysis.riccati import FASTER, faster_rates
from obsdesign.equations.clocks import events_of
from obsdesign.equations.estimation_error import flow_error_matrix
from obsdesign.equations.luenberger.gains import LuenbergerGains
from obsdesign.equations.modes import SwitchedGains
from obsdesign.problem.modes import spans_of
from obsdesign.problem.options import LuenbergerOptions
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate, Certificates
from obsdesign.synthesis.modes import require_served, stability_certificates
from obsdesign.synthesis.placement import riccati_gain
from obsdesign.synthesis.time_scale import pace_of_stays


def synthesize(problem: Problem, budget: TimeBudget = UNLIMITED) -> Iterator[Candidate]:
    """Yield candidates in order of preference: Riccati gains of growing speed, then L = 0."""
    require_served(problem)
    rate = problem.options_as(LuenbergerOptions).decay_rate
    if all("L" in own.gains for own in problem.in_modes):
        yield _candidate(problem, "L as given", None, rate, budget)
        return
    for k, factor in enumerate(FASTER):
        label = "Riccati L" + (f", {factor:g} x faster" if factor else "")
        yield _candidate(problem, label, k, rate, budget)
    yield _candidate(problem, "L = 0", None, rate, budget)


def _candidate(
    problem: Problem, label: str, speed: int | None, rate: float, budget: TimeBudget
) -> Candidate:
    """Gains of all modes: as given, else of a speed, zero where speed is None or none is known."""
    plant, gains = problem.plant, []
    zero = np.zeros((plant.n, plant.p))
    for k, own in enumerate(problem.in_modes):
        L = own.gains.get("L")
        if L is None:
            pace = pace_of_stays(plant.modes[k].every)
            L = zero if speed is None else _riccati(own, speed, rate, pace)
        gains.append(LuenbergerGains.from_plant(plant.in_mode(k, entered=True), L=L, M=zero))
    spacing = plant.timing.spacing or None
    switched = SwitchedGains(spans_of(plant.modes), tuple(gains), events_of(plant), spacing)
    certificates = Certificates()
    names = {"mode_stability": 0.0} | ({"decay_rate": rate} if rate > 0 else {})
    for name, shift in names.items():
        flows = [
            flow_error_matrix(exact(own.A), exact(own.L), exact(own.C))
            + exact(shift * np.eye(plant.n))
            for own in gains
        ]
        entry = [None if own.G is None else exact(own.G) for own in gains]
        modes = graph_of(problem, flows, entry)
        certificates = certificates.joined(stability_certificates(name, modes, budget))
    searched = any("L" not in own.gains for own in problem.in_modes)
    return Candidate(
        label, switched, certificates.evidence, searched, solvers=certificates.solvers
    )  # fmt: skip


def _riccati(own: Problem, speed: int, rate: float, pace: float) -> Matrix:
    """A gain of a mode; of the modes of its flow that y sees alone, zero if there is none."""
    A, C = own.plant.flow.A, own.plant.output.C
    shift = max(float(np.linalg.eigvals(A).real.max()), 0.0)
    # where y does not see all that grows, the flow slowed down is the one that is observed
    for slowed in (0.0, 1.01 * shift + 1e-3 * float(np.abs(A).max())):
        F = A - slowed * np.eye(len(A))
        try:
            return riccati_gain(F, C, None, faster_rates(A, rate)[speed], pace=pace)
        except np.linalg.LinAlgError:
            continue
    return np.zeros((len(A), len(C)))
