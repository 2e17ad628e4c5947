"""The largest decay rates that some common P allows: each step of a secant search finds a P.

The margin of the search falls almost linearly with the rate, so that two steps foretell where it
ends; the next one stays a little on this side. Proposals are floats; the rates that come out are
proved, each with a matrix of its own.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Entries, Matrix, NewEntries
from lmi.arithmetic.balancing import Scaling
from lmi.arithmetic.balls import Exact, exact, to_float
from lmi.families import Edge
from lmi.find.cutting_plane import Proposal, propose
from lmi.prove.rates import (
    LEAST_CONTRACTION,
    RATE_BOXES,
    Rates,
    approx_rates,
    propose_rates,
    prove_rate,
)
from lmi.time_budget import UNLIMITED, TimeBudget

# the search ends this close to where the margin is estimated to vanish, relative to the rate
_RELATIVE_ACCURACY = {"per_jump": 2e-3, "in_time": 5e-2}
# of the way to there this share remains, which is the margin of the proof
_REMAINING_SHARE, _MOST_STEPS = 0.1, 6


def largest_rates(
    F: ArrayLike,
    H: ArrayLike,
    P: ArrayLike,
    low: float,
    high: float,
    *,
    budget: TimeBudget = UNLIMITED,
) -> Entries | None:
    """The largest rates that some common P allows, nearly, proved; None if none are.

    Rates of x -> e^{F theta} H x, theta in [low, high]: per_jump is gamma with M' P M < gamma^2 P
    for M = e^{F theta} H; in_time is alpha, 1 / time unit, with the same for F + alpha I and
    gamma = 1. F, H: (n, n) floats or exact rationals; P: (n, n) of a proof over the range.
    Result: {"per_jump", "in_time", "P_per_jump", "P_in_time"}; where nothing better is proved, the
    rates of the given P alone.
    """
    flow, jump = exact(F), exact(H)
    scaling = Scaling.from_pair(flow, jump, high)
    given = scaling.form(np.asarray(P, dtype=np.float64))
    rates = _largest((scaling.map(flow), scaling.map(jump)), given, low, high, budget=budget)
    if rates is None:
        return None
    names = [name for name in rates if name.startswith("P_")]
    return rates | {name: scaling.undone.form(np.array(rates[name])).tolist() for name in names}


def _largest(
    pair: tuple[Exact, Exact], given: Matrix, low: float, high: float, *, budget: TimeBudget
) -> NewEntries | None:
    """`largest_rates` of a balanced pair (F, H), with P given in its coordinates."""
    F, H = pair
    approx = approx_rates(F, H, {"P": given.tolist()}, low, high)
    if approx is None:
        return None
    edge = Edge(to_float(F), to_float(H), low, high)
    limits, unit = _limits(edge), np.eye(len(edge.F))
    first = propose(edge.F, edge.H, low, high, start=given, budget=budget)
    search = _Search(edge, given, first, budget)
    families = {
        "per_jump": lambda x: (edge.F, edge.H / x),
        "in_time": lambda x: (edge.F + x * unit, edge.H),
    }
    result: NewEntries = {}
    for name, family in families.items():
        span = _Span(
            1.0 if name == "per_jump" else 0.0, getattr(approx, name), getattr(limits, name)
        )
        for value, better in search.towards(family, span, _RELATIVE_ACCURACY[name]):
            rates = Rates(value, 0.0) if name == "per_jump" else Rates(0.5, value)
            P = better.tolist()
            done = prove_rate(F, H, {"P": P}, low, high, rates=rates, name=name, steps=RATE_BOXES)
            if done.outcome == "proved":
                result |= {name: value, f"P_{name}": P}
                break
    if len(result) < 2 * len(families):
        usual = propose_rates(F, H, {"P": given.tolist()}, low, high)
        return None if usual is None else asdict(usual)
    return result


@dataclass(frozen=True)
class _Span:
    """Rates: of every stable system, as estimated for its P, and the limit for every P."""

    nothing: float
    estimate: float
    limit: float


def _limits(edge: Edge) -> Rates:
    """Rates that no P can exceed: those of the worst constant dwell time."""
    with np.errstate(all="ignore"):
        thetas, maps = edge.grid()
        radii = np.clip(np.abs(np.linalg.eigvals(maps)).max(axis=1), LEAST_CONTRACTION, None)
    later = thetas > 0
    in_time = float(np.min(-np.log(radii[later]) / thetas[later], initial=math.inf))
    if math.isinf(edge.high):
        in_time = min(in_time, -float(np.linalg.eigvals(edge.F).real.max()))
    return Rates(float(radii.max()), in_time)


@dataclass(frozen=True)
class _Search:
    """Of matrices P for larger and larger rates; first: the proposal for no rate.

    Each try works in the coordinates of P, with the theta of the last success.
    """

    edge: Edge
    P: Matrix
    first: Proposal
    budget: TimeBudget

    def towards(
        self, family: Callable[[float], tuple[Matrix, Matrix]], span: _Span, fine: float
    ) -> list[tuple[float, Matrix]]:
        """Rates with a P that floats find for them, best first."""
        last, reached, margin, bad = self.first, span.nothing, self.first.optimum, span.limit
        pairs = list[tuple[float, Matrix]]()
        if not (math.isfinite(bad) and margin > 0):
            return pairs
        following = span.estimate + _REMAINING_SHARE * (reached - span.estimate)
        for _ in range(_MOST_STEPS):
            if abs(following - reached) <= fine * abs(reached):
                break
            proposal = self._proposal(family(following), last.thetas)
            if proposal.P is None:
                bad = following
                following = (reached + bad) / 2
                continue
            fall = (margin - proposal.optimum) / (following - reached)
            last, reached, margin = proposal, following, proposal.optimum
            pairs.append((reached, proposal.P))
            end = reached + margin / fall if fall * (bad - reached) > 0 else bad
            end = end if abs(end - reached) < abs(bad - reached) else bad
            following = end + _REMAINING_SHARE * (reached - end)
        return pairs[::-1]

    def _proposal(self, pair: tuple[Matrix, Matrix], thetas: tuple[float, ...]) -> Proposal:
        edge = self.edge
        return propose(*pair, edge.low, edge.high, seeds=thetas, start=self.P, budget=self.budget)
