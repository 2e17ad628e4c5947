"""Unknown-input observers: coordinates, left inverse, annihilator and gain by QR and Riccati.

Where it does not exist (`obsdesign.analysis.invariant_zeros`) there is nothing to choose. The gain
L itself is chosen in `synthesis.reduced_gain`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lmi.time_budget import remark
from obsdesign.analysis.invariant_zeros import hidden_states, shows_every_input, zeros_decay
from obsdesign.analysis.units import own_units
from obsdesign.equations.unknown_input import matrices as equations
from obsdesign.errors import DoesNotApply, InputError
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.unknown_input.reduced_gain import reduced_gain
from obsdesign.synthesis.unknown_input.reduced_system import (
    Reduced,
    annihilator,
    left_inverse,
    output_variances,
)

Matrix = NDArray[np.float64]


def synthesize(problem: Problem) -> Iterator[Candidate]:
    """One candidate, without gains where no observer exists; InputError for unusable problems."""
    if text := equations.objection(problem.plant):
        raise DoesNotApply(text)
    D = problem.require("flow.D")
    problem.require_measured("continuous", "periodic")
    plant = problem.plant
    for name in ("poles", "weights"):
        if name in problem.options and "L" in problem.gains:
            raise InputError(f"observer.{name} chooses L, but L is given; drop one.")
    if "poles" in problem.options and "weights" in problem.options:
        raise InputError("observer.poles and observer.weights both choose L; drop one.")
    noise = plant.output.noise_std
    chosen = equations.differentiator(problem)
    if chosen in equations.SMOOTHING and not np.all(noise > 0):
        raise InputError(
            f"output.noise_std is required by differentiator = {chosen!r}, positive for every "
            f"output; got {noise.tolist()}."
        )
    if "lag" in problem.options and chosen != "fixed_lag":
        raise InputError(
            f"observer.lag is the delay of differentiator = 'fixed_lag'; got {chosen!r}. Drop one."
        )
    A, C = plant.flow.A, plant.output.C
    exists = shows_every_input(C, D).outcome == "proved"
    if not exists or zeros_decay(A, C, D).outcome != "proved":
        yield Candidate("none exists", {})
        return
    try:
        with np.errstate(all="ignore"):
            label, gains = _gains(problem, D)
            finite = all(np.isfinite(X).all() for X in gains.values() if isinstance(X, np.ndarray))
    except InputError:
        raise
    except (np.linalg.LinAlgError, ValueError):  # what overflowed is nothing to decompose
        finite = False
    if not finite:
        yield Candidate("beyond binary64", {}, searched=True)
        return
    if "differentiator" not in problem.options and chosen == "fixed_lag":
        remark(_choice_of_differentiator(problem, gains))
    yield Candidate(label, gains, searched=not ("L" in problem.gains or _asks_for_growth(problem)))


def _choice_of_differentiator(problem: Problem, gains: Mapping[str, Any]) -> str:
    """The delay of the differentiator that was chosen, and the noise of the one without delay."""
    h, lag = problem.plant.output.period, gains["lag"]
    late, noise = f"{lag} samples late", ""
    if h is not None:
        late += f" ({lag * h:g})"
        spread = np.sqrt(2 * (gains["N"] ** 2 @ problem.plant.output.noise_std**2)) / h
        noise = f", which leaves noise of {', '.join(f'{value:.2g}' for value in spread)} in d"
    return (
        "output.noise_std is given, so that observer.differentiator = 'fixed_lag' was chosen: rows "
        f"come {late}, smoothed to the noise. Without delay: 'cell'{noise}."
    )


def _asks_for_growth(problem: Problem) -> bool:
    """Poles that do not decay refute what was asked, whatever gain gives them."""
    real = [np.ravel(pole)[0] for pole in problem.options.get("poles", [])]
    return any(value >= 0 for value in real)


def _gains(problem: Problem, D: Matrix) -> tuple[str, dict[str, Any]]:
    flow, C, (n, q) = problem.plant.flow, problem.plant.output.C, D.shape
    sizes = own_units(flow.A, C, D)[0]
    T1 = problem.gains.get("T1")
    if T1 is None:  # in units that balance the plant, the last columns of Q are orthogonal to D
        unit = D / sizes[:, None] * equations.lengths((D / sizes[:, None]).T)
        Ta = np.linalg.qr(unit, mode="complete")[0][:, q:]
        T1, T = np.hstack([Ta * sizes[:, None], D]), Ta.T / sizes
    else:
        T = np.linalg.solve(T1, np.eye(n))[: n - q]
    N, root = left_inverse(C @ D, output_variances(problem))
    Z = annihilator(C @ D, equations.lengths(C * sizes))
    balanced = flow.A * sizes / sizes[:, None], C * sizes, D / sizes[:, None]
    hidden = T @ hidden_states(flow.A, C, D)
    reduced = Reduced.of(*balanced, T1[:, : n - q] / sizes[:, None], T * sizes, N, Z, hidden)
    label, L = reduced_gain(problem, reduced, root)
    B = equations.inputs(flow.B, flow.lower, flow.upper)
    found = equations.matrices((flow.A, B, C, D), T1, T, N, Z, L)
    plain = {"A": flow.A, "C": C, "D": D} | ({} if flow.B is None else {"B": flow.B})
    gains = plain | {"T1": T1, "T": T, "N": N, "Z": Z, "L": L} | found
    gains |= {"first": reduced.first_state()}
    chosen = equations.differentiator(problem)
    return label, equations.without_empty(gains) | equations.differentiation(problem, chosen)
