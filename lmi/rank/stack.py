"""Stacks of products of flows and jumps, over a box of thetas: floats to steer by.

    O(theta_1, ..., theta_m) = rows C X_0, C X_1, ..., C X_(k-1),
    X_i = e^{F theta} H X_(i-1),   X_0 = right, or e^{F theta_1} right if the stack flows first.

`lmi.rank.full_rank` proves that O has full column rank for all thetas of a box. What outputs grow
by with theta scales the block rows and does not matter to that: wherever ranks are decided relative
to size, a block row is measured in units of its own size at the same thetas.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import Exact, to_float
from lmi.arithmetic.exponential import expm
from lmi.arithmetic.spectrum import spectral_radii
from lmi.memory import require_memory

# columns of a stack at the centre that are this close to dependent give no coordinates
DEPENDENT = 1e-10
# where else in the range to look for independent columns
_OTHERS = (0.381966, 0.618034, 0.236068, 0.0, 1.0)
# a spectral radius below is that of a step that destroys everything, but for rounding
_NO_STEP = 1e-12
# a basis with a larger condition number is not worth its obliqueness
_OBLIQUE = 1e4


@dataclass(frozen=True)
class Stack:
    """F, H exact (n, n); C exact (p, n); right exact (n, r); blocks: number k of block rows."""

    F: Exact
    H: Exact
    C: Exact
    right: Exact
    blocks: int
    flows_first: bool = False

    @property
    def thetas(self) -> int:
        """Number m of thetas that O depends on."""
        return self.blocks - 1 + self.flows_first

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of O."""
        return self.blocks * len(self.C), self.right.shape[1]

    @property
    def growth(self) -> float:
        """The mean real part of the modes of F."""
        modes = np.diag(to_float(self.F))
        return float(modes.sum()) / len(modes)

    def approx(self, thetas: Matrix, growth: float = 0.0) -> Matrix:
        """O in floats at points (N, m): (N, rows, r); block rows at time t times e^{-growth t}."""
        F, H, C = to_float(self.F), to_float(self.H), to_float(self.C)
        points = np.asarray(thetas, dtype=np.float64)
        # flows, with eight temporaries of their exponentials, and states with outputs
        require_memory(
            f"a window of {self.blocks} impulses and {len(F)} states, at {len(points)} places,",
            points.size * 10 * len(F) ** 2,
            "a shorter window or fewer states are required",
        )
        flows = expm((F - growth * np.eye(len(F))) * points[..., None, None])
        return np.concatenate([C @ X for X in self._states(flows, H)], axis=-2)

    def approx_change(self, thetas: Matrix, growth: float = 0.0) -> Matrix:
        """Derivative of `approx` at points (N, m) as all thetas change in proportion, in floats."""
        F, C, H = (
            to_float(self.F) - growth * np.eye(len(self.F)),
            to_float(self.C),
            to_float(self.H),
        )
        points = np.asarray(thetas, dtype=np.float64)
        flows = expm(F * points[..., None, None])
        states = self._states(flows, H)
        change = np.zeros_like(states[0])
        rows = [C @ change]
        first = 0
        if self.flows_first:
            change = (F * points[:, 0, None, None]) @ states[0]
            rows, first = [C @ change], 1
        for i in range(first, points.shape[1]):
            X = states[i - first + 1]
            change = flows[:, i] @ (H @ change) + (F * points[:, i, None, None]) @ X
            rows.append(C @ change)
        return np.concatenate(rows, axis=-2)

    def _states(self, flows: Matrix, H: Matrix) -> list[Matrix]:
        right = to_float(self.right)
        X = np.broadcast_to(right, (len(flows), *right.shape))
        steps = [flows[:, i] for i in range(flows.shape[1])]
        if self.flows_first:
            X, steps = steps[0] @ X, steps[1:]
        states = [X]
        for E in steps:
            X = E @ (H @ X)
            states.append(X)
        return states


def coordinates(stack: Stack, low: float, high: float) -> tuple[Matrix, bool]:
    """(R, full): z = R x makes the columns of O at a typical constant theta orthonormal.

    Its block rows are first divided by what one step of that theta makes of them in the long run,
    a power of two for each: a factor e^{mu theta} of all modes leaves R alone. The typical theta is
    the middle of [low, high], or another one where the columns of O are dependent there, closer
    than DEPENDENT. full is False when they are so everywhere: then R is a diagonal matrix of their
    sizes. R is a float (r, r) that is used as it is.
    """
    places = low + (high - low) * np.array([0.5, *_OTHERS])
    stacks = stack.approx(np.repeat(places[:, None], stack.thetas, axis=1), stack.growth)
    stacks = stacks / _long_run(stack, places)
    sizes = np.nan_to_num(np.abs(stacks).max(axis=1), nan=0.0, posinf=0.0).max(axis=0)
    # a column that no output shows is as large as the largest; where none is shown, of size 1
    sizes = np.where(sizes > 0, sizes, float(sizes.max(initial=0.0)) or 1.0)
    units = np.exp2(np.round(np.log2(sizes)))  # powers of two: no rounding
    for rows in stacks[np.isfinite(stacks).all(axis=(1, 2))] / units:
        values = np.linalg.svd(rows, compute_uv=False)
        if len(values) < len(units) or not values[-1] > DEPENDENT * values[0]:
            continue
        Q, upper = np.linalg.qr(rows)
        # of all orthonormal bases of the outputs the one nearest to a fixed set of vectors:
        # whatever basis the state had, z is the same, and so is the work of a proof
        left, _, right = np.linalg.svd(Q.T @ _polynomials(stack))
        return (left @ right).T @ upper * units, True
    return np.diag(units), False


def _long_run(stack: Stack, places: Matrix) -> Matrix:
    """Powers of two like rho^j for the rows of block j, rho the spectral radius of one step."""
    F = to_float(stack.F) - stack.growth * np.eye(len(stack.F))
    steps = expm(F * places[:, None, None]) @ to_float(stack.H)
    radii = spectral_radii(steps)
    exponents = np.round(np.log2(np.where(radii > _NO_STEP, radii, 1.0)))
    blocks = np.repeat(np.arange(stack.blocks), len(stack.C))
    sizes: Matrix = np.exp2(exponents[:, None, None] * blocks[:, None])
    return sizes


def _polynomials(stack: Stack) -> Matrix:
    """Orthonormal polynomials of rising degree along the blocks, one set for each row of C."""
    p, columns = len(stack.C), stack.shape[1]
    powers = np.linspace(-1.0, 1.0, stack.blocks)[:, None] ** np.arange(-(-columns // p))
    Q, upper = np.linalg.qr(powers)
    fixed: Matrix = np.kron(Q * np.sign(np.diag(upper)), np.eye(p))[:, :columns]
    return fixed


def state_basis(stack: Stack, R: Matrix) -> Matrix:
    """Columns of right R^-1, completed by what the jump destroys: coordinates of the states X_i.

    Floats (n, n), used as they are; orthogonal columns complete them where the jump destroys too
    little, or some of them. LinAlgError if R is singular, or nearly so that floats overflow.
    """
    columns: Matrix = np.asarray(np.linalg.solve(R.T, to_float(stack.right).T).T, dtype=np.float64)
    if not np.isfinite(columns).all():
        raise np.linalg.LinAlgError("coordinates beyond floats")
    n, r = columns.shape
    if n == r:
        return columns
    H, F = to_float(stack.H), to_float(stack.F)
    destroyed = np.linalg.svd(H)[2][r:].T
    scaled = columns / np.abs(columns).max(axis=0)
    whole = np.hstack([scaled / np.linalg.norm(scaled, axis=0), destroyed])
    if not np.isfinite(whole).all() or np.linalg.cond(whole) > _OBLIQUE:
        destroyed = np.linalg.qr(columns, mode="complete")[0][:, r:]
    # as large as what they drive the other coordinates by in a unit of time
    driven = np.linalg.lstsq(np.hstack([columns, destroyed]), F @ destroyed, rcond=None)[0][:r]
    size = float(np.linalg.norm(driven, 2))
    return np.hstack([columns, destroyed / size if size > 0 else destroyed])


def approx_margin(stack: Stack, thetas: Matrix, R: Matrix) -> Matrix:
    """Smallest singular value of O R^-1 at points (N, m), its block rows scaled to norm 1.

    Floats; NaN where it overflows.
    """
    rows = _solved(stack.approx(thetas, stack.growth), R)
    return _least_value(stack, rows, unit_blocks(np.nan_to_num(rows), stack.blocks))


def approx_vanishing(stack: Stack, thetas: Matrix, R: Matrix) -> Matrix:
    """Return `approx_margin` with each block row in units that include its change.

    The unit is the row's size, together with its change in proportion to theta. Continuous also
    where a block row passes through zero, and zero only where rank is lost.
    """
    rows = _solved(stack.approx(thetas, stack.growth), R)
    changes = _solved(stack.approx_change(thetas, stack.growth), R)
    both = np.nan_to_num(np.concatenate([rows, changes], axis=-1))
    return _least_value(stack, rows, unit_blocks(both, stack.blocks)[..., : rows.shape[-1]])


def _solved(rows: Matrix, R: Matrix) -> Matrix:
    return np.swapaxes(np.linalg.solve(R.T, np.swapaxes(rows, -1, -2)), -1, -2)


def _least_value(stack: Stack, rows: Matrix, scaled: Matrix) -> Matrix:
    finite = np.asarray(np.isfinite(rows).all(axis=(-2, -1)))
    if stack.shape[0] < stack.shape[1]:
        return np.where(finite, 0.0, np.nan)
    values: Matrix = np.asarray(np.linalg.svd(scaled, compute_uv=False)[:, -1])
    return np.where(finite, values, np.nan)


def unit_blocks(rows: Matrix, blocks: int) -> Matrix:
    """(..., rows, r) with each block of rows divided by its Frobenius norm, where not zero."""
    split = rows.reshape(*rows.shape[:-2], blocks, -1, rows.shape[-1])
    sizes = np.linalg.norm(split, axis=(-2, -1), keepdims=True)
    scaled: Matrix = (split / np.where(sizes > 0, sizes, 1.0)).reshape(rows.shape)
    return scaled
