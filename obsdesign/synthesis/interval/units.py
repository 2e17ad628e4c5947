"""Units that gains of interval observers are sought in, and the largest gains there.

None depends on the units of the problem file: a search has numbers of its own (floors, tolerances
of a program), which must mean the same for a plant in seconds and in nanoseconds.
"""

from __future__ import annotations

import math

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.analysis.balancing import BalancedPlant
from obsdesign.analysis.interval.requirements import objective_of
from obsdesign.problem.options import IntervalOptions
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.time_scale import event_pace, input_pace

# caps of the gains where none is given, in multiples of the plant's own size: the width goes on
# shrinking, ever more slowly, as gains grow, and a limit may be approached only by endless gains
_DEFAULT_LIMIT = {"narrowest": 20.0, "shortest_dwell": 100.0, "feasible": 1000.0}


def balanced_units(problem: Problem) -> BalancedPlant:
    """The plant in units in which disturbances and noise are of size one, if there are any."""
    plant = problem.plant
    pace = event_pace(problem) or input_pace(problem) or 1.0
    units = BalancedPlant.from_plant(plant, pace)
    inputs = [np.subtract(*plant.flow.b_bounds[::-1]) / units.sizes / units.pace]
    if plant.jump is not None:
        inputs.append(np.subtract(*plant.jump.c_bounds[::-1]) / units.sizes)
    inputs.append(problem.require_noise_bound() / units.rows)
    return units.scaled(float(np.concatenate(inputs).max()) or 1.0)


def pace_of_search(problem: Problem, units: BalancedPlant) -> float:
    """Pace that gains of the flow are large against: of the plant, or of its jumps or samples.

    The latter is a floor: a flow that does less than this in a dwell time hardly matters.
    """
    return max(units.pace, event_pace(problem))


def gain_caps(
    problem: Problem, S: Matrix | None, units: BalancedPlant, pace: float
) -> tuple[Matrix, Matrix]:
    """Caps of L and M in z."""
    factor, plant = _DEFAULT_LIMIT[objective_of(problem)], problem.plant
    jump = 1.0 if plant.jump is None else float(np.abs(units.map(plant.jump.G)).max())
    L = _caps(problem, S, units, factor, pace)
    return L, _caps(problem, S, units, factor * max(jump, 1.0))


def sampling_limit(problem: Problem, S: Matrix | None, units: BalancedPlant) -> Matrix:
    """Cap of the gain at samples in z, (n, p): the given one, or more than any plant needs."""
    return _caps(problem, S, units, _DEFAULT_LIMIT["feasible"])


def given_limit(problem: Problem) -> float:
    """Largest admissible entry of a gain, inf without one."""
    limit = problem.options_as(IntervalOptions).gain_limit
    return math.inf if limit is None else limit


def _caps(
    problem: Problem, S: Matrix | None, units: BalancedPlant, largest: float, pace: float = 1.0
) -> Matrix:
    """Caps (n, p) of a gain in z: of the given limit of |S K|, or `largest` in balanced units.

    pace: of z's time, for a gain of the flow; `largest` is in that time.
    """
    limit, plant = given_limit(problem), problem.plant
    basis = np.diag(units.sizes) if S is None else S
    if math.isfinite(limit):
        reach = units.sizes if S is None else np.full(plant.n, np.abs(S).sum(axis=1).max())
        return np.asarray(limit / pace / reach[:, None] * units.rows)
    size = float(np.abs(units.C).max()) * np.abs(basis / units.sizes[:, None]).sum(axis=1).max()
    return np.full((plant.n, plant.p), largest / max(size, 1e-300))
