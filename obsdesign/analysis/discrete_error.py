"""The error of a point observer in discrete time, over all times that its clocks allow.

    e+ = (I - L C) A^N e     from sample to sample, N steps apart, without events
    e+ = H A F^(k-1) e       from event to event, k steps apart, with F = (I - L C) A, a sample in
                             every step; F = A where y is known at events alone

Ages are whole numbers: a node of the graph for every number of steps since the event.
"""

from __future__ import annotations

import math

import numpy as np

from lmi.arithmetic.balls import PRECISIONS, Exact, exact, precision, rational, scalar
from lmi.modes import Modes
from obsdesign.equations.estimation_error import jump_error_matrix
from obsdesign.equations.luenberger.gains import StepGains
from obsdesign.equations.time_grid import steps_of
from obsdesign.problem.options import LuenbergerOptions
from obsdesign.problem.problem import Problem

# steps between two events that a proof follows one by one
MOST_AGES = 60
# steps between two samples, of which a map is computed exactly
MOST_STEPS = 400
# exponent of the growth of a step by which a decay rate is claimed
MOST_DECAY = 100.0
_OPTIONS = ("decay_rate",)


def reason_against_steps(problem: Problem) -> str | None:
    """Reason against a point observer for a problem in discrete time, one sentence, or None."""
    plant = problem.plant
    output, jump, dt = plant.output, plant.jump, plant.flow.dt
    assert dt is not None
    for name in problem.options.to_document():
        if name not in _OPTIONS:
            return f"observer.{name} is not available with flow.dt; {', '.join(_OPTIONS)} is."
    if reason := _reason_against_rate(problem, dt):
        return reason
    if jump is None:
        if output.period is not None and (steps_of(output.period, dt) or 0) > MOST_STEPS:
            return (
                f"{plant.stated('output.period')} must be at most {MOST_STEPS} steps for kind "
                f"'luenberger'; got {output.period:g}."
            )
        return None
    if reason := problem.reason_without("jump.dwell_time"):
        return reason
    if output.period is not None and output.measured == "periodic" and output.period > 1.5 * dt:
        entry = plant.stated("output.period")
        return (
            f"{entry} must be flow.dt = {dt:g} for kind 'luenberger' with events, or y is known "
            f"at events alone; got {output.period:g}."
        )
    low, high = steps_between_events(problem)
    if (low if math.isinf(high) else high) > MOST_AGES or low < 1:
        entry = plant.stated("jump.dwell_time")
        return (
            f"{entry} must lie between 1 and {MOST_AGES} steps, or start there and end at inf, "
            f"for kind 'luenberger'; got {list(problem.require_dwell_time())}."
        )
    return None


def _reason_against_rate(problem: Problem, dt: float) -> str | None:
    rate = problem.options_as(LuenbergerOptions).decay_rate
    if rate * dt <= MOST_DECAY:
        return None
    return (
        f"observer.decay_rate times flow.dt must be at most {MOST_DECAY:g}: e^(decay_rate dt) "
        f"multiplies every step; got {rate:g} times {dt:g}."
    )


def steps_between_events(problem: Problem) -> tuple[int, float]:
    """(fewest, most) steps between two events: whole numbers, or an infinite most."""
    dt = problem.plant.flow.dt
    assert dt is not None
    low, high = problem.require_dwell_time()
    return steps_of(low, dt) or 0, math.inf if math.isinf(high) else float(steps_of(high, dt) or 0)


def error_maps(problem: Problem, gains: StepGains, rate: float = 0.0) -> Exact | Modes:
    """Return the map (n, n) of the error from one sample or event to the next.

    Where the time between events is a range: the graph of the maps of steps and events. rate: each
    step is multiplied by e^{rate dt}, rounded up.
    """
    unit, A = exact(np.eye(gains.n)), exact(gains.A)
    L, M, C = exact(gains.L), exact(gains.M), exact(gains.C)
    A = A * exact(_growth(rate, gains.step))
    if gains.G is None:
        whole = A
        for _ in range(gains.period_steps - 1):
            whole = whole @ A
        return np.asarray((unit - L @ C) @ whole)
    step = (unit - L @ C) @ A
    event = jump_error_matrix(exact(gains.G), M, C, gains.jump_measurement) @ A
    low, high = steps_between_events(problem)
    if low == high:
        for _ in range(low - 1):
            event = event @ step
        return np.asarray(event)
    return _ages(step, event, low, high)


def _ages(step: Exact, event: Exact, low: int, high: float) -> Modes:
    """A node for each age of the event, entered by a step, and by an event for age zero."""
    ages = low if math.isinf(high) else int(high)
    following = []
    for age in range(ages):
        after = [0] if age + 1 >= low else []
        if age + 1 < ages:
            after.append(age + 1)
        elif math.isinf(high):
            after.append(age)
        following.append(after)
    names = ["event", *(f"{age} steps later" for age in range(1, ages))]
    if ages == 1:  # a step without an event is entered in another way than the event
        following, names = [[0, 1], [0, 1]], ["event", "no event"]
    count = len(names)
    zero = step * 0
    maps = [event, *([step] * (count - 1))]
    return Modes.from_flows([zero] * count, [(1.0, 1.0)] * count, following, maps, names)


def _growth(rate: float, dt: float) -> float:
    """A float at least e^(rate dt), 1 without a rate."""
    if not rate:
        return 1.0
    with precision(PRECISIONS[0]):
        power = scalar(rational(rate) * rational(dt)).exp().upper()
        return math.nextafter(float(power), math.inf)
