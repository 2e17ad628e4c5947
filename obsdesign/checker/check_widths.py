#!/usr/bin/env python3
"""Prove again, from a design file alone, how narrow the bounds of its observer become.

    python3 -I -S check_widths.py design.json          ("-" reads standard input)

This file needs nothing but Python >= 3.8 and its standard library. It is meant to be read: each
step states its inequality. It trusts no number of the file that it has not proved, and it prints
what it proved in its own words, and what it did not check. Its reading of files, matrices, balls
and exponentials are those of check_design.py, word for word.

The observer of     x'(t) = A x + b(t)  between jumps,   x(t) = G x(t-) + c  at jumps,   y = C x + v
keeps lower <= x <= upper. The width w = upper - lower, in coordinates z of x = S z, obeys

    w' = W w + f       between jumps      W Metzler (no entry off the diagonal is negative), f >= 0
    w+ = N w- + h      at jumps           N >= 0, h >= 0

and that of x is |S| w. Dwell times T between jumps lie in [low, high]. The claim is about a tube
v > 0, the width just after a jump. Let u' = W u + f from u(0) = v. With

    N u(T) + h < v  and  |S| u(T) < before      for all T in [low, high]
    |S| v <= after  and  |S| u(t) < always      for all t in [0, high]

(entry by entry) the width comes, as jumps go on, to at most `after` just after a jump, `before`
just before one and `always` at any time. For W is Metzler: what starts below u stays below u, and
what starts at m v stays below m u, m >= 1, because f, h >= 0. So if w <= m v after a jump, then
w <= m (N u(T) + h) <= (1 - e) m v after the next one, for an e > 0 that serves for all T (a closed
range is compact; late u(T) are below a z with W z + f <= 0 that has the inequalities, too): m falls
until it is below 1, and then the width stays in the tube. If high = inf, W is proved Hurwitz, too:
where jumps stay away, w tends to -W^-1 f, which is below z.

Without jumps: W v + f < 0. Then W is Hurwitz, since v > 0, and w tends to -W^-1 f <= v.

Not here: whether the gains are those of the problem in the file, which check_gains.py compares.

Exit code 0: proved. 1: not proved (which refutes nothing). 2: not a design that this program reads.
Whatever goes wrong on the way raises an error, and an error never proves anything.
"""

import hashlib
import json
import math
import sys
from fractions import Fraction
from operator import mul
from typing import Any, Callable, Dict, List, NamedTuple, Optional, Sequence, Tuple

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


# 1. Matrices of fractions: exact. A vector is a matrix of one column -----------------------------


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


def column(values: Sequence[Fraction]) -> Matrix:
    """A vector."""
    return [[a] for a in values]


def is_below(X: Matrix, Y: Matrix) -> bool:
    """X < Y, entry by entry."""
    return all(a < b for rows in zip(X, Y) for a, b in zip(*rows))


def is_at_most(X: Matrix, Y: Matrix) -> bool:
    """X <= Y, entry by entry."""
    return all(a <= b for rows in zip(X, Y) for a, b in zip(*rows))


def is_metzler(X: Matrix, slack: Fraction = Fraction(0)) -> bool:
    """Are all entries off the diagonal at least zero, or -slack?"""
    return all(a >= -slack for i, row in enumerate(X) for j, a in enumerate(row) if i != j)


def is_nonnegative(X: Matrix) -> bool:
    """Are all entries at least zero?"""
    return all(a >= 0 for row in X for a in row)


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


def norm(x: List[List[int]]) -> int:
    """The largest sum of absolute values in a row."""
    return max(sum(map(abs, row)) for row in x)


def ball(X: Matrix) -> Ball:
    """A ball that holds an exact matrix: entries are rounded down, by less than one unit."""
    return Ball([[(a.numerator << BITS) // a.denominator for a in row] for row in X], 1)


def upper_ends(X: Ball) -> Matrix:
    """The upper ends of the entries of a ball."""
    return [[Fraction(a + X.radius, 1 << BITS) for a in row] for row in X.x]


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


# 4. Upper bounds of a positive system for a range of times ---------------------------------------


class Path:
    """X u(t) < (1, ..., 1)' for a range of t, where u' = W u + f from u(0) = start.

    W Metzler, f >= 0, start >= 0, X >= 0. y = (u, 1) obeys y' = Z y, and a ball holds y(t). W, f
    and times are in the units of the flow.
    """

    def __init__(self, W: Matrix, f: Matrix, start: Matrix) -> None:
        is_positive = is_metzler(W) and is_nonnegative(f) and is_nonnegative(start)
        demand(is_positive, "the system is not positive")
        self.remainders: Dict[Fraction, Matrix] = {}
        self.start, zeros = start, [[Fraction(0)] * (len(W) + 1)]
        self.flow = Flow(ball([row + a for row, a in zip(W, f)] + zeros))
        self.W, self.f = ([[a / self.flow.speed for a in row] for row in X] for X in (W, f))

    def prove(self, X: Matrix, ends: Range) -> None:
        """Prove X u(t) < (1, ..., 1)' for all t of a range, or raise NotProved."""
        demand(is_nonnegative(X), "the system is not positive")
        self.X, self.remainders = X, {}
        self.resting = [resting_point(self.W, self.f, X, self.start)] if ends[1] == math.inf else []
        y = ball([*self.start, [Fraction(1)]])
        self.flow.prove_range(y, ends, self.holds_from, self.advance)

    def holds_from(self, y: Ball) -> bool:
        """Certify X u < 1 at all later times: u <= z, W z + f <= 0 and X z < 1.

        Such a z bounds all later u: the solution from z falls. z may be u itself.
        """
        u = upper_ends(y)[:-1]
        return any(
            is_at_most(u, z)
            and all(a <= 0 for (a,) in total(product(self.W, z), self.f))
            and all(a < 1 for (a,) in product(self.X, z))
            for z in [u, *self.resting]
        )

    def advance(self, y: Ball, length: Fraction) -> Fraction:
        """Prove [0, s] from u on, s = length / 2^k, for the rest of time or by a box; return s."""
        if self.holds_from(y):
            return length
        W, X = ball(self.W), ball(self.X)
        derivatives = [Ball(y.x[:-1], y.radius)]  # u, W u + f, W (W u + f), W^2 (W u + f), ...
        derivatives.append(W.times(derivatives[0]).plus(ball(self.f)))
        while len(derivatives) < DEGREE + 2:
            derivatives.append(W.times(derivatives[-1]))
        rows, last = [X.times(each) for each in derivatives[:-1]], derivatives[-1]
        size = upper_ends(Ball([[abs(a) for a in entry] for entry in last.x], last.radius))
        h = length
        for _ in range(MOST_HALVINGS if all(a < 1 for (a,) in upper_ends(rows[0])) else 0):
            if self.is_box(rows, size, h):
                return h
            h /= 2
        raise NotProved("the inequality fails, or nearly fails, at some time in the range")

    def is_box(self, rows: List[Ball], last: Matrix, h: Fraction) -> bool:
        """Certify X u(t + s) < 1 for all s in [0, h].

        rows: X u, X u', X u'', ... at t, up to the derivative d = DEGREE; last >= |u^(d+1)(t)|.
        X u(t + s) is sum_k s^k / k! X u^(k), k <= d, plus a remainder (`remainder_map`). A
        polynomial sum_k a_k (s/h)^k is on [0, h] an average of its Bernstein coefficients
        sum_{k<=i} C(i,k) / C(d,k) a_k, i = 0 .. d, here with a_k = h^k / k! X u^(k).
        """
        if not h:  # the range is one time, where `advance` has tested it
            return True
        if h not in self.remainders:
            self.remainders[h] = self.remainder_map(h)
        if not self.remainders[h]:
            return False
        room = [[1 - a] for (a,) in product(self.remainders[h], last)]
        a = [X.scaled(h**k / math.factorial(k)) for k, X in enumerate(rows)]
        for i in range(DEGREE, -1, -1):
            coefficient = a[0]
            for k in range(1, i + 1):
                weight = Fraction(math.comb(i, k), math.comb(DEGREE, k))
                coefficient = coefficient.plus(a[k].scaled(weight))
            if not is_below(upper_ends(coefficient), room):
                return False
        return True

    def remainder_map(self, h: Fraction) -> Matrix:
        """K with: the Taylor remainder of X u on [0, h] is at most K last; empty if none is known.

        It is the integral of (s - r)^d / d! X u^(d+1)(t + r) over r in [0, s], s <= h, d = DEGREE,
        where u^(d+1)(t + r) = e^(W r) u^(d+1)(t) is at most e^(W r) last: e^(W r) >= 0. If
        R = (I/h - W)^-1 >= 0, then e^(W r - r/h) R last >= 0 has the slope -e^(W r - r/h) last:
        the integral of this over [0, h] is at most R last, that of e^(W r) last at most e R last.
        So K = 3 h^d / d! X R, rounded up. (If R is not >= 0, the flow grows: h is too long.)
        """
        unit = identity(len(self.W))
        shifted = difference([[a / h for a in row] for row in unit], self.W)
        rows, pivots = echelon([a + b for a, b in zip(shifted, unit)])
        R = [row[len(unit) :] for row in rows]
        if pivots != [*range(len(unit))] or not is_nonnegative(R):
            return []
        factor = 3 * h**DEGREE / math.factorial(DEGREE)
        return upper_ends(ball([[factor * a for a in row] for row in product(self.X, R)]))


def resting_point(W: Matrix, f: Matrix, X: Matrix, start: Matrix) -> Matrix:
    """z with W z + f < 0 and X z < (1, ..., 1)', for a Hurwitz W; NotProved if there is none.

    A Metzler W is Hurwitz if and only if p = -W^-1 b > 0 for a b > 0. With e = -W^-1 f, to which u
    tends, z = e + c p has W z + f = -c b, and any c > 0 with X z < 1 serves. b has the shape of the
    start, so that u is soon below z.
    """
    minus_W, b = difference(difference(W, W), W), [[a + Fraction(1, 2**20)] for (a,) in start]
    p, e = solution(minus_W, b), solution(minus_W, f)
    demand(all(a > 0 for (a,) in p), "the flow is not proved to decay")
    pairs = list(zip(product(X, e), product(X, p)))
    demand(all(a < 1 for (a,), _ in pairs), "what the flow tends to is too large")
    c = min(((1 - x) / y / 2 for (x,), (y,) in pairs if y), default=Fraction(1))
    return total(e, p, c)


# 5. Reading a design -----------------------------------------------------------------------------

# the entries that each block of a problem may have; plants with others are not checked
PROBLEM = {
    "flow": "A B D d_bounds disturbance disturbance_matrix input_bound",
    "jump": "G E H disturbance disturbance_matrix dwell_time dwell_jitter input_bound",
    "output": "C noise_bound noise_std noise_cv measured period jump_measurement",
}


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
    proposed, nothing that is believed; ends: of the dwell times.
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
        known = {"name", "names", "observer", *PROBLEM}
        demand({*self.problem} <= known, "plants with other blocks are not checked")
        for place, names in PROBLEM.items():
            unknown = {*self.problem.get(place, {})} - {*names.split()}
            demand(not unknown, f"{place}: {sorted(unknown)} is not known to this program")
        self.measured = self.problem["output"]["measured"]
        demand(self.measured in ("continuous", "at_jumps"), "y is measured at other times")
        self.has_jumps = "G" in self.gains
        demand(self.has_jumps == ("jump" in self.problem), "problem and gains differ about jumps")
        self.evidence = keys_once([(entry["id"], entry["evidence"]) for entry in body["claims"]])
        stability = [name for name in ("dwell_stability", "decay_rate") if name in self.evidence]
        self.vectors = [name for name in stability if "vector" in self.evidence[name]]
        has_width = self.kind == "interval" and bool({"width", "sampled_width"} & {*self.evidence})
        demand("M_cells" not in self.gains, "gains by cells of dwell times are not checked")
        demand(has_width or self.vectors != [], "neither a width is claimed nor a vector proposed")
        self.sizes: Dict[str, int] = {}
        self.n = len(self.array("A", "nn"))
        self.ends = interval(self.gains["dwell_time"] if self.has_jumps else [0, "inf"])

    def array(self, name: str, shape: str) -> Any:
        """A stored gain, exact."""
        return array(self.gains[name], shape, self.sizes)

    def disturbance(self, prefix: str, letter: str) -> Tuple[Matrix, Matrix]:
        """(X, widths) of a disturbance X d, where d is in a box of these widths."""
        X, place = identity(self.n), {"": "flow", "jump_": "jump"}[prefix]
        if f"{prefix}disturbance_matrix" in self.gains:
            X, place = (
                self.array(f"{prefix}disturbance_matrix", f"n{letter}"),
                f"{prefix}disturbance",
            )
        else:
            letter = "n"
        low, high = (column(self.array(f"{place}_{end}", letter)) for end in ("lower", "upper"))
        demand(is_at_most(low, high), "bounds cross")
        return X, difference(high, low)

    def noise(self, gain: Matrix) -> Matrix:
        """2 |gain| V: what noise |v| <= V, around its centre, adds to the width."""
        V = column(self.array("noise_bound", "p"))
        demand(is_nonnegative(V), "a bound of the noise is negative")
        return product(absolute(gain), total(V, V))


# 6. The system of the width ----------------------------------------------------------------------


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


class System(NamedTuple):
    """w' = W w + f between jumps, w+ = N w- + h at them; without jumps N and h are empty.

    The width of x = S z is out w, out = |S|. For F = D0 - D1, D0 Metzler, D1 >= 0, bounds of z
    follow upper' = D0 upper - D1 lower + .., lower' = D0 lower - D1 upper + ..: W = D0 + D1.
    """

    W: Matrix
    f: Matrix
    N: Matrix
    h: Matrix
    out: Matrix


def in_units(X: Matrix, rows: Matrix, columns: Matrix) -> Matrix:
    """X_ij columns_j / rows_i: the same map, of vectors that are measured in these units."""
    return [[a * c / r for a, (c,) in zip(row, columns)] for row, (r,) in zip(X, rows)]


def width_system(design: Design) -> System:
    """The system of the width, and the signs that it rests on.

    With F, H in coordinates x = S z:  cooperative: F Metzler, H >= 0;  split, coordinates:
    F = D0 - D1, H = Gp - Gn;  two_coordinates, x = S2 z2 at jumps: F Metzler, S2^-1 H S2 = T >= 0,
    and what maps widths from S to S2 and back are |S2^-1 S| and |S^-1 S2|. An input X d, d in a box
    of widths b, adds |S^-1 X| b, and noise that a gain L takes in adds 2 |S^-1 L| V.
    """
    form, unit = design.gains["form"], identity(design.n)
    has_two, is_cooperative = form == "two_coordinates", form == "cooperative"
    needed = {"cooperative": "", "split": "", "coordinates": "S", "two_coordinates": "S S2 T"}[form]
    fits = {"S", "S2", "T", "M_cells"} & {*design.gains} == {*needed.split()}
    demand(fits, "the gains are not those of their form")
    S = design.array("S", "nn") if needed else unit
    S2 = design.array("S2", "nn") if has_two else S
    L, M = design.array("L", "np"), design.array("M", "np")
    F, H = error_maps(design, M)
    F, D0, D1 = solution(S, product(F, S)), design.array("D0", "nn"), design.array("D1", "nn")
    slack = largest(F) / 2**46 if has_two else Fraction(0)  # D1 holds what is below zero
    is_signed = is_metzler(F, slack) and not (is_cooperative and largest(D1))
    demand(is_signed or form in ("split", "coordinates"), "the flow of the error is not Metzler")
    demand(is_metzler(D0), "D0 is not Metzler")
    W, (X, box) = width_map(F, D0, D1), design.disturbance("", "b")
    f = total(product(absolute(solution(S, X)), box), design.noise(solution(S, L)))
    if H is None:
        return System(W, f, [], [], absolute(S))
    H, plus = solution(S2, product(H, S2)), design.array("T" if has_two else "Gp", "nn")
    minus = difference(plus, plus) if has_two else design.array("Gn", "nn")
    is_signed = is_nonnegative(H) and not largest(minus)
    demand(is_signed or not is_cooperative, "the jump of the error is not nonnegative")
    demand(is_nonnegative(plus), "a stored split of the jump has a wrong sign")
    N, (X, box) = width_map(H, plus, minus), design.disturbance("jump_", "c")
    if design.gains["jump_measurement"] == "after":  # the correction acts on c as well
        X = difference(X, product(M, product(design.array("C", "pn"), X)))
    demand(design.gains["jump_measurement"] != "none" or not largest(M), "M acts on nothing")
    h = total(product(absolute(solution(S2, X)), box), design.noise(solution(S2, M)))
    there, back = absolute(solution(S2, S)), absolute(solution(S, S2))
    return System(W, f, product(back, product(N, there)), product(back, h), absolute(S))


def with_samples(design: Design, system: System, v: Matrix, limit: Fraction) -> System:
    """The system of the width if y is known at samples alone, at most `limit` apart.

    Between samples y is bounded by what the plant makes of the box at the sample, of width r(0):
    r' = Mz(A) r + d for the width of its prediction, Mz: absolute values off the diagonal; and
    s' = |C A| r + |C| d, s(0) = 0, for the width of C x - C x(sample), d the part of f that is no
    noise. It enters as |L| s. At the time t <= limit after the sample, s is at most
    s1 r(0) + s0, for limit too, since both grow. For the path u from w(0), which bounds w,
    r(0) = u(0) <= e^(-W_ii t) u(t), entry by entry, since u' >= W_ii u. So, with
    e_i = e^(-min(W_ii, 0) limit),

        u' <= W u + f + |L| (s1 diag(e) u + s0).

    (With the sample at the end of a step in place of its start, s(limit) - s(t) enters, no more.)
    A jump ends a step; where M acts it has a sample of its own.
    All in coordinates z: A, C, L stand for S^-1 A S, C S, S^-1 L; w, r are measured in units of v,
    and each s in units in which it is of the size of r.
    """
    n, S = design.n, design.array("S", "nn") if "S" in design.gains else identity(design.n)
    A, C = solution(S, product(design.array("A", "nn"), S)), product(design.array("C", "pn"), S)
    X, box = design.disturbance("", "b")
    d, L = product(absolute(solution(S, X)), box), absolute(solution(S, design.array("L", "np")))
    metzler = [[a if i == j else abs(a) for j, a in enumerate(row)] for i, row in enumerate(A)]
    r_columns, ones = [*v, [Fraction(1)]], column([Fraction(1)] * len(C))
    r = in_units([row + a for row, a in zip(metzler, d)], v, r_columns)
    pairs = zip(absolute(product(C, A)), product(absolute(C), d))
    s = in_units([row + a for row, a in pairs], ones, r_columns)
    units = column([limit * largest([row]) or Fraction(1) for row in s])
    s = in_units(s, units, column([Fraction(1)] * (n + 1)))
    zeros = [Fraction(0)] * len(C)
    Z = [row[:n] + zeros + row[n:] for row in r + s] + [[Fraction(0)] * (n + 1) + zeros]
    E, L = upper_ends(exponential(ball(Z).scaled(limit)))[n:-1], in_units(L, v, units)
    slow = [
        [-min(a, Fraction(0)) if i == j else Fraction(0) for j, a in enumerate(row)]
        for i, row in enumerate(system.W)
    ]
    late = product([row[:n] for row in E], upper_ends(exponential(ball(slow).scaled(limit))))
    W, f = total(system.W, product(L, late)), total(system.f, product(L, [row[-1:] for row in E]))
    return system._replace(W=W, f=f)


# 7. Widths, and vectors that prove stability -----------------------------------------------------


def prove_width(design: Design, system: System, evidence: Table, limit: Time) -> str:
    """Prove the widths that a claim states; return them in words.

    limit: of the times between samples; infinite where those are not used, or y is continuous.
    Widths z_j are measured in units of the largest that `always` allows, min_i always_i / |S_ij|.
    """
    n, unit, columns = design.n, [[Fraction(1)]], transposed(system.out)
    v, always = vectors(evidence, "tube always", n)
    demand(all(a > 0 for (a,) in v + always), "the tube, or a bound, is not positive")
    size = column([min(a / b for (a,), b in zip(always, each) if b) for each in columns])
    W, N, out = in_units(system.W, size, size), in_units(system.N, size, size), system.out
    f, h, v = (in_units(x, size, unit) for x in (system.f, system.h, v))
    system = System(W, f, N, h, in_units(out, column([Fraction(1)] * n), size))
    if limit < math.inf:
        system = with_samples(design, system, size, limit)
    W, f, N, h, out = system
    if not N:
        demand(all(a < 0 for (a,) in total(product(W, v), f)), "W v + f < 0 fails")
        demand(is_at_most(product(out, v), always), "the bound is below the tube")
        return f"the width comes to at most {listed(always)}"
    after, before = vectors(evidence, "after_jump before_jump", n)
    demand(is_nonnegative(h), "the jump of the width is not nonnegative")
    demand(is_at_most(product(out, v), after), "the bound after jumps is below the tube")
    ones = column([Fraction(1)] * n)
    room = difference(v, h)  # N u < v - h
    demand(all(a > 0 for (a,) in room + before), "the jump leaves the tube, or a bound is 0")
    path, stated = Path(W, f, v), evidence.get("constant_dwell", [])
    jumps = in_units(N, room, ones)
    path.prove(jumps + in_units(out, before, ones), design.ends)
    path.prove(in_units(out, always, ones), (Fraction(0), design.ends[1]))
    constant = [prove_constant_dwell(system, design.ends, row) for row in stated]
    return (
        f"the width comes, as jumps go on, to at most {listed(after)} after a jump, "
        f"{listed(before)} before one and {listed(always)} at any time" + "".join(constant)
    )


def prove_constant_dwell(system: System, ends: Range, row: Table) -> str:
    """Widths that one dwell time T leads to, before and after jumps and on average, in words.

    In units of T, (u, 1, m) with m' = u turns (a, 1, 0) into (E a + g, 1, K a + k). Before jumps
    the width tends to the solution of w = E (N w + h) + g, since products of E N vanish (the tube).
    Larger E, g, upper ends, make it larger: to b >= 0 with E (N b + h) + g = b, from where
    w = E (N w + h) + g never leads above b. The average over T
    is at most K (N b + h) + k.
    """
    W, f, N, h, out = system
    n, T = len(W), time(row["dwell_time"])
    demand(ends[0] <= T <= ends[1] and 0 < T < math.inf, "a constant dwell time is out of range")
    Z = [[a * T for a in r + b] + [Fraction(0)] * n for r, b in zip(W, f)]
    Z += [[Fraction(0)] * (2 * n + 1)] + [r + [Fraction(0)] * (n + 1) for r in identity(n)]
    whole = upper_ends(exponential(ball(Z)))
    E, g = [r[:n] for r in whole[:n]], [r[n : n + 1] for r in whole[:n]]
    b = solution(difference(identity(n), product(E, N)), total(product(E, h), g))
    demand(is_nonnegative(b), "no limit of the width was shown")
    after = total(product(N, b), h)
    mean = product([r[: n + 1] for r in whole[n + 1 :]], [*after, [Fraction(1)]])
    stated = vectors(row, "before_jump after_jump mean", n)
    for limit, bound in zip((b, after, mean), stated):
        demand(is_at_most(product(out, limit), bound), "a width at a constant dwell time is larger")
    before, later, average = map(listed, stated)
    return (
        f"; if all dwell times are {float(T)!r}, {later} after a jump, {before} before one and "
        f"{average} on average"
    )


def prove_vector(F: Matrix, H: Matrix, ends: Range, evidence: Table) -> None:
    """Stability by one vector v > 0, for F Metzler and H >= 0: with M = e^(F T) H, or H e^(F T),

    v' M < v' (left), or M v < v (right), for all T. So products of M shrink v' x, or the largest
    x_i / v_i, for every x >= 0. In units of v: a path from (1, ..., 1)', or from H (1, ..., 1)'.
    """
    v = column(array(evidence["vector"], "n", {"n": len(F)}))
    left = {"left": True, "right": False}[evidence["side"]]
    before = {"before_jump": True, "after_jump": False}[evidence["form"]]
    demand(all(a > 0 for (a,) in v), "the vector is not positive")
    if left:  # the transposed inequality: M' v < v
        F, H = transposed(F), transposed(H)
    F, H, ones = in_units(F, v, v), in_units(H, v, v), column([Fraction(1)] * len(F))
    demand(is_nonnegative(H), "the jump is not nonnegative")
    start, X = (ones, H) if left == before else (product(H, ones), identity(len(F)))
    Path(F, difference(ones, ones), start).prove(X, ends)


def vectors(evidence: Table, names: str, n: int) -> List[Matrix]:
    """Vectors of a certificate."""
    return [column(array(evidence[name], "n", {"n": n})) for name in names.split()]


def listed(v: Matrix) -> str:
    """A vector of the file, as text."""
    return "(" + ", ".join(repr(float(a)) for (a,) in v) + ")"


# 8. The verdict ----------------------------------------------------------------------------------


def times_of_samples(design: Design, between: str = "continuously") -> str:
    """When y is measured, in words: `between` jumps if it is continuous, and at jumps."""
    at_jumps = design.has_jumps and design.gains["jump_measurement"] != "none"
    times = [between] * (design.measured == "continuous" and between != "")
    return " and ".join(times + ["at jumps"] * at_jumps) or "at no time"


def prove_design(design: Design) -> List[str]:
    """Prove what this program knows of a design; return sentences: what was proved, what not.

    Only claims that were proved in this run are left out of what was not checked. F + r I has the
    maps e^(F T) H e^(r T): if their products tend to zero, so does e^(r t) e(t).
    """
    sentences, proved, quantity = [], [], "error"  # type: Tuple[List[str], List[str], str]
    F, H = error_maps(design, design.array("M", "np"))
    y = f"with y measured {times_of_samples(design)}"
    low, high = map(float, design.ends)
    end = "inf)" if high == math.inf else f"{high!r}]"
    when = f", for every sequence of dwell times in [{low!r}, {end}" if H else ""
    if design.kind == "interval":
        system, quantity = width_system(design), "width of the bounds"
        F, H = system.W, system.N
        sentences.append("proved: signs of the bounds, splits to 2^-46 of the largest entry")
        proved += ["flow_positive", "jump_positive"] if H else ["flow_positive"]
        if "width" in design.evidence:
            widths = prove_width(design, system, design.evidence["width"], math.inf)
            sentences.append(f"proved: {y}, {widths}{when}")
        if "sampled_width" in design.evidence:
            limit = step_limit(design, design.evidence["sampled_width"])
            widths = prove_width(design, system, design.evidence["sampled_width"], limit)
            apart = f"at most {float(limit)!r} apart" if limit < math.inf else ""
            at = times_of_samples(design, apart)
            sentences.append(f"proved: with samples {at}, {widths}{when}")
        proved += ["width", "sampled_width"]
    rate = Fraction(time(design.problem["observer"].get("decay_rate", 0)))
    demand((rate > 0) == ("decay_rate" in design.evidence), "decay_rate: option or claim is alone")
    for claim, shift in (("dwell_stability", Fraction(0)), ("decay_rate", rate)):
        if claim in design.vectors:
            shifted = total(F, identity(design.n), shift)
            demand(H is not None and H != [], "a vector is proved over jumps")
            prove_vector(shifted, H or [], design.ends, design.evidence[claim])
            decay = f"decays like e^(-{float(shift)!r} t)" if shift else "tends to zero"
            quiet = f"{y}, without disturbances and noise"
            sentences.append(f"proved: {quiet}, the {quantity} {decay}{when}")
            proved += [claim, "hurwitz"] if high == math.inf else [claim]
    others = ascii(sorted({*design.evidence} - {*proved}))
    return [*sentences, f"not checked: {others}, {OTHERS}"]


def step_limit(design: Design, evidence: Table) -> Time:
    """The longest time between samples that a claim is about; infinite if L = 0 uses none."""
    demand(design.measured == "continuous", "samples are those of a continuous y")
    stated = evidence["step_limit"]
    limit, own = time(stated), time(design.gains.get("step_limit", stated))
    demand(0 < limit == own, "the step limit is not that of the gains")
    demand(limit < math.inf or not largest(design.array("L", "np")), "L needs a step limit")
    return limit


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
