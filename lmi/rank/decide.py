"""Decide full column rank of a stack of products over a box of dwell times.

Rank is decided relative to size: in coordinates that make the stack at the centre of the box
orthonormal (`lmi.rank.stack`), and with block rows scaled to norm 1, its smallest singular value
must stay above MARGIN. Refuted by a witness (`lmi.rank.witness`), proved by boxes
(`lmi.rank.full_rank`).
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix, NewEntries, Value
from lmi.rank.full_rank import BOX_LIMIT, prove_full_rank
from lmi.rank.stack import Stack, approx_margin, approx_vanishing, coordinates, unit_blocks
from lmi.rank.witness import MARGIN, check_deficient, outright, too_few
from lmi.time_budget import UNLIMITED, TimeBudget
from lmi.verdict import Verdict, refuted, undecided

_GRID, _RANDOM = 201, 300
_SEED = 20091  # the search repeats itself exactly
_POLISHED, _STEPS, _SHRINK = 3, 120, 0.5
# the margin that is proved should reach this part of the least one in floats: bounds of convergence
# rest on it
_SHARE = 0.75


@np.errstate(all="ignore")
def decide_full_rank(
    stack: Stack, low: float, high: float, limit: int = BOX_LIMIT, *, budget: TimeBudget = UNLIMITED
) -> Verdict:
    """Full column rank with MARGIN for all thetas in [low, high]^m: search, refute or prove.

    0 <= low <= high, both finite. Proved evidence as `prove_full_rank`, with "approx_sigma_min"
    and "approx_worst", the least singular value of O where it is least in its coordinates, and
    "asked", the margin to be proved; refuted evidence holds the witness.
    """
    if (witness := outright(stack)) is not None:
        return refuted(witness)
    R, full = coordinates(stack, low, high)
    points = _candidates(stack, low, high)
    search = _Search(stack, low, high, R)
    if len(points) > 1 and (pair := _sign_change(stack, points, R)) is not None:
        return check_deficient(stack, low, high, {"between": pair})
    worst, margin = search.worst(points)
    if not full or not margin >= MARGIN:
        verdict = search.deficient(worst if full else points[0] * 0 + (low + high) / 2)
        if verdict.outcome == "refuted" or not full:
            return verdict
    required = max(_SHARE * margin, MARGIN)
    prove = functools.partial(prove_full_rank, stack, low, high, R, budget=budget)
    verdict = prove(margin=required, limit=min(BOX_LIMIT // 10, limit))
    if verdict.outcome != "proved":
        counter = search.deficient(search.vanishing(points))
        if counter.outcome == "refuted":
            return counter
        required = MARGIN
        verdict = prove(margin=required, limit=limit)
    if "thetas" in verdict.evidence:  # the proof may have been led to a place the search missed
        place = np.array([verdict.evidence["thetas"]])
        worst, margin = search.worst(place)
        counter = search.deficient(worst) if margin < MARGIN else verdict
        verdict = counter if counter.outcome == "refuted" else verdict
    evidence = {"asked": required, **approx_evidence(stack, worst.tolist(), low, high)}
    return Verdict(verdict.outcome, {**verdict.evidence, **evidence})


@dataclass(frozen=True)
class _Search:
    """The search for places in [low, high]^m at which the rank is lost; floats, R: coordinates."""

    stack: Stack
    low: float
    high: float
    R: Matrix

    def deficient(self, place: Matrix) -> Verdict:
        """Refuted if the rank is certainly lost at a place."""
        return check_deficient(self.stack, self.low, self.high, {"thetas": place.tolist()})

    def worst(self, points: Matrix) -> tuple[Matrix, float]:
        """The place of least margin near the lowest of these points, and its margin."""
        margin_at = functools.partial(approx_margin, self.stack, R=self.R)
        return _polished(margin_at, points, self.low, self.high)

    def vanishing(self, points: Matrix) -> Matrix:
        """The worst place where block rows pass through zero next to it."""
        margin_at = functools.partial(approx_vanishing, self.stack, R=self.R)
        return _polished(margin_at, points, self.low, self.high)[0]


def approx_evidence(stack: Stack, thetas: Value, low: float, high: float) -> NewEntries:
    """{"approx_sigma_min", "approx_worst"}: O at thetas (m,) in floats; {} for no such thetas."""
    numbers = isinstance(thetas, list) and all(isinstance(x, int | float) for x in thetas)
    if not numbers or len(thetas) != stack.thetas:
        return {}
    place = np.array([thetas], dtype=np.float64)
    if not ((place >= low) & (place <= high)).all():
        return {}
    rows = stack.approx(place)[0]
    value = float(np.linalg.svd(rows, compute_uv=False)[-1]) if np.isfinite(rows).all() else 0.0
    return {"approx_sigma_min": value, "approx_worst": place[0].tolist()}


@np.errstate(all="ignore")
def prove_again(
    stack: Stack, low: float, high: float, margin: float, *, budget: TimeBudget = UNLIMITED
) -> Verdict:
    """The proof of `decide_full_rank` without its search; the margin is that of the evidence."""
    if stack.shape[0] < stack.shape[1]:
        return refuted(too_few(stack))
    R, full = coordinates(stack, low, high)
    if not full:
        return undecided("the stack has no full rank anywhere in the box")
    return prove_full_rank(stack, low, high, R, margin=max(margin, MARGIN), budget=budget)


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
    windows = stack.approx(points, stack.growth)
    if not np.isfinite(windows).all():
        return None
    scaled = np.swapaxes(np.linalg.solve(R.T, np.swapaxes(windows, -1, -2)), -1, -2)
    signs, relative = np.linalg.slogdet(unit_blocks(scaled, stack.blocks))
    usable = np.isfinite(relative) & (relative > np.log(MARGIN))
    places = np.flatnonzero(usable[:_GRID])
    for a, b in itertools.pairwise(places):
        if signs[a] * signs[b] < 0:
            return [points[a].tolist(), points[b].tolist()]
    plus, minus = (np.flatnonzero(usable & (signs == s)) for s in (1, -1))
    if len(plus) and len(minus):
        return [points[plus[0]].tolist(), points[minus[0]].tolist()]
    return None


def _polished(
    margin_at: Callable[[Matrix], Matrix], points: Matrix, low: float, high: float
) -> tuple[Matrix, float]:
    """The least margin after a compass search from the lowest points, and where."""
    margins = margin_at(points)
    order = np.argsort(np.nan_to_num(margins, nan=np.inf))[:_POLISHED]
    best, value = points[order[0]], float(margins[order[0]])
    m = points.shape[1]
    if m == 0 or low == high:
        return best, value
    directions = np.vstack([np.eye(m), -np.eye(m), np.ones((1, m)), -np.ones((1, m))])
    for start in order:
        point, least, step = points[start], float(margins[start]), (high - low) / 20
        for _ in range(_STEPS):
            tried = np.clip(point + step * directions, low, high)
            values = np.nan_to_num(margin_at(tried), nan=np.inf)
            k = int(np.argmin(values))
            if values[k] < least:
                point, least = tried[k], float(values[k])
            else:
                step *= _SHRINK
            if least < 1e-3 * MARGIN or step < 1e-15 * high:
                break
        if least < value:
            best, value = point, least
    return best, value
