#!/usr/bin/env python3
"""Prove again, from a design file alone, how narrow set-membership bounds become.

    python3 -I -S check_sets.py design.json          ("-" reads standard input)

This file needs nothing but Python >= 3.8 and its standard library. It is meant to be read: each
step states its inequality. It trusts no number of the file that it has not proved, and it prints
what it proved in its own words, and what it did not check. Its reading of files, balls and
exponentials are those of check_events.py, word for word.

The plant:  x' = A x + B u + b, or x+ = A x + B u + b in discrete time;  x+ = G x + E w + c at a
jump;  y = C x + v at a sample. b = X w with w in a box, likewise c, and v in a box of half widths
V. A stage is a step of time or a jump, which a sample may follow.

Bounds by multipliers. Of l'x at the end of a window of stages: let p = l there and, backwards
through its stages, with any mu_k where a sample follows stage k, and none where none does,

    q = p - C' mu_k,    then  p <- e^(A'h) q,  or A'^m q in m steps of discrete time,  or G' q.

As p'x = q'x + mu'(C x) and C x = y - v, every l'x lies within a number that y, u and the middles
of all boxes determine, and what is left of it: on either side at most

    |p|' r + sum of |mu_k|' V + s(q),        p: at the start of the window

r: half the width of the box in which x is known to be at that start; s(q): what the disturbance of
a stage adds along q, as the observer bounds it (section 4). So the upper bound by mu and the lower
bound by -mu, with the same numbers from the data, are at most 2 (|p|' r + ...) apart. The design
stores a mu for each entry of x and each window of its pattern; the observer evaluates them beside
any others, and keeps the narrower bounds.

A tube. Half widths after row j of the pattern are at most M r + k, M >= 0, k >= 0, r those after an
earlier row. Where v > 0 has M v + k < v at all rows, they come below v as time goes on: let m >= 1
be the largest ratio of r to v in one turn of the pattern. Then M m v + k <= m (M v + k)
<= m (1 - e) v with one e > 0 for all rows, so that the next ratio is at most the larger of 1 and
m (1 - e).

No narrower. Disturbances of at most their half widths, from e = 0, lead to an e at the end of a
window with |C e| <= V at all samples. Added to any trajectory without noise, at the middle of all
boxes, e and -e have the same samples, with v = -C e or C e: bounds that hold contain both.

Exit code 0: proved. 1: not proved (which refutes nothing). 2: not a design that this program reads.
Whatever goes wrong on the way raises an error, and an error never proves anything.
"""

import hashlib
import json
import math
import sys
from fractions import Fraction
from operator import mul
from typing import Any, Dict, List, NamedTuple, Sequence, Set, Tuple

Matrix = List[List[Fraction]]
Vector = List[Fraction]
Table = Dict[str, Any]
Time = Any  # a Fraction, or math.inf
Range = Tuple[Time, Time]  # (shortest, longest)
Box = Tuple[Matrix, Vector, Vector]  # X, lower, upper: X w, lower <= w <= upper

BITS = 512  # balls count in units of 2^-BITS
MOST_STEPS = 120
MOST_COUNTED = 32
NEAR = Fraction(1, 10**9)  # dwell times are multiples of the period up to this part of them


class NotProved(Exception):
    """The reason for which something is not proved."""


def demand(condition: bool, reason: str) -> None:
    """NotProved unless the condition holds."""
    if not condition:
        raise NotProved(reason)


# 1. Balls: matrices of integers in units of 2^-BITS, with one radius -----------------------------


def transposed(X: Sequence[Sequence[Any]]) -> List[List[Any]]:
    """X'."""
    return [list(column) for column in zip(*X)]


def identity(n: int) -> Matrix:
    """The unit matrix."""
    return [[Fraction(i == j) for j in range(n)] for i in range(n)]


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


def magnitude(X: Ball) -> Ball:
    """|X|, entry by entry."""
    return Ball([[abs(a) for a in row] for row in X.x], X.radius)


def part(X: Ball, first: int, last: int) -> Ball:
    """Columns of X from first up to last, this one not included."""
    return Ball([row[first:last] for row in X.x], X.radius)


def side_by_side(parts: Sequence[Ball]) -> Ball:
    """[X, Y, ...]: one radius, the largest."""
    rows = [[a for row in rows for a in row] for rows in zip(*(X.x for X in parts))]
    return Ball(rows, max(X.radius for X in parts))


def dot(row: Sequence[Fraction], y: Vector) -> Fraction:
    """The sum of products."""
    return sum(map(mul, row, y), Fraction(0))


def sizes_of(X: Matrix) -> Matrix:
    """|X|, entry by entry."""
    return [[abs(a) for a in row] for row in X]


# 2. Reading a design -----------------------------------------------------------------------------

# the entries that each block of a problem may have; plants with others are not checked
PROBLEM = {
    "flow": "A B D d_bounds disturbance disturbance_matrix dt input_bound",
    "jump": "G E disturbance disturbance_matrix dwell_time dwell_jitter input_bound",
    "output": "C noise_bound noise_std noise_cv measured period jump_measurement",
    "observer": "kind gains window steps fixed_lag directions",
}
GAINS = (
    "A B C D E G d_lower d_upper directions disturbance_lower disturbance_matrix disturbance_upper "
    "dt dwell_jitter dwell_time fixed_lag flow_lower flow_upper jump_disturbance_lower jump_lower "
    "jump_disturbance_matrix jump_disturbance_upper jump_measurement jump_upper measured period "
    "multipliers noise_bound noise_centre steps window"
)


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
    """A design that is unchanged since it was signed: a plant, the same in problem and gains.

    evidence: of each claim, by its id; widths and trajectories that are proposed.
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
        demand(is_design and body["kind"] == "set_membership", "no design of this kind")
        self.gains, self.problem = body["gains"], body["problem"]
        is_named = type(body["name"]) is str and body["name"] == self.problem["name"]
        demand(is_named, "the design and its problem have different names")
        demand({*self.problem} <= {"name", "names", *PROBLEM}, "a block is not known")
        for place, names in PROBLEM.items():
            unknown = {*self.problem.get(place, {})} - {*names.split()}
            demand(not unknown, f"{place}: {sorted(unknown)} is not known to this program")
        unknown = {*self.gains} - {*GAINS.split()}
        demand(not unknown, f"gains: {sorted(unknown)} is not known to this program")
        bounds = self.problem["flow"].get("d_bounds", {})
        demand({*bounds} <= {"lower", "upper"}, "an unknown input of bounded rate is not checked")
        self.evidence = keys_once([(entry["id"], entry["evidence"]) for entry in body["claims"]])
        demand("width" in self.evidence, "no width is claimed")

    def read(self) -> None:
        """Read the plant; NotProved where problem and gains differ."""
        gains, flow = self.gains, self.problem["flow"]
        jump, output = self.problem.get("jump", {}), self.problem["output"]
        self.sizes: Dict[str, int] = {}
        self.A = self.same(flow, "A", "nn")
        self.C, self.n = self.same(output, "C", "pn"), self.sizes["n"]
        self.same(flow, "B", "nm")
        self.G = self.same(jump, "G", "nn")
        self.same(jump, "E", "nl")
        demand(("jump" in self.problem) == (self.G is not None), "G is missing")
        self.dt = self.same(flow, "dt", "")
        self.b = self.disturbance(flow, "", "flow_")
        self.add_unknown_input(flow)
        self.c = self.disturbance(jump, "jump_", "jump_") if jump else ([], [], [])
        self.V = self.noise(output)
        self.period = self.same(output, "period", "")
        self.words = [gains["measured"], gains["jump_measurement"]]
        same = self.words == [output["measured"], output["jump_measurement"]]
        demand(same, "gains.measured or gains.jump_measurement is another")
        self.dwell = interval(jump.get("dwell_time", [0, "inf"]))
        demand(interval(gains.get("dwell_time", [0, "inf"])) == self.dwell, "dwell_time is another")
        jitter = [time(block.get("dwell_jitter", "inf")) for block in (jump, gains)]
        demand(jitter[0] == jitter[1], "gains.dwell_jitter is another")
        self.read_options(self.problem["observer"])
        self.change_units([Fraction(a) for a in units([self.A, self.G or self.A])])

    def change_units(self, scales: Vector) -> None:
        """Describe the plant by z with z_i = scale_i x_i: powers of two, so that balls keep bits.

        A multiplier of the bound of z_i is scale_i times that of x_i.
        """
        self.scales = scales
        for X in filter(None, (self.A, self.G)):
            X[:] = [[s * a / t for a, t in zip(row, scales)] for s, row in zip(scales, X)]
        self.C = [[a / s for a, s in zip(row, scales)] for row in self.C]
        for X, _, _ in (self.b, self.c):
            X[:] = [[s * a for a in row] for s, row in zip(scales, X)]
        self.multipliers: List[Any] = [
            [[[s * a for a in mu] for mu in stages] for s, stages in zip(scales, window)]
            for window in self.stored
        ]

    def same(self, block: Table, name: str, shape: str) -> Any:
        """An entry of the problem, None without one; NotProved where that of gains is another."""
        if name not in block:
            demand(name not in self.gains, f"gains.{name} is not due")
            return None
        value = array(block[name], shape, self.sizes)
        demand(array(self.gains[name], shape, self.sizes) == value, f"gains.{name} is another")
        return value

    def disturbance(self, block: Table, prefix: str, ends: str) -> Box:
        """The disturbance of a block, as the gains have it; NotProved where they differ.

        Stored bounds lower <= X w of an image are rounded outward, by less than 2^-40 of its terms.
        """
        sizes = {"n": self.n}
        is_plain = "disturbance_matrix" not in block
        X = identity(self.n) if is_plain else array(block["disturbance_matrix"], "nb", sizes)
        sizes["b"] = len(X[0])
        lower, upper = (array(block["disturbance"][end], "b", sizes) for end in ("lower", "upper"))
        demand(all(low <= high for low, high in zip(lower, upper)), "bounds cross")
        stored = [f"{prefix}disturbance_{name}" for name in ("matrix", "lower", "upper")]
        if is_plain:
            demand(not {*stored} & {*self.gains}, f"gains.{prefix}disturbance_ is not due")
        for name, shape, value in zip(
            stored, ("nb", "b", "b"), () if is_plain else (X, lower, upper)
        ):
            demand(array(self.gains[name], shape, sizes) == value, f"gains.{name} is another")
        image = [array(self.gains[f"{ends}{end}"], "n", sizes) for end in ("lower", "upper")]
        for row, low, high in zip(X, *image):
            products = [(a * c, b * c) for c, a, b in zip(row, lower, upper)]
            slack = 0 if is_plain else sum(max(abs(a), abs(b)) for a, b in products) / 2**40
            fits = 0 <= sum(map(min, products)) - low <= slack
            fits = fits and 0 <= high - sum(map(max, products)) <= slack
            demand(fits, f"gains.{ends}lower or upper does not hold the disturbance")
        return X, lower, upper

    def add_unknown_input(self, flow: Table) -> None:
        """Put the columns of D beside those of b; NotProved where gains have others."""
        D = self.same(flow, "D", "nq")
        demand((D is None) == ("d_bounds" not in flow), "an unknown input has no bounds")
        for k, end in enumerate(("lower", "upper") if D else ()):
            bounds = array(flow["d_bounds"][end], "q", self.sizes)
            same = array(self.gains[f"d_{end}"], "q", self.sizes) == bounds
            demand(same, f"gains.d_{end} is another")
            self.b[1 + k].extend(bounds)
        demand(all(low <= high for low, high in zip(*self.b[1:])), "bounds cross")
        for row, own in zip(self.b[0], D or []):
            row.extend(own)

    def noise(self, output: Table) -> Vector:
        """V with |v - centre| <= V, as stored; NotProved unless it is the noise of the problem.

        A centre is rounded, and V for it is rounded up: by less than 2^-40.
        """
        stated, sizes = output["noise_bound"], self.sizes
        for name in ("noise_std", "noise_cv"):
            demand(min(array(output[name], "p", sizes)) >= 0, f"output.{name} is negative")
        if any(type(entry) is list for entry in stated):
            pairs = array(stated, "p2", {**sizes, "2": 2})
        else:
            pairs = [[-b, b] for b in array(stated, "p", sizes)]
        V = array(self.gains["noise_bound"], "p", sizes)
        centre = array(self.gains.get("noise_centre", [0.0] * len(V)), "p", sizes)
        self.least_V = [(high - low) / 2 for low, high in pairs]
        for (low, high), c, r in zip(pairs, centre, V):
            slack = 0 if low == -high else max(abs(low), abs(high)) / 2**40
            fits = low <= high and c - r <= low and high <= c + r and 2 * r <= high - low + slack
            demand(fits, "gains.noise_bound does not hold the noise")
        return V  # type: ignore[no-any-return]

    def read_options(self, observer: Table) -> None:
        """The window and its multipliers; NotProved where options are those of another problem."""
        gains, sizes = self.gains, dict(self.sizes)
        self.window = gains["window"]
        demand(type(self.window) is int and self.window > 0, "gains.window must be a number")
        demand(observer["kind"] == "set_membership", "problem.observer.kind is another")
        stated = {"window": self.window, "steps": 20, **observer}
        for name in ("window", "steps", "fixed_lag", "directions"):
            same = json.dumps(gains.get(name)) == json.dumps(stated.get(name))
            demand(same, f"gains.{name} is another")
        self.stored = array(gains["multipliers"], "znwp", {**sizes, "w": self.window})


# 3. The pattern: samples every period, jumps as early as they may come ---------------------------


class Step(NamedTuple):
    """A time h, or a jump (h = 0); a sample after it; the end of a row."""

    h: Fraction
    jump: bool
    sampled: bool
    ends_row: bool


class Pattern:
    """Steps of one cycle, which repeats itself: those that the observer's design is made for.

    A sample every period and a jump at the first one after the shortest dwell time, or one at every
    shortest dwell time where y is known at jumps alone. A sample in the row of a jump is one before
    it, or after it, or none: then at least one falls between two jumps.
    """

    def __init__(self, design: Design) -> None:
        measured, when = design.words
        demand(when in ("before", "after", "none"), "jump_measurement is no known word")
        low, high, period = *design.dwell, design.period
        jump = Step(Fraction(0), True, when == "after", True)
        if measured == "at_jumps":
            is_sampled = design.G is not None and low > 0 and when != "none"
            demand(is_sampled, "jumps, their shortest time or the samples at them are missing")
            self.cycle, stage = [Step(low, False, when == "before", False), jump], low
            self.words = f"a sample and a jump every {float(low)!r}"
        else:
            demand(measured == "periodic" and period > 0, "samples have no period")
            plain, stage = Step(period, False, True, True), period
            self.cycle, self.words = [plain], f"a sample every {float(period)!r}"
            if design.G is not None:
                demand("dwell_time" in design.gains, "no dwell time is stated")
                count = max(math.ceil(low / period * (1 - NEAR)), 2 if when == "none" else 1)
                demand(count <= MOST_STEPS, f"more than {MOST_STEPS} samples between two jumps")
                demand(count * period <= high * (1 + NEAR), "no dwell time is one of the pattern")
                last = Step(period, False, when == "before", False)
                self.cycle = [plain] * (count - 1) + [last, jump]
                self.words += f" and a jump every {count} periods"
        if design.dt is not None:
            demand(
                stage <= design.dt * (MOST_COUNTED + Fraction(1, 2)), "too many steps in a stage"
            )
        self.ends = [k for k, step in enumerate(self.cycle) if step.ends_row]

    def window(self, end: int, count: int) -> Tuple[Step, ...]:
        """The `count` steps up to step `end` of the cycle, oldest first."""
        return tuple(self.cycle[k % len(self.cycle)] for k in range(end - count + 1, end + 1))


# 4. What a step does, and how the observer bounds its disturbance --------------------------------


class StepMap:
    """x+ = Phi x + what the disturbance adds, in so many pieces of length d, the last one first.

    F0: int e^(A s) X ds over a piece; FM = e^(A s_i) X at its middle s_i; slope: A FM d/2; bend:
    E2 d^2/4, E2 >= |A^2 e^(A s) X| on the piece. radius: half widths of w, of one piece. d = 0: a
    sum of F0 w over its pieces, of jumps or of steps of discrete time.
    """

    def __init__(self, Phi: Ball, F0: Sequence[Ball], radius: Vector) -> None:
        self.Phi, self.F0, self.d = Phi, side_by_side(F0), Fraction(0)
        self.radius = radius * len(F0)

    def of_flow(self, A: Ball, middles: List[Ball], ends: Tuple[Ball, Ball], d: Fraction) -> None:
        """Add what only a flow has. ends: X and e^(|A| d/2) |X|; middles: of e^(A s_i).

        On a piece A^2 e^(A s) X = A^2 e^(A s_i) e^(A (s - s_i)) X, and |s - s_i| <= d/2: the size
        of it is at most E2 = |A^2 e^(A s_i)| e^(|A| d/2) |X|.
        """
        self.d, square = d, A.times(A)
        FM = [middle.times(ends[0]) for middle in middles]
        bends = [magnitude(square.times(middle)).times(ends[1]) for middle in middles]
        self.FM = side_by_side(FM)
        self.slope = side_by_side([A.times(X) for X in FM]).scaled(d / 2)
        self.bend = side_by_side(bends).scaled(d * d / 4)

    def support(self, q: Ball) -> Vector:
        """What the disturbance adds along each row of q, at most, as the observer bounds it."""
        totals, unit = tops(q.times(self.F0)), 1 << BITS
        if self.d:
            middle = q.times(self.FM)
            slopes, bends = tops(q.times(self.slope)), tops(magnitude(q).times(self.bend))
            rows = zip(totals, middle.x, slopes, bends)
            totals = [[self.of_piece(*terms, middle.radius) for terms in zip(*row)] for row in rows]
        return [sum(map(mul, row, self.radius), Fraction(0)) / unit for row in totals]

    def of_piece(self, total: int, middle: int, slope: int, bend: int, radius: int) -> Any:
        """int |g(s)| ds over a piece, g(s) = q' e^(A s) X, at most, as the observer bounds it.

        About s_i, with l0 = |q' FM|, l1 = |q' A FM|, l2 = |q|' E2, g differs from l0 + l1 (s - s_i)
        by l2 (s - s_i)^2 / 2 at most; slope = l1 d/2, bend = l2 d^2/4. Of three bounds

            |q' F0|                              where l0 >= slope + bend/2: g has one sign
            |q' F0| + (slope + bend) d/2         |g'| <= l1 + l2 d/2
            int |l0 + l1 s| ds + bend d/6        int |l0 + l1 s| ds grows with l0 and with l1

        the observer takes the first where it holds, else the least. It rounds: here l0 has to be
        larger by one part in 10^9.
        """
        low, high = abs(middle) - radius, abs(middle) + radius
        if 2 * low * 10**9 >= (2 * slope + bend) * (10**9 + 1):
            return total
        line = high * self.d
        if high < slope:  # l1 d^2/4 + l0^2 / l1
            line = slope * self.d / 2 + high * high * self.d / (2 * slope)
        return min(total + (slope + bend) * self.d / 2, line + bend * self.d / 6)


def tops(X: Ball) -> List[List[int]]:
    """Upper ends of |X|, entry by entry, in units of 2^-BITS."""
    return [[abs(a) + X.radius for a in row] for row in X.x]


def active(box: Box) -> Tuple[Matrix, Vector]:
    """(X, half widths of w) of the columns that add anything; without any, zeros and none."""
    pairs = [
        (column, (high - low) / 2) for column, low, high in zip(transposed(box[0]), *box[1:])
        if low < high and any(column)
    ]  # fmt: skip
    return transposed([column for column, _ in pairs] or [[Fraction(0)] * len(box[0])]), [
        half for _, half in pairs
    ]


def flow_map(design: Design, h: Fraction, pieces: int) -> StepMap:
    """A step of time h in so many pieces; e^([[A, X], [0, 0]] d) = [[e^(A d), F0], [0, I]]."""
    (X, radius), n, d = active(design.b), design.n, h / pieces
    A, width = ball(design.A), len(X[0])
    rows = [a + b for a, b in zip(design.A, X)] + [[Fraction(0)] * (n + width)] * width
    whole, half = exponential(ball(rows).scaled(d)), exponential(A.scaled(d / 2))
    F0, middles = [part(Ball(whole.x[:n], whole.radius), n, n + width)], [half]
    for _ in range(pieces - 1):
        F0.append(part(Ball(whole.x[:n], whole.radius), 0, n).times(F0[-1]))
        middles.append(part(Ball(whole.x[:n], whole.radius), 0, n).times(middles[-1]))
    result = StepMap(middles[-1].times(half), F0, radius)
    growth = exponential(ball(sizes_of(design.A)).scaled(d / 2)).times(ball(sizes_of(X)))
    result.of_flow(A, middles, (ball(X), growth), d)
    return result


def counted_map(design: Design, h: Fraction) -> StepMap:
    """The steps of discrete time in a time h."""
    (X, radius), A = active(design.b), ball(design.A)
    Phi, F0, count = A, [ball(X)], round(h / design.dt)
    demand(count > 0 and abs(h - count * design.dt) <= NEAR * h, "a time is no number of steps")
    for _ in range(count - 1):
        Phi, F0 = A.times(Phi), [*F0, A.times(F0[-1])]
    return StepMap(Phi, F0, radius)


def step_maps(design: Design, step: Step, pieces: Sequence[int]) -> List[StepMap]:
    """The maps of a step, of which the observer may take any, for so many pieces."""
    if step.jump:
        X, radius = active(design.c)
        return [StepMap(ball(design.G), [ball(X)], radius)]
    if design.dt is not None:
        return [counted_map(design, step.h)]
    return [flow_map(design, step.h, count) for count in pieces]


# 5. Units of the states, and how many pieces the observer cuts a step into -----------------------


def piece_counts(design: Design, h: Fraction) -> List[int]:
    """Numbers of pieces of a step h: the least power of two >= 4 N h, or 32 if that is less.

    N: the largest column sum of |A|, in the units above. The observer knows h by time stamps alone:
    a length nearby may have another number. It is found in floats, as by the observer: it is no
    part of a proof, and the answer states it.
    """
    norm_of_A = max(sum(abs(float(a)) for a in column) for column in zip(*design.A))
    wanted = [4 * norm_of_A * float(h) * (1 + e) for e in (-2e-6, 2e-6)]
    return sorted({1 << math.ceil(math.log2(min(max(x, 1.0), 32.0))) for x in wanted})


def units(maps: Sequence[Matrix]) -> List[float]:
    """Units of the states, powers of two, in which the maps are balanced (Osborne's iteration).

    States that depend on each other, a part, get rows and columns of like size; the unit of a part
    grows until what other parts add to it is at most one.
    """
    n = range(len(maps[0]))
    sizes = [[float(max(abs(X[i][j]) for X in maps)) for j in n] for i in n]
    weights = [[math.log2(a) if a and i != j else -math.inf for j, a in enumerate(row)]
               for i, row in enumerate(sizes)]  # fmt: skip
    reach: List[Set[int]] = [{j for j in n if sizes[i][j]} | {i} for i in n]
    for _ in n:
        reach = [set().union(*(reach[j] for j in own)) for own in reach]
    result = [0.0 for _ in n]
    parts = {tuple(j for j in n if j in reach[i] and i in reach[j]) for i in n}
    for own in sorted(parts, key=lambda own: len(reach[own[0]])):
        for _ in range(40 if len(own) > 1 else 0):
            steps = []
            for i in own:
                row = max(weights[i][j] + result[j] for j in own) - result[i]
                column = max(weights[j][i] - result[j] for j in own) + result[i]
                steps.append((row - column) / 2)
                result[i] += steps[-1]
            if max(map(abs, steps)) <= 0.5:
                break
        least = min(result[i] for i in own)
        others = [weights[i][j] + result[j] - result[i] + least
                  for i in own for j in n if j not in own]  # fmt: skip
        for i in own:
            result[i] += max([0.0, *others]) - least
    return [2.0 ** max(round(-x), -240) for x in result]


# 6. The proofs -----------------------------------------------------------------------------------


def window_map(
    design: Design, window: Sequence[List[StepMap]], gains: Sequence[Matrix]
) -> Tuple[Matrix, Vector]:
    """(|p|, k) of a window: half widths of x at its end are at most |p| r + k.

    gains: for each step the multipliers of every entry of x, one row for each; see the head.
    """
    p, k = ball(identity(design.n)), [Fraction(0)] * design.n
    for maps, mu in zip(reversed(window), reversed(gains)):
        minus = [[-dot(row, column) for column in transposed(design.C)] for row in mu]
        q = p.plus(ball(minus))
        added = [max(each) for each in zip(*(each.support(q) for each in maps))]
        noise = [dot([*map(abs, row)], design.V) for row in mu]
        k = [sum(each, Fraction(0)) for each in zip(k, added, noise)]
        p = bounded(q.times(maps[0].Phi))
    return upper_ends(magnitude(p)), k


def row_maps(
    design: Design, pattern: Pattern, pieces: Sequence[int]
) -> List[Tuple[int, Matrix, Vector]]:
    """(start, M, k) of every row: half widths after it are at most M r + k, r after row `start`.

    Where a window begins within a row, between a step and its jump, r first takes that step.
    """
    maps = {step: step_maps(design, step, pieces) for step in {*pattern.cycle}}
    windows = list(dict.fromkeys(pattern.window(end, design.window) for end in pattern.ends))
    demand(len(windows) == len(design.multipliers), "multipliers are those of other windows")
    lines, result = {}, []
    for window, stored in zip(windows, design.multipliers):
        gains = transposed(stored)  # by step, then by state
        silent = (mu for step, mu in zip(window, gains) if not step.sampled)
        demand(not any(any(row) for mu in silent for row in mu), "a multiplier has no sample")
        lines[window] = window_map(design, [maps[step] for step in window], gains)
    none = [[Fraction(0)] * len(design.V)] * design.n
    for end in pattern.ends:
        M, k = lines[pattern.window(end, design.window)]
        before = (end - design.window) % len(pattern.cycle)  # the step before the window
        if before not in pattern.ends:
            first, added = window_map(design, [maps[pattern.cycle[before]]], [none])
            k = [a + dot(row, added) for a, row in zip(k, M)]
            M = [[dot(row, column) for column in transposed(first)] for row in M]
            before = (before - 1) % len(pattern.cycle)
        result.append((pattern.ends.index(before), M, k))
    return result


def prove_width(design: Design, pattern: Pattern, evidence: Table) -> Tuple[Vector, str]:
    """Prove the tube; return the widths that it comes to, and the numbers of pieces in words."""
    sizes = {"n": design.n, "r": len(pattern.ends)}
    tube, always = array(evidence["tube"], "rn", sizes), array(evidence["always"], "n", sizes)
    widths = [2 * max(column) for column in transposed(tube)]
    demand(all(a <= b for a, b in zip(widths, always)), "the width is below the tube")
    pieces = [] if design.dt is not None else piece_counts(design, pattern.cycle[0].h)
    demand(all(a > 0 for row in tube for a in row), "the tube is not positive")
    scaled = [[s * a for s, a in zip(design.scales, row)] for row in tube]
    for v, (start, M, k) in zip(scaled, row_maps(design, pattern, pieces)):
        after = [dot(row, scaled[start]) + a for row, a in zip(M, k)]
        demand(all(a < b for a, b in zip(after, v)), "the tube is left, or nearly left")
    return always, f", steps cut into {' or '.join(map(str, pieces))} pieces" if pieces else ""


def prove_least(design: Design, pattern: Pattern, stated: Table) -> Vector:
    """Widths that two trajectories show; see the head. stated: disturbances that are proposed.

    In each of so many pieces of a step w is constant, a part in [-1, 1] of its half widths.
    """
    steps, pieces, rows = (stated[name] for name in ("steps", "pieces", "rows"))
    counts = [steps, pieces, *rows]
    demand(all(type(a) is int for a in counts) and len(rows) == design.n, "counts are none")
    demand(0 < steps <= 10000 and 0 < pieces <= 64, "a trajectory is too long")
    demand(all(0 <= row < len(pattern.ends) for row in rows), "a row is none of the pattern")
    maps = {step: step_maps(design, step, [pieces])[0] for step in {*pattern.cycle}}
    inputs = [[number(a) for a in own] for own in stated["disturbances"]]
    demand(len(inputs) == design.n, "a trajectory is missing")
    return [
        distance(design, [(maps[x], x.sampled) for x in pattern.window(pattern.ends[row], steps)],
                 own, i)
        for i, (row, own) in enumerate(zip(rows, inputs))
    ]  # fmt: skip


def distance(
    design: Design, window: Sequence[Tuple[StepMap, bool]], parts: Vector, i: int
) -> Fraction:
    """2 |e_i| in the units of x at the end of a window, at least, for an e with |C e| <= V.

    An e that leaves this strip at a sample is made smaller, all of it, disturbances too.
    """
    demand(len(parts) == sum(len(step.radius) for step, _ in window), "a disturbance is missing")
    demand(all(abs(a) <= 1 for a in parts), "a disturbance leaves its bounds")
    C, e, largest, unit = ball(design.C), Ball([[0]] * design.n, 0), Fraction(1), 1 << BITS
    silent = [not any(row[j] for j in reached_states(design)) for row in design.C]
    for step, sampled in window:
        e, size = bounded(step.Phi.times(e)), len(step.radius)
        if size:
            e = e.plus(step.F0.times(ball([[a * b] for a, b in zip(parts, step.radius)])))
        parts = parts[size:]
        for (y,), V, is_zero in zip(tops(C.times(e)) if sampled else (), design.least_V, silent):
            if y > V * largest * unit and not is_zero:
                if not V:
                    return Fraction(0)
                largest = y / (V * unit)
    least = Fraction(2 * (abs(e.x[i][0]) - e.radius), unit) / (largest * design.scales[i])
    return max(least, Fraction(0))


def reached_states(design: Design) -> Set[int]:
    """States that a disturbance acts on, at once or through others; of all others e is 0."""
    result = {
        i for box in (design.b, design.c) for i, row in enumerate(active(box)[0]) if any(row)
    }  # fmt: skip
    rows = [*enumerate(design.A), *enumerate(design.G or [])]
    for _ in range(design.n):
        result |= {i for i, row in rows if any(row[j] for j in result)}
    return result


# 7. The verdict ----------------------------------------------------------------------------------


def prove_design(design: Design) -> List[str]:
    """Prove what this program knows of a design; return sentences: what was proved, what not."""
    design.read()
    pattern, proved = Pattern(design), ["width"]
    always, pieces = prove_width(design, pattern, design.evidence["width"])
    when = f"with {pattern.words}"
    sentences = [f"{when}: the width of the bounds by the stored multipliers comes, after every "
                 f"row, to at most {tuple(map(float, always))}{pieces}; rounding at run time adds "
                 "to it"]  # fmt: skip
    if "optimal" in design.evidence:
        least = prove_least(design, pattern, design.evidence["optimal"]["trajectories"])
        stated = array(design.evidence["optimal"]["least"], "n", {"n": design.n})
        shown = all(float(a) >= b for a, b in zip(least, stated))
        demand(shown, "the trajectories do not show the least widths")
        demand(all(a <= b for a, b in zip(least, always)), "two proofs contradict each other")
        down = tuple(float(a * (1 - Fraction(1, 2**50))) for a in least)
        sentences.append(
            f"{when}: no observer can guarantee, from the samples up to a row, "
            f"widths after all rows below {down}"
        )
        proved.append("optimal")
    others = ascii(sorted({*design.evidence} - {*proved}))
    return [
        *(f"proved: {each}" for each in sentences),
        f"not checked: {others}, other times of samples and jumps, and any other word of the file",
    ]


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
