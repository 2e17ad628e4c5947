"""Typical magnitudes of states, outputs and known inputs of a plant, in units of its file.

Of states and outputs the root mean square over a simulation with random disturbances, where the
nominal plant decays by itself and something drives it; otherwise, and of inputs without a stated
bound, what disturbances and noise make in units that balance the plant. In other units of the file
they are the same magnitudes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.data.simulation import simulate
from obsdesign.data.simulation.rows import default_until
from obsdesign.document import jsonable
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.estimated_bounds import estimated_bounds, settled_bounds
from obsdesign.synthesis.interval.units import balanced_units

# rows of a simulation, and its end where there are no jumps, in times 1 / (decay rate)
_ROWS, _DECAYED = 500, 10.0


@dataclass(frozen=True)
class SignalSizes:
    """x (n,), y (p,), u (m,), w (l,)."""

    x: Matrix
    y: Matrix
    u: Matrix
    w: Matrix

    @staticmethod
    def from_problem(stated: Problem, nominal: Problem) -> SignalSizes:
        """Of a problem with parameters, and without them: input_bound is that of the former."""
        units = balanced_units(nominal)
        flow, jump = stated.plant.flow, stated.plant.jump
        u = _input_sizes(flow.B, flow.input_bound, units.sizes * units.pace)
        w = np.zeros(0)
        if jump is not None:
            w = _input_sizes(jump.E, jump.input_bound, units.sizes)
        x = _simulated(stated, nominal, u, w) if _decays(nominal) else np.zeros(nominal.plant.n)
        x = np.where(x > 0, x, units.sizes)
        C, radius = nominal.plant.output.C, nominal.require_noise_bound()
        return SignalSizes(x, np.abs(C) @ x + radius, u, w)


def _decays(nominal: Problem) -> bool:
    """Is the state bounded as time goes on, by an estimate?"""
    A, jump = nominal.plant.flow.A, nominal.plant.jump
    unit = np.eye(len(A))
    with np.errstate(all="ignore"):
        if jump is None:
            return bool(np.isfinite(settled_bounds(A, unit)).all())
        ends = nominal.require_dwell_time()
        return bool(np.isfinite(estimated_bounds((A, unit), (jump.G, unit), ends)).all())


def _simulated(stated: Problem, nominal: Problem, u: Matrix, w: Matrix) -> Matrix:
    """Root mean square of x, (n,), parameters in the middle of their ranges."""
    body = stated.to_dict()
    for block, sizes in (("flow", u), ("jump", w)):
        if len(sizes):
            body[block]["input_bound"] = sizes
    plant = Problem.from_dict(jsonable(body)).plant
    if plant.jump is None:
        until = _DECAYED / -float(np.linalg.eigvals(nominal.plant.flow.A).real.max())
    else:
        until = default_until(plant, "random")
    rng = np.random.default_rng(0)
    drawn = simulate(plant, until=until, step=until / _ROWS, rng=rng, parameters="nominal")
    x = drawn.block("x")
    result: Matrix = np.sqrt((x * x).mean(axis=0))
    return result


def _input_sizes(inputs: Matrix | None, bound: Matrix | None, effect: Matrix) -> Matrix:
    """Largest magnitudes as stated, else those whose largest effect is as large as `effect`."""
    if inputs is None:
        return np.zeros(0)
    if bound is not None:
        return bound
    largest = (np.abs(inputs) / effect[:, None]).max(axis=0, initial=0.0)
    return 1 / np.where(largest > 0, largest, 1.0)
