"""Unknown-input observers: coordinates, left inverse, annihilator, gain by QR and Riccati.

Where none exists (`obsdesign.analysis.invariant_zeros`) there is nothing to choose. The gain L
itself is chosen in `reduced_gain.py`.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lmi.arithmetic.arrays import Array, Matrix
from lmi.time_budget import UNLIMITED, Remark, TimeBudget
from obsdesign.analysis.balancing import balancing_units
from obsdesign.analysis.invariant_zeros import shows_every_input, zero_states, zeros_decay
from obsdesign.equations.unknown_input import formulas as equations
from obsdesign.equations.unknown_input.gains import SMOOTHING, UnknownInputGains
from obsdesign.equations.unknown_input.options import (
    REASON_AGAINST_JUMPS,
    differentiation,
    differentiator,
)
from obsdesign.errors import DoesNotApply, InputError
from obsdesign.problem.options import UnknownInputOptions
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.given_gains import refuse_second_choice
from obsdesign.synthesis.unknown_input.discrete_time import step_inputs
from obsdesign.synthesis.unknown_input.reduced_gain import reduced_gain
from obsdesign.synthesis.unknown_input.reduced_system import (
    Reduced,
    annihilator,
    left_inverse,
    output_variances,
)


def synthesize(problem: Problem, budget: TimeBudget = UNLIMITED) -> Iterator[Candidate]:
    """One candidate, without gains where no observer exists; InputError for unusable problems."""
    del budget  # nothing is searched for
    if problem.plant.flow.dt is not None:
        yield from step_inputs(problem)
        return
    _refuse_unusable(problem)
    D, plant = problem.require("flow.D"), problem.plant
    A, C = plant.flow.A, plant.output.C
    exists = shows_every_input(C, D).outcome == "proved"
    if not exists or zeros_decay(A, C, D).outcome != "proved":
        yield Candidate("none exists", None)
        return
    computed = _finite_gains(problem, D)
    if computed is None:
        yield Candidate("beyond binary64", None, searched=True)
        return
    label, gains = computed
    options, remarks = problem.options_as(UnknownInputOptions), tuple[Remark, ...]()
    if options.differentiator is None and gains.differentiator == "fixed_lag":
        remarks = (Remark(_choice_of_differentiator(problem, gains)),)
    yield Candidate(label, gains, searched="L" not in problem.gains, remarks=remarks)


def _refuse_unusable(problem: Problem) -> None:
    """DoesNotApply or InputError for what this kind cannot serve, or options that contradict."""
    if problem.plant.jump is not None:
        raise DoesNotApply(REASON_AGAINST_JUMPS)
    problem.require("flow.D")
    problem.require_measured("continuous", "periodic")
    options, noise = problem.options_as(UnknownInputOptions), problem.plant.output.noise_std
    refuse_second_choice(options, "is given" if "L" in problem.gains else None)
    chosen = differentiator(options.differentiator, noise)
    if chosen in SMOOTHING and not np.all(noise > 0):
        raise InputError(
            f"output.noise_std is required by differentiator = {chosen!r}, positive for every "
            f"output; got {noise.tolist()}."
        )
    if options.is_stated("lag") and chosen != "fixed_lag":
        raise InputError(
            f"observer.lag is the delay of differentiator = 'fixed_lag'; got {chosen!r}. Drop one."
        )


def _finite_gains(problem: Problem, D: Matrix) -> tuple[str, UnknownInputGains] | None:
    """Return (label, gains), or None where they are beyond binary64."""
    try:
        with np.errstate(all="ignore"):
            label, gains = _gains(problem, D)
    except InputError:
        raise
    except (np.linalg.LinAlgError, ValueError):  # what overflowed is nothing to decompose
        return None
    arrays = [value for value in vars(gains).values() if isinstance(value, np.ndarray)]
    return (label, gains) if all(np.isfinite(array).all() for array in arrays) else None


def _choice_of_differentiator(problem: Problem, gains: UnknownInputGains) -> str:
    """The delay of the differentiator that was chosen, and the noise of the one without delay."""
    h, lag = problem.plant.output.period, gains.lag
    assert lag is not None
    late, noise = f"{lag} samples late", ""
    if h is not None:
        late += f" ({lag * h:g})"
        spread = np.sqrt(2 * (gains.N**2 @ problem.plant.output.noise_std**2)) / h
        noise = f", which leaves noise of {', '.join(f'{value:.2g}' for value in spread)} in d"
    return (
        "output.noise_std is given, so that observer.differentiator = 'fixed_lag' was chosen: rows "
        f"come {late}, smoothed to the noise. Without delay: 'cell'{noise}."
    )


def _gains(problem: Problem, D: Matrix) -> tuple[str, UnknownInputGains]:
    flow, output, options = (
        problem.plant.flow,
        problem.plant.output,
        problem.options_as(UnknownInputOptions),
    )
    C, n = output.C, len(D)
    sizes = balancing_units(flow.A, C, D)[0]
    T1, T = _coordinates(problem, D, sizes)
    N, root = left_inverse(C @ D, output_variances(problem))
    Z = annihilator(C @ D, equations.lengths(C * sizes))
    balanced = flow.A * sizes / sizes[:, None], C * sizes, D / sizes[:, None]
    hidden = T @ zero_states(flow.A, C, D)
    Ta = T1[:, : n - D.shape[1]]
    reduced = Reduced.from_plant(
        balanced, Ta=Ta / sizes[:, None], T=T * sizes, N=N, Z=Z, hidden=hidden
    )
    label, L = reduced_gain(problem, reduced, root)
    B = equations.known_inputs(flow.B, *flow.disturbance_box())
    plant = equations.PlantMatrices(flow.A, B, C, D)
    matrices = equations.observer_matrices(plant, T1, T, N=N, Z=Z, L=L)
    chosen = differentiator(options.differentiator, output.noise_std)
    return label, UnknownInputGains(
        A=flow.A,
        C=C,
        D=D,
        B=flow.B,
        **vars(matrices),
        first=reduced.first_state(),
        **differentiation(chosen, output.noise_std, output.noise_centre, options.lag),
    )


def _coordinates(problem: Problem, D: Matrix, sizes: Matrix) -> tuple[Array, Array]:
    """T1 = [Ta, D] and the first n - q rows of its inverse; sizes: units that balance the plant."""
    n, q = D.shape
    T1 = problem.gains.get("T1")
    if T1 is not None:
        return T1, np.linalg.solve(T1, np.eye(n))[: n - q]
    # in units that balance the plant, the last columns of Q are orthogonal to D
    unit = D / sizes[:, None] * equations.lengths((D / sizes[:, None]).T)
    Ta = np.linalg.qr(unit, mode="complete")[0][:, q:]
    return np.hstack([Ta * sizes[:, None], D]), Ta.T / sizes
