#!/usr/bin/env python3
"""Prove the stability of an observer's error again, from its design file alone.

    python3 -I -S check_design.py design.json          ("-" reads standard input)

This file needs nothing but Python >= 3.8 and its standard library. It is meant to be read: each
step states its inequality. It trusts no number of the file that it has not proved, and it prints
what it proved in its own words, and what it did not check.

The plant         x'(t) = A x + ...  between jumps,   x(t) = G x(t-) + ...  at jumps,   y = C x + v
and its observer  with gains L between jumps and M at them have an error that obeys

    e'(t) = F e      between jumps          F = A - L C
    e(t)  = H e(t-)  at jumps               H = G - M C, or (I - M C) G, or G

or, for observers that give bounds, a width w = upper - lower with w' = W w, w+ = N w- (read F = W,
H = N). Dwell times T between jumps lie in a range. The claim: the products of the maps e^(F T) H
tend to zero for every sequence of them. Certificates are matrices P > 0 with

    Phi(T)' P Phi(T) < P      for every T in the range,  Phi(T) = e^(F T) H,

or a P for each window of dwell times. They stand in the file, whoever made them. Each jump then
shrinks e' P e by a factor below 1 that serves for all T: a closed range is compact, and as T -> inf
Phi(T) tends to zero, F being proved Hurwitz there. Between jumps |e^(F t)| is bounded, on
t <= longest T or because F is Hurwitz: so e tends to zero at jumps, and between them.

Inequalities X < Y between symmetric matrices say that Y - X is positive definite; X' is the
transpose of X. Lyap(X) = F'X + XF is the derivative of e^(F't) X e^(Ft) at t = 0.

Not here: whether the gains are those of the problem in the file, which check_gains.py compares;
widths, and stability proved by a vector, which check_widths.py proves.

Exit code 0: proved. 1: not proved (which refutes nothing). 2: not a design that this program reads.
Whatever goes wrong on the way raises an error, and an error never proves anything.
"""

import hashlib
import json
import math
import sys
from fractions import Fraction
from operator import mul
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple

Matrix = List[List[Fraction]]
Table = Dict[str, Any]
Time = Any  # a Fraction, or math.inf
Range = Tuple[Time, Time]  # (shortest, longest)

BITS = 256  # balls count in units of 2^-BITS
DEGREE = 6  # of Taylor polynomials
# not checked; the first of these is what check_gains.py compares
OTHERS = "whether A, C, G, L, M, times, bounds are the problem's, options, other words of the file"
MOST_BOXES = 20000
MOST_HALVINGS = 40


class NotProved(Exception):
    """The reason for which something is not proved."""


def demand(condition: bool, reason: str) -> None:
    """NotProved unless the condition holds."""
    if not condition:
        raise NotProved(reason)


# 1. Matrices of fractions: exact -----------------------------------------------------------------


def transposed(X: Sequence[Sequence[Any]]) -> List[List[Any]]:
    """X'."""
    return [list(column) for column in zip(*X)]


def product(X: Matrix, Y: Matrix) -> Matrix:
    """X Y."""
    columns = transposed(Y)
    return [[sum((a * b for a, b in zip(row, c)), Fraction(0)) for c in columns] for row in X]


def total(X: Matrix, Y: Matrix, factor: Fraction = Fraction(1)) -> Matrix:
    """X + factor Y."""
    return [[a + factor * b for a, b in zip(*rows)] for rows in zip(X, Y)]


def difference(X: Matrix, Y: Matrix) -> Matrix:
    """X - Y."""
    return total(X, Y, Fraction(-1))


def absolute(X: Matrix) -> Matrix:
    """|X|, entry by entry."""
    return [[abs(a) for a in row] for row in X]


def identity(n: int) -> Matrix:
    """The unit matrix."""
    return [[Fraction(i == j) for j in range(n)] for i in range(n)]


def largest(X: Matrix) -> Fraction:
    """The largest absolute value of an entry."""
    return max((abs(a) for row in X for a in row), default=Fraction(0))


def echelon(X: Matrix) -> Tuple[Matrix, List[int]]:
    """The nonzero rows of the reduced row echelon form, and the columns of its pivots."""
    rows, pivots = [list(row) for row in X], []  # type: Tuple[Matrix, List[int]]
    for j in range(len(rows[0])):
        k = len(pivots)
        i = next((i for i in range(k, len(rows)) if rows[i][j]), None)
        if i is None:
            continue
        rows[k], rows[i] = rows[i], rows[k]
        rows[k] = [a / rows[k][j] for a in rows[k]]
        for i in range(len(rows)):
            if i != k and rows[i][j]:
                rows[i] = [a - rows[i][j] * b for a, b in zip(rows[i], rows[k])]
        pivots.append(j)
    return rows[: len(pivots)], pivots


def solution(X: Matrix, Y: Matrix) -> Matrix:
    """X^-1 Y; NotProved if X is singular."""
    n = len(X)
    rows, pivots = echelon([a + b for a, b in zip(X, Y)])
    demand(pivots[:n] == list(range(n)), "a matrix that must be invertible is singular")
    return [row[n:] for row in rows[:n]]


# 2. Balls: matrices of integers in units of 2^-BITS, with one radius -----------------------------


class Ball:
    """All real matrices X with |X_ij - x_ij 2^-BITS| <= radius 2^-BITS for every entry."""

    def __init__(self, x: List[List[int]], radius: int) -> None:
        self.x = x
        self.radius = radius

    def plus(self, other: "Ball") -> "Ball":
        """X + Y: radii add."""
        rows = [[a + b for a, b in zip(*pair)] for pair in zip(self.x, other.x)]
        return Ball(rows, self.radius + other.radius)

    def times(self, other: "Ball") -> "Ball":
        """X Y, for radii a and b of an m x k and a k x n matrix.

        (x + dx)(y + dy) = x y + x dy + dx y + dx dy: an entry is off by at most
        b max_i sum_k |x_ik| + a max_j sum_k |y_kj| + k a b; to round x y and this sum down takes
        one unit each.
        """
        columns = transposed(other.x)
        rows = [[sum(map(mul, row, c)) >> BITS for c in columns] for row in self.x]
        a, b = self.radius, other.radius
        error = b * norm(self.x) + a * norm(columns) + len(other.x) * a * b
        return Ball(rows, (error >> BITS) + 2)

    def scaled(self, c: Fraction) -> "Ball":
        """c X: the entries c x are rounded down, and so is the radius |c| a: one unit each."""
        p, q = c.numerator, c.denominator
        return Ball([[a * p // q for a in row] for row in self.x], self.radius * abs(p) // q + 2)


Balls = List[Ball]


def norm(x: List[List[int]]) -> int:
    """The largest sum of absolute values in a row."""
    return max(sum(map(abs, row)) for row in x)


def ball(X: Matrix) -> Ball:
    """A ball that holds an exact matrix: entries are rounded down, by less than one unit."""
    return Ball([[(a.numerator << BITS) // a.denominator for a in row] for row in X], 1)


def is_positive(D: Ball) -> bool:
    """Certify D > 0 for all symmetric matrices in a ball d of radius r.

    The true matrix is symmetric: E' X E, Lyap(X) and sums of them are, for a symmetric X. So the
    lower triangle alone counts, though the entries of d itself may differ by rounding.

    They differ from d by E with |E_ij| <= r, so that |E| <= n r and D >= d - n r I.
    Elimination: a matrix is positive definite if its first pivot p is
    positive and so is the Schur complement d_ij - d_i d_j / p of the others. These quotients are
    rounded down, so the computed complement is too large by some E, 0 <= E_ij < 1, symmetric since
    the lower triangle is used: |E| <= n, and the complement is at least the computed one minus n I.
    """
    n, rows = len(D.x), [row[: i + 1] for i, row in enumerate(D.x)]
    given_away = n * D.radius
    while rows:
        for row in rows:
            row[-1] -= given_away
        p, *column = [row[0] for row in rows]
        if p <= 0:
            return False
        pairs = zip(column, rows[1:])
        rows = [[a - b * c // p for a, c in zip(row[1:], column)] for b, row in pairs]
        given_away = n
    return True


def is_negative(X: Ball) -> bool:
    """Certify X < 0."""
    return is_positive(X.scaled(Fraction(-1)))


def is_less(X: Ball, Y: Ball) -> bool:
    """Certify X < Y."""
    return is_positive(Y.plus(X.scaled(Fraction(-1))))


def congruence(E: Ball, X: Ball) -> Ball:
    """E' X E."""
    return Ball(transposed(E.x), E.radius).times(X.times(E))


def lyapunov(F: Ball, X: Ball) -> Ball:
    """Lyap(X) = F'X + XF, for a symmetric X: the sum of X F and its transpose."""
    image = X.times(F)
    return image.plus(Ball(transposed(image.x), image.radius))


def bounding_factor(X: Ball, Y: Ball) -> Optional[Fraction]:
    """A c with X < c Y, Y > 0, within thousandths of the least; None if it is above 2^68.

    From 2^-60 on c grows by ever smaller steps, each of which is taken if its end does not serve.
    """
    c, coarse = Fraction(1, 2**60), [Fraction(2**2**k) for k in (6, 5, 4, 3, 2, 1, 0)]
    for step in coarse + [1 + Fraction(1, 2**k) for k in range(1, 11)]:
        if not is_less(X, Y.scaled(c * step)):
            c *= step
    c *= 1 + Fraction(1, 512)
    return c if is_less(X, Y.scaled(c)) else None


# 3. The exponential of a flow, and ranges of time ------------------------------------------------


Test = Callable[[Ball], bool]
Advance = Callable[[Ball, Fraction], Fraction]


class Flow:
    """x' = F x: its maps e^(F t), and proofs along it. Times are in units in which |F| is 1."""

    def __init__(self, F: Ball) -> None:
        self.speed = Fraction(max(norm(F.x), 1), 1 << BITS)
        self.F = F.scaled(1 / self.speed)
        self.maps: Dict[Fraction, Ball] = {}
        self.boxes = 0

    def map(self, t: Fraction) -> Ball:
        """e^(F t), kept for every t that was needed."""
        if t not in self.maps:
            self.maps[t] = exponential(self.F.scaled(t))
        return self.maps[t]

    def prove_range(self, start: Ball, ends: Range, holds_from: Test, advance: Advance) -> None:
        """Prove what `holds_from` and `advance` certify for E = e^(F t) start and all t of a range.

        holds_from(E): at this t and all later ones. advance(E, length): on [t, t + u], with the u =
        length / 2^k that it returns, so that doubling u ends at length exactly.
        """
        low, high = (t * self.speed for t in ends)
        E = self.map(low).times(start)
        if not holds_from(E):
            length = self.time_of_tail(E, holds_from) if high == math.inf else high - low
            self.cover(E, length, advance)

    def cover(self, E: Ball, length: Fraction, advance: Advance) -> None:
        """Prove [0, length] from E on: first [0, u], then [u, 2u], [2u, 4u], ... in the same way.

        Each of them starts from e^(F u) E. Errors grow with the depth of this recursion, not with
        the number of boxes.
        """
        self.boxes += 1
        demand(self.boxes <= MOST_BOXES, f"more than {MOST_BOXES} boxes")
        u = advance(E, length)
        while u < length:
            self.cover(self.map(u).times(E), u, advance)
            u *= 2

    def time_of_tail(self, E: Ball, holds_from: Test) -> Fraction:
        """A time t, by doubling, at which `holds_from` certifies e^(F t) E."""
        t = Fraction(1, 1 + (norm(self.F.x) >> BITS))
        step = self.map(t)
        for _ in range(MOST_HALVINGS):
            if holds_from(step.times(E)):
                return t
            step, t = bounded(step.times(step)), 2 * t
        raise NotProved("no tail was shown to hold, however late")


def bounded(X: Ball) -> Ball:
    """X; NotProved beyond 2^(3 BITS), 2^(4 BITS) units, which an unstable flow leads to."""
    demand(max(norm(X.x), X.radius) >> (4 * BITS) == 0, "numbers grow too large")
    return X


def exponential(Y: Ball) -> Ball:
    """e^Y by e^Z = sum Z^k / k!, Z = Y / 2^s with row sums |Z| <= 1/2, and s squarings.

    The rest of the series from k = K on has row sums of at most 2 (1/2)^K / K!, which is below one
    unit, 2^-BITS, once 2^(K-1) K! > 2^BITS.
    """
    Z, s, n, K = Y, 0, len(Y.x), 1
    while norm(Z.x) + n * Z.radius > 1 << (BITS - 1):
        Z, s = Z.scaled(Fraction(1, 2)), s + 1
    term = result = ball(identity(n))
    while math.factorial(K) << (K - 1) <= 1 << BITS:
        term = term.times(Z).scaled(Fraction(1, K))
        result, K = result.plus(term), K + 1
    result = Ball(result.x, result.radius + 1)
    for _ in range(s):
        result = bounded(result.times(result))
    return result


# 4. One matrix inequality for a range of times ---------------------------------------------------


class Decrease:
    """right' e^(F't) P e^(Ft) right < S for every S of `sources`, for a range of t.

    P >= 0 may be singular. tails: matrices that are proposed to fall along the flow.
    """

    def __init__(self, flow: Flow, P: Ball, sources: Balls, tails: Balls) -> None:
        self.flow, self.P, self.sources, self.proposed = flow, P, sources, tails
        self.tails = [X for X in map(self.falling, (P, *tails)) if X]
        self.remainder: Optional[Tuple[Ball, Fraction, Fraction]] = None
        # Lyap^k(P), k = 0 .. DEGREE + 1: the derivatives of P(u) = e^(F'u) P e^(Fu) at u = 0
        self.derivatives = [P]
        for _ in range(DEGREE + 1):
            self.derivatives.append(lyapunov(flow.F, self.derivatives[-1]))

    def prove(self, right: Ball, ends: Range) -> None:
        """Prove it for all t of a range, or raise NotProved."""
        self.flow.prove_range(right, ends, self.holds_from, self.advance)

    def falling(self, Q: Ball) -> Optional[Ball]:
        """X = c Q with X > P and Lyap(X) < 0; None if Q is no such matrix.

        Then M(t)' P M(t) <= M(t)' X M(t), M(t) = e^(Ft) right, and the right side falls with t.
        """
        falls = is_positive(Q) and is_negative(lyapunov(self.flow.F, Q))
        c = bounding_factor(self.P, Q) if falls else None
        return None if c is None else Q.scaled(c)

    def steep(self, Z: Ball) -> Balls:
        """X = c (P + 256^k F'ZF) that falls: one, or none.

        Where the slowest mode of F hardly decays, F'ZF is small for it, and large for the others,
        which e^(Ft) soon makes small: such an X holds much earlier than Z does.
        """
        sums = (self.P.plus(congruence(self.flow.F, Z).scaled(Fraction(256**k))) for k in range(13))
        return [X for X in [next(filter(None, map(self.falling, sums)), None)] if X]

    def holds_from(self, E: Ball) -> bool:
        """Certify E' X E < S for a falling X > P: it stays true at all later times."""
        return any(self.holds(congruence(E, X)) for X in self.tails)

    def holds(self, form: Ball) -> bool:
        """Certify form < S for every source."""
        return all(is_less(form, S) for S in self.sources)

    def advance(self, E: Ball, length: Fraction) -> Fraction:
        """Prove [0, u] from E on, u = length / 2^k, by a tail or by a box; return u."""
        if self.holds_from(E):
            return length
        if self.remainder is None:
            self.tails += [X for Z in self.proposed for X in self.steep(Z)]
            self.remainder = self.best_remainder(E)
        R, mu, c = self.remainder
        forms, image = [congruence(E, X) for X in self.derivatives[: DEGREE + 1]], congruence(E, R)
        h = length
        while mu * h > 8:
            h /= 2
        for _ in range(MOST_HALVINGS if self.holds(forms[0]) else 0):
            if self.is_box(forms, image.scaled(remainder_factor(h, mu, c)), h):
                return h
            h /= 2
        raise NotProved("the inequality fails, or nearly fails, at some time in the range")

    def best_remainder(self, E: Ball) -> Tuple[Ball, Fraction, Fraction]:
        """(R, mu, c) for boxes from E on: R > 0, Lyap(R) <= mu R, Lyap^(DEGREE + 1)(P) <= c R.

        c, mu >= 0. Whichever is taken is certified: the choice, by floats, affects only the speed.
        More of I makes R rounder; cost is about one over the length of the box that R allows.
        """
        unit = ball(identity(len(self.P.x))).scaled(Fraction(norm(self.P.x), 1 << BITS))
        choices: List[Tuple[float, int, Tuple[Ball, Fraction, Fraction]]] = []
        rounder = (self.P.plus(unit.scaled(Fraction(1, share))) for share in (1000, 30, 1))
        for R in (*self.tails, self.P, *rounder):
            if is_positive(R):
                growth = lyapunov(self.flow.F, R)
                mu = Fraction(0) if is_negative(growth) else bounding_factor(growth, R)
                c = bounding_factor(self.derivatives[DEGREE + 1], R)
                size = bounding_factor(congruence(E, R), self.sources[0])
                if mu is not None and c is not None and size is not None:
                    cost = max(float(c * size) ** (1 / (DEGREE + 1)), float(mu) / 8)
                    choices.append((cost, len(choices), (R, mu, c)))
        demand(bool(choices), "no bound of the remainder of a Taylor polynomial was shown")
        return min(choices)[2]

    def is_box(self, forms: Balls, remainder: Ball, h: Fraction) -> bool:
        """Certify E' P(u) E < S for all u in [0, h], P(u) = e^(F'u) P e^(Fu).

        P(u) = sum_k u^k / k! Lyap^k(P), k <= d = DEGREE, plus a remainder of at most eps R
        (`remainder_factor`). A polynomial sum_k a_k (u/h)^k is, on [0, h], an average of its
        Bernstein coefficients sum_{k<=i} C(i,k) / C(d,k) a_k, i = 0 .. d. With a_k = h^k / k!
        E' Lyap^k(P) E it is enough that each of them, plus eps E' R E, is less than S.
        """
        a = [X.scaled(h**k / math.factorial(k)) for k, X in enumerate(forms)]
        for i in range(DEGREE, -1, -1):
            coefficient = remainder
            for k in range(i + 1):
                weight = Fraction(math.comb(i, k), math.comb(DEGREE, k))
                coefficient = coefficient.plus(a[k].scaled(weight))
            if not self.holds(coefficient):
                return False
        return True


def remainder_factor(h: Fraction, mu: Fraction, c: Fraction) -> Fraction:
    """eps = c h^(d+1) / (d+1)! 3^m, m >= mu h whole: the Taylor remainder is at most eps R.

    It is the integral of (u - v)^d / d! e^(F'v) Lyap^(d+1)(P) e^(Fv) over v in [0, u], where
    Lyap^(d+1)(P) <= c R, and e^(F'v) R e^(Fv) <= e^(mu v) R because Lyap(R) <= mu R; c, mu >= 0
    so that this grows with u, v; e < 3.
    """
    return Fraction(c * h ** (DEGREE + 1) / math.factorial(DEGREE + 1) * 3 ** math.ceil(mu * h))


# 5. Windows of dwell times -----------------------------------------------------------------------
#
# A window is taken at a jump. Offset 0 is the dwell time after this jump, -1 that before it. Cells
# are half-open, a border belongs to the upper one; the inequalities are proved on their closures.
# Dwell times before the first jump are invented: any that the ranges and the jitter allow.

Cells = Dict[int, Range]  # offset of a dwell time -> its cell; the whole range where it is missing
Edge = Tuple[Any, Any, Time, Time]  # window, next window, range of the dwell time between them


def check_partition(windows: Sequence[Cells], region: Cells, ends: Range) -> None:
    """NotProved unless the windows divide the region: every sequence of dwell times is in one.

    A cut at a border that no window straddles divides both, until each part has one window, which
    must fill its part.
    """
    offsets = sorted({*region}.union(*windows))
    if len(windows) == 1 and all(windows[0].get(j, ends) == region.get(j, ends) for j in offsets):
        return
    for j in offsets if len(windows) > 1 else ():
        low, high = region.get(j, ends)
        for cut in sorted({window.get(j, ends)[1] for window in windows}):
            below = [window for window in windows if window.get(j, ends)[1] <= cut]
            above = [window for window in windows if window.get(j, ends)[0] >= cut]
            if low < cut < high and above and len(below) + len(above) == len(windows):
                check_partition(below, {**region, j: (low, cut)}, ends)
                check_partition(above, {**region, j: (cut, high)}, ends)
                return
    raise NotProved("the windows do not divide all sequences of dwell times")


def common_cells(window: Cells, later: Cells, ends: Range) -> Optional[Cells]:
    """Cells of a window and of the next one, whose offsets are one later; None if disjoint."""
    both = dict(window)
    for j, (low, high) in later.items():
        a, b = both.get(j + 1, ends)
        both[j + 1] = max(low, a), min(high, b)
        if not both[j + 1][0] < both[j + 1][1]:
            return None
    return both


def is_reachable(cells: Cells, ends: Range, jitter: Time) -> bool:
    """Whether dwell times that change by at most `jitter` can be in these cells, one by one.

    Neighbours are compared forwards alone: a necessary condition. Edges too many only add to what
    has to be proved.
    """
    first, last = min(cells, default=0), max(cells, default=0)
    low, high = cells.get(first, ends)
    for a, b in (cells.get(j, ends) for j in range(first + 1, last + 1)):
        low, high = max(low - jitter, a), min(high + jitter, b)
        if not low < high:
            return False
    return True


def edges_of(windows: Sequence[Cells], ends: Range, jitter: Time) -> List[Edge]:
    """Every window with each that can follow it, and the dwell times that both allow."""
    edges = []
    for s, window in enumerate(windows):
        for t, later in enumerate(windows):
            both = common_cells(window, later, ends)
            if both is not None and is_reachable(both, ends, jitter):
                edges.append((s, t, *both.get(0, ends)))
    return edges


# 6. Reading a design -----------------------------------------------------------------------------

# the entries that each block of a problem may have; plants with others are not checked
PROBLEM = {
    "flow": "A B D d_bounds disturbance disturbance_matrix input_bound",
    "jump": "G E H disturbance disturbance_matrix dwell_time dwell_jitter input_bound",
    "output": "C noise_bound noise_std noise_cv measured period jump_measurement",
}
BORDER = Fraction(1, 250_000_000)  # relative room at borders, more than observers need


def number(value: Any) -> Fraction:
    """A number of the file, exact: a double, none beyond 1e150, no truth value, no word.

    Integers that no double equals are refused: an observer would run with another number.
    """
    is_number = type(value) in (int, float) and abs(value) <= 1e150  # false for NaN and infinity
    demand(is_number and value == float(value), f"no double up to 1e150: {value!r:.40}")
    return Fraction(value)


def time(value: Any) -> Time:
    """A time, or another number that must not be negative; "inf" is infinity."""
    result = math.inf if value == "inf" else number(value)
    demand(result >= 0, "a number must not be negative")
    return result


def interval(value: Any) -> Range:
    """[shortest, longest] of a time."""
    low, high = value
    demand(type(value) is list and 0 <= number(low) <= time(high), "no range of times")
    return number(low), time(high)


def array(value: Any, shape: str, sizes: Dict[str, int]) -> Any:
    """Nested lists of numbers; each letter of the shape stands for one size, kept in `sizes`."""
    if not shape:
        return number(value)
    demand(type(value) is list and len(value) > 0, f"a list of numbers is due; got {value!r:.40}")
    demand(sizes.setdefault(shape[0], len(value)) == len(value), "sizes do not fit each other")
    return [array(entry, shape[1:], sizes) for entry in value]


def keys_once(items: List[Tuple[str, Any]]) -> Table:
    """A table of the file, whose keys must differ."""
    demand(len(dict(items)) == len(items), "a key stands twice")
    return dict(items)


class Design:
    """A design that is unchanged since it was signed.

    gains: with which the observer runs; evidence: of each claim, by its id, certificates that are
    proposed, nothing that is believed; ends, jitter: of the dwell times.
    """

    def __init__(self, text: str) -> None:
        body = json.loads(text, object_pairs_hook=keys_once)
        signed = {key: value for key, value in body.items() if key != "digest"}
        canonical = json.dumps(
            signed, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False
        )
        digest = "sha256:" + hashlib.sha256(canonical.encode("utf-8")).hexdigest()
        demand(body["digest"] == digest, "the digest is not that of the content")
        is_design = body["format"] == "obsdesign/design" and repr(body["version"]) == "1"
        demand(is_design and body["kind"] in ("interval", "luenberger"), "no design of these kinds")
        self.kind, self.gains, self.problem = body["kind"], body["gains"], body["problem"]
        demand({*self.problem} <= {"name", "names", "observer", *PROBLEM}, "a block is not known")
        for place, names in PROBLEM.items():
            unknown = {*self.problem.get(place, {})} - {*names.split()}
            demand(not unknown, f"{place}: {sorted(unknown)} is not known to this program")
        self.measured = self.problem["output"]["measured"]
        demand(self.measured in ("continuous", "at_jumps"), "y is measured at other times")
        self.has_jumps = "G" in self.gains
        demand(self.has_jumps == ("jump" in self.problem), "problem and gains differ about jumps")
        self.evidence = keys_once([(entry["id"], entry["evidence"]) for entry in body["claims"]])
        claims = [self.evidence.get(name, {}) for name in ("dwell_stability", "decay_rate")]
        demand(all("vector" not in x for x in claims), "vectors are checked by check_widths.py")
        self.sizes: Dict[str, int] = {}
        self.n = len(self.array("A", "nn"))
        self.ends = interval(self.gains["dwell_time"] if self.has_jumps else [0, "inf"])
        self.jitter = time(self.gains.get("dwell_jitter", "inf"))

    def array(self, name: str, shape: str) -> Any:
        """A stored gain, exact."""
        return array(self.gains[name], shape, self.sizes)


# 7. The hypotheses that need no analysis: gains, signs, splits -----------------------------------


def is_metzler(X: Matrix, slack: Fraction = Fraction(0)) -> bool:
    """Are all entries off the diagonal at least zero, or -slack?"""
    return all(a >= -slack for i, row in enumerate(X) for j, a in enumerate(row) if i != j)


def is_nonnegative(X: Matrix) -> bool:
    """Are all entries at least zero?"""
    return all(a >= 0 for row in X for a in row)


def width_map(X: Matrix, plus: Matrix, minus: Matrix) -> Matrix:
    """The map of the width for X = plus - minus, minus >= 0: plus + minus + |E|.

    E = plus - minus - X is rounding, at most 2^-46 of the largest entry of X: some operations on
    doubles, of 2^-53 each; more would be another split. The observer carries it: plus + E^- and
    minus + E^+ are an exact split.
    """
    E = absolute(difference(difference(plus, minus), X))
    demand(largest(E) <= largest(X) / 2**46, "a stored split is not that of its matrix")
    demand(is_nonnegative(minus), "a stored split has a wrong sign")
    return total(total(plus, minus), E)


def error_maps(design: Design, M: Matrix) -> Tuple[Matrix, Optional[Matrix]]:
    """(F, H) of the error, F = A - L C, H by when y is measured at a jump; H None without jumps."""
    A, C, L = design.array("A", "nn"), design.array("C", "pn"), design.array("L", "np")
    demand(design.measured == "continuous" or not largest(L), "L acts where y is not measured")
    F = difference(A, product(L, C))
    if not design.has_jumps:
        return F, None
    G = design.array("G", "nn")
    outputs = {"before": C, "after": product(C, G), "none": difference(C, C)}
    return F, difference(G, product(M, outputs[design.gains["jump_measurement"]]))


def width_maps(design: Design) -> Tuple[Matrix, Optional[Matrix]]:
    """(W, N) of the width, w' = W w + ..., w+ = N w- + ..., and the signs that they rest on.

    With F, H in coordinates x = S z:  cooperative: F Metzler, H >= 0;  split, coordinates:
    F = D0 - D1, H = Gp - Gn;  two_coordinates, x = S2 z2 at jumps: F Metzler, S2^-1 H S2 = T >= 0,
    and what maps widths from S to S2 and back are |S2^-1 S| and |S^-1 S2|. With these signs the
    errors upper - x and x - lower, once >= 0, stay so: the bounds hold the state.
    """
    form, unit = design.gains["form"], identity(design.n)
    has_two, is_cooperative = form == "two_coordinates", form == "cooperative"
    needed = {"cooperative": "", "split": "", "coordinates": "S", "two_coordinates": "S S2 T"}[form]
    own = {"S", "S2", "T", "M_cells"} & {*design.gains}
    demand(own == {*needed.split()}, "the gains are not those of their form")
    S = design.array("S", "nn") if needed else unit
    S2 = design.array("S2", "nn") if has_two else S
    F, H = error_maps(design, design.array("M", "np"))
    F, D0, D1 = solution(S, product(F, S)), design.array("D0", "nn"), design.array("D1", "nn")
    slack = largest(F) / 2**46 if has_two else Fraction(0)  # D1 holds what is below zero
    is_signed = is_metzler(F, slack) and not (is_cooperative and largest(D1))
    demand(is_signed or form in ("split", "coordinates"), "the flow of the error is not Metzler")
    demand(is_metzler(D0), "D0 is not Metzler")
    W = width_map(F, D0, D1)
    if H is None:
        return W, None
    H, plus = solution(S2, product(H, S2)), design.array("T" if has_two else "Gp", "nn")
    minus = difference(plus, plus) if has_two else design.array("Gn", "nn")
    is_signed = is_nonnegative(H) and not largest(minus)
    demand(is_signed or not is_cooperative, "the jump of the error is not nonnegative")
    demand(is_nonnegative(plus), "a stored split of the jump has a wrong sign")
    N = product(width_map(H, plus, minus), absolute(solution(S2, S)))
    return W, product(absolute(solution(S, S2)), N)


# 8. Stability for every sequence of dwell times --------------------------------------------------


def matrices(values: Any, shape: str, n: int) -> Balls:
    """Symmetric matrices of a certificate, n x n for shape knn, of another size for kmm."""
    result: List[Matrix] = array(values, shape, {"n": n}) if values else []
    demand(all(transposed(X) == X for X in result), "a matrix of a certificate is not symmetric")
    return [ball(X) for X in result]


def units(F: Matrix, H: Matrix) -> Matrix:
    """D, diagonal, powers of two: for x = D z, D^-1 F D and D^-1 H D have like rows and columns.

    Any D serves. In units that differ much, numbers of few bits bound little.
    """
    n, D = len(F), identity(len(F))
    for i in [*range(n)] * 10:
        speed = max(abs(a) * D[k][k] / D[j][j] for j in range(n) for k, a in enumerate(F[j]))
        size = total(absolute(H), absolute(F), 1 / (speed or Fraction(1)))
        row = sum(size[i][j] * D[j][j] for j in range(n) if j != i) / D[i][i]
        column = sum(size[j][i] / D[j][j] for j in range(n) if j != i) * D[i][i]
        if row and column:
            D[i][i] *= Fraction(2) ** round(math.log2(row / column) / 2)
    return D


def prove_hurwitz(F: Matrix, candidates: Balls) -> None:
    """Prove that e^(F t) tends to zero: by X > 0, Lyap(X) < 0, or v > 0, F v < 0, F Metzler.

    For a Metzler F such a v exists if and only if F v = -(1, ..., 1) has a positive solution.
    """
    forms = [X for X in candidates if len(X.x) == len(F)]
    if not any(is_positive(X) and is_negative(lyapunov(ball(F), X)) for X in forms):
        demand(is_metzler(F), "no matrix X > 0 with F'X + XF < 0 is in the file (evidence.tails)")
        v = solution(F, [[Fraction(-1)] for _ in F])
        demand(all(a > 0 for (a,) in v), "the flow is not proved to decay")


def prove_stability(design: Design, F: Matrix, H: Matrix, evidence: Table) -> None:
    """Prove that products of the maps e^(F T) H tend to zero, for all sequences of dwell times."""
    ends, tails = design.ends, matrices(evidence.get("tails"), "knn", design.n)
    edges, P = [(0, 0, *ends)], []  # type: Tuple[List[Edge], Balls]
    if "P" in evidence:
        P = matrices([evidence["P"]], "kmm", design.n)
    elif "windows" in evidence:
        windows, P = read_windows(evidence, ends)
        check_partition(windows, {}, ends)
        edges = edges_of(windows, ends, design.jitter)
    if ends[1] == math.inf:  # a P may serve for all late T although e^(F t) does not decay
        prove_hurwitz(F, P + tails)
    if P:
        prove_windows(F, H, edges, P, tails)
    else:
        demand(ends[0] == ends[1], "the file holds no certificate of stability")
        prove_one_dwell_time(F, H, ends[0])


def read_windows(evidence: Table, ends: Range) -> Tuple[List[Cells], Balls]:
    """Cells and P of each window: proposals, which check_partition and the proofs judge."""
    windows = []
    for entry in evidence["windows"]:
        cells = {int(j): interval(cell) for j, cell in entry["dwell"].items()}
        inside = all(ends[0] <= low < high <= ends[1] for low, high in cells.values())
        demand(inside and all(abs(j) <= 100 for j in cells), "a cell is empty, or too far away")
        windows.append(cells)
    return windows, matrices([entry["P"] for entry in evidence["windows"]], "kmm", 0)


def prove_windows(F: Matrix, H: Matrix, edges: List[Edge], P: Balls, tails: Balls) -> None:
    """Phi(T)' P_t Phi(T) < P_s for every window s, each t that can follow it, all T of both.

    So x' P_w x falls from jump to jump, w the window that the dwell times are in; T, between the
    two jumps, is at offset 0 of s and -1 of t. P may be smaller than F: with H = U V, V the rows of
    its echelon form, V e^(F T) U has the same products. For x = D z it is V D, D^-1 F D, D^-1 U.
    """
    V, right = identity(len(F)), H
    if len(P[0].x) < len(F):
        V, pivots = echelon(H)
        right = [[row[j] for j in pivots] for row in H]
    demand(len(P[0].x) == len(V), "P has neither the size of the plant nor the rank of H")
    demand(bool(edges) and all(map(is_positive, P)), "no edge, or a P is not positive definite")
    sources: Dict[Tuple[int, Time, Time], List[int]] = {}
    for now, after, low, high in edges:
        sources.setdefault((after, low, high), []).append(now)
    D = units(F, H)
    flow, right = Flow(ball(solution(D, product(F, D)))), solution(D, right)
    V, tails = product(V, D), [congruence(ball(D), X) for X in tails]
    for (after, low, high), earlier in sources.items():
        inequality = Decrease(flow, congruence(ball(V), P[after]), [P[s] for s in earlier], tails)
        inequality.prove(ball(right), (low, high))


def prove_one_dwell_time(F: Matrix, H: Matrix, T: Fraction) -> None:
    """Some power of the one map M = e^(F T) H has row sums below 1: M^k tends to zero."""
    M = exponential(ball(F).scaled(T)).times(ball(H))
    for _ in range(MOST_HALVINGS):
        if norm(M.x) + len(F) * M.radius < 1 << BITS:
            return
        M = bounded(M.times(M))
    raise NotProved("the map over the one dwell time was not shown to be stable")


def prove_schedule(design: Design, F: Matrix, evidence: Table) -> None:
    """With jump gains M_j for dwell times in cell j: e^(F'T) H_j' P_j H_j e^(FT) < P_i

    for all T in cell j, and all i that can precede j: e' P_i e falls from jump to jump. Dwell times
    near a border, within BORDER of it, may count to either cell: time stamps are rounded. P_i is
    that of the cell of the dwell time before, T', and |T - T'| <= jitter: that cell is no further
    away, max(low_i - high_j, low_j - high_i) <= jitter.
    """
    gains, borders = design.array("M_cells", "znp"), design.array("dwell_borders", "b")
    inner, count = [design.ends[0], *borders, design.ends[1]], len(gains)
    fits = count == len(borders) + 1 and all(a < b for a, b in zip(inner, inner[1:]))
    demand(fits, "the borders do not increase, or there are as many gains as borders")
    lows = [inner[0], *(max(inner[0], b * (1 - BORDER)) for b in borders)]
    highs = [*(min(inner[-1], b * (1 + BORDER)) for b in borders), inner[-1]]
    P = matrices(evidence["P_cells"], "knn", design.n)
    tails = matrices(evidence.get("tails"), "knn", design.n)
    demand(len(P) == count and all(map(is_positive, P)), "a P is missing, or not positive definite")
    if highs[-1] == math.inf:
        prove_hurwitz(F, tails)
    D = units(F, design.array("G", "nn"))
    flow, right = Flow(ball(solution(D, product(F, D)))), ball(solution(D, identity(design.n)))
    tails = [congruence(ball(D), X) for X in tails]
    for j, M in enumerate(gains):
        gaps = [max(a - highs[j], lows[j] - b) for a, b in zip(lows, highs)]
        sources = [X for gap, X in zip(gaps, P) if gap <= design.jitter]
        # H D, where jumps exist: never []
        target = congruence(ball(product(error_maps(design, M)[1] or [], D)), P[j])
        Decrease(flow, target, sources, tails).prove(right, (lows[j], highs[j]))


def prove_rates(design: Design, F: Matrix, H: Matrix) -> str:
    """Prove how fast the error shrinks; return it in words. By one P, or the P of windows, each:

    Phi(T)' P Phi(T) < g^2 P: at each jump by the factor g; it is Phi(T)' P Phi(T) < P for H / g.
    Phi(T)' P Phi(T) < e^(-2 r T) P: like e^(-r t); the same for F + r I.
    """
    stated, stability = design.evidence["rates"], design.evidence["dwell_stability"]
    g, r = number(stated["per_jump"]), time(stated["in_time"])
    demand(0 < g < 1, "a factor per jump is between 0 and 1")
    shrunk = [[a / g for a in row] for row in H]
    faster = total(F, identity(design.n), r)
    for name, own_F, own_H in (("per_jump", F, shrunk), ("in_time", faster, H)):
        own = {"P": stated[f"P_{name}"]} if f"P_{name}" in stated else {}
        prove_stability(design, own_F, own_H, {**stability, **own})
    return f"in a norm per window to at most {float(g)!r} of itself and like e^(-{float(r)!r} t)"


# 9. The verdict ---------------------------------------------------------------------------------


def times_of_samples(design: Design, between: str = "continuously") -> str:
    """When y is measured, in words: `between` jumps if it is continuous, and at jumps."""
    at_jumps = design.has_jumps and design.gains["jump_measurement"] != "none"
    times = [between] * (design.measured == "continuous" and between != "")
    return " and ".join(times + ["at jumps"] * at_jumps) or "at no time"


def prove_design(design: Design) -> List[str]:
    """Prove what this program knows of a design; return sentences: what was proved, what not.

    Only claims that were proved in this run are left out of what was not checked. What the file
    says of its claims (`verdict`) is never read. F + r I has the maps e^(F T) H e^(r T): if their
    products tend to zero, so does e^(r t) e(t).
    """
    sentences, quantity, proved = [], "error", []  # type: Tuple[List[str], str, List[str]]
    F, H = error_maps(design, design.array("M", "np"))
    if design.kind == "interval":
        quantity, (F, H) = "width of the bounds", width_maps(design)
        sentences.append("proved: signs of the bounds, splits to 2^-46 of the largest entry")
        proved += ["flow_positive", "jump_positive"] if H else ["flow_positive"]
    y = f"with y measured {times_of_samples(design)}, without disturbances and noise"
    (low, high), jitter = map(float, design.ends), float(design.jitter)
    end = "inf)" if high == math.inf else f"{high!r}]"
    limit = "" if jitter == math.inf else f" that change by at most {jitter!r} at a time"
    when = f", for every sequence of dwell times in [{low!r}, {end}{limit}" if H else ""
    rate = Fraction(time(design.problem["observer"].get("decay_rate", 0)))
    demand((rate > 0) == ("decay_rate" in design.evidence), "decay_rate: option or claim is alone")
    claims = [("hurwitz" if H is None else "dwell_stability", Fraction(0)), ("decay_rate", rate)]
    for name, shift in claims if rate else claims[:1]:
        shifted, evidence = total(F, identity(design.n), shift), design.evidence[name]
        if H is None:
            prove_hurwitz(shifted, matrices(evidence.get("tails"), "knn", design.n))
        elif "M_cells" in design.gains:
            prove_schedule(design, shifted, evidence)
        else:
            prove_stability(design, shifted, H, evidence)
        proved += [name, "hurwitz"] if high == math.inf else [name]  # late times need both
        decay = f"decays like e^(-{float(shift)!r} t)" if shift else "tends to zero"
        sentences.append(f"proved: {y}, the {quantity} {decay}{when}")
    if H is not None and "rates" in design.evidence and "M_cells" not in design.gains:
        sentences.append("proved: likewise, from jump to jump, " + prove_rates(design, F, H))
        proved.append("rates")
    return [*sentences, f"not checked: {sorted({*design.evidence} - {*proved})!a}, {OTHERS}"]


def main(*paths: str) -> int:
    """Check one design file, print the answer, return the exit code."""
    code = 2
    try:
        demand(len(paths) == 1, f"one design file is due. {__doc__}")
        with open(0 if paths == ("-",) else paths[0], "rb") as file:
            design = Design(file.read().decode("utf-8"))
        code = 1
        print("\n".join(prove_design(design)))
    except Exception as error:  # whatever goes wrong, nothing is proved
        reason = error if isinstance(error, NotProved) else repr(error)
        print("not proved:" if code == 1 else "not read:", reason)
        return code
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
