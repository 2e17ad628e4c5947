"""Impulsive observers: a point observer corrected at impulses only, gains from a sliding window.

    xhat' = A xhat + B u + (b_lower + b_upper)/2                               between impulses
    xhat+ = G xhat- + E w + (c_lower + c_upper)/2 + L[k] (C xhat- - y[k])      at impulse k

Source: E. A. Medina, D. A. Lawrence, State Estimation for Linear Impulsive Systems, gain (12) of
Theorem 3.1, here without its inverse and without large powers of alpha: with the window matrix

    O = rows alpha^-(k-j) C X_j, j = k-l+1 .. k (newest last, weight 1),   O = Q R,
    L[k] = -J X_k R^-1 (last p rows of Q)'

which is (12) exactly. Two windows share the formula:

    full         X_(k-l+1) = I: the window starts just before its first impulse, where (12) is
                 left with l - 1 spacings (the spacing before cancels); J = G
    compressed   X_(k-l+1) = e^{A delta} U: it starts just after the impulse before, in the image
                 of G, spanned by U; J = U S, which is G: l spacings

Between impulses X_(j+1) = e^{A delta} J X_j. Hypothesis: O has full column rank, uniformly over
the spacings (`verification.impulsive`). For a measurement after the jump, C stands for C G.

Notation
    A, C, J     d x d, p x d, d x d: the plant, or the part of it that the window looks at
    U           d x r, or None for a full window; columns of O: r, or d
    window      l, number of impulses; alpha > 1 weighs the past, and 1/alpha is the certified
                factor per impulse
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from obsdesign.equations.estimation_error import seen_before_jump

Array = NDArray[Any]  # float64, or object arrays of exact rationals

# what is left to itself must shrink by this factor per impulse, in the norm of its P: a margin,
# so that a defective eigenvalue 1 that rounding has split does not pass for a stable one
QUOTIENT_RATE = 0.95
# parts of a cascade are asked for so many times the rate that is wanted of all of it
CASCADE_MARGIN = 1.1
LONGEST_WINDOW = 4096  # impulses
# impulses of a proof of full rank beyond the fewest conceivable ones
_FURTHER_BLOCKS = 4
STRATEGIES = ("full", "compressed", "subspace", "quadratic")


@dataclass(frozen=True)
class Core:
    """What a window looks at; see the module's notation.

    S: the left factor of J = U S, r x d, for a compressed window; lift: n x d, how the core lies
    in the state, None where it is the state itself.
    """

    A: Array
    C: Array
    J: Array
    U: Array | None = None
    S: Array | None = None
    lift: Array | None = None

    @property
    def size(self) -> int:
        """Columns of the window matrix."""
        return len(self.A) if self.U is None else int(self.U.shape[1])

    def spacings(self, window: int) -> int:
        """How many spacings the gain of a window depends on."""
        return window - 1 if self.U is None else window

    def stack(self, window: int) -> tuple[Array, Array, Array, Array, int, bool]:
        """The window matrix for `lmi.rank.stack.Stack`: F, H, C, right, blocks, flows first."""
        start = 0 * self.A + np.eye(len(self.A), dtype=np.int64) if self.U is None else self.U
        return self.A, self.J, self.C, start, window, self.U is not None


def factor_left_alone(decay_rate: float, longest: float) -> float:
    """The factor per impulse that parts must reach which are left to themselves.

    QUOTIENT_RATE, or less where a decay rate per unit of time is asked for.
    """
    return min(QUOTIENT_RATE, float(np.exp(-CASCADE_MARGIN * decay_rate * longest)))


def core_of(gains: Mapping[str, Any]) -> Core:
    """The core of a design's gains: floats, or exact numbers where the gains are exact.

    full: the plant. compressed: image U and coimage S, n x r and r x n. subspace: core_A, core_C,
    core_G in the middle block of the basis, and image, coimage where its window is compressed.
    """
    if "core_A" in gains:
        A, C, G = (gains[f"core_{name}"] for name in "ACG")
        first, size = (int(number) for number in gains["core_place"])
        lift = gains["basis"][:, first : first + size]
    else:
        A, G = gains["A"], gains["G"]
        C, lift = seen_before_jump(G, gains["C"], gains["jump_measurement"]), None
    if "image" not in gains:
        return Core(A, C, G, lift=lift)
    U, S = gains["image"], gains["coimage"]
    return Core(A, C, U @ S, U, S, lift)


def most_blocks(core: Core, p: int) -> int:
    """Impulses that a proof of full rank may use, of a window however long: p outputs at each.

    Full rank of the first measurements of a window is full rank of all of them.
    """
    return math.ceil(core.size / p) + _FURTHER_BLOCKS


def window_matrix(core: Core, flows: Array) -> tuple[Array, Array]:
    """(O with weights 1, J X_k) for the flows e^{A delta} of a window, oldest first.

    flows: (..., m, d, d), m = core.spacings(window); O: (..., p * window, r); J X_k: (..., d, r).
    """
    d = len(core.A)
    steps = [flows[..., i, :, :] for i in range(flows.shape[-3])]
    if core.U is None:
        X = np.broadcast_to(np.eye(d), (*flows.shape[:-3], d, d))
    else:
        X = steps.pop(0) @ core.U
    rows = [core.C @ X]
    for flow in steps:
        X = flow @ (core.J @ X)
        rows.append(core.C @ X)
    return np.concatenate(rows, axis=-2), core.J @ X


def weighted(rows: Array, outputs: int, alpha: float) -> Array:
    """Window rows with block j of age i = k - j weighed by alpha^-i: the newest, last, by 1."""
    blocks = rows.shape[-2] // outputs
    ages = np.repeat(np.arange(blocks)[::-1], outputs)
    weights: Array = float(alpha) ** -ages.astype(np.float64)
    return rows * weights[:, None]


def window_gains(core: Core, flows: Array, alpha: float) -> Array:
    """L[k] of (12), (..., d, p), for the flows of a window, (..., m, d, d), oldest first."""
    p = len(core.C)
    rows, left = window_matrix(core, flows)
    Q, R = np.linalg.qr(weighted(rows, p, alpha))
    newest = np.swapaxes(Q[..., -p:, :], -1, -2)
    return -left @ np.linalg.solve(R, newest)


def objection(plant: Any) -> str | None:
    """What this observer cannot use of a plant, or None; one sentence."""
    if plant.output.measured != "at_jumps":
        return (
            f"output.measured must be at_jumps for kind 'impulsive'; got {plant.output.measured!r}."
        )
    if plant.jump is None or plant.jump.dwell_time is None:
        return (
            "jump.dwell_time = [shortest, longest] is required by kind 'impulsive'; it is missing."
        )
    return None
