"""Full column rank over a box of thetas, proved by branch and bound in balls.

A box on which `lmi.rank.stack_box` cannot show it is halved where its bound is widest, and the box
with the least margin at its centre comes next: where the rank is lost the search ends early, and
where it ends undecided the worst place is known. A box of one point is not halved but evaluated
with more bits. Coordinates that make the stack at the centre
orthonormal (`lmi.rank.stack`) take the units and the basis of the state out of the question.
"""

from __future__ import annotations

import heapq
import math

import numpy as np

from lmi.arithmetic.arrays import Matrix, NewEntries
from lmi.arithmetic.balls import precision
from lmi.rank.normalised_stack import NormalisedStack, normalised
from lmi.rank.stack import Stack
from lmi.rank.stack_box import Box, bounds
from lmi.time_budget import UNLIMITED, TimeBudget
from lmi.verdict import Verdict, proved, undecided

BOX_LIMIT = 20_000
_BITS = 128
# a box of one point cannot be halved: more bits are all that helps there
_POINT_BITS = (_BITS, 512, 2048)
# a side halved so often is a point to every purpose
_DEPTH = 48


def prove_full_rank(
    stack: Stack,
    low: float,
    high: float,
    R: Matrix,
    *,
    margin: float = 0.0,
    limit: int = BOX_LIMIT,
    budget: TimeBudget = UNLIMITED,
) -> Verdict:
    """O(theta) has full column rank for all theta in [low, high]^m, 0 <= low <= high finite.

    R: coordinates, a float (r, r), invertible (`lmi.rank.stack.coordinates`). Proved evidence:

    sigma_min  a lower bound of the smallest singular value of O over the box
    margin     one of O R^-1 with block rows scaled to norm 1, above `margin`
    spread     for each block i a bound of ||X_i x|| over all x with ||O x|| = 1, in the coordinates
               of the state that `lmi.rank.stack.state_basis` gives, as for the next two
    largest    one of ||O R^-1||
    recalled   one of ||O X^-1||, X the last X_i as its first r coordinates; infinite where it is
               not seen to be invertible
    boxes      how many it took, at most `limit`, and BOX_LIMIT / m

    Undecided evidence: "thetas", near which it could not be shown.
    """
    if not 0 <= low <= high or math.isinf(high):
        raise ValueError(f"0 <= low <= high, both finite, is required; got [{low}, {high}]")
    if stack.shape[0] < stack.shape[1]:
        return undecided(f"{stack.shape[0]} rows cannot have rank {stack.shape[1]}")
    # the work on a box rises with its sides
    limit = min(limit, BOX_LIMIT // max(stack.thetas, 1))
    for bits in _POINT_BITS if low == high else (_BITS,):
        with precision(bits), np.errstate(all="ignore"):
            family = normalised(stack, low, high, R)
            if family is None:
                return undecided("the coordinates are not certainly invertible")
            verdict = _branch(stack, family, margin, limit, budget)
        if verdict.outcome == "proved":
            break
    return verdict


def _branch(
    stack: Stack, family: NormalisedStack, margin: float, limit: int, budget: TimeBudget
) -> Verdict:
    todo = [(math.inf, 0, Box(((0, 0),) * stack.thetas))]
    least, least_margin, count, serial = math.inf, math.inf, 0, 0
    spread, largest, recalled = np.zeros(stack.blocks), 0.0, 0.0
    worst, worst_box, reason = math.inf, todo[0][2], ""
    out_of_time: NewEntries = {}
    while todo and not reason:
        box = heapq.heappop(todo)[2]
        count += 1
        bound = bounds(stack, family, box, margin)
        if bound.proved:
            least, least_margin = min(least, bound.size), min(least_margin, bound.relative)
            spread, largest = np.maximum(spread, bound.spread), max(largest, bound.largest)
            recalled = max(recalled, bound.recalled)
            continue
        if bound.centre <= worst:
            worst, worst_box = bound.centre, box
        if count + len(todo) >= limit:
            reason = f"{limit} boxes did not suffice"
        if bound.widest is None or box.sides[bound.widest][0] >= _DEPTH or bound.centre <= margin:
            reason = "it nearly fails"
        if family.is_point:
            reason = f"the box is one point, and {_POINT_BITS[-1]} bits did not suffice there"
        elif out_of_time := budget.ended():
            reason = f"{count} boxes were looked at"
        if not reason and bound.widest is not None:
            for half in box.halves(bound.widest):
                serial += 1
                heapq.heappush(todo, (bound.centre, serial, half))
    if not reason:
        return proved(sigma_min=least, margin=least_margin, spread=spread.tolist(),
                      largest=largest, recalled=recalled, boxes=count)  # fmt: skip
    place = [family.centre(side) * family.unit for side in worst_box.sides]
    text = ", ".join(f"{theta:.9g}" for theta in place)
    return undecided(f"full rank could not be shown: {reason}; the worst place is ({text})",
                     thetas=place, boxes=count, **out_of_time)  # fmt: skip
