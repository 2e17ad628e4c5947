"""One box of thetas: lower bounds of the singular values of a stack of products, in balls.

On a box with centre c, with Y O(c) Z close to 1 (Y, Z floats from a QR of O(c) with rows and
columns of like size), and E the bounds of |1 - Y O(theta) Z| of `lmi.rank.window_box`: if 1 - E has
a nonnegative inverse N, O has full column rank on the box, and with e the error at one theta

    x = Z (1 - e)^-1 Y O x,     |(1 - e)^-1| <= N, entry by entry.

Whether N exists does not depend on the size of rows and columns, so that the growth of outputs
with theta, which scales the rows, costs no boxes.

Floats choose Y and Z; everything that decides is ball arithmetic, and sums and products of small
nonnegative float matrices, raised by far more than their rounding.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import Balls, ball, exact, middle
from lmi.rank.normalised_stack import RAISED, NormalisedStack, magnitudes, norm_above
from lmi.rank.stack import Stack
from lmi.rank.window_box import WindowBox, window_box

# sums of a few floats of either sign are off by less, relative to the sum of their sizes
_ROUNDING = 1e-13
# bounds of exponentials are no smaller: an upper bound must not underflow
_TINY = 1e-300


@dataclass(frozen=True)
class Box:
    """Sides as (level, index): the index-th of the 2^level equal parts of [low, high]."""

    sides: tuple[tuple[int, int], ...]

    def halves(self, i: int) -> tuple[Box, Box]:
        """The box cut in two across its side i."""
        level, index = self.sides[i]
        parts = ((level + 1, 2 * index), (level + 1, 2 * index + 1))
        first, second = ((*self.sides[:i], part, *self.sides[i + 1 :]) for part in parts)
        return Box(first), Box(second)


@dataclass(frozen=True)
class BoxBounds:
    """Bounds on a box.

    Where `proved`, those of `prove_full_rank`. Always: the side to halve (None: no side is left)
    and `centre`, the margin at the centre in floats (0 where unknown).
    """

    proved: bool
    widest: int | None
    centre: float
    size: float = 0.0
    relative: float = 0.0
    spread: tuple[float, ...] = ()
    largest: float = math.inf
    recalled: float = math.inf


def bounds(stack: Stack, family: NormalisedStack, box: Box, margin: float) -> BoxBounds:
    """Bounds on a box; proved only if the margin of O there is above `margin`."""
    flows = [family.flow(side) for side in box.sides]
    states = [flows[0] * family.right if stack.flows_first else family.right]
    steps = [flow * family.H for flow in flows[stack.flows_first :]]
    for P in steps:
        states.append(P * states[-1])
    rows = [family.C * X for X in states]
    halves = [family.half(side) for side in box.sides]
    pair = _pair(rows, _variations(family, states, steps, halves))
    if pair is None:
        return BoxBounds(False, _longest(box), 0.0)
    p = len(stack.C)
    Y, Z = ball(exact(pair[0])), ball(exact(pair[1]))
    blocks = [ball(exact(pair[0][:, j * p : (j + 1) * p])) for j in range(len(rows))]
    window = window_box(family, states, steps, halves, Y=blocks, Z=Z, flows_first=stack.flows_first)
    norms = _block_sizes([middle(row) for row in rows])
    centre = 1.0 / float(np.linalg.norm(middle(Z * Y) * np.repeat(norms, p), 2))
    N = nonnegative_inverse_above(window.error)
    widest = _widest(box, window, N)
    if N is None:
        return BoxBounds(False, widest, centre)
    return _proved(family, box, window, rows, inverse=(Y, Z, N), steer=(margin, centre, widest))


def _proved(
    family: NormalisedStack,
    box: Box,
    window: WindowBox,
    rows: list[Balls],
    *,
    inverse: tuple[Balls, Balls, Matrix],
    steer: tuple[float, float, int | None],
) -> BoxBounds:
    """The bounds that follow from Y, Z and N; not proved where the margin is too small."""
    (Y, Z, N), (margin, centre, widest) = inverse, steer
    p, count, size = rows[0].nrows(), len(rows), len(N)
    outputs = _outputs(family, window, rows, Z)
    normal = np.repeat(_block_sizes(outputs), p) * RAISED
    unit: Matrix = np.eye(size)
    off, Y_size, Z_size = N - unit, magnitudes(Y), magnitudes(Z)
    undo = (unit + window.undone) @ N - unit
    relative = 1 / norm_above((magnitudes(Z * Y) + Z_size @ undo @ Y_size) * normal) / RAISED
    if not relative > margin:
        return BoxBounds(False, widest, centre)
    start = family.back * Z
    growth = _growths(family, box, count)
    since = {i: np.repeat([growth(i, j) for j in range(count)], p) for i in (None, *range(count))}
    plain = magnitudes(start * Y) + magnitudes(start) @ undo @ Y_size
    smallest = 1 / norm_above(plain * since[None]) / RAISED
    spread = []
    for i, (W, D) in enumerate(zip(window.states, window.varied, strict=True)):
        recovered = magnitudes(W * Y) + (magnitudes(W) @ off + D @ N) @ Y_size
        spread.append(norm_above(recovered * since[i]))
    largest = norm_above(np.vstack([row * growth(j, None) for j, row in enumerate(outputs)]))
    until = [growth(j, count - 1) for j in range(count)]
    recalled = _recalled(family, window, rows, Z, until)
    return BoxBounds(True, widest, centre, smallest, relative, tuple(spread), largest, recalled)


def nonnegative_inverse_above(E: Matrix) -> Matrix | None:
    """N above (1 - E)^-1 entry by entry, for a nonnegative E with spectral radius below 1.

    None unless that is certain: some v > 0 has (1 - E) v > 0. Floats; rounding is accounted for.
    """
    if not np.isfinite(E).all():
        return None
    unit: Matrix = np.eye(len(E))
    try:
        N = np.linalg.inv(unit - E)
    except np.linalg.LinAlgError:
        return None
    v = N.sum(axis=1)
    clear = v - E @ v - _ROUNDING * (v + E @ v)
    if not ((v > 0).all() and (clear > 0).all()):
        return None
    N = np.maximum(N, 0.0)
    missing = np.abs(unit - (N - E @ N)) + _ROUNDING * (unit + N + E @ N)
    above: Matrix = (N + np.outer(v, (missing / clear[:, None]).max(axis=0))) * RAISED
    return above if np.isfinite(above).all() else None


def _variations(
    family: NormalisedStack, states: list[Balls], steps: list[Balls], halves: list[float]
) -> Matrix:
    """About how much each row of O varies over the box, as all thetas rise together; floats."""
    F, C = middle(family.F), middle(family.C)
    first = len(halves) - len(steps)
    change = F @ middle(states[0]) * (halves[0] if first else 0.0)
    variations = [C @ change]
    for P, X, h in zip(steps, states[1:], halves[first:], strict=True):
        change = middle(P) @ change + F @ middle(X) * h
        variations.append(C @ change)
    return np.asarray(np.linalg.norm(np.vstack(variations), axis=1))


def _pair(rows: list[Balls], variations: Matrix) -> tuple[Matrix, Matrix] | None:
    """Floats Y, Z with Y O(c) Z close to 1, rows and columns of like size over the box.

    A row that passes through zero counts by its variation over the box.
    """
    approx = np.vstack([middle(block) for block in rows])
    heights = np.maximum(np.linalg.norm(approx, axis=1), variations)
    heights[heights == 0] = 1.0
    scaled = approx / heights[:, None]
    widths = np.linalg.norm(scaled, axis=0)
    if not np.isfinite(scaled).all() or not (widths > 0).all():
        return None
    Q, upper = np.linalg.qr(scaled / widths)
    try:
        Z = np.linalg.inv(upper) / widths[:, None]
    except np.linalg.LinAlgError:
        return None
    Y = Q.T / heights
    return (Y, Z) if np.isfinite(Z).all() and np.isfinite(Y).all() else None


def _outputs(
    family: NormalisedStack, window: WindowBox, rows: list[Balls], Z: Balls
) -> list[Matrix]:
    """Above the entries of the block rows of O R^-1 over the box."""
    C = magnitudes(family.C)
    try:
        back = magnitudes(Z.inv())
    except ZeroDivisionError:
        return [np.full((row.nrows(), row.ncols()), np.inf) for row in rows]
    unit: Matrix = np.eye(len(back))
    result = []
    for row, D in zip(rows, window.varied, strict=True):
        varied = magnitudes(row * Z) @ window.undone + C @ D @ (unit + window.undone)
        result.append((magnitudes(row) + varied @ back) * RAISED)
    return result


def _block_sizes(rows: list[Matrix]) -> Matrix:
    """Frobenius norms of block rows; 1 for those that are zero, which say nothing."""
    sizes = np.array([float(np.linalg.norm(row)) for row in rows])
    return np.where(sizes > 0, sizes, 1.0)


def _growths(
    family: NormalisedStack, box: Box, count: int
) -> Callable[[int | None, int | None], float]:
    """(i, j) -> bound over the box of e^{growth (t_i - t_j)}, t_j the time of block j.

    None stands for the time 0 that the thetas start from.
    """
    first = len(box.sides) - (count - 1)  # 1 where the stack flows first
    centres = [family.centre(side) for side in box.sides]
    halves = [family.half(side) for side in box.sides]
    rounding = _ROUNDING * sum(centres)

    def between(later: int | None, earlier: int | None) -> float:
        end, start = (0 if block is None else block + first for block in (later, earlier))
        low, high = min(start, end), max(start, end)
        time = sum(centres[low:high]) * (1 if end > start else -1)
        varied = abs(family.growth) * (sum(halves[low:high]) + rounding)
        return max(float(np.exp(family.growth * time + varied)) * RAISED, _TINY)

    return between


def _recalled(
    family: NormalisedStack, window: WindowBox, rows: list[Balls], Z: Balls, growths: list[float]
) -> float:
    """Above the norm of the output rows times the inverse of the first part of the last."""
    size = Z.ncols()
    try:
        back = _first_rows(window.states[-1], size).inv()
    except ZeroDivisionError:
        return math.inf
    N = nonnegative_inverse_above(magnitudes(back) @ window.varied[-1][:size] * RAISED)
    if N is None:
        return math.inf
    C, off, back_size = magnitudes(family.C), N - np.eye(size), magnitudes(back)
    blocks = []
    for row, D, growth in zip(rows, window.varied, growths, strict=True):
        varied = (magnitudes(row * Z) @ off + C @ D @ N) @ back_size
        blocks.append((magnitudes(row * Z * back) + varied) * growth)
    bound = norm_above(np.vstack(blocks))
    return bound if math.isfinite(bound) else math.inf


def _first_rows(X: Balls, count: int) -> Balls:
    if X.nrows() == count:
        return X
    return type(X)(count, X.ncols(), [x for row in X.tolist()[:count] for x in row])


def _widest(box: Box, window: WindowBox, N: Matrix | None) -> int | None:
    """The side with the largest part in the error, weighted by N, or by the error's own vectors."""
    if not window.shares:
        return None
    if not all(np.isfinite(share).all() for share in window.shares):
        return _longest(box)
    if N is None:
        weights = _largest_vector(window.error.T), _largest_vector(window.error)
    else:
        weights = N.sum(axis=0), N.sum(axis=1)
    return int(np.argmax([weights[0] @ share @ weights[1] for share in window.shares]))


def _largest_vector(E: Matrix) -> Matrix:
    """Sizes of the entries of the eigenvector of a nonnegative matrix's largest eigenvalue."""
    values, vectors = np.linalg.eig(E)
    largest: Matrix = np.abs(vectors[:, int(np.argmax(np.abs(values)))])
    return largest


def _longest(box: Box) -> int | None:
    levels = [level for level, _ in box.sides]
    return int(np.argmin(levels)) if levels else None
