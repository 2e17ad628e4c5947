"""Whether the samples of every window of stages determine the state at its end, in balls.

Synthesis chooses the window by it, verification proves it again.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lmi.arithmetic.arrays import Array, Indices, Matrix
from lmi.arithmetic.balls import Exact, exact, pivot_columns, precision, scalar, solve_entries
from obsdesign.analysis.set_membership.enclosed import BALLS
from obsdesign.equations.set_membership.gains import SetMembershipGains
from obsdesign.equations.set_membership.nominal import NominalMaps, StepMap
from obsdesign.equations.set_membership.pattern import Pattern, Step

_BITS = 320


def determines_state(gains: SetMembershipGains, pattern: Pattern, count: int) -> bool:
    """Is it proved that the samples of every window of so many stages determine the state?"""
    with precision(_BITS):
        maps = NominalMaps(gains, BALLS)
        steps = maps.steps(pattern.cycle, lambda h: (1,))
        return all(
            any(_determines(steps, maps.C, window[k:], L) for k, L in _starts(gains, window))
            for window in pattern.windows(count)
        )


def _starts(gains: SetMembershipGains, window: tuple[Step, ...]) -> Iterator[tuple[int, Exact]]:
    """(k, basis): the state before step k is basis z for an unknown z, known disturbances apart.

    Behind a jump with a singular G it is in the range of G, so that fewer samples determine it.
    """
    yield 0, exact(np.eye(gains.n))
    if gains.G is None:
        return
    G = exact(gains.G)
    basis = G[:, pivot_columns(G)]
    if basis.shape[1] < gains.n:
        yield from ((k + 1, basis) for k, step in enumerate(window) if step.jump)


def _determines(
    steps: dict[Step, StepMap], C: Array, window: tuple[Step, ...], basis: Exact
) -> bool:  # fmt: skip
    """Is the map from z to the samples of a window injective? x = basis z before it."""
    state, rows = basis, [np.zeros((0, basis.shape[1]), dtype=object)]
    for step in window:
        state = steps[step].Phi @ state
        if step.sampled:
            rows.append(C @ state)
    observed = np.vstack(rows)
    chosen = _independent(observed)
    if chosen is None:
        return False
    square = observed[chosen]
    return solve_entries(square, exact(np.eye(len(square)))) is not None


def _independent(rows: Array) -> Indices | None:
    """Indices of n rows that are independent in floats; None if there are fewer."""
    n = rows.shape[1]
    left: Matrix = np.array([[float(scalar(x)) for x in row] for row in rows]).reshape(len(rows), n)
    size = np.linalg.norm(left, axis=1, keepdims=True)
    left = left / np.where(size > 0, size, 1.0)
    chosen = []
    for _ in range(n):
        norms = np.linalg.norm(left, axis=1)
        best = int(norms.argmax()) if len(norms) else -1
        if best < 0 or not norms[best] > 0:
            return None
        chosen.append(best)
        unit = left[best] / norms[best]
        left = left - np.outer(left @ unit, unit)
        left[best] = 0.0
    return np.array(chosen, dtype=np.intp)
