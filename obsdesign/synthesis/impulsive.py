"""Impulsive observers: window, weight of the past and strategy where they are left open.

Strategies are tried from the strongest hypothesis to the weakest: full (the plant is strongly
observable), compressed (it is after an impulse, in the image of G), subspace (a part of it is, and
the rest decays), quadratic (a matrix inequality). A window that is not given is the shortest one
that can be certified.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import scipy.linalg

from lmi.balls import exact
from lmi.deficient import MARGIN, decide_full_rank
from lmi.stack import Stack, approx_margin, coordinates
from lmi.verdict import Verdict
from obsdesign.equations import impulsive as equations
from obsdesign.equations.estimation_error import plant_data
from obsdesign.errors import InputError
from obsdesign.problem import Problem
from obsdesign.synthesis.candidate import Candidate

ALPHA = 1.3
# windows longer than the shortest conceivable one that are tried
_LONGER = 4
_RANK = 1e-10


def synthesize(problem: Problem) -> Iterator[Candidate]:
    """Candidates in order of preference; InputError for what cannot be built at all."""
    if text := equations.objection(problem.plant):
        raise InputError(text)
    asked = problem.options.get("strategy", "auto")
    order = equations.STRATEGIES if asked == "auto" else (asked,)
    if math.isinf(problem.require_dwell_time()[1]):
        order = order[:1]
    for strategy in order:
        if strategy == "full":
            yield _full(problem)
        if strategy == "compressed":
            found = _compressed(problem, asked == "auto")
            if found is not None:
                yield found


def _base(problem: Problem, strategy: str) -> dict[str, Any]:
    alpha = float(problem.options.get("alpha", ALPHA))
    return plant_data(problem.plant) | {"strategy": strategy, "alpha": alpha}


def _full(problem: Problem) -> Candidate:
    return windowed(problem, _base(problem, "full"), "full")


def _compressed(problem: Problem, only_if_singular: bool) -> Candidate | None:
    assert problem.plant.jump is not None
    U, S = image_of(problem.plant.jump.G)
    if only_if_singular and U.shape[1] == problem.plant.n:
        return None
    if not U.shape[1]:
        U, S = np.eye(problem.plant.n)[:, :1], np.zeros((1, problem.plant.n))
    gains = _base(problem, "compressed") | {"image": U, "coimage": S}
    return windowed(problem, gains, "compressed")


def image_of(G: Any) -> tuple[Any, Any]:
    """(U, S) with G = U S up to rounding: independent columns of G, and what makes up the others."""
    sizes = np.abs(G).max(axis=0)
    scale = np.where(sizes > 0, sizes, 1.0)
    upper, order = scipy.linalg.qr(G / scale, mode="r", pivoting=True)
    diagonal = np.abs(np.diag(upper))
    rank = int(np.sum(diagonal > _RANK * max(float(diagonal.max(initial=0.0)), 1e-300)))
    chosen = np.sort(order[:rank])
    U = G[:, chosen]
    S = np.linalg.lstsq(U, G)[0] if rank else np.zeros((0, len(G)))
    S[:, chosen] = np.eye(rank)
    return U, S


def windowed(problem: Problem, gains: Mapping[str, Any], label: str) -> Candidate:
    """The candidate with the window that is asked for, or the shortest one that is proved."""
    low, high = problem.require_dwell_time()
    numbers = dict(gains) | {
        name: exact(value)
        for name, value in gains.items()
        if isinstance(value, np.ndarray) and value.ndim == 2
    }
    core = equations.core_of(numbers)
    shortest = math.ceil(core.size / problem.plant.p)
    asked = problem.options.get("window")
    if asked is not None or math.isinf(high):
        window = int(asked or shortest)
        verdict = None if math.isinf(high) else decide_full_rank(_stack(core, window), low, high)
        return _candidate(gains, label, window, verdict, searched=False)
    for window in range(shortest, shortest + _LONGER + 1):
        verdict = decide_full_rank(_stack(core, window), low, high)
        if verdict.outcome == "proved" or _budget(verdict) or _hopeless(core, verdict, low, high):
            return _candidate(gains, label, window, verdict, searched=False)
    return _candidate(gains, label, window, verdict, searched=True)


def _stack(core: equations.Core, window: int) -> Stack:
    return Stack(*core.stack(window))


def _candidate(
    gains: Mapping[str, Any], label: str, window: int, verdict: Verdict | None, *, searched: bool
) -> Candidate:
    evidence = {} if verdict is None else verdict.evidence
    certificates = {"strongly_observable": evidence}
    return Candidate(label, dict(gains) | {"window": window}, certificates, searched=searched)


def _budget(verdict: Verdict) -> bool:
    return verdict.outcome == "undecided" and verdict.evidence.get("boxes", 0) > 1000


def _hopeless(core: equations.Core, verdict: Verdict, low: float, high: float) -> bool:
    """Does what refutes this window refute every longer one too? One spacing, kept for ever."""
    witness = verdict.evidence.get("witness", {})
    thetas = witness.get("thetas", [])
    if verdict.outcome != "refuted":
        return False
    if witness.get("method") == "exact":
        return True  # the state is destroyed unseen by the next jump
    if not thetas or max(thetas) - min(thetas) > 1e-6 * max(thetas):
        return False
    longer = _stack(core, core.size + 1)
    R, full = coordinates(longer, low, high)
    if not full:
        return True
    place = np.full((1, longer.thetas), float(np.mean(thetas)))
    return bool(approx_margin(longer, place, R)[0] < 100 * MARGIN)
