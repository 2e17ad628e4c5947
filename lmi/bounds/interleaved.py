"""Boxes under two kinds of events: samples at a fixed period, jumps in between; proved.

    r+ = |e^{A s}| r + c(s)              over a time s without an event
    r+ = |K e^{A s}| r + d(s) + k        over a time s that ends with a sample
    r+ = |G e^{A s}| r + e(s) + j        over a time s that ends with a jump, with times between
                                         jumps in [low, high]

A, K, G of any sign; c, d, e bound what b >= 0 adds on the way
(`lmi.arithmetic.exponential.absolute_flow`). Boxes of a state x' = A x + u with |u| <= b obey this,
and the product with K or G is taken before the absolute value, not after it. A positive system w' =
W w + b, w+ = K w + k, w+ = G w + j is the case of a Metzler A and K, G >= 0.

From just after a sample, m periods without a jump and then one with a jump at the offset s lead to

    p_0 = p,  p_{i+1} = P(h) p_i,      psi(s) = P(h - s) J(s) p_m

with P, J the last two maps, and if psi(s) < p for every s and every m that the range of dwell times
allows, p is not exceeded at the sample after a jump, and drawn to: the strict inequality contracts
what is outside. One jump at most falls in a period (low >= h). Where jumps may stay away for ever a
vector above some p_m that P(h) does not raise bounds all later ones. Ball arithmetic, no solver.

lost: a sample at the time of a jump is not taken. Then P(h) J(h) p_m < p has to hold as well, two
periods between samples, and low > h: else there might be no samples at all.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balancing import Scaling
from lmi.arithmetic.balls import (
    Balls,
    Exact,
    Rational,
    ball,
    exact,
    middle,
    precision,
    rational,
    to_float,
    upper_ends,
)
from lmi.bounds.mean_value import Path, Time, absolute_flow, constant
from lmi.verdict import Verdict, proved, undecided

_BITS = 128
_STEPS = 1500
MOST_PERIODS = 4000
_SHORTEST = 2.0**-30  # of a period
_SETTLED = (1e-12, 1e-9, 1e-7)  # relative room for a bound of all later p_m


@dataclass(frozen=True)
class Interleaved:
    """Exact matrices; G, j None without jumps. period, low, high: floats, taken exactly.

    lost: no sample is taken at the time of a jump.
    """

    A: Exact
    b: Exact
    K: Exact
    k: Exact
    G: Exact | None
    j: Exact | None
    period: float
    low: float
    high: float
    lost: bool = False

    @property
    def periods(self) -> tuple[int, float]:
        """Fewest and most periods without a jump between two that hold one."""
        h = rational(self.period)
        whole = rational(self.low) / h
        # a jump at a sample is in the period before it if that sample is lost, else in either
        fewest = int(whole.ceil()) - 2 if self.lost else max(1, int(whole.floor())) - 1
        if math.isinf(self.high):
            return fewest, math.inf
        return fewest, max(int((rational(self.high) / h).ceil()) - 1, fewest)

    def sampled(self, time: Time) -> tuple[Path, Path]:
        """(sizes, added) of a time that ends with a sample."""
        sizes, added = absolute_flow(self.K, self.A, self.b, time)
        return sizes, added + constant(self.k)

    def jumped(self, time: Time) -> tuple[Path, Path]:
        """(sizes, added) of a time that ends with a jump."""
        assert self.G is not None
        assert self.j is not None
        sizes, added = absolute_flow(self.G, self.A, self.b, time)
        return sizes, added + constant(self.j)

    @property
    def whole(self) -> Time:
        """A period."""
        return Time(rational(self.period), 0.0, rational(0.0))

    def over_period(self) -> Balls:
        """Balls of the map from sample to sample on (r, 1)."""
        return _augmented(*self.sampled(self.whole))


@dataclass(frozen=True)
class Bounds:
    """Bounds that are to be proved; exact.

    p (n,): after the sample that follows a jump (without jumps: after samples); sampled, jumped
    (n,): after any sample and after any jump; always (q,): X r.
    """

    p: Exact
    sampled: Exact
    jumped: Exact | None
    always: Exact


def prove_interleaved(system: Interleaved, X: Exact, bounds: Bounds) -> Verdict:
    """p is a tube and the other bounds hold in it, for every sequence of jumps; or undecided."""
    parts = [system.b, system.k, X] + ([] if system.j is None else [system.j])
    entries: list[Rational] = [x for part in parts for x in part.ravel().tolist()]
    if any(x < 0 for x in entries) or not all(x > 0 for x in bounds.p):
        return undecided("the system, or the tube, is not positive")
    system, X, bounds = _scaled(system, X, bounds)
    with precision(_BITS), np.errstate(all="ignore"):
        if system.G is None:
            return _samples(system, X, bounds)
        return _cycles(system, X, bounds)


def _scaled(system: Interleaved, X: Exact, bounds: Bounds) -> tuple[Interleaved, Exact, Bounds]:
    """The same question with states and rows of X in powers of two like p and `always`."""
    state, out = Scaling.like(to_float(bounds.p)), Scaling.like(to_float(bounds.always))
    jumped = None if bounds.jumped is None else state.rows(bounds.jumped)
    within = Bounds(
        state.rows(bounds.p), state.rows(bounds.sampled), jumped, out.rows(bounds.always)
    )
    scaled = replace(
        system,
        A=state.map(system.A),
        b=state.rows(system.b),
        K=state.map(system.K),
        k=state.rows(system.k),
        G=None if system.G is None else state.map(system.G),
        j=None if system.j is None else state.rows(system.j),
    )
    return scaled, out.rows(state.columns(X)), within


def _samples(system: Interleaved, X: Exact, bounds: Bounds) -> Verdict:
    """Without jumps: P(h) p < p <= sampled."""
    sample = system.over_period()
    if not _below(sample * _column(bounds.p), bounds.p):
        return undecided("the width after a sample is not below the tube one period later")
    if not all(a >= b for a, b in zip(bounds.sampled, bounds.p, strict=True)):
        return undecided("the bound after samples is below the tube")
    verdict = _between_samples(system, X, bounds, None)
    return proved(method="one period in balls") if verdict.outcome == "proved" else verdict


def _cycles(system: Interleaved, X: Exact, bounds: Bounds) -> Verdict:
    if system.low < system.period:
        return undecided(
            f"the shortest dwell time {system.low!r} is below the sampling period "
            f"{system.period!r}: several jumps may fall between two samples"
        )
    if system.lost and system.low <= system.period:
        return undecided(
            f"the shortest dwell time {system.low!r} is the sampling period: all samples may fall "
            "on jumps, where nothing is measured"
        )
    sample = system.over_period()
    before_jumps = _uppermost_before_jumps(system, bounds, sample)
    if isinstance(before_jumps, str):
        return undecided(before_jumps)
    widest, m = before_jumps
    if system.lost:
        jump = _augmented(*system.jumped(system.whole))
        if not _below(sample * jump * _column(widest), bounds.p):
            return undecided("the tube fails after a jump at a sample, which is lost")
    verdict = _between_samples(system, X, bounds, widest)
    if verdict.outcome != "proved":
        return verdict
    return proved(method="cycles in balls", periods=m, steps=verdict.evidence["steps"])


def _uppermost_before_jumps(
    system: Interleaved, bounds: Bounds, sample: Balls
) -> tuple[Exact, int] | str:
    """Above p_m for every m that allows a jump, and the last m looked at; or why there is none."""
    fewest, most = system.periods
    widest = np.full(len(system.b), -math.inf)
    p = _column(bounds.p)
    for m in range(MOST_PERIODS + 1):
        if not _below(p, bounds.sampled, strictly=False):
            return f"the bound after samples fails {m} periods after a jump"
        if m >= fewest:
            widest = np.maximum(upper_ends(p).reshape(-1)[:-1], widest)
            if m >= most:
                return exact(widest), m
            above = _not_raised(sample, p, bounds.sampled)
            if above is not None:
                return exact(np.maximum(above, widest)), m
        p = sample * p
    return f"the width still grows {MOST_PERIODS} periods after a jump"


def _not_raised(sample: Balls, p: Balls, limit: Exact) -> Matrix | None:
    """q >= p, q <= limit, that one more period does not raise: it bounds all that follows p."""
    top = upper_ends(p).reshape(-1)[:-1]
    candidates = [top]
    P = middle(sample)[:-1, :-1]
    try:
        push = np.linalg.solve(np.eye(len(P)) - P, np.ones(len(P)))
    except np.linalg.LinAlgError:
        push = np.full(len(P), math.inf)
    if np.isfinite(push).all() and (push > 0).all():
        candidates += [top + room * top.max() * push for room in _SETTLED]
    for q in candidates:
        column = _column(exact(q))
        if _below(column, limit, strictly=False) and _below(sample * column, exact(q), False):
            return q
    return None


def _between_samples(
    system: Interleaved, X: Exact, bounds: Bounds, widest: Exact | None
) -> Verdict:
    """Prove the bounds for every time s in [0, h] after a sample, by the mean value form."""
    h = system.period
    at, step = 0.0, h / 4
    for count in range(1, _STEPS + 1):
        if at >= h:
            return proved(steps=count)
        end = min(at + step, h)
        half = (rational(end) - rational(at)) / 2
        time = Time(rational(at) + half, math.nextafter(float(half.p) / float(half.q), math.inf),
                    rational(1.0))  # fmt: skip
        if all(_holds(*pair, time.reach) for pair in _comparisons(system, X, bounds, widest, time)):
            at, step = end, step * 1.7
        else:
            step *= 0.5
            if step < _SHORTEST * h:
                return undecided(f"the tube fails, or nearly fails, {at!r} after a sample")
    return undecided(f"{_STEPS} steps did not reach the end of the period")


def _comparisons(
    system: Interleaved, X: Exact, bounds: Bounds, widest: Exact | None, time: Time
) -> Iterator[tuple[Path, Exact]]:
    """Pairs of what has to be below and what it has to be below."""
    flow, added = absolute_flow(exact(np.eye(len(system.b))), system.A, system.b, time)
    out = constant(X)
    yield out * (flow * constant(bounds.sampled) + added), bounds.always
    if widest is None or bounds.jumped is None:
        return
    sizes, entering = system.jumped(time)
    jumped = sizes * constant(widest) + entering
    yield jumped, bounds.jumped
    yield out * (flow * constant(bounds.jumped) + added), bounds.always
    remaining = Time(rational(system.period) - time.middle, time.reach, -time.rate)
    late, pushed = system.sampled(remaining)
    yield late * jumped + pushed, bounds.p


def _holds(path: Path, bound: Exact, reach: float) -> bool:
    pairs = zip(path.upper(reach), ball(bound[:, None]).entries(), strict=True)
    return all(bool(x < b) for x, b in pairs)


def _augmented(sizes: Path, added: Path) -> Balls:
    """Balls of r -> sizes r + added on (r, 1), in the middle."""
    pairs = zip(sizes.middle.tolist(), added.middle.tolist(), strict=True)
    rows = [[*row, *more] for row, more in pairs]
    last = exact([0.0] * len(rows) + [1.0])
    return type(sizes.middle)([*rows, list(last)])


def _column(p: Exact) -> Balls:
    return ball(np.append(p, exact([1.0]))[:, None])


def _below(column: Balls, bound: Exact, strictly: bool = True) -> bool:
    pairs = zip(column.entries(), ball(bound[:, None]).entries(), strict=False)
    return all(bool(x < b) if strictly else bool(x <= b) for x, b in pairs)
