"""Impulsive inputs: observer gain, window and exponents where they are left open.

K places the poles of A - K C at real, distinct places a little faster than those of A: slow
observers leave more of an impulse to be seen, and with a real spectrum few exponents determine an
impulse (`verification.uniqueness`). The window is a part of the shortest dwell time. Exponents: the
largest lambda for which what (15) neglects stays below `ratio` (it is monotone), and its
neighbours below: among all choices with that ratio the slow corner is the least sensitive to noise
(`observer.check_exponents` asks IPOPT whether it is).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lmi.balls import exact, fixed_vector
from obsdesign.equations import impulse_rule
from obsdesign.equations import impulsive_input as equations
from obsdesign.equations.estimation_error import flow_error_matrix, plant_data
from obsdesign.equations.impulse_fit import balanced_size
from obsdesign.errors import InputError
from obsdesign.problem import Problem
from obsdesign.structure import approx_unobservable_modes
from obsdesign.synthesis import exponent_nlp
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.impulse_samples import sampled_candidate
from obsdesign.synthesis.placement import placed_gain

Matrix = NDArray[np.float64]

_WINDOW = 0.8  # of the shortest dwell time
_MARGIN = 0.25  # of the window
_LARGEST_GAIN = 1e3  # size of A - K C against that of A
_MEMORY = 6.0  # time constants of the slowest mode of A - K C that a window is worth
_FEWEST = 24  # samples of a window
_RATIO = 0.05
_FASTER, _APART = 1.25, 1.2  # poles of the observer against those of the plant and each other
_SPACING = 1 / 13  # of exponents, relative to the largest
_BETTER = 0.99  # deviation against the corner's from which another choice counts
_SPREAD = 10.0  # the fastest of spread exponents, times the margin
_FASTEST = 3.3  # lambda margin, where no lambda keeps the ratio


def synthesize(problem: Problem) -> Iterator[Candidate]:
    """Candidates in order of preference; InputError for what cannot be built at all."""
    plant = problem.plant
    problem.require("jump.H")
    low, _ = problem.require_dwell_time()
    problem.require_measured("continuous", "periodic")
    if text := equations.objection(plant):
        raise InputError(text)
    _check_options(problem)
    weighting = _weighting(problem)
    window = float(problem.options.get("window", _WINDOW * low or 1.0))
    operator, reason = _operator(problem, window)
    if operator == "samples":
        yield sampled_candidate(problem, low, reason)
        return
    K = problem.gains.get("K")
    K = _gain(problem, window) if K is None else K
    D = flow_error_matrix(plant.flow.A, K, plant.output.C)
    if "window" not in problem.options:
        window = _remembered(problem, D, window)
    margin = float(problem.options.get("margin", _MARGIN * window))
    if margin >= window:
        raise InputError(
            f"observer.margin must be less than the window, {window!r}; got {margin!r}."
        )
    data = _data(problem) | {
        "K": K, "window": window, "margin": margin, "weighting": weighting,
        "operator": operator, "nonnegative": bool(problem.options.get("nonnegative", False)),
        "state_correction": bool(problem.options.get("state_correction", False)),
    }  # fmt: skip
    if "threshold" in problem.options:
        data["threshold"] = float(problem.options["threshold"])
    if "exponents" in problem.options:
        given = np.array(problem.options["exponents"], dtype=np.float64)
        yield Candidate(
            "given exponents", data | {"exponents": given, "rule": _rule(data, D, given)}
        )
        return
    n = plant.n
    rows = [exact(plant.output.C)]
    for _ in range(n - 1):
        rows.append(rows[-1] @ exact(plant.flow.A))
    # a window that is too long and a state that is not seen refute every K and all exponents
    open_question = window < low and not any(fixed_vector(X) for X in (rows, [exact(data["H"])]))
    for label, chosen, rule in _choices(problem, data, D):
        yield Candidate(label, data | {"exponents": chosen, "rule": rule}, searched=open_question)


def _remembered(problem: Problem, D: Matrix, window: float) -> float:
    """No longer than something of an impulse is left in the output, so that all of it is used."""
    slowest = float(-np.linalg.eigvals(D).real.max())
    if slowest <= 0:
        return window
    least = max(4 * float(problem.options.get("margin", 0.0)),
                _FEWEST * float(problem.plant.output.period or 0.0))  # fmt: skip
    return min(window, max(_MEMORY / slowest, least))


def _choices(
    problem: Problem, data: dict[str, Any], D: Matrix
) -> Iterator[tuple[str, Matrix, str]]:
    """(label, exponents, rule): the corner and spread exponents.

    Spread ones first where |b| has no peak: impulses are then evaluated when they are old, which
    fast kernels have forgotten. They also differ most from each other: with many states neighbours
    are too much alike for the rank.
    """
    n, window, margin = len(D), data["window"], data["margin"]
    spread = np.asarray(-np.geomspace(1.0 / window, _SPREAD / margin, 2 * n), dtype=np.float64)
    last = (f"{2 * n} spread exponents", spread, _rule(data, D, spread))
    corners = [
        corner_exponents(D, data["C"], data["H"], window, margin, _ratio(problem), count)
        for count in (2 * n, 2 * n + 2)
    ]
    asked = any(name in problem.options for name in ("ratio", "check_exponents", "threshold"))
    early = not asked and _rule_or_none(data, D, corners[0]) in (None, "position")
    if early:
        yield last
    for corner in corners:
        if _rule_or_none(data, D, corner) is None:
            continue
        for label, chosen in _looked_at_again(problem, data, D, corner):
            yield label, chosen, _rule(data, D, chosen)
    if not early:
        yield last


def _rule_or_none(data: dict[str, Any], D: Matrix, exponents: Matrix) -> str | None:
    """None where these exponents cannot work in the window."""
    try:
        return _rule(data, D, exponents)
    except InputError:
        return None


def _looked_at_again(
    problem: Problem, data: dict[str, Any], D: Matrix, corner: Matrix
) -> Iterator[tuple[str, Matrix]]:
    """(label, exponents): the corner, and before it what IPOPT finds better, where asked."""
    label = f"{len(corner)} exponents"
    if not problem.options.get("check_exponents"):
        yield label, corner
        return
    tau, std = data["window"], problem.plant.output.noise_std
    age = None if _rule(data, D, corner) == "peak" else equations.OLD * tau
    scale = std / std.max() if std.any() else np.ones(len(std))
    found, size = exponent_nlp.second_opinion(D, data["C"], data["H"], corner, scale, tau, age)
    told = f"times {size:.3g} as uncertain as with {corner[0]:.4g} ... {corner[-1]:.4g}"
    if found is None:
        label += "; IPOPT did not converge"
    elif size > _BETTER:
        label += ", confirmed by IPOPT"
    elif equations.neglected_ratio(
        D, data["C"], data["H"], found, tau, data["margin"]
    )[0] > _ratio(problem) * (1 + 1e-6):  # fmt: skip
        label += f"; IPOPT finds {told}, but more is neglected than the ratio allows"
    else:
        yield f"{label} from IPOPT, {told}", found
    yield label, corner


def _rule(data: dict[str, Any], D: Matrix, exponents: Matrix) -> str:
    """When to evaluate: at a peak of |R| where every impulse makes one, else by position."""
    window, margin = data["window"], data["margin"]
    if text := impulse_rule.growth_objection(exponents, len(D), len(data["C"]), window):
        raise InputError(text)
    try:
        rule, oldest = impulse_rule.rule_of(D, data["C"], data["H"], exponents, window, margin)
    except ValueError as error:
        if window >= data["dwell_time"][0]:
            return "position"  # a claim refutes the window, whatever the rule
        raise InputError(
            f"{error}; are the units of flow.A and output.C what they should be?"
        ) from None
    text = impulse_rule.margin_objection(oldest, window, margin)
    if text and data["H"].any():
        raise InputError(text)
    return "threshold" if "threshold" in data else rule


def _data(problem: Problem) -> dict[str, Any]:
    plant = problem.plant
    data = plant_data(plant) | {"H": problem.require("jump.H")}
    data |= {"noise_std": plant.output.noise_std, "noise_cv": plant.output.noise_cv}
    if plant.output.measured == "periodic":
        data["period"] = float(plant.output.period or 0.0)
    return data


def _ratio(problem: Problem) -> float:
    return float(problem.options.get("ratio", _RATIO))


def _weighting(problem: Problem) -> str:
    """plain or gls; gls by default where every output has noise. InputError if it has none."""
    output = problem.plant.output
    silent = np.flatnonzero((output.noise_std == 0) & (output.noise_cv == 0))
    asked = problem.options.get("weighting", "plain" if len(silent) else "gls")
    if asked == "gls" and len(silent):
        raise InputError(
            f"output.noise_std must be > 0 with observer.weighting = 'gls'; got 0 for output "
            f"{silent[0] + 1}."
        )
    return str(asked)


def _check_options(problem: Problem) -> None:
    options, jump = problem.options, problem.plant.jump
    directions = 0 if jump is None or jump.H is None else jump.H.shape[1]
    if options.get("nonnegative") and directions > 1:
        raise InputError(
            f"observer.nonnegative takes one direction of impulses; jump.H has {directions}."
        )
    if options.get("state_correction") and _weighting(problem) == "plain":
        raise InputError(
            "observer.state_correction needs observer.weighting = 'gls', and output.noise_std > 0: "
            "without noise there is nothing to weigh the state by."
        )
    if options.get("check_exponents"):
        if "exponents" in options or options.get("operator") == "samples":
            other = "exponents" if "exponents" in options else "operator = 'samples'"
            raise InputError(
                f"observer.check_exponents looks at exponents that are left open; observer.{other} "
                "leaves none."
            )
        if _weighting(problem) == "gls":
            raise InputError(
                "observer.check_exponents is about observer.weighting = 'plain': whitened features "
                "hardly depend on the exponents."
            )
        if directions > 1:
            raise InputError(
                f"observer.check_exponents takes one direction of impulses; jump.H has "
                f"{directions}."
            )


def _operator(problem: Problem, window: float) -> tuple[str, str]:
    """(operator, why): samples where an integral operator would be too coarse."""
    asked = problem.options.get("operator")
    plant = problem.plant
    own = [
        name
        for name in ("exponents", "ratio", "threshold", "check_exponents")
        if name in problem.options
    ]
    own += ["gains.K"] if "K" in problem.gains else []
    if asked is not None:
        if asked == "samples" and own:
            raise InputError(
                f"observer.{own[0]} belongs to operator 'integral'; with 'samples' all samples of "
                "the window are used as they are."
            )
        return str(asked), "asked for"
    if plant.output.measured != "periodic" or own:
        return "integral", ""
    reason = equations.is_coarse(plant.flow.A, None, float(plant.output.period or 0.0))
    if reason is None:
        few = window / float(plant.output.period or 1.0)
        reason = f"the window holds only {few:.3g} samples" if few < 12 else None
    return ("integral", "") if reason is None else ("samples", reason)


def _gain(problem: Problem, window: float) -> Matrix:
    """Real distinct poles; zero where a mode is not seen (a claim says so).

    Also zero where that would take a gain beyond all measure and the plant forgets by itself: some
    direction is hardly seen.
    """
    A, C = problem.plant.flow.A, problem.plant.output.C
    if approx_unobservable_modes(A, C):
        return np.zeros((problem.plant.n, problem.plant.p))
    speeds = np.sort(np.abs(np.linalg.eigvals(A)))
    poles: list[float] = []
    for speed in speeds.tolist():
        wanted = max(_FASTER * speed, 1.0 / window)
        poles.append(max(wanted, _APART * poles[-1]) if poles else wanted)
    K = placed_gain(A, C, [-pole for pole in poles])
    immense = balanced_size(A - K @ C) > _LARGEST_GAIN * max(balanced_size(A), 1.0 / window)
    forgets = float(np.linalg.eigvals(A).real.max()) * window < -1
    return np.zeros_like(K) if immense and forgets else K


def slowest_exponent(
    D: Matrix, C: Matrix, H: Matrix, window: float, margin: float, ratio: float
) -> float | None:
    """The largest lambda <= -1/window with |E| <= ratio |b| for ages in [margin, window].

    By bisection. None where no lambda does: then h changes sign, and rows of b have zeros. Kernels
    slower than the window are all alike on it: their features hardly differ.
    """

    def holds(size: float) -> bool:
        worst, _ = equations.neglected_ratio(D, C, H, np.array([-size]), window, margin, 60)
        return worst <= ratio

    high = 1.0 / margin
    while not holds(high):
        high *= 2
        if high * window > 500:
            return None
    low = high / 2
    while holds(low):
        if low * window <= 1:
            return -1.0 / window
        low /= 2
    for _ in range(40):
        middle = math.sqrt(low * high)
        low, high = (low, middle) if holds(middle) else (middle, high)
    return -high


def corner_exponents(
    D: Matrix, C: Matrix, H: Matrix, window: float, margin: float, ratio: float, count: int
) -> Matrix:
    """`count` exponents: the slowest one the ratio allows, and as many below it, evenly spaced.

    Where no ratio can be kept: from the length of the window to that of the margin, evenly in
    proportion.
    """
    first = slowest_exponent(D, C, H, window, margin, ratio)
    if first is None:
        return np.asarray(-np.geomspace(1.0 / window, _FASTEST / margin, count), dtype=np.float64)
    return np.asarray(first * (1 + _SPACING * np.arange(count)), dtype=np.float64)
