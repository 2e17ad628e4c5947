"""Find R(tau) of `lmi.prove.clock_matrix`: the largest margin t of its conditions.

    maximise t   subject to   (a), (c) with margin t DECAY,   (b) with margin t w(tau),   tr R_0 = n

The time unit is the last node. w = tau, but never below LEAST_WEIGHT: the form cannot be larger
right after a jump, and a constant margin would leave none for short dwell times. Where a solution
is not proved, the search goes on in coordinates in which its R_0 is the identity. Nothing here is
proved; every proposal is.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import clarabel
import numpy as np

from lmi.arithmetic.arrays import Array, Matrix
from lmi.arithmetic.balancing import Scaling
from lmi.arithmetic.balls import to_float
from lmi.find.conic import maximise_last, smat, svec, triangle
from lmi.find.semidefinite import congruences
from lmi.memory import require_cones
from lmi.parameters import AffineFamily
from lmi.prove.clock_matrix import prove_clock_matrix
from lmi.time_budget import UNLIMITED, TimeBudget
from lmi.verdict import Verdict, undecided

DEGREE = 3
SEGMENTS = (8, 12, 16, 24)
_DECAY = 0.1
_LEAST_WEIGHT = 1e-4
# lower bound of R_0, whose trace is n
_FLOOR = 1e-6
_TURNS = 3
# a margin below it is none, even in better coordinates
_HOPELESS = -1e-2
# ranges that begin this early, relative to their end, have nodes crowded at their beginning
_CROWDED = ((0.03, 3.0), (0.25, 2.0))


def find_clock_matrix(
    family: AffineFamily,
    low: float,
    high: float,
    *,
    segments: Sequence[int] = SEGMENTS,
    budget: TimeBudget = UNLIMITED,
) -> Verdict:
    """Proved with a certificate, {"nodes", "R"}, of the fewest segments that do; else undecided.

    low, high: range of the dwell time; high may be infinite. Undecided evidence has the largest
    margin seen, "approx_margin", in units of the last attempt.
    """
    attempt = undecided("no matrices were tried")
    for count in dict.fromkeys([0] if high == 0 or (low == 0 and math.isinf(high)) else segments):
        attempt = _attempt(family, low, high, nodes_of(low, high, count), budget)
        if attempt.outcome == "proved" or budget.remaining() < 0:
            break
    if attempt.outcome == "proved":
        return attempt
    return Verdict("undecided", {**attempt.evidence, **budget.ended()}, attempt.solvers)


def nodes_of(low: float, high: float, segments: int) -> list[float]:
    """Nodes from 0 to high, or to low where high is infinite; low is one of them."""
    last = low if math.isinf(high) else high
    if segments == 0:
        return [0.0]
    share = 0.0 if last == low else 1 - low / last
    before = 0 if low == 0 else max(1, round(segments * (1 - share))) if share else segments
    power = next((g for early, g in _CROWDED if low < early * last), 1.0)
    nodes = [low * k / before for k in range(before)] + [low]
    if share:
        steps = segments if power > 1 else max(segments - before, segments // 2)
        nodes += [low + (last - low) * (k / steps) ** power for k in range(1, steps)] + [last]
    return nodes


@dataclass(frozen=True)
class _Vertices:
    """Matrices in floats, (k, n, n) each, in the coordinates of the search; time unit 1."""

    flows: Matrix
    jumps: Matrix

    def changed(self, S: Matrix) -> _Vertices:
        """The same matrices for z = S^-1 x."""
        back = np.linalg.inv(S)
        return _Vertices(back @ self.flows @ S, back @ self.jumps @ S)


def _attempt(
    family: AffineFamily, low: float, high: float, nodes: list[float], budget: TimeBudget
) -> Verdict:
    """One set of nodes, in coordinates that follow the solutions."""
    scaling = Scaling.from_pair(abs(family.A).sum(axis=0), abs(family.G).sum(axis=0), nodes[-1])
    unit = nodes[-1] or 1.0
    vertices = _Vertices(
        np.array([to_float(scaling.map(A)) for A in family.flow_vertices()]) * unit,
        np.array([to_float(scaling.map(G)) for G in family.jump_vertices()]),
    )
    times = np.array(nodes) / unit
    first = nodes.index(low) * DEGREE if len(nodes) > 1 else 0
    must_decay = nodes[-1] < high
    S, margin = np.eye(family.order), -math.inf
    attempt = undecided("the solver has no matrices")
    for _ in range(_TURNS):
        seconds = max(budget.remaining(), 0.0)
        R, margin = _solved(vertices.changed(S), times, first, must_decay, seconds)
        if not np.isfinite(R).all() or margin < _HOPELESS:
            break
        back = np.linalg.inv(S)
        certificate = {"nodes": nodes, "R": _stored(back.T @ R @ back, scaling)}
        attempt = prove_clock_matrix(family, low, high, certificate)
        if attempt.outcome == "proved":
            evidence = {**certificate, **attempt.evidence, "approx_margin": margin}
            return Verdict("proved", evidence, ("Clarabel",))
        values, vectors = np.linalg.eigh(R[0])
        S = S @ (vectors / np.sqrt(np.maximum(values, _FLOOR)))
    return Verdict("undecided", {**attempt.evidence, "approx_margin": margin}, ("Clarabel",))


def _stored(R: Matrix, scaling: Scaling) -> list[list[list[float]]]:
    R = scaling.undone.form((R + np.swapaxes(R, 1, 2)) / 2)
    stored: list[list[list[float]]] = R.tolist()
    return stored


def _solved(
    vertices: _Vertices, times: Matrix, first: int, must_decay: bool, seconds: float
) -> tuple[Matrix, float]:
    """Coefficients of R and the margin t; floats, which may be nan."""
    n, K = vertices.flows.shape[-1], len(times) - 1
    blocks = K * DEGREE + 1
    cones = 1 + (blocks - first) * len(vertices.jumps) + (
        (K * (DEGREE + 1) + must_decay) * len(vertices.flows)
    )  # fmt: skip
    require_cones(
        f"a matrix of {n} states on {K} segments at {len(vertices.flows)} vertices", [n] * cones,
        "fewer states or parameters are required",
    )  # fmt: skip
    program = _Program(n, blocks)
    program.add({0: -program.own}, 0.0, _FLOOR)
    for rows in _flow_rows(vertices, times):
        program.add(rows, _DECAY)
    images = congruences(vertices.jumps)
    greville = np.interp(np.arange(blocks) / DEGREE, np.arange(K + 1), times)
    for image in images:
        for c in range(first, blocks):
            rows = {c: -program.own}
            rows[0] = rows.get(0, 0) + image
            program.add(rows, max(float(greville[c]), _LEAST_WEIGHT))
    if must_decay:
        for A in vertices.flows:
            program.add({blocks - 1: lyapunov(A)}, _DECAY)
    return program.solved(seconds)


def _flow_rows(vertices: _Vertices, times: Matrix) -> Iterator[dict[int, Matrix]]:
    """Matrices by block of condition (a), as it must be negative."""
    unit = np.eye(triangle(vertices.flows.shape[-1])[0].size)
    for A in vertices.flows:
        operator = lyapunov(A)
        for k, h in enumerate(np.diff(times)):
            for j in range(DEGREE + 1):
                c, before, after = k * DEGREE + j, j / h, (DEGREE - j) / h
                rows = {c: operator + (before - after) * unit}
                if j > 0:
                    rows[c - 1] = -before * unit
                if j < DEGREE:
                    rows[c + 1] = after * unit
                yield rows


@dataclass
class _Program:
    """Rows sum_c M_c svec(R_c) + t margin svec(I) <= -floor svec(I), and tr R_0 = n."""

    n: int
    blocks: int
    entries: list[tuple[Array, Array, Array]] = field(default_factory=list)
    right: list[Matrix] = field(default_factory=list)

    @property
    def size(self) -> int:
        """Length of svec of one block."""
        return self.n * (self.n + 1) // 2

    @property
    def own(self) -> Matrix:
        """The identity on svec."""
        return np.eye(self.size)

    def add(self, rows: dict[int, Matrix], margin: float, floor: float = 0.0) -> None:
        """Append one semidefinite constraint."""
        start, unit = len(self.right) * self.size, svec(np.eye(self.n))
        for block, M in rows.items():
            i, j = np.nonzero(M)
            self.entries.append((start + i, block * self.size + j, M[i, j]))
        if margin:
            i = np.flatnonzero(unit)
            last = np.full(len(i), self.blocks * self.size)
            self.entries.append((start + i, last, margin * unit[i]))
        self.right.append(-floor * unit)

    def solved(self, seconds: float) -> tuple[Matrix, float]:
        """(R, t), as the solver left them."""
        cones = [clarabel.PSDTriangleConeT(self.n)] * len(self.right) + [clarabel.ZeroConeT(1)]
        b = np.concatenate([*self.right, [float(self.n)]])
        i = np.flatnonzero(svec(np.eye(self.n)))
        self.entries.append((np.full(len(i), len(b) - 1), i, np.ones(len(i))))
        rows, columns, values = (np.concatenate(part) for part in zip(*self.entries, strict=True))
        shape = (len(b), self.blocks * self.size + 1)
        from scipy import sparse  # slow to import

        A = sparse.csc_matrix((values, (rows, columns)), shape=shape)
        x, _ = maximise_last(A, b, cones, seconds=seconds)
        return smat(x[:-1].reshape(self.blocks, self.size)), float(x[-1])


def lyapunov(A: Matrix) -> Matrix:
    """The matrix of R -> A'R + R A on svec."""
    n = len(A)
    basis = smat(np.eye(n * (n + 1) // 2))
    operator: Matrix = svec(A.T @ basis + basis @ A).T
    return operator
