#!/usr/bin/env python3
"""Prove again from a design file that a plant with uncertain parameters is stable by itself.

    python3 -I -S check_uncertain.py design.json          ("-" reads standard input)

This file needs nothing but Python >= 3.8 and its standard library, and all of its numbers are
fractions. It is about the claim `robust_stability` of designs of kind luenberger: the plant

    x'(t) = A(p) x between jumps,  x(t) = G(p) x(t-) at jumps,  A(p) = A + sum_i p_i A_i, G alike,

tends to zero for every course of the parameters p_i(t) in their ranges and every sequence of dwell
times in [low, high]; the value of a parameter at a jump is one of its own. A parameter that is
constant is one unknown number.

The certificate: R(tau), tau the time since the last jump, piecewise polynomial of degree d between
nodes 0 = tau_0 < ... < tau_K, by its Bernstein coefficients R_0, ..., R_(K d); segment k, of length
h, has R_(kd), ..., R_(kd+d); after tau_K it stays R_(Kd). With X < Y if Y - X is positive definite,

    (a)  A'R_c + R_c A + (j/h) (R_c - R_(c-1)) + ((d-j)/h) (R_(c+1) - R_c) < 0,  c = kd + j
    (b)  0 < R_0,  and  G'R_0 G < R_c  for all coefficients where tau >= low
    (c)  A'R_(Kd) + R_(Kd) A < 0  if tau_K < high

at all corners A, G of the ranges. (a) has the Bernstein coefficients of A'R + R A + dR/dtau, so
that x'R(tau)x falls between jumps, by (b) at jumps, and by (c) after the last node. R(tau) > 0 by
(b) where tau >= low, and before it, since x'R(tau)x falls on its way to a positive value there. The
conditions are affine in A and convex in G: what holds at the corners holds in the ranges. The range
of a constant parameter may be cut in halves, each with a certificate of its own.

Exit code 0: proved. 1: not proved (which refutes nothing). 2: not a design that this program reads.
Whatever goes wrong on the way raises an error, and an error never proves anything.
"""

import hashlib
import itertools
import json
import math
import sys
from fractions import Fraction
from typing import Any, Dict, List, Tuple

Matrix = List[List[Fraction]]
Table = Dict[str, Any]
Ends = Tuple[Fraction, Any]  # the longest dwell time is a Fraction, or math.inf

MOST_PARAMETERS = 10
PROBLEM = {
    "flow": "A B D d_bounds disturbance disturbance_matrix input_bound A_radius",
    "jump": "G E H disturbance disturbance_matrix dwell_time dwell_jitter input_bound G_radius",
}
# besides: what does not act on the plant by itself; `state`, a box of x, would only restrict it
BLOCKS = {"name", "names", "output", "observer", "parameter", "state", *PROBLEM}


class NotProved(Exception):
    """The reason for which something is not proved."""


def demand(condition: bool, reason: str) -> None:
    """NotProved unless the condition holds."""
    if not condition:
        raise NotProved(reason)


# 1. Numbers and matrices, exact ------------------------------------------------------------------


def number(value: Any) -> Fraction:
    """A number of the file, exact: a double, none beyond 1e150, no truth value, no word."""
    is_number = type(value) in (int, float) and abs(value) <= 1e150  # false for NaN and infinity
    demand(is_number and value == float(value), f"no double up to 1e150: {value!r:.40}")
    return Fraction(value)


def square(value: Any, n: int) -> Matrix:
    """An n x n matrix of the file."""
    is_square = type(value) is list and all(type(row) is list and len(row) == n for row in value)
    demand(is_square and len(value) == n, f"an {n} x {n} matrix is due")
    return [[number(entry) for entry in row] for row in value]


def product(X: Matrix, Y: Matrix) -> Matrix:
    """X Y."""
    return [[sum((a * b for a, b in zip(row, c)), Fraction(0)) for c in zip(*Y)] for row in X]


def total(X: Matrix, Y: Matrix, factor: Fraction = Fraction(1)) -> Matrix:
    """X + factor Y."""
    return [[a + factor * b for a, b in zip(*rows)] for rows in zip(X, Y)]


def transposed(X: Matrix) -> Matrix:
    """X'."""
    return [list(column) for column in zip(*X)]


def lyapunov(A: Matrix, R: Matrix) -> Matrix:
    """A'R + R A, for a symmetric R."""
    image = product(R, A)
    return total(image, transposed(image))


def demand_less(X: Matrix, Y: Matrix, condition: str) -> None:
    """Prove X < Y by elimination: every pivot of Y - X is positive, exactly."""
    D = total(Y, X, Fraction(-1))
    while D:
        pivot, row = D[0][0], D[0]
        demand(pivot > 0, f"condition ({condition}) fails")
        D = [[a - b[0] * c / pivot for a, c in zip(b[1:], row[1:])] for b in D[1:]]


# 2. The plant ------------------------------------------------------------------------------------


class Family:
    """A(p), G(p) with |p_i| <= 1: the middle, and what each parameter adds on half its range."""

    def __init__(self, A: List[Matrix], G: List[Matrix], is_constant: List[bool]) -> None:
        self.A, self.G, self.is_constant = A, G, is_constant

    def half(self, i: int, side: int) -> "Family":
        """The family with p_i in [-1, 0] (side -1) or [0, 1] (side 1), |p_i| <= 1 again."""
        halves = []
        for middle, *effects in (self.A, self.G):
            zeros = total(middle, middle, Fraction(-1))
            half = total(zeros, effects[i], Fraction(1, 2))
            halves.append([total(middle, half, Fraction(side)), *effects])
            halves[-1][1 + i] = half
        return Family(halves[0], halves[1], self.is_constant)


def corners(parts: List[Matrix]) -> List[Matrix]:
    """The middle plus and minus every effect that is not zero: their hull holds all of them."""
    middle, *effects = parts
    acting = [effect for effect in effects if any(map(any, effect))]
    demand(len(acting) <= MOST_PARAMETERS, f"more than {MOST_PARAMETERS} parameters act")
    result = []
    for signs in itertools.product((-1, 1), repeat=len(acting)):
        vertex = middle
        for sign, effect in zip(signs, acting):
            vertex = total(vertex, effect, Fraction(sign))
        result.append(vertex)
    return result


def radius_parameters(block: Table, name: str, n: int) -> List[Table]:
    """A parameter for each entry that is known up to a radius, as `flow.A_radius` says."""
    result: List[Table] = []
    if f"{name}_radius" not in block:
        return result
    rows = block[f"{name}_radius"]
    square(rows, n)
    for i, j in itertools.product(range(n), repeat=2):
        unit = [[float((i, j) == (k, m)) for m in range(n)] for k in range(n)]
        demand(rows[i][j] >= 0, "a radius must not be negative")
        result.append({"range": [-rows[i][j], rows[i][j]], "constant": False, name: unit})
    return result


def read_family(problem: Table) -> Family:
    """The family of a problem, every range as its middle and half its width."""
    flow, jump = problem["flow"], problem.get("jump", {})
    n = len(flow["A"])
    zeros = [[Fraction(0)] * n for _ in range(n)]
    middle = {"A": square(flow["A"], n), "G": square(jump["G"], n) if jump else zeros}
    effects: Dict[str, List[Matrix]] = {"A": [], "G": []}
    stated = [*problem.get("parameter", [])]
    stated += radius_parameters(flow, "A", n) + radius_parameters(jump, "G", n)
    for parameter in stated:
        known = {"name", "range", "constant", "A", "B", "G", "E", "C"}
        demand({*parameter} <= known, "an entry of a parameter is not known to this program")
        low, high = map(number, parameter["range"])
        demand(low <= high, "a range must be [low, high]")
        demand(type(parameter.get("constant", False)) is bool, "constant must be true or false")
        for name in effects:
            unit = square(parameter[name], n) if name in parameter else zeros
            middle[name] = total(middle[name], unit, (low + high) / 2)
            effects[name].append(total(zeros, unit, (high - low) / 2))
    is_constant = [parameter.get("constant", False) for parameter in stated]
    return Family([middle["A"], *effects["A"]], [middle["G"], *effects["G"]], is_constant)


# 3. The certificate ------------------------------------------------------------------------------


def prove_tree(family: Family, ends: Ends, node: Table, depth: int) -> int:
    """Prove a certificate, or those of both halves of a constant parameter; the number of cells."""
    if "halves" not in node:
        prove_cell(family, ends, node)
        return 1
    i, (lower, upper) = node["parameter"], node["halves"]
    is_cut = type(i) is int and 0 <= i < len(family.is_constant) and family.is_constant[i]
    demand(is_cut and depth < 16, "only ranges of constant parameters are cut, 16 times at most")
    cells = prove_tree(family.half(i, -1), ends, lower, depth + 1)
    return cells + prove_tree(family.half(i, 1), ends, upper, depth + 1)


def prove_cell(family: Family, ends: Ends, certificate: Table) -> None:
    """Prove (a), (b) and (c) at all corners of a family."""
    n, (low, high) = len(family.A[0]), ends
    nodes = [number(value) for value in certificate["nodes"]]
    R = [square(value, n) for value in certificate["R"]]
    demand(all(transposed(S) == S for S in R), "a coefficient of R is not symmetric")
    rises = all(a < b for a, b in zip(nodes, nodes[1:]))
    demand(nodes[0] == 0 and rises and low in nodes and nodes[-1] <= high, "nodes do not fit")
    segments = len(nodes) - 1
    d = (len(R) - 1) // segments if segments else 0
    demand(len(R) == segments * d + 1 and (d > 0 or not segments), "R has not its coefficients")
    zeros = total(R[0], R[0], Fraction(-1))
    demand_less(zeros, R[0], "b")
    for G in corners(family.G):
        image = product(transposed(G), product(R[0], G))
        for S in R[nodes.index(low) * d :]:
            demand_less(image, S, "b")
    for A in corners(family.A):
        for k in range(segments):
            h = nodes[k + 1] - nodes[k]
            for j in range(d + 1):
                c, derivative = k * d + j, lyapunov(A, R[k * d + j])
                if j > 0:
                    derivative = total(derivative, total(R[c], R[c - 1], Fraction(-1)), j / h)
                if j < d:
                    derivative = total(derivative, total(R[c + 1], R[c], Fraction(-1)), (d - j) / h)
                demand_less(derivative, zeros, "a")
        if nodes[-1] < high:
            demand_less(lyapunov(A, R[-1]), zeros, "c")


# 4. The verdict ----------------------------------------------------------------------------------


def keys_once(items: List[Tuple[str, Any]]) -> Table:
    """A table of the file, whose keys must differ."""
    demand(len(dict(items)) == len(items), "a key stands twice")
    return dict(items)


class Design:
    """A design that is unchanged since it was signed: its plant, dwell times and certificate."""

    def __init__(self, text: str) -> None:
        body = json.loads(text, object_pairs_hook=keys_once)
        signed = {key: value for key, value in body.items() if key != "digest"}
        canonical = json.dumps(
            signed, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False
        )
        digest = "sha256:" + hashlib.sha256(canonical.encode("utf-8")).hexdigest()
        demand(body["digest"] == digest, "the digest is not that of the content")
        is_design = body["format"] == "obsdesign/design" and repr(body["version"]) == "1"
        demand(is_design and body["kind"] == "luenberger", "no design of this kind")
        problem = body["problem"]
        demand({*problem} <= BLOCKS, "plants with other blocks are not checked")
        for place, names in PROBLEM.items():
            unknown = {*problem.get(place, {})} - {*names.split()}
            demand(not unknown, f"{place}: {sorted(unknown)} is not known to this program")
        self.family = read_family(problem)
        self.has_jumps = "jump" in problem
        low, high = problem["jump"]["dwell_time"] if self.has_jumps else [0, "inf"]
        self.ends: Ends = number(low), math.inf if high == "inf" else number(high)
        demand(0 <= self.ends[0] <= self.ends[1], "dwell_time must be [shortest, longest]")
        evidence = keys_once([(entry["id"], entry["evidence"]) for entry in body["claims"]])
        self.certificate = evidence["robust_stability"]["certificate"]


def prove_design(design: Design) -> List[str]:
    """Prove the claim; return sentences: what was proved, what not."""
    cells = prove_tree(design.family, design.ends, design.certificate, 0)
    low, high = (float(end) for end in design.ends)
    end = "inf)" if high == math.inf else f"{high!r}]"
    when = f", for every sequence of dwell times in [{low!r}, {end}" if design.has_jumps else ""
    return [
        "proved: the plant by itself tends to zero, for every course of its "
        f"{len(design.family.is_constant)} parameters in their ranges{when}, without inputs "
        f"(cells of constant parameters: {cells})",
        "not checked: the error of the observer, its gains, the box of the state, and any sentence "
        "of the file",
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
