#!/usr/bin/env python3
"""Prove again, from a design file alone, that widths decay with clocks of their own.

    python3 -I -S check_events.py design.json          ("-" reads standard input)

This file needs nothing but Python >= 3.8 and its standard library. It is meant to be read: each
step states its inequality. It trusts no number of the file that it has not proved, and it prints
what it proved in its own words, and what it did not check. Its reading of files, balls and
exponentials are those of check_widths.py, word for word.

The plant:  x' = A x + b;  x+ = G x + c at an event;  y = C x + v at a sample of a sensor. An event
happens some time in [shortest, longest] after the last one of its name; a sensor has a sample in
every time as long as its gap. The observer keeps lower <= x <= upper. Its width w = upper - lower
obeys, entry by entry, with W = A off the diagonal in absolute values,

    w' <= W w + f                      between events and samples, f the width of b
    w+ <= |G| w + h                    at an event, or where a gain M corrects by what is measured
                                       there: the least of this and |G - M C| w + h + 2 |M| V
    w+ <= w and |I - L C| w + 2 |L| V  at a sample, |v| <= V, and for a row c of C with c_i != 0
    w_i+ <= (2 V + sum_(j != i) |c_j| w_j) / |c_i|

All these maps are monotone, so that further samples only make w smaller: whatever holds for the
width by some samples alone, chosen even by what comes later, holds for w.

A graph. A node stands for a set of instants, v > 0 at it for a bound of w there. A passage leads to
a node from instants of another one, through what happens there, T, and a time in [low, high]: then
w at the node is at most the path u' = W u + f from u(0) = T(v of the other one). A strategy is a
list of passages of which one applies, whichever it is: the largest bounds w. If at every node and
for every entry i one strategy has all its passages strictly below v_i, then every w comes, as time
goes on, below v. For let m >= 1 be the largest ratio of w to v so far: flow, events and samples
take m v to at most m times what they make of v (f, h, V >= 0), at most m (1 - e) v with one e > 0
for all passages: the next ratio is at most the larger of 1 and m (1 - e). With f = h = V = 0 the
same holds for every m > 0: w tends to zero. Passages that take no time do no harm: from a mark a
few of them lead to nodes that only a mark before it leads to, so that m shrinks once per mark.
Between marks w is bounded, since the time to the next is, or else w decays by itself. If `every`
begins at 0, marks may be many in a short time: the claim is then about their number.

A row is a time at which several events happen, in any order; a gain M acts at its first event.

The graph is made here, from the problem; the file proposes a v for each of its nodes.

Exit code 0: proved. 1: not proved (which refutes nothing). 2: not a design that this program reads.
Whatever goes wrong on the way raises an error, and an error never proves anything.
"""

import hashlib
import json
import math
import sys
from fractions import Fraction
from itertools import combinations, permutations, product
from operator import mul
from typing import Any, Dict, Iterator, List, NamedTuple, Optional, Sequence, Set, Tuple

Matrix = List[List[Fraction]]
Vector = List[Fraction]
Map = Tuple[Matrix, Vector]  # (N, k): w+ <= N w + k
Table = Dict[str, Any]
Time = Any  # a Fraction, or math.inf
Range = Tuple[Time, Time]  # (shortest, longest)
Passage = Tuple[int, int, Range]  # from a node (by place), what happens there (by place), time
Strategy = List[Passage]

BITS = 256  # balls count in units of 2^-BITS
MOST_BOXES = 20000
MOST_HALVINGS = 40
MOST_MARKS = 256
MOST_NODES = 3000
MOST_PARTS = 64
NOW: Range = (Fraction(0), Fraction(0))


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


# 2. Paths u' = W u + f over ranges of time -------------------------------------------------------


class PositiveFlow:
    """u' = W u + f, W Metzler, f >= 0: y = (u, 1) obeys y' = Z y, and e^(Z t) >= 0."""

    def __init__(self, W: Matrix, f: Vector) -> None:
        is_metzler = all(a >= 0 for i, row in enumerate(W) for j, a in enumerate(row) if i != j)
        demand(is_metzler and min(f) >= 0, "the system is not positive")
        self.speed = max(sum(map(abs, row)) for row in W) or Fraction(1)
        self.Z = ball([[*row, a] for row, a in zip(W, f)] + [[Fraction(0)] * (len(f) + 1)])
        self.maps: Dict[Time, Ball] = {}
        self.boxes: Dict[Range, Tuple[Matrix, Matrix]] = {}

    def map(self, t: Fraction) -> Ball:
        """e^(Z t), kept for every t that was needed."""
        if t not in self.maps:
            self.maps[t] = exponential(self.Z.scaled(t))
        return self.maps[t]

    def box(self, t: Fraction, h: Fraction) -> Tuple[Matrix, Matrix]:
        """X and Y with u(t + s) <= the larger of X y(0) and Y y(0) for 0 <= s <= h, if y(0) >= 0.

        On [t, t + h] u is at most the larger of its ends, and h^2 / 8 times the largest |u''|: so
        far it may be from its chord. u'' = Z^2 y, and Z^2 y(t + s) = e^(Z s) Z^2 E y(0), E =
        e^(Z t); with P >= 0, the positive part of Z, e^(Z s) <= e^(P h), entry by entry. So

            X = E + K,   Y = e^(Z (t + h)) + K,   K = h^2 / 8 e^(P h) |Z^2 E|.
        """
        if (t, h) not in self.boxes:
            demand(len(self.boxes) < MOST_BOXES, f"more than {MOST_BOXES} boxes")
            E, end = self.map(t), self.map(t + h)
            curve = self.Z.times(self.Z.times(E))
            size = Ball([[abs(a) for a in row] for row in curve.x], curve.radius)
            P = Ball([[max(a, 0) for a in row] for row in self.Z.x], self.Z.radius)
            K = exponential(P.scaled(h)).times(size).scaled(h * h / 8)
            self.boxes[t, h] = upper_ends(E.plus(K)), upper_ends(end.plus(K))
        return self.boxes[t, h]

    def is_below(self, start: Vector, i: int, limit: Fraction, ends: Range) -> bool:
        """Prove u_i(t) < limit for the path from u(0) = start >= 0 and all t of a range.

        A range that one box does not prove is halved; False where it fails at an end. For an
        infinite range the start is raised by limit / 2^20, so that u(low) > 0: a larger start makes
        u larger, and proves more.
        """
        low, high = ends
        y = [*start, Fraction(1)]
        if high == math.inf:
            y = [a + limit / 2**20 for a in start] + [Fraction(1)]
            high = low + self.time_of_return(y, low)
        left = [(low, high - low)]
        while left:
            t, h = left.pop()
            if all(dot(X[i], y) < limit for X in self.box(t, h)):
                continue
            is_short = h * 2**MOST_HALVINGS <= high - low
            if is_short or any(dot(upper_ends(self.map(s))[i], y) >= limit for s in (t, t + h)):
                return False
            left += [(t, h / 2), (t + h / 2, h / 2)]
        return True

    def time_of_return(self, y: Vector, low: Fraction) -> Fraction:
        """T with u(low + T) < u(low), entry by entry, for u(low) > 0; NotProved if there is none.

        Then u(t + T) <= u(t) for all t >= low, since paths keep their order: what holds on
        [low, low + T] holds for ever. And with f = 0, u falls to zero, as every path then does.
        """
        E = self.map(low)
        start = [dot(row, y) for row in upper_ends(Ball(E.x, -E.radius))[:-1]]  # its lower ends
        for k in range(MOST_HALVINGS):
            T = (1 << k) / self.speed
            later = [dot(row, y) for row in upper_ends(bounded(self.map(low + T)))[:-1]]
            if all(b < a for a, b in zip(start, later)):
                return T
        raise NotProved("the width does not decay by itself, and events may stay away")


def dot(row: Sequence[Fraction], y: Vector) -> Fraction:
    """The sum of products."""
    return sum(map(mul, row, y), Fraction(0))


def least(maps: List[Map], u: Vector) -> Vector:
    """The least of N u + k, entry by entry."""
    return [min(x) for x in zip(*([dot(row, u) + a for row, a in zip(N, k)] for N, k in maps))]


# 3. Reading a design -----------------------------------------------------------------------------

# the entries that each block of a problem may have; plants with others are not checked
PROBLEM = {
    "flow": "A B D d_bounds disturbance disturbance_matrix input_bound",
    "event": "name G E every report_delay time_error disturbance disturbance_matrix input_bound",
    "sensor": "name C noise_bound noise_std noise_cv every jitter losses sends_on_change sees at "
    "report_delay time_error",
    "timing": "spacing memory",
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


class Sensor(NamedTuple):
    """Its outputs, rows of C by place; event: at which alone it is read, None for none."""

    name: str
    outputs: List[int]
    gap: Time
    event: Optional[str]
    sees: str


class Event(NamedTuple):
    """Its map; times since the last one of its name."""

    name: str
    G: Matrix
    M: Matrix
    every: Range


class Design:
    """A design that is unchanged since it was signed.

    Clocks are those of the problem, numbers of the plant those with which the observer runs, which
    must be the same ones. evidence: of each claim, by its id, a v that is proposed.
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
        demand(is_design and body["kind"] == "interval", "no design of this kind")
        self.gains, self.problem = body["gains"], body["problem"]
        demand({*self.problem} <= {"name", "names", "observer", *PROBLEM}, "a block is not known")
        for place, names in PROBLEM.items():
            blocks = self.problem.get(place, {})
            for block in blocks if place in ("event", "sensor") and blocks else [blocks]:
                unknown = {*block} - {*names.split()}
                demand(not unknown, f"{place}: {sorted(unknown)} is not known to this program")
                demand(block.get("time_error", 0) == 0, "times of events are uncertain")
        self.evidence = keys_once([(entry["id"], entry["evidence"]) for entry in body["claims"]])
        demand("event_stability" in self.evidence, "no claim about clocks is made")

    def read(self) -> None:
        """Read the plant; NotProved where problem and gains differ."""
        problem, gains, sizes = self.problem, self.gains, {}  # type: Table, Table, Dict[str, int]
        self.A, self.C = array(gains["A"], "nn", sizes), array(gains["C"], "pn", sizes)
        self.L, self.n = array(gains["L"], "np", sizes), sizes["n"]
        self.V = array(gains["noise_bound"], "p", sizes)
        lower, upper = (array(gains[f"flow_{end}"], "n", sizes) for end in ("lower", "upper"))
        self.f = [high - low for low, high in zip(lower, upper)]
        C = [row for x in problem["sensor"] for row in array(x["C"], "on", {"n": self.n})]
        same = array(problem["flow"]["A"], "nn", sizes) == self.A and C == self.C
        demand(same and min(self.V) >= 0, "gains.A or gains.C is another, or noise is negative")
        self.spacing = time(problem.get("timing", {}).get("spacing", 0))
        demand(time(gains.get("spacing", 0)) == self.spacing, "gains.spacing is another")
        self.sensors, self.events = self.read_sensors(), self.read_events(sizes)
        blocks = [*problem.get("event", []), *problem["sensor"]]
        demand(len({x["name"] for x in blocks}) == len(blocks), "two blocks have one name")
        self.is_late = any(time(x.get("report_delay", 0)) for x in blocks)
        self.counted = [k for k, x in enumerate(self.sensors) if 0 < x.gap < math.inf]

    def read_sensors(self) -> List[Sensor]:
        """The sensors of the problem, which must be those of the gains, too."""
        sensors, first = [], 0  # type: List[Sensor], int
        events = [block["name"] for block in self.problem.get("event", [])]
        demand(len(self.gains["sensors"]) == len(self.problem["sensor"]), "sensors differ")
        for block, stored in zip(self.problem["sensor"], self.gains["sensors"]):
            name, sees, size, event = block["name"], block["sees"], len(block["C"]), block.get("at")
            own = [stored["name"], stored["sees"], stored["outputs"], stored.get("event")]
            demand(own == [name, sees, size, event], "a sensor of the gains is another")
            demand(sees in ("before", "after") and event in (None, *events), "sees, or at, is none")
            demand((event is None) == ("every" in block), "a sensor has both clocks, or none")
            every = block.get("every", [0, "inf"])
            b, c = (float(time(block.get(name, 0))) for name in ("losses", "jitter"))
            # b samples lost, and one late by c after one early by c; in doubles, as the observer
            is_period = isinstance(every, (int, float))
            demand(is_period or b == c == 0, "losses and jitter are those of a period")
            ends = [0, 0] if every == "continuous" else every
            gap = time(float(time(every)) * (1 + b) + 2 * c) if is_period else interval(ends)[1]
            demand(gap == time(stored["gap"]), "the gap of a sensor is another")
            sensors.append(Sensor(name, [*range(first, first + size)], gap, event, sees))
            first += size
        return sensors

    def read_events(self, sizes: Dict[str, int]) -> List[Event]:
        """The events of the problem, which must be those of the gains, too."""
        blocks, stored = self.problem.get("event", []), self.gains.get("events", [])
        maps = array(self.gains["M"], "enp", sizes) if blocks else []
        demand(len(blocks) == len(stored) == len(maps), "events differ")
        events = []
        for block, own, M in zip(blocks, stored, maps):
            every, times = block.get("every", [0, "inf"]), own.get("dwell_time", [0, "inf"])
            ends = interval(every if isinstance(every, list) else [every, every])
            events.append(Event(block["name"], array(block["G"], "nn", sizes), M, ends))
            same = Event(own["name"], array(own["G"], "nn", sizes), M, interval(times))
            demand(same == events[-1], "an event of the gains is another")
        return events


# 4. What events and samples make of the width ----------------------------------------------------


class WidthMaps:
    """w' <= W w + f, and the maps of events and samples, on which the graph stands.

    homogeneous: without inputs, f = h = V = 0. events: that count, by place. An event with |G| <= I
    that no sensor is read at, and that cannot happen again at once, may as well not happen: it
    only makes the homogeneous width smaller. Unless it may stand ahead of another in its row, and
    so take away a gain M, which acts at the first event of a row alone.
    """

    def __init__(self, design: Design, homogeneous: bool) -> None:
        self.design, self.unit, rows = design, identity(design.n), enumerate(design.A)
        self.V, self.f = ([0 * a if homogeneous else a for a in x] for x in (design.V, design.f))
        self.W = [[a if i == j else abs(a) for j, a in enumerate(row)] for i, row in rows]
        self.flow, self.events = PositiveFlow(self.W, self.f), []  # type: PositiveFlow, List[int]
        may_precede = not design.spacing and any(a for x in design.events for r in x.M for a in r)
        for e, event in enumerate(design.events):
            widens = any(abs(a) > b for rows in zip(event.G, self.unit) for a, b in zip(*rows))
            if widens or self.is_read(e) or may_precede or not event.every[0]:
                self.events.append(e)

    def is_read(self, e: int) -> bool:
        """Is a sensor read at an event alone?"""
        return any(x.event == self.design.events[e].name for x in self.design.sensors)

    def corrected(self, X: Matrix, gain: Matrix, outputs: Sequence[int]) -> Map:
        """|X - gain C| w + 2 |gain| V, where these outputs are measured and no others enter."""
        C, used = self.design.C, [[a * (p in outputs) for p, a in enumerate(g)] for g in gain]
        rows = [[dot(g, c) for c in transposed(C)] for g in used]
        N = [[abs(a - b) for a, b in zip(*pair)] for pair in zip(X, rows)]
        return N, [2 * dot([*map(abs, g)], self.V) for g in used]

    def sampled(self, k: int) -> List[List[Map]]:
        """What a sample of a sensor makes of w: one stage, the least of maps."""
        outputs, zeros = self.design.sensors[k].outputs, [Fraction(0)] * self.design.n
        maps = [(self.unit, zeros), self.corrected(self.unit, self.design.L, outputs)]
        for c, V in ((self.design.C[p], self.V[p]) for p in outputs):
            N, k0 = [list(row) for row in self.unit], list(zeros)
            for i, a in enumerate(c):
                if a:
                    N[i] = [Fraction(0) if i == j else abs(b / a) for j, b in enumerate(c)]
                    k0[i] = 2 * V / abs(a)
            maps.append((N, k0))
        return [maps]

    def happened(self, kind: Sequence[int]) -> List[List[Map]]:
        """What events of one row make of the homogeneous w, stage by stage.

        Samples before them, their maps, samples after them. A gain M acts at the first event, where
        all that it corrects by is measured before that event: afterwards the state is another one.
        """
        sensors, names = self.design.sensors, [self.design.events[e].name for e in kind]
        read = [k for k, x in enumerate(sensors) if x.event in names]
        before = [k for k in read if sensors[k].sees == "before"]
        stages = [stage for k in before for stage in self.sampled(k)]
        measured = {p for k in before if sensors[k].event == names[0] for p in sensors[k].outputs}
        for e in kind:
            G, M = self.design.events[e].G, self.design.events[e].M
            maps = [self.corrected(G, M, [])]
            if e == kind[0] and all(p in measured for row in M for p, a in enumerate(row) if a):
                maps.append(self.corrected(G, M, sorted(measured)))
            stages.append(maps)
        return stages + [stage for k in read if k not in before for stage in self.sampled(k)]


# 5. Marks: instants at which events happen -------------------------------------------------------


def meet(X: Range, Y: Range) -> List[Range]:
    """Times in both ranges: one range, or none."""
    low, high = max(X[0], Y[0]), min(X[1], Y[1])
    return [(low, high)] if low <= high else []


def less(X: Range, Y: Range) -> List[Range]:
    """Differences s - t >= 0 of times s and t in two ranges: one range, or none."""
    low, high = max(X[0] - Y[1], Fraction(0)), X[1] - Y[0]
    return [(low, high)] if low <= high else []


def parts(length: Fraction, count: int) -> List[Range]:
    """Equal parts of [0, length]."""
    return [(length * i / count, length * (i + 1) / count) for i in range(count)]


class Mark(NamedTuple):
    """Events that happen at once, one or several of a row, and how long ago the others did.

    passed: the time since the last of every event just before the mark, in a range: of its own
    events the stated one, of the others a cell. Just after it that of its own events is 0.
    """

    events: Tuple[int, ...]
    passed: Dict[int, Range]

    def until(self, following: "Mark") -> List[Range]:
        """Times to the next mark: what had passed of every event there, less what has here."""
        result: List[Range] = [(Fraction(0), math.inf)]
        for e, later in following.passed.items():
            own = less(later, NOW if e in self.events else self.passed[e])
            result = [both for x, y in product(result, own) for both in meet(x, y)]
        return result


class Marks:
    """All marks, and `before`: of each the marks before it, with the time from there.

    A mark that none leads to, or that none of all earlier ones leads to, happens a few times only.
    Cells of the time since an event: `cells` in the shortest `every` of all, `beyond` in what is
    between shortest and longest of its own; at a mark the others are at least the spacing ago.
    """

    def __init__(self, system: WidthMaps, cells: int, beyond: int) -> None:
        every = {e: system.design.events[e].every for e in system.events}
        self.unit = min((low for low, _ in every.values() if low > 0), default=None)
        self.cells, self.every, spacing = cells, every, (system.design.spacing, math.inf)
        self.kinds = [(e,) for e in every]  # type: List[Tuple[int, ...]]
        for size in range(2, len(every) + 1) if not spacing[0] else ():
            # in one row, where a sensor is read at one: otherwise the same as one by one
            rows = permutations(every, size)
            self.kinds += [kind for kind in rows if any(map(system.is_read, kind))]
        ages = {e: [y for x in self.ages(e, beyond) for y in meet(x, spacing)] for e in every}
        choices = [[[every[e]] if e in kind else ages[e] for e in every] for kind in self.kinds]
        demand(sum(math.prod(map(len, own)) for own in choices) <= MOST_MARKS, "too many marks")
        self.marks: List[Mark] = []
        for kind, own in zip(self.kinds, choices):
            self.marks += [Mark(kind, dict(zip(every, passed))) for passed in product(*own)]
        self.before = self.preceding()

    def count(self, length: Fraction) -> int:
        """Cells of a time, `cells` in each unit, or in itself if shorter, but not too many."""
        return min(math.ceil(length * self.cells / min(length, self.unit or length)), MOST_PARTS)

    def ages(self, e: int, beyond: int) -> List[Range]:
        """Cells of the time since an event that has not happened again."""
        low, high = self.every[e]
        first = parts(low, self.count(low)) if low > 0 else []
        if high == math.inf:
            return [*first, (low, high)]
        later = parts(high - low, 1 if high == low else beyond)
        return first + [(low + a, low + b) for a, b in later]

    def preceding(self) -> Dict[int, List[Tuple[int, Range]]]:
        """Marks that may come before each, of those that have some before them, and so on."""
        both = product(range(len(self.marks)), repeat=2)
        pairs = [(x, y, time) for x, y in both for time in self.marks[x].until(self.marks[y])]
        size = len(pairs) + 1
        while len(pairs) < size:
            size, reached = len(pairs), {y for _, y, _ in pairs}
            pairs = [pair for pair in pairs if pair[0] in reached]
        before: Dict[int, List[Tuple[int, Range]]] = {}
        for x, y, time in pairs:
            before.setdefault(y, []).append((x, time))
        return before


# 6. The graph: bounds before marks, by the last samples before them ------------------------------


class Graph:
    """Nodes, by place, as passages lead from them, and the strategies of each.

    mark Y          just before the mark Y
    aged Y, s, i    the same where the last sample of sensor s is in cell i of its gap ago
    own Y, s, i     the same, by what this sensor alone comes to
    sample Y, s, i  just before that sample, where it is after the mark before Y
    both Y, r, s, i the same, by the last sample of another sensor r, where that is before it
    """

    def __init__(self, system: WidthMaps, marks: Marks) -> None:
        self.marks, self.before = marks, marks.before
        self.sensors = system.design.counted
        gaps = {s: system.design.sensors[s].gap for s in self.sensors}
        self.cells = {s: parts(gap, marks.count(gap)) for s, gap in gaps.items()}
        self.aged = {s: self.ages_at_marks(s) for s in self.sensors}
        self.happens = [system.happened(kind) for kind in marks.kinds]
        self.happens += [system.sampled(s) for s in self.sensors] + [[]]
        self.places: Dict[Tuple[Any, ...], int] = {}
        self.nodes: List[List[Strategy]] = []
        for y in self.before:
            self.place("mark", y)
        while len(self.nodes) < len(self.places):
            demand(len(self.places) <= MOST_NODES, "the graph is too large")
            name, *where = [*self.places][len(self.nodes)]
            self.nodes.append([x for x in getattr(self, f"of_{name}")(*where) if x])

    def ages_at_marks(self, s: int) -> Set[Tuple[int, int]]:
        """(mark, cell) that may be: the last sample after the mark before, or before that too."""
        cells = range(len(self.cells[s]))
        reached = {(y, i) for y in self.before for i in cells if self.since(y, self.cells[s][i])}
        steps = [
            (x, j, y, i)
            for y, before in self.before.items()
            for (x, time), j, i in product(before, cells, cells)
            if self.grown(s, j, i, time)
        ]
        size = 0
        while size < len(reached):
            size = len(reached)
            reached |= {(y, i) for x, j, y, i in steps if (x, j) in reached}
        return reached

    def grown(self, s: int, j: int, i: int, time: Range) -> List[Range]:
        """Times between two marks in which the age of a sample goes from cell j to cell i."""
        return [y for x in less(self.cells[s][i], self.cells[s][j]) for y in meet(time, x)]

    def since(self, y: int, cell: Range) -> List[Tuple[int, Range]]:
        """Marks before y, and the time from each to a sample in a cell before y."""
        return [(x, own) for x, time in self.before[y] for own in less(time, cell)]

    def place(self, *node: Any) -> int:
        """The place of a node, which is made if it is new."""
        return self.places.setdefault(node, len(self.places))

    def event(self, y: int) -> int:
        """The place of what happens at a mark."""
        return self.marks.kinds.index(self.marks.marks[y].events)

    def sample(self, s: int) -> int:
        """The place of what a sample does."""
        return len(self.marks.kinds) + self.sensors.index(s)

    def after(self, x: int, time: Range) -> Passage:
        """From a mark on."""
        return self.place("mark", x), self.event(x), time

    def same(self, *node: Any) -> Passage:
        """From a node of the same instants."""
        return self.place(*node), len(self.happens) - 1, NOW

    def of_mark(self, y: int) -> Iterator[Strategy]:
        """By the mark before; by each sensor; by both of two sensors, in either order."""
        yield [self.after(*before) for before in self.before[y]]
        yield from (self.all_ages("aged", y, s) for s in self.sensors)
        for r, s in combinations(self.sensors, 2):
            yield [*self.last_of_both(y, r, s), *self.last_of_both(y, s, r)]

    def all_ages(self, name: str, y: int, s: int) -> Strategy:
        """Whatever the age of the last sample of a sensor is."""
        cells = range(len(self.cells[s]))
        return [self.same(name, y, s, i) for i in cells if (y, i) in self.aged[s]]

    def of_aged(self, y: int, s: int, i: int) -> Iterator[Strategy]:
        """By this sensor, or by each other one, whatever its age."""
        if self.sensors == [s]:
            yield from self.of_own(y, s, i)
        else:
            yield [self.same("own", y, s, i)]
            yield from (self.all_ages("own", y, r) for r in self.sensors if r != s)

    def of_own(self, y: int, s: int, i: int) -> Iterator[Strategy]:
        """By the last sample, after the mark before or before that too; or by that mark."""
        strategy, cell = [], self.cells[s][i]
        if self.since(y, cell):
            strategy.append((self.place("sample", y, s, i), self.sample(s), cell))
        for (x, time), j in product(self.before[y], range(len(self.cells[s]))):
            for own in self.grown(s, j, i, time) if (x, j) in self.aged[s] else []:
                strategy.append((self.place("aged", x, s, j), self.event(x), own))
        yield strategy
        yield [self.after(*before) for before in self.before[y]]

    def of_sample(self, y: int, s: int, i: int) -> Iterator[Strategy]:
        """By the mark before it."""
        yield [self.after(*before) for before in self.since(y, self.cells[s][i])]

    def of_both(self, y: int, r: int, s: int, i: int) -> Iterator[Strategy]:
        """By the last sample of r before it, or a mark since which r was silent."""
        yield [*self.from_first(y, r, s, i)]

    def last_of_both(self, y: int, r: int, s: int) -> Iterator[Passage]:
        """From the last sample of s, where that of r is before it; or s was silent since a mark."""
        for i, cell in enumerate(self.cells[s]):
            if any(True for _ in self.from_first(y, r, s, i)):
                yield self.place("both", y, r, s, i), self.sample(s), cell
        yield from self.unsampled(y, s, NOW)

    def from_first(self, y: int, r: int, s: int, i: int) -> Iterator[Passage]:
        """To the last sample of s before y, from that of r, which is before it."""
        cell = self.cells[s][i]
        if not self.since(y, cell):
            return
        for k, age in enumerate(self.cells[r]):
            for time in less(age, cell) if self.since(y, age) else []:
                yield self.place("sample", y, r, k), self.sample(r), time
        yield from self.unsampled(y, r, cell)

    def unsampled(self, y: int, s: int, earlier: Range) -> Iterator[Passage]:
        """To a time before y, in a range, from a mark before y since which s was silent.

        Where its last sample was in a cell ago at that mark, s is silent for what the gap leaves.
        """
        for (x, time), (j, (low, _)) in product(self.before[y], enumerate(self.cells[s])):
            silent = meet(time, (Fraction(0), self.cells[s][-1][1] - low))
            for left in (z for own in silent for z in less(own, earlier)):
                if (x, j) in self.aged[s]:
                    yield self.place("aged", x, s, j), self.event(x), left


# 7. The proof ------------------------------------------------------------------------------------


def prove_graph(system: WidthMaps, graph: Graph, tube: Matrix) -> None:
    """Prove that at every node each entry has a strategy with all passages below v."""
    starts: Dict[Tuple[int, int], Vector] = {}
    for v, strategies in zip(tube, graph.nodes):
        for source, place, _ in (x for each in strategies for x in each):
            u = tube[source]
            for stage in graph.happens[place]:
                u = least(stage, u)
            starts[source, place] = u
        for i, limit in enumerate(v):
            lists = (
                (system.flow.is_below(starts[x, place], i, limit, time) for x, place, time in each)
                for each in strategies
            )
            demand(any(map(all, lists)), f"entry {i + 1} of a bound is not proved")


def prove_stability(design: Design, evidence: Table) -> None:
    """Prove that the homogeneous width tends to zero.

    Where all events may stay away for ever, the width has to fall by itself.
    """
    tube, cells = array(evidence["tube"], "vn", {"n": design.n}), evidence["cells"]
    demand(type(cells) is int and 1 <= cells <= MOST_MARKS, "cells must be a number of cells")
    demand(all(a > 0 for v in tube for a in v), "the bound is not positive")
    system, longest = WidthMaps(design, homogeneous=True), [x.every[1] for x in design.events]
    if not system.events:
        prove_still(system, *tube)
        return
    if all(longest[e] == math.inf for e in system.events):
        system.flow.time_of_return([Fraction(1)] * (design.n + 1), Fraction(0))
    graphs = [Graph(system, Marks(system, cells, beyond)) for beyond in sorted({1, cells})]
    fitting = [graph for graph in graphs if len(graph.nodes) == len(tube)]
    demand(fitting != [], "the graph has another number of nodes")
    prove_graph(system, fitting[0], tube)


def prove_still(system: WidthMaps, v: Vector) -> None:
    """The graph of a plant without events: one node, all times, at which w is below v.

    Entry i is below v_i where (W v + f)_i < 0, the others being at most v: from v_i it falls. Or a
    time ago (`span`; any serves) w was at most v, and all entries flow. Or a sensor had a sample at
    most its gap ago: from what that makes of v all entries flow, or i alone does, the others being
    at most v.
    """
    gaps = {s: system.design.sensors[s].gap for s in system.design.counted}
    times = [*gaps.values(), *(1 / -row[i] for i, row in enumerate(system.W) if row[i] < 0)]
    span = Fraction(2) ** math.frexp(max(times, default=1))[1]
    for i, row in enumerate(system.W):
        rate, limit = dot(row, v) + system.f[i], v[i]
        alone = PositiveFlow([[row[i]]], [rate - row[i] * limit])
        shown = rate < 0 or system.flow.is_below(v, i, limit, (span, span))
        for s, gap in gaps.items():
            u = least(system.sampled(s)[0], v)
            shown = shown or alone.is_below([u[i]], 0, limit, (NOW[0], gap))
            shown = shown or system.flow.is_below(u, i, limit, (NOW[0], gap))
        demand(shown, f"entry {i + 1} of the bound is not proved")


def prove_width(design: Design, evidence: Table) -> str:
    """Prove the width at all times of a plant without events; return it in words."""
    n = {"n": design.n}
    always, (v,) = array(evidence["always"], "n", n), array(evidence["tube"], "vn", n)
    demand(all(0 < a <= b for a, b in zip(v, always)), "the bound is below the tube, or 0")
    prove_still(WidthMaps(design, homogeneous=False), v)  # as time goes on w < v, v <= always
    return (
        f"with b, v in bounds of the gains the width comes to at most {tuple(map(float, always))}"
    )


# 8. The verdict ----------------------------------------------------------------------------------


def assumed(design: Design) -> str:
    """When events and samples come, in words: the proof rests on each of these."""
    ends = [" to ".join(repr(float(t)) for t in x.every) for x in design.events]
    words = [f"{x.name!a} again {own} later" for x, own in zip(design.events, ends)]
    if len(design.events) > 1 and design.spacing:
        words.append(f"different events at least {float(design.spacing)!r} apart")
    for k, x in enumerate(design.sensors):
        own = "nothing" if x.event is None else f"a sample {x.sees} every {x.event!a}"
        own = f"a sample in any {float(x.gap)!r}" if k in design.counted else own
        words.append(f"of {x.name!a} {own}")
    return ", ".join(words + ["every report in"] * design.is_late)


def prove_design(design: Design) -> List[str]:
    """Prove what this program knows of a design; return sentences: what was proved, what not."""
    design.read()
    prove_stability(design, design.evidence["event_stability"])
    proved = {"event_stability": "without disturbances and noise the width tends to zero"}
    if not design.events and "event_width" in design.evidence:
        proved["event_width"] = prove_width(design, design.evidence["event_width"])
    others = ascii(sorted({*design.evidence} - {*proved}))
    return [
        *(f"proved: {each}; assumed: {assumed(design)}" for each in proved.values()),
        f"not checked: {others}, whether bounds of b and v in the gains are those of the problem, "
        "and L and M those that it may state, options, and any other word of the file",
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
