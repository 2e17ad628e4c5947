"""Point observers in discrete time: gains of a Kalman filter, and certificates.

L: of the filter for the step, or for the steps from sample to sample, with weights one in units
that balance the plant, the noise smaller from one candidate to the next. M: the same correction
before the event, G L, or after it, L.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lmi.arithmetic.arrays import Matrix, NewEntries
from lmi.decide.mode_stability import decide_modes
from lmi.modes import Modes
from lmi.solvers import Solvers, merged
from lmi.time_budget import TimeBudget
from obsdesign.analysis.balancing import BalancedPlant
from obsdesign.analysis.discrete_error import error_maps, reason_against_steps, steps_between_events
from obsdesign.equations.luenberger.gains import StepGains, step_entries
from obsdesign.equations.time_grid import rounded_steps
from obsdesign.errors import DoesNotApply
from obsdesign.problem.options import LuenbergerOptions
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.given_gains import given_gain

# variances of the noise of y beside those of the state
_NOISES = (1.0, 1e-3, 1e-6)


def step_candidates(problem: Problem, budget: TimeBudget) -> Iterator[Candidate]:
    """Yield candidates in order of preference; DoesNotApply for problems that are not served."""
    if reason := reason_against_steps(problem):
        raise DoesNotApply(reason)
    plant = problem.plant
    L, M = given_gain(problem, "L"), given_gain(problem, "M")
    zero = np.zeros((plant.n, plant.p))
    if L is not None and M is not None:
        yield _candidate(problem, "gains as given", L, M, budget, searched=False)
        return
    for noise in _NOISES:
        K = _filter_gain(problem, noise)
        if K is not None:
            label = "Kalman gain" + (f", noise {noise:g}" if noise < 1 else "")
            chosen = K if L is None else L, _jump_gain(problem, K) if M is None else M
            yield _candidate(problem, label, *chosen, budget, searched=True)
    chosen = zero if L is None else L, zero if M is None else M
    yield _candidate(problem, "open gains at zero", *chosen, budget, searched=True)


def _candidate(
    problem: Problem, label: str, L: Matrix, M: Matrix, budget: TimeBudget, *, searched: bool
) -> Candidate:
    gains = StepGains(**step_entries(problem.plant), L=L, M=M)
    rate = problem.options_as(LuenbergerOptions).decay_rate
    certificates, solvers = dict[str, NewEntries](), Solvers()
    for name, own in {"step_stability": 0.0, "decay_rate": rate}.items():
        maps = error_maps(problem, gains, own)
        if isinstance(maps, Modes) and (own or name == "step_stability"):
            verdict = decide_modes(maps, budget=budget)
            certificates[name] = dict(verdict.evidence)
            solvers = merged(solvers, verdict.solvers)
    return Candidate(label, gains, certificates, searched, solvers=solvers)


def _jump_gain(problem: Problem, K: Matrix) -> Matrix:
    """The correction K before an event, seen from after it, or after it; zero without one."""
    jump = problem.plant.jump
    if jump is None or problem.plant.output.jump_measurement == "none":
        return np.zeros_like(K)
    return np.asarray(jump.G @ K if problem.plant.output.jump_measurement == "before" else K)


def _filter_gain(problem: Problem, noise: float) -> Matrix | None:
    """K (n, p) of x+ = x + K (y - C x) in the steady state; None where floats hold none."""
    plant = problem.plant
    A, C, G = plant.flow.A, plant.output.C, None if plant.jump is None else plant.jump.G
    steps = 1
    if plant.output.measured == "at_jumps":
        steps = steps_between_events(problem)[0]
        A = np.asarray((np.eye(plant.n) if G is None else G) @ np.linalg.matrix_power(A, steps))
    elif plant.output.period is not None and plant.flow.dt is not None:
        A = np.linalg.matrix_power(A, rounded_steps(plant.output.period, plant.flow.dt))
    sizes = BalancedPlant.from_matrices(A, C, G).sizes
    A, C = A * sizes / sizes[:, None], C * sizes
    rows = np.abs(C).max(axis=1)
    rows[rows == 0] = 1.0
    C = C / rows[:, None]
    from scipy.linalg import solve_discrete_are  # slow to import

    try:
        P = solve_discrete_are(A.T, C.T, np.eye(len(A)), noise * np.eye(len(C)))
        K = np.linalg.solve(C @ P @ C.T + noise * np.eye(len(C)), C @ P).T
    except (np.linalg.LinAlgError, ValueError):
        return None
    return np.asarray(sizes[:, None] * K / rows) if np.isfinite(K).all() else None
