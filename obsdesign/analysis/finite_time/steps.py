"""Finite-time estimation in discrete time: requirements, and the error of a window, exact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import exact, to_float
from obsdesign.analysis.finite_time.requirements import reason_against
from obsdesign.equations.finite_time.steps import StepWindowGains, cancelled_terms, error_maps
from obsdesign.equations.time_grid import steps_of
from obsdesign.problem.options import FiniteTimeOptions
from obsdesign.problem.problem import Problem

# bias of a window in parts of the terms that cancel in it: rounding of its gains leaves less
ROUNDING = 1e-9
# steps of a window that is proved: exact numbers grow with each
MOST_STEPS = 400
_OPTIONS = ("window", "method")


def reason_against_steps(problem: Problem) -> str | None:
    """Reason against a finite-time observer for a problem in discrete time, or None."""
    options, plant = problem.options_as(FiniteTimeOptions), problem.plant
    for name in options.to_document():
        if name not in _OPTIONS:
            return f"observer.{name} is not available with flow.dt; {', '.join(_OPTIONS)} are."
    if options.method != "least_squares":
        return f"observer.method must be least_squares with flow.dt; got {options.method!r}."
    if problem.gains:
        return "observer.gains.L is not available with flow.dt: least squares have no L."
    if reason := reason_against(problem):
        return reason
    dt, period = plant.flow.dt, plant.output.sample_period
    assert dt is not None
    samples = plant.n if options.window is None else round(options.window / period)
    if samples * (steps_of(period, dt) or 1) > MOST_STEPS:
        return f"a window of at most {MOST_STEPS} steps is required; got {samples} samples."
    return None


@dataclass(frozen=True)
class WindowError:
    """Bounds of |x_hat - x|: bias (n, n) times |x| at the first sample, and radius (n,).

    scale (n, n): size of the terms that cancel in the bias. radius None without a noise bound.
    """

    bias: Matrix
    scale: Matrix
    radius: Matrix | None

    @classmethod
    def from_gains(cls, gains: StepWindowGains) -> WindowError:
        """Of stored gains, exact and then rounded up."""
        A, C, W = exact(gains.A), exact(gains.C), exact(gains.of_samples)
        maps = error_maps(A, C, W, gains.period_steps)
        sizes = cancelled_terms(A, C, W, gains.period_steps)
        half = (exact(gains.flow_upper) - exact(gains.flow_lower)) / 2
        radius = None
        if gains.noise_bound is not None:
            total = sum((abs(q) @ half for q in maps[1:]), half * 0)
            total = total + sum(abs(own) @ exact(gains.noise_bound) for own in W)
            radius = _raised(to_float(total))
        return cls(_raised(to_float(abs(maps[0]))), to_float(sizes), radius)


def _raised(values: Matrix) -> Matrix:
    return np.where(values > 0, np.nextafter(values, np.inf), 0.0)
