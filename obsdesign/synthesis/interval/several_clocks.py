"""Interval observers for several clocks: gains of each sensor and event as if alone.

A corrected box is kept only where it is narrower than what the strips of a sample leave, so that
every gain is sound. Of a sensor with one output none is ever narrower: each entry of |I - L C| w +
2 |L| V, as a function of its entry of L, is least at 0 or at the strip. So L = 0 there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from lmi.arithmetic.arrays import Array
from lmi.solvers import Solvers, merged
from lmi.time_budget import TimeBudget
from obsdesign.analysis.interval.several_clocks import (
    reason_against_clocks,
    sensor_columns,
    with_given,
)
from obsdesign.equations.interval.clock_gains import ClockedIntervalGains
from obsdesign.errors import DoesNotApply, InputError
from obsdesign.problem.named_gains import clock_condition
from obsdesign.problem.options import IntervalOptions
from obsdesign.problem.output import Output, stacked
from obsdesign.problem.plant import Jump
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.convex_gain import UserConstraints
from obsdesign.synthesis.interval.event_tubes import event_certificates
from obsdesign.synthesis.kind import candidates_of

LABEL = "split"
# of the largest noise of a sensor's outputs: what is free of noise has that much
_LEAST_NOISE = 1e-6


def clocked_candidate(
    problem: Problem, constraints: UserConstraints | None, budget: TimeBudget
) -> Candidate:
    """The observer of a problem with several clocks; DoesNotApply where none can be built."""
    if constraints is not None:
        raise InputError(
            f"constraints on open gains are not available {clock_condition(problem.plant)}."
        )
    problem.require_noise_bound()
    if reason := reason_against_clocks(problem):
        raise DoesNotApply(reason)
    plant = problem.plant
    solvers: Solvers = ()
    L, M = np.zeros((plant.n, plant.p)), np.zeros((len(plant.events), plant.n, plant.p))
    for (entry, columns), sensor in zip(sensor_columns(plant), plant.sensors, strict=True):
        if entry not in problem.gains and len(sensor.C) > 1:
            L[:, columns], used = _at_samples(problem, sensor, budget)
            solvers = merged(solvers, used)
    for place, event in enumerate(plant.events):
        if f"{event.name}.M" not in problem.gains:
            M[place], used = _at_event(problem, event, budget)
            solvers = merged(solvers, used)
    L, M = with_given(plant, problem.gains, L, M)
    gains = ClockedIntervalGains.from_plant(plant, L=L, M=M if len(M) else None)
    certificates = event_certificates(gains, budget)
    return Candidate(LABEL, gains, certificates, searched=True, solvers=solvers)


def _at_samples(problem: Problem, sensor: Output, budget: TimeBudget) -> tuple[Array, Solvers]:
    """The gain of a sensor as the only one, read every longest gap, without events.

    In discrete time that of least squares: what its outputs determine is theirs.
    """
    if problem.plant.flow.dt is not None:
        return _least_squares(sensor), ()
    if not 0.0 < sensor.gap < math.inf:
        return np.zeros(sensor.C.shape[::-1]), ()
    output = _output([sensor], "periodic", sensor.gap)
    return _alone(_one_clock(problem, None, output), "L", budget)


def _at_event(problem: Problem, event: Jump, budget: TimeBudget) -> tuple[Array, Solvers]:
    """The gain (n, p) of an event with the sensors that are read just before it.

    Zero without any. Nothing else happens in the plant that it is chosen for.
    """
    plant = problem.plant
    M = np.zeros((plant.n, plant.p))
    read = [x for x in plant.sensors if x.event == event.name and x.jump_measurement == "before"]
    # in discrete time the sample before the event does what a gain could
    if not read or event.dwell_time is None or plant.flow.dt is not None:
        return M, ()
    jump = Jump(
        G=event.G, E=event.E, lower=event.lower, upper=event.upper, dwell_time=event.dwell_time,
        disturbance_matrix=event.disturbance_matrix,
    )  # fmt: skip
    own, solvers = _alone(_one_clock(problem, jump, _output(read, "at_jumps", None)), "M", budget)
    names = {f"{sensor.name}.L" for sensor in read}
    columns = [columns for entry, columns in sensor_columns(plant) if entry in names]
    M[:, np.concatenate([np.arange(plant.p)[one] for one in columns])] = own
    return M, solvers


def _least_squares(sensor: Output) -> Array:
    """The pseudoinverse of C, rows in units of their noise, (n, p)."""
    radius = sensor.noise_radius
    V = np.ones(len(sensor.C)) if radius is None else radius
    rows = np.maximum(V, _LEAST_NOISE * (V.max() or 1.0))
    return np.asarray(np.linalg.pinv(sensor.C / rows[:, None]) / rows)


def _output(sensors: Sequence[Output], measured: str, period: float | None) -> Output:
    whole = stacked(sensors)
    return Output(whole.C, whole.noise_bound, measured=measured, period=period)


def _one_clock(problem: Problem, jump: Jump | None, output: Output) -> Problem:
    """The plant with one jump or none and one output, for bounds in its own coordinates."""
    limit = problem.options_as(IntervalOptions).gain_limit
    observer = {"kind": "interval", "form": "split"}
    stated = {} if limit is None else {"gain_limit": limit}
    return Problem(flow=problem.plant.flow, jump=jump, output=output, observer=observer | stated)


def _alone(problem: Problem, gain: str, budget: TimeBudget) -> tuple[Array, Solvers]:
    """The gain of the first candidate; zero where the plant has none."""
    nothing = np.zeros((problem.plant.n, problem.plant.p))
    try:
        candidate = next(candidates_of(problem, budget), None)
    except InputError:
        return nothing, ()
    if candidate is None or candidate.gains is None:
        return nothing, ()
    chosen: Array = getattr(candidate.gains, gain)
    return chosen, candidate.solvers
