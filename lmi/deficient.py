"""Does a stack of products lose rank somewhere in a box of thetas? Looked for in floats, decided.

Rank is decided relative to size: in coordinates that make the stack at the centre of the box
orthonormal (`lmi.stack`), its smallest singular value must stay above MARGIN. Refuted by thetas
and a vector x with |O x| < MARGIN |R x|, checked in balls, or, for a square stack, by two places
where its determinant has opposite signs: between them it is zero.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from lmi.balls import ball, exact, exp_times, fixed_vector, precision, rational, scalar
from lmi.full_rank import BOX_LIMIT, prove_full_rank
from lmi.stack import Matrix, Stack, approx_margin, coordinates
from lmi.verdict import Verdict, proved, refuted, undecided

MARGIN = 1e-10

_GRID, _RANDOM = 201, 300
_SEED = 20091  # the search repeats itself exactly
_POLISHED, _STEPS, _SHRINK = 3, 120, 0.5
_BITS = 256
# the margin that is proved should reach this part of the least one seen; less where the first
# theta alone moves it
_SHARE, _SHARE_FIRST = 0.5, 0.1


def decide_full_rank(stack: Stack, low: float, high: float, limit: int = BOX_LIMIT) -> Verdict:
    """Full column rank with MARGIN for all thetas in [low, high]^m: search, refute or prove.

    0 <= low <= high, both finite. Proved evidence as `prove_full_rank`, with "approx_sigma_min"
    and "approx_worst", the least value seen and where, and "asked", the margin to be proved;
    refuted evidence holds the witness.
    """
    if (witness := _outright(stack)) is not None:
        return refuted(witness)
    R, full = coordinates(stack, low, high)
    points = _candidates(stack, low, high)
    margins = approx_margin(stack, points, R)
    if len(points) > 1 and (pair := _sign_change(stack, points, R)) is not None:
        return check_deficient(stack, low, high, {"between": pair})
    worst, margin = _polished(stack, points, margins, R, low, high)
    if not full or not margin >= MARGIN:
        place = points[0] * 0 + (low + high) / 2 if not full else worst
        verdict = check_deficient(stack, low, high, {"thetas": place.tolist()})
        if verdict.outcome == "refuted" or not full:
            return verdict
    verdict = undecided("no attempt was made")
    wanted = (_SHARE_FIRST if stack.flows_first else _SHARE) * margin
    for asked, share in ((wanted, limit // 10), (MARGIN, limit)):
        asked = max(asked, MARGIN)
        verdict = prove_full_rank(stack, low, high, R, margin=asked, limit=share)
        if verdict.outcome == "proved":
            break
    if "thetas" in verdict.evidence:  # the proof may have been led to a place the search missed
        place = np.array([verdict.evidence["thetas"]])
        worst, margin = _polished(stack, place, approx_margin(stack, place, R), R, low, high)
        if margin < MARGIN:
            counter = check_deficient(stack, low, high, {"thetas": worst.tolist()})
            verdict = counter if counter.outcome == "refuted" else verdict
    plain = np.eye(stack.shape[1])
    everywhere = np.vstack([points, worst[None]])
    told = {"approx_sigma_min": float(approx_margin(stack, everywhere, plain).min()),
            "approx_worst": worst.tolist(), "asked": asked}  # fmt: skip
    return Verdict(verdict.outcome, {**verdict.evidence, **told})


def prove_again(stack: Stack, low: float, high: float, asked: float) -> Verdict:
    """The proof of `decide_full_rank` without its search: asked is the evidence's."""
    if stack.shape[0] < stack.shape[1]:
        return refuted(_too_few(stack))
    R, full = coordinates(stack, low, high)
    if not full:
        return undecided("the stack has no full rank anywhere in the box")
    return prove_full_rank(stack, low, high, R, margin=max(asked, MARGIN))


def check_deficient(stack: Stack, low: float, high: float, witness: Mapping[str, Any]) -> Verdict:
    """Is this a witness? {"thetas": (m,)} or, for a square stack, {"between": two of them}.

    Refuted with thetas, null vector and ratio; otherwise undecided. Thetas outside [low, high]
    are no witness.
    """
    if (outright := _outright(stack)) is not None:
        return refuted(outright)
    R, _ = coordinates(stack, low, high)
    pair = [_point(stack, values, low, high) for values in witness.get("between", ())]
    if len(pair) == 2 and pair[0] is not None and pair[1] is not None:
        return _check_signs(stack, pair[0], pair[1], R)
    thetas = _point(stack, witness.get("thetas", ()), low, high)
    if thetas is None:
        return undecided("no thetas inside the box were given")
    return _check_vector(stack, thetas, R)


def _point(stack: Stack, values: Any, low: float, high: float) -> Matrix | None:
    try:
        point = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        return None
    inside = point.shape == (stack.thetas,) and bool(np.all((low <= point) & (point <= high)))
    return point if inside else None


def _outright(stack: Stack) -> dict[str, Any] | None:
    """What forbids full rank whatever the thetas are."""
    if stack.shape[0] < stack.shape[1]:
        return _too_few(stack)
    if stack.flows_first or stack.blocks == 1:
        return None
    vector = fixed_vector([stack.H @ stack.right, stack.C @ stack.right])
    if vector is None:
        return None
    shown = ", ".join(f"{x:.6g}" for x in vector)
    reason = f"the state ({shown}) is not seen and the next jump destroys it"
    return {"null_vector": vector, "ratio": 0.0, "method": "exact", "reason": reason}


def _too_few(stack: Stack) -> dict[str, Any]:
    rows, columns = stack.shape
    reason = f"{rows} measured numbers cannot tell {columns} states apart"
    return {"rows": rows, "columns": columns, "reason": reason}


def _candidates(stack: Stack, low: float, high: float) -> Matrix:
    """Constant thetas on a grid, and random ones; corners are where they often are worst."""
    m = stack.thetas
    if m == 0 or low == high:
        return np.full((1, m), low)
    rng = np.random.default_rng(_SEED)
    constant = np.repeat(np.linspace(low, high, _GRID)[:, None], m, axis=1)
    free = low + (high - low) * rng.random((_RANDOM, m))
    corners = np.where(rng.random((_RANDOM // 3, m)) < 0.5, low, high)
    return np.vstack([constant, free, corners])


def _sign_change(stack: Stack, points: Matrix, R: Matrix) -> list[list[float]] | None:
    """Two neighbours on the constant grid, else any two points, with determinants of other sign."""
    if stack.shape[0] != stack.shape[1]:
        return None
    signs, logs = np.linalg.slogdet(stack.approx(points))
    relative = logs - np.linalg.slogdet(R)[1]
    usable = np.isfinite(relative) & (relative > np.log(MARGIN))
    places = np.flatnonzero(usable[:_GRID])
    for a, b in zip(places[:-1], places[1:], strict=True):
        if signs[a] * signs[b] < 0:
            return [points[a].tolist(), points[b].tolist()]
    plus, minus = (np.flatnonzero(usable & (signs == s)) for s in (1, -1))
    if len(plus) and len(minus):
        return [points[plus[0]].tolist(), points[minus[0]].tolist()]
    return None


def _polished(
    stack: Stack, points: Matrix, margins: Matrix, R: Matrix, low: float, high: float
) -> tuple[Matrix, float]:
    """The least margin after a compass search from the lowest points, and where."""
    order = np.argsort(np.nan_to_num(margins, nan=np.inf))[:_POLISHED]
    best, value = points[order[0]], float(margins[order[0]])
    m = stack.thetas
    if m == 0 or low == high:
        return best, value
    directions = np.vstack([np.eye(m), -np.eye(m), np.ones((1, m)), -np.ones((1, m))])
    for start in order:
        here, least, step = points[start], float(margins[start]), (high - low) / 20
        for _ in range(_STEPS):
            tried = np.clip(here + step * directions, low, high)
            found = np.nan_to_num(approx_margin(stack, tried, R), nan=np.inf)
            k = int(np.argmin(found))
            if found[k] < least:
                here, least = tried[k], float(found[k])
            else:
                step *= _SHRINK
            if least < 1e-3 * MARGIN or step < 1e-15 * high:
                break
        if least < value:
            best, value = here, least
    return best, value


def _stacked(stack: Stack, thetas: Sequence[float]) -> Any:
    """Ball matrix O at exact thetas, rows of all blocks, as a list of block rows."""
    H, C, X = ball(stack.H), ball(stack.C), ball(stack.right)
    steps = list(thetas)
    if stack.flows_first:
        X = exp_times(stack.F, steps.pop(0)) * X
    rows = [C * X]
    for theta in steps:
        X = exp_times(stack.F, theta) * (H * X)
        rows.append(C * X)
    return rows


def _check_vector(stack: Stack, thetas: Matrix, R: Matrix) -> Verdict:
    """The last right singular vector at these thetas, checked: |O x| < MARGIN |R x|."""
    approx = stack.approx(thetas[None])[0]
    try:
        scaled = np.linalg.solve(R.T, approx.T).T
        x = np.linalg.solve(R, np.linalg.svd(scaled)[2][-1])
    except np.linalg.LinAlgError:
        return undecided("no null vector can be computed")
    if not np.isfinite(x).all():
        return undecided("no null vector can be computed")
    x = x / np.abs(x).max()
    with precision(_BITS):
        vector = ball(exact(x[:, None]))
        seen = _square(np.concatenate([(row * vector).tolist() for row in _stacked(stack, thetas)]))
        size = _square((ball(exact(R)) * vector).tolist())
        small = bool(seen < scalar(rational(MARGIN)) ** 2 * size)
        ratio = float((seen / size).abs_upper()) ** 0.5
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


def _square(rows: Any) -> Any:
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
    sign = np.linalg.slogdet(stack.approx(a[None]))[0][0]
    left, right = a, b
    for _ in range(60):
        middle = (left + right) / 2
        same = np.linalg.slogdet(stack.approx(middle[None]))[0][0] == sign
        left, right = (middle, right) if same else (left, middle)
    scaled = np.linalg.solve(R.T, stack.approx(left[None])[0].T).T
    values = np.linalg.svd(scaled)
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
               "method": "change of sign of the determinant, in balls", "reason": reason}  # fmt: skip
    return refuted(witness)


def _determinant(stack: Stack, thetas: Matrix) -> Any:
    rows = np.concatenate([row.tolist() for row in _stacked(stack, thetas.tolist())])
    size = len(rows)
    matrix = type(ball(exact(np.eye(size))))(size, size, list(rows.reshape(-1)))
    return matrix.det()
