"""Witnesses that a stack of products loses rank, checked in balls.

Thetas and a vector x with |O x| < MARGIN |R x|, the block rows of O R^-1 scaled to norm 1, or, for
a square stack, two places where its determinant has opposite signs: between them it is zero.

A block row that passes through zero next to these thetas counts as zero: where its norm is below
MARGIN times that of its derivative, as the thetas change in proportion, it is scaled by the latter.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lmi.arithmetic.arrays import Entries, Matrix, NewEntries
from lmi.arithmetic.balls import (
    Ball,
    Balls,
    ball,
    exact,
    exp_times,
    fixed_vector,
    precision,
    rational,
    scalar,
)
from lmi.rank.stack import Stack, coordinates, unit_blocks
from lmi.verdict import Verdict, refuted, undecided

MARGIN = 1e-10
_BITS = 256


@np.errstate(all="ignore")
def check_deficient(stack: Stack, low: float, high: float, witness: Entries) -> Verdict:
    """Check a witness against full rank.

    witness: {"thetas": (m,)} or, for a square stack, {"between": two of them}. Refuted with thetas,
    null vector and ratio; otherwise undecided. Thetas outside [low, high] are no witness.
    """
    if (plain := outright(stack)) is not None:
        return refuted(plain)
    R, _ = coordinates(stack, low, high)
    pair = [_point(stack, values, low, high) for values in witness.get("between", ())]
    square = stack.shape[0] == stack.shape[1]
    if square and len(pair) == 2 and pair[0] is not None and pair[1] is not None:
        return _check_signs(stack, pair[0], pair[1], R)
    thetas = _point(stack, witness.get("thetas", ()), low, high)
    if thetas is None:
        return undecided("no thetas inside the box were given")
    return _check_vector(stack, thetas, R)


def _point(stack: Stack, values: object, low: float, high: float) -> Matrix | None:
    try:
        point = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        return None
    inside = point.shape == (stack.thetas,) and bool(np.all((low <= point) & (point <= high)))
    return point if inside else None


def outright(stack: Stack) -> NewEntries | None:
    """Witness against full rank for all thetas alike; None if there is none."""
    if stack.shape[0] < stack.shape[1]:
        return too_few(stack)
    if stack.flows_first or stack.blocks == 1:
        return None
    vector = fixed_vector([stack.H @ stack.right, stack.C @ stack.right])
    if vector is None:
        return None
    shown = ", ".join(f"{x:.6g}" for x in vector)
    reason = f"the state ({shown}) is not seen and the next jump destroys it"
    return {"null_vector": vector, "ratio": 0.0, "method": "exact", "reason": reason}


def too_few(stack: Stack) -> NewEntries:
    """The witness that there are fewer rows than columns."""
    rows, columns = stack.shape
    reason = f"{rows} measured numbers cannot tell {columns} states apart"
    return {"rows": rows, "columns": columns, "reason": reason}


def _stacked(stack: Stack, thetas: Sequence[float]) -> tuple[list[Balls], list[Balls]]:
    """Ball matrix O at exact thetas as a list of block rows, and how it changes in proportion."""
    F, H, C, X = ball(stack.F), ball(stack.H), ball(stack.C), ball(stack.right)
    change = X * scalar(0)
    steps = list(thetas)
    if stack.flows_first:
        theta = steps.pop(0)
        X = exp_times(stack.F, theta) * X
        change = F * X * scalar(rational(theta))
    rows, changes = [C * X], [C * change]
    for theta in steps:
        flow = exp_times(stack.F, theta)
        X = flow * (H * X)
        change = flow * (H * change) + F * X * scalar(rational(theta))
        rows.append(C * X)
        changes.append(C * change)
    return rows, changes


def _check_vector(stack: Stack, thetas: Matrix, R: Matrix) -> Verdict:
    """The last right singular vector at these thetas, checked: |O x| < MARGIN |R x|."""
    approx = stack.approx(thetas[None], stack.growth)[0]
    if not np.isfinite(approx).all():
        return undecided("the window overflows")
    change = stack.approx_change(thetas[None], stack.growth)[0]
    try:
        rows, changing = (np.linalg.solve(R.T, X.T).T for X in (approx, change))
        scaled = _in_units(rows, changing, stack.blocks)
        x = np.linalg.solve(R, np.linalg.svd(scaled)[2][-1])
    except np.linalg.LinAlgError:
        return undecided("no null vector can be computed")
    if not np.isfinite(x).all():
        return undecided("no null vector can be computed")
    x = x / np.abs(x).max()
    with precision(_BITS):
        vector = ball(exact(x[:, None]))
        columns = ball(exact(R))
        output_square = _output_square(*_stacked(stack, thetas.tolist()), columns, vector)
        size = _square((columns * vector).tolist())
        small = bool(output_square < scalar(rational(MARGIN)) ** 2 * size)
        ratio = float((output_square / size).abs_upper()) ** 0.5
    at = ", ".join(f"{theta:.9g}" for theta in thetas)
    shown = ", ".join(f"{v:.6g}" for v in x)
    if not small:
        return undecided(f"the least relative singular value seen is {ratio:.3g} at ({at})",
                         thetas=thetas.tolist(), ratio=ratio)  # fmt: skip
    where = f"at the spacings ({at}) " if len(thetas) else ""
    reason = f"{where}the state ({shown}) is not seen: its outputs are {ratio:.3g} of usual ones"
    witness = {"thetas": thetas.tolist(), "null_vector": x.tolist(), "ratio": ratio,
               "method": "outputs of a state, in balls", "reason": reason}  # fmt: skip
    return refuted(witness)


def _output_square(rows: list[Balls], changes: list[Balls], R: Balls, vector: Balls) -> Ball:
    """Square of |O x| with the block rows of O R^-1 in their units, where they are not zero."""
    back, total = R.inv(), scalar(0)
    for row, change in zip(rows, changes, strict=True):
        size, changing = _whole_square(row * back), _whole_square(change * back)
        if size < scalar(rational(MARGIN)) ** 2 * changing:
            size = changing
        outputs = _square((row * vector).tolist())
        total = total + (outputs if size == 0 else outputs / size)
    return total


def _in_units(rows: Matrix, changes: Matrix, blocks: int) -> Matrix:
    """`unit_blocks` of rows (k p, r), those that pass through zero in units of their change."""
    split, other = (X.reshape(blocks, -1, X.shape[-1]) for X in (rows, changes))
    sizes, changing = (np.linalg.norm(X, axis=(1, 2), keepdims=True) for X in (split, other))
    sizes = np.where(sizes < MARGIN * changing, changing, sizes)
    scaled: Matrix = (split / np.where(sizes > 0, sizes, 1.0)).reshape(rows.shape)
    return scaled


def _whole_square(X: Balls) -> Ball:
    return _square([[x] for line in X.tolist() for x in line])


def _square(rows: list[list[Ball]]) -> Ball:
    total = scalar(0)
    for (value,) in rows:
        total = total + value * value
    return total


def _check_signs(stack: Stack, a: Matrix, b: Matrix, R: Matrix) -> Verdict:
    """Certified opposite signs of det O at two places; the zero between them is approached."""
    with precision(_BITS):
        first, second = (_determinant(stack, point) for point in (a, b))
        opposite = bool(first < 0 and second > 0) or bool(first > 0 and second < 0)
    if not opposite:
        return undecided("the determinant has no certified change of sign")
    sign = np.linalg.slogdet(stack.approx(a[None], stack.growth))[0][0]
    left, right = a, b
    for _ in range(60):
        middle = (left + right) / 2
        same = np.linalg.slogdet(stack.approx(middle[None], stack.growth))[0][0] == sign
        left, right = (middle, right) if same else (left, middle)
    scaled = np.linalg.solve(R.T, stack.approx(left[None], stack.growth)[0].T).T
    values = np.linalg.svd(unit_blocks(scaled, stack.blocks))
    x = np.linalg.solve(R, values[2][-1])
    x = x / np.abs(x).max()
    at = ", ".join(f"{theta:.9g}" for theta in left)
    shown = ", ".join(f"{v:.6g}" for v in x)
    reason = (
        f"near the spacings ({at}) the state ({shown}) is not seen: the determinant of the window "
        "changes its sign"
    )
    witness = {"between": [a.tolist(), b.tolist()], "thetas": left.tolist(),
               "null_vector": x.tolist(), "ratio": float(values[1][-1]),
               "method": "sign change of the determinant, in balls", "reason": reason}  # fmt: skip
    return refuted(witness)


def _determinant(stack: Stack, thetas: Matrix) -> Ball:
    rows = np.concatenate([row.tolist() for row in _stacked(stack, thetas.tolist())[0]])
    size = len(rows)
    matrix = type(ball(exact(np.eye(size))))(size, size, list(rows.reshape(-1)))
    return matrix.det()
