"""Bounds of positive systems with inputs, proved for all times between two jumps.

    u' = W u + f,  u(0) = start          W Metzler, f >= 0

Question: X u(theta) <= bound for every theta in [low, high], X >= 0, high may be infinite. With
X = N and bound = start - h it says that `start` is not exceeded after a jump N u + h: a tube, in
which the system stays from jump to jump, and to which it comes from anywhere, since the inequality
is strict. Ball arithmetic, mean value form on steps of adapted length; no solver.

What a positive system with inputs tends to under one constant dwell time, from above.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balancing import Scaling
from lmi.arithmetic.balls import (
    PRECISIONS,
    Balls,
    Exact,
    ball,
    exact,
    exp_around,
    exp_times,
    identity,
    number,
    precision,
    solve,
    to_float,
    upper_ends,
    working_bits,
)
from lmi.verdict import Verdict, proved, undecided


def periodic_limit(
    W: Exact, N: Exact, f: Exact, h: Exact, theta: float
) -> tuple[Matrix, Matrix, Matrix] | None:
    """Upper ends of what u' = W u + f, u+ = N u + h tends to under a constant theta > 0.

    (before a jump, after it, on average), (n,) floats that exceed the exact limits by less than an
    ulp or two; None when no limit can be certified. The system must be stable: not checked here.
    """
    n = len(f)
    zero, unit = np.full((n, n), f[0] * 0, dtype=object), exact(np.eye(n))
    Z = np.block([[W, unit, zero], [zero, zero, unit], [zero, zero, zero]])
    with precision(PRECISIONS[1]):
        whole = exp_times(Z, theta).tolist()
        flow, once, twice = (
            type(ball(unit))([row[k * n : (k + 1) * n] for row in whole[:n]]) for k in range(3)
        )
        push, kick = ball(f[:, None]), ball(h[:, None])
        before = solve(identity(n) - flow * ball(N), flow * kick + once * push)
        if before is None:
            return None
        after = ball(N) * before + kick
        total = once * after + twice * push
        mean = total * (1 / number(theta))
        ends = [upper_ends(x).reshape(-1) for x in (before, after, mean)]
    return (ends[0], ends[1], ends[2]) if np.isfinite(ends).all() else None


STEP_LIMIT = 1500
_SHORTEST = 2.0**-40  # of the natural time unit: shorter steps mean that nothing is left to gain


@dataclass(frozen=True)
class Affine:
    """u' = W u + f from start; exact (n, n), (n,), (n,).

    matrices: the exponentials that were computed, by time or radius and precision; a system with
    another start, made by `dataclasses.replace`, shares them.
    """

    W: Exact
    f: Exact
    start: Exact
    matrices: dict[tuple[str, float, int], Balls] = field(
        default_factory=dict, compare=False, repr=False
    )

    @cached_property
    def generator(self) -> Exact:
        """Of (u, 1)."""
        n = len(self.f)
        Z = np.full((n + 1, n + 1), self.f[0] * 0, dtype=object)
        Z[:n, :n], Z[:n, n] = self.W, self.f
        return Z

    @property
    def generator_ball(self) -> Balls:
        """The generator, at the current precision."""
        return self._known("generator", 0.0, lambda: ball(self.generator))

    def flow(self, theta: float) -> Balls:
        """e^(Z theta) of the generator Z."""
        return self._known("flow", theta, lambda: exp_times(self.generator, theta))

    def flow_around(self, radius: float) -> Balls:
        """Ball matrix that contains e^(Z s) for every |s| <= radius."""
        return self._known("around", radius, lambda: exp_around(self.generator, radius))

    def _known(self, name: str, time: float, made: Callable[[], Balls]) -> Balls:
        key = (name, time, working_bits())
        if key not in self.matrices:
            self.matrices[key] = made()
        return self.matrices[key]


@dataclass(frozen=True)
class Tube:
    """Bounds of the tube that u is compared with.

    v (n,): after a jump u+ = N u + h. before, always (q,): X u in [low, high] and in
    [0, high]; after (q,): X v. Exact.
    """

    v: Exact
    after: Exact
    before: Exact
    always: Exact


def prove_tube(
    W: Exact, f: Exact, N: Exact, h: Exact, X: Exact, *, tube: Tube, low: float, high: float
) -> Verdict:
    """Prove that a tube is invariant and attracts: u' = W u + f, u+ = N u + h.

    Dwell times between jumps are in [low, high]. With v > 0 the strict inequality N e^{W theta} v <
    v shrinks whatever is outside. States and rows of X are measured in powers of two like v and
    `always`.
    """
    if not all(x > 0 for x in tube.v):
        return undecided("the tube is not positive")
    if not all(a >= b for a, b in zip(tube.after, X @ tube.v, strict=True)):
        return undecided("the bound after jumps is below the tube")
    state, out = Scaling.like(to_float(tube.v)), Scaling.like(to_float(tube.always))
    flow, steps = Affine(state.map(W), state.rows(f), state.rows(tube.v)), 0
    X = out.rows(state.columns(X))
    before, always = out.rows(tube.before), out.rows(tube.always)
    for rows, bound, start in (
        (state.map(N), state.rows(tube.v - h), low), (X, before, low), (X, always, 0.0),
    ):  # fmt: skip
        verdict = prove_below(flow, rows, bound, start, high)
        if verdict.outcome != "proved":
            return verdict
        steps += verdict.evidence["steps"]
    return proved(method="mean value form in balls", steps=steps)


def prove_below(system: Affine, X: Exact, bound: Exact, low: float, high: float) -> Verdict:
    """X u(theta) < bound, entry by entry, for all theta in [low, high]; undecided otherwise.

    X (q, n) >= 0 and bound (q,), exact. Signs of W, f and X are checked here.
    """
    n = len(system.f)
    off_diagonal = system.W[~np.eye(n, dtype=bool)]
    if any(entry < 0 for entry in [*off_diagonal, *system.f, *system.start, *X.flat]):
        return undecided("the system is not positive")
    verdict = undecided("no attempt was made")
    for bits in PRECISIONS[:2]:
        with precision(bits), np.errstate(all="ignore"):
            verdict = _stepped(system, X, bound, float(low), float(high))
        if verdict.outcome == "proved" or verdict.evidence.get("steps", 0) >= STEP_LIMIT:
            break
    return verdict


def _stepped(system: Affine, X: Exact, bound: Exact, low: float, high: float) -> Verdict:
    Z = system.generator_ball
    rows = ball(np.hstack([X, -bound[:, None]]))
    start = ball(np.append(system.start, exact([1.0]))[:, None])
    unit = 1.0 / max(float(np.abs(to_float(system.W)).sum(axis=1).max()), 1e-300)
    steady = _steady(system, X, bound) if math.isinf(high) else None
    theta, step = low, min(unit, high - low)
    for count in range(1, STEP_LIMIT + 1):
        state = system.flow(theta) * start
        if not _negative(rows * state):
            reason = f"the bound fails, or nearly fails, at theta = {theta!r}"
            return undecided(reason, theta=theta, steps=count)
        if theta >= high:
            return proved(steps=count)
        if _is_decreasing(Z, state) or _is_below(state, steady):
            return proved(steps=count, tail_from=theta)
        while True:
            end = min(theta + step, high)
            half = 0.5 * (end - theta)
            middle = theta + half
            if not end > theta or step < _SHORTEST * unit:
                reason = f"the bound fails, or nearly fails, after theta = {theta!r}"
                return undecided(reason, theta=theta, steps=count)
            reach = max(
                math.nextafter(middle - theta, math.inf), math.nextafter(end - middle, math.inf)
            )
            if _step(rows, Z, system.flow(middle) * start, system.flow_around(reach), reach):
                break
            step *= 0.5
        theta, step = end, step * 1.7
    return undecided(f"{STEP_LIMIT} steps did not reach the end", theta=theta, steps=STEP_LIMIT)


def _step(rows: Balls, Z: Balls, middle: Balls, around: Balls, reach: float) -> bool:
    """Mean value form: value in the middle, plus the largest rate times the way to the ends."""
    values = (rows * middle).entries()
    # of the rate in the middle, where a fast state that has settled moves little: e^(Zs) is wide
    slopes = (rows * (around * (Z * middle))).entries()
    pairs = zip(values, slopes, strict=True)
    return all(bool(value + abs(slope) * number(reach) < 0) for value, slope in pairs)


def _negative(column: Balls) -> bool:
    return all(bool(x < 0) for x in column.entries())


def _is_decreasing(Z: Balls, state: Balls) -> bool:
    """u' <= 0 now, hence for ever: u' is a solution of the positive system y' = W y."""
    return all(bool(x <= 0) for x in (Z * state).entries())


def _steady(system: Affine, X: Exact, bound: Exact) -> Exact | None:
    """z with W z + f < 0 and X z < bound: whatever is below it stays below, and below the bound."""
    W, f = to_float(system.W), to_float(system.f)
    try:
        push = np.linalg.solve(-W, np.ones(len(W)))
        equilibrium = np.linalg.solve(-W, f)
    except np.linalg.LinAlgError:
        return None
    if not (np.isfinite(push).all() and np.isfinite(equilibrium).all()):
        return None
    scale = max(float(np.abs(equilibrium).max()), 1e-300) / max(float(np.abs(push).max()), 1e-300)
    for share in (1e-2, 1e-4, 1e-6, 1e-8):
        z = exact(equilibrium + share * scale * push)
        inside = all(x < b for x, b in zip(X @ z, bound, strict=True))
        if inside and all(x < 0 for x in system.W @ z + system.f):
            return z
    return None


def _is_below(state: Balls, steady: Exact | None) -> bool:
    if steady is None:
        return False
    return all(bool(x <= number_of) for x, number_of in zip(
        state.entries(), ball(steady[:, None]).entries(), strict=False
    ))  # fmt: skip
