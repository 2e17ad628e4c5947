"""Impulsive observers: corrected at impulses only, with gains of a sliding window.

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
    A, C, J     d x d, p x d, d x d: the core: the plant, or the part of it that is corrected
    U           d x r, or None for a full window; columns of O: r, or d
    window      l, number of impulses; alpha > 1 weighs the past, and 1/alpha is the certified
                factor per impulse
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Array
from obsdesign.equations.estimation_error import seen_before_jump
from obsdesign.equations.impulsive.gains import ImpulsiveGains

# uncorrected blocks must shrink by this factor per impulse, in the norm of their P: a margin, so
# that a defective eigenvalue 1 that rounding has split does not pass for a stable one
QUOTIENT_RATE = 0.95
# blocks of a cascade must decay at so many times the rate of the whole
CASCADE_MARGIN = 1.1
# impulses of a proof of full rank beyond the fewest conceivable ones
_FURTHER_BLOCKS = 4


@dataclass(frozen=True)
class Core:
    """The part of the plant that a window corrects; see the module's notation.

    S: the left factor of J = U S, r x d, for a compressed window; lift: n x d, how the core lies
    in the state, None where it is the state itself.
    """

    A: Array
    C: Array
    J: Array
    U: Array | None = None
    S: Array | None = None
    lift: Array | None = None

    @classmethod
    def from_gains(cls, gains: ImpulsiveGains, number: Callable[[Array], Array]) -> Core:
        """The core of a design's gains; number: np.asarray, or what makes exact matrices of floats.

        full: the plant. compressed: its window starts in the image of G. subspace: the core in the
        middle block of the basis, its window compressed where it has an image.
        """
        if gains.core_A is None or gains.core_G is None or gains.core_C is None:
            A, G = number(gains.A), number(gains.jump_matrix)
            C, lift = seen_before_jump(G, number(gains.C), gains.jump_measurement), None
        else:
            A, G, C = (number(X) for X in (gains.core_A, gains.core_G, gains.core_C))
            assert gains.basis is not None
            lift = number(gains.basis[:, gains.core_columns])
        if gains.image is None or gains.coimage is None:
            return cls(A, C, G, lift=lift)
        U, S = number(gains.image), number(gains.coimage)
        return cls(A, C, U @ S, U, S, lift)

    @property
    def size(self) -> int:
        """Columns of the window matrix."""
        return len(self.A) if self.U is None else int(self.U.shape[1])

    def spacings(self, window: int) -> int:
        """Number of spacings that the gain of a window depends on."""
        return window - 1 if self.U is None else window

    def stack(self, window: int) -> tuple[Array, Array, Array, Array, int, bool]:
        """The window matrix for `lmi.rank.stack.Stack`: F, H, C, right, blocks, flows first."""
        start = 0 * self.A + np.eye(len(self.A), dtype=np.int64) if self.U is None else self.U
        return self.A, self.J, self.C, start, window, self.U is not None


def uncorrected_factor(decay_rate: float, longest: float) -> float:
    """The factor per impulse that uncorrected blocks must reach.

    QUOTIENT_RATE, or less where the problem states a decay rate per unit of time.
    """
    return min(QUOTIENT_RATE, float(np.exp(-CASCADE_MARGIN * decay_rate * longest)))


def most_blocks(core: Core, p: int) -> int:
    """Impulses that a proof of full rank may use, whatever the window: p outputs at each.

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
