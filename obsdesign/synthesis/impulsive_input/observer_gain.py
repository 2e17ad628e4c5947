"""K of the observer between impulses: as given, placed, by Riccati equation, or by default.

By default the poles of A - K C are real, distinct and a little faster than those of A: slow
observers leave more of an impulse in the output, and with a real spectrum few exponents determine
an impulse (`verification.impulsive_input.uniqueness`). A fast K hides impulses, whether its poles
are given or follow from weights (Section III-F).
"""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.analysis.hidden_modes import approx_unobservable_modes
from obsdesign.equations.impulsive_input.curve import balanced_size
from obsdesign.problem.options import ImpulsiveInputOptions
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.given_gains import refuse_second_choice
from obsdesign.synthesis.placement import no_kalman_gain, placed_gain, riccati_gain

_LARGEST_SPEED_RATIO = 1e3  # size of A - K C against that of A
# poles of the observer against those of the plant and each other
_SPEED_RATIO, _POLE_RATIO = 1.25, 1.2


def observer_gain(problem: Problem, window: float) -> Matrix:
    """K (n, p): given, with `poles`, by `weights`, or with poles of its own.

    window: the longest that the dwell times allow. InputError where two of the first three are
    stated, or where poles or weights give no K.
    """
    options = problem.options_as(ImpulsiveInputOptions)
    given: Matrix | None = problem.gains.get("K")
    refuse_second_choice(options, None if given is None else "is given", "K")
    A, C = problem.plant.flow.A, problem.plant.output.C
    if given is not None:
        return given
    if options.poles is not None:
        return placed_gain(A, C, options.poles)
    if options.weights is None:
        return _default_gain(problem, window)
    try:
        return riccati_gain(A, C, options.weights)
    except np.linalg.LinAlgError:
        raise no_kalman_gain("K") from None


def _default_gain(problem: Problem, window: float) -> Matrix:
    """K with real distinct poles; zero where a mode is unobservable, which a claim refutes.

    Also zero where some direction is nearly unobservable, so that K is immense, and the plant is
    stable by itself.
    """
    A, C = problem.plant.flow.A, problem.plant.output.C
    if approx_unobservable_modes(A, C):
        return np.zeros((problem.plant.n, problem.plant.p))
    speeds = np.sort(np.abs(np.linalg.eigvals(A)))
    poles: list[float] = []
    for speed in speeds.tolist():
        wanted = max(_SPEED_RATIO * speed, 1.0 / window)
        poles.append(max(wanted, _POLE_RATIO * poles[-1]) if poles else wanted)
    K = placed_gain(A, C, [-pole for pole in poles])
    is_immense = balanced_size(A - K @ C) > _LARGEST_SPEED_RATIO * max(
        balanced_size(A), 1.0 / window
    )
    decays = float(np.linalg.eigvals(A).real.max()) * window < -1
    return np.zeros_like(K) if is_immense and decays else K
