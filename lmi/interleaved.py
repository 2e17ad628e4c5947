"""Positive systems with two kinds of events: samples at a fixed period, jumps in between; proved.

    u' = W u + f             between events
    u+ = K u + k             every h, at samples
    u+ = N u + j             at jumps, with times between them in [low, high]

From just after a sample, m periods without a jump and then one with a jump at the offset s lead to

    p_0 = p,  p_{i+1} = K u_{p_i}(h) + k,      psi(s) = K u_{N u_{p_m}(s) + j}(h - s) + k

and if psi(s) < p for every s and every m that the range of dwell times allows, p is not exceeded at
the sample after a jump, and drawn to: the strict inequality contracts what is outside. One jump at
most falls in a period (low >= h). Ball arithmetic, no solver.

lost: a sample at the time of a jump is not taken. Then psi = K u_{N u_{p_m}(h) + j}(h) + k < p has
to hold as well, two periods between samples, and low > h: else there might be no samples at all.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from lmi.balls import (
    Exact,
    ball,
    exact,
    exp_around,
    exp_times,
    number,
    precision,
    rational,
    upper_ends,
)
from lmi.tube import Affine, prove_below
from lmi.verdict import Verdict, proved, undecided

_BITS = 128
_STEPS = 400
MOST_PERIODS = 4000
_SHORTEST = 2.0**-30  # of a period


@dataclass(frozen=True)
class Interleaved:
    """Exact matrices; N, j None without jumps. period, low, high: floats, taken exactly.

    lost: no sample is taken at the time of a jump.
    """

    W: Exact
    f: Exact
    K: Exact
    k: Exact
    N: Exact | None
    j: Exact | None
    period: float
    low: float
    high: float
    lost: bool = False

    @staticmethod
    def of(system: Any, period: float, low: float, high: float, lost: bool = False) -> Interleaved:
        """From an object with W, f, K, k, N, h (N, h None without jumps)."""
        W, f, K, k = (exact(X) for X in (system.W, system.f, system.K, system.k))
        N, j = (None if X is None else exact(X) for X in (system.N, system.h))
        return Interleaved(W, f, K, k, N, j, period, low, high, lost)

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


@dataclass(frozen=True)
class Bounds:
    """What is to be proved; exact. p (n,): after the sample that follows a jump (without jumps:
    after samples); sampled, jumped (n,): after any sample and after any jump; always (q,): X u.
    """

    p: Exact
    sampled: Exact
    jumped: Exact | None
    always: Exact


def prove_interleaved(system: Interleaved, X: Exact, bounds: Bounds) -> Verdict:
    """p is a tube and the other bounds hold in it, for every sequence of jumps; or undecided."""
    n = len(system.f)
    parts = [system.W[~np.eye(n, dtype=bool)], system.f, system.K, system.k]
    parts += [] if system.N is None or system.j is None else [system.N, system.j]
    entries: list[Any] = [x for part in parts for x in part.flat]
    if any(x < 0 for x in entries) or not all(x > 0 for x in bounds.p):
        return undecided("the system, or the tube, is not positive")
    with precision(_BITS), np.errstate(all="ignore"):
        verdict = _samples(system, bounds) if system.N is None else _cycles(system, bounds)
    if verdict.outcome != "proved":
        return verdict
    for start in (bounds.sampled, bounds.jumped):
        if start is not None:
            between = prove_below(
                Affine(system.W, system.f, start), X, bounds.always, 0.0, system.period
            )
            if between.outcome != "proved":
                return between
    return verdict


def _samples(system: Interleaved, bounds: Bounds) -> Verdict:
    """Without jumps: K u_p(h) + k < p <= sampled."""
    after = _augmented(system.K, system.k) * exp_times(_generator(system), system.period)
    if not _below(after * _column(bounds.p), bounds.p):
        return undecided("the width after a sample is not below the tube one period later")
    if not all(a >= b for a, b in zip(bounds.sampled, bounds.p, strict=True)):
        return undecided("the bound after samples is below the tube")
    return proved(method="one period in balls")


def _cycles(system: Interleaved, bounds: Bounds) -> Verdict:
    assert system.N is not None
    assert system.j is not None
    assert bounds.jumped is not None
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
    Z = _generator(system)
    sample = _augmented(system.K, system.k) * exp_times(Z, system.period)
    before_jumps = _uppermost_before_jumps(system, bounds, sample)
    if isinstance(before_jumps, str):
        return undecided(before_jumps)
    widest, m = before_jumps
    jump = _augmented(system.N, system.j)
    if system.lost:
        flow = exp_times(Z, system.period)
        if not _below(sample * jump * flow * _column(exact(widest)), bounds.p):
            return undecided("the tube fails after a jump at a sample, which is lost")
    verdict = _offsets(system, Z, jump, widest, bounds.p)
    if verdict.outcome != "proved":
        return verdict
    before = prove_below(
        Affine(system.W, system.f, exact(widest)), system.N, bounds.jumped - system.j, 0.0,
        system.period,
    )  # fmt: skip
    if before.outcome != "proved":
        return before
    return proved(method="cycles in balls", periods=m, steps=verdict.evidence["steps"])


def _uppermost_before_jumps(
    system: Interleaved, bounds: Bounds, sample: Any
) -> tuple[Any, int] | str:
    """Above p_m for every m that allows a jump, and the last m looked at; or why there is none."""
    fewest, most = system.periods
    widest, m = None, 0
    p = _column(bounds.p)
    while True:
        if not _below(p, bounds.sampled, strictly=False):
            return f"the bound after samples fails {m} periods after a jump"
        if m >= fewest:
            widest = _uppermost(p, widest)
        following = sample * p
        if _falls(following, p) and m >= fewest:
            break  # and goes on falling: sample is monotone
        if m >= most:
            break
        p, m = following, m + 1
        if m > MOST_PERIODS:
            return f"the width still grows {MOST_PERIODS} periods after a jump"
    if math.isinf(most) and not _falls(following, p):
        return "the width does not fall from sample to sample"
    assert widest is not None
    return widest, m


def _offsets(system: Interleaved, Z: Exact, jump: Any, start: Any, bound: Exact) -> Verdict:
    """psi(s) < bound for every offset s in [0, h], by the mean value form."""
    flow, h = ball(Z), system.period
    sample = _augmented(system.K, system.k)
    commutator = jump * flow - flow * jump
    column = _column(exact(start))
    at, step = 0.0, h / 4
    for count in range(1, _STEPS + 1):
        if at >= h:
            return proved(steps=count)
        end = min(at + step, h)
        middle = at + 0.5 * (end - at)
        reach = math.nextafter(max(middle - at, end - middle), math.inf)
        # h - middle is rounded: what is wrong with it is within an ulp
        rest = exp_times(Z, h - middle) * exp_around(Z, math.ulp(h))
        late, early = sample * rest, exp_times(Z, middle) * column
        around = exp_around(Z, reach)
        value = (late * jump * early).entries()
        slope = (late * around * commutator * around * early).entries()
        total = [x + abs(y) * number(reach) for x, y in zip(value, slope, strict=True)]
        if all(bool(x < b) for x, b in zip(total, ball(bound[:, None]).entries(), strict=False)):
            at, step = end, step * 1.7
        else:
            step *= 0.5
            if step < _SHORTEST * h:
                return undecided(
                    f"the tube fails, or nearly fails, for jumps {at!r} after a sample"
                )
    return undecided(f"{_STEPS} steps did not reach the end of the period")


def _generator(system: Interleaved) -> Exact:
    return Affine(system.W, system.f, system.f).generator


def _augmented(A: Exact, b: Exact) -> Any:
    """u -> A u + b on (u, 1)."""
    n = len(b)
    whole = exact(np.eye(n + 1))
    whole[:n, :n], whole[:n, n] = A, b
    return ball(whole)


def _column(p: Exact) -> Any:
    return ball(np.append(p, exact([1.0]))[:, None])


def _below(column: Any, bound: Exact, strictly: bool = True) -> bool:
    pairs = zip(column.entries(), ball(bound[:, None]).entries(), strict=False)
    return all(bool(x < b) if strictly else bool(x <= b) for x, b in pairs)


def _falls(following: Any, p: Any) -> bool:
    pairs = list(zip(following.entries(), p.entries(), strict=True))[:-1]
    return all(bool(x < y) for x, y in pairs)


def _uppermost(p: Any, so_far: Any) -> Any:
    """Entrywise upper bound of the columns seen, as floats."""
    here = upper_ends(p).reshape(-1)[:-1]
    return here if so_far is None else np.maximum(here, so_far)
