"""The largest decay rates that some common P allows: each step of a secant search finds a P.

The margin of the search falls almost linearly with the rate, so that two steps foretell where it
ends; the next one stays a little on this side. Proposals are floats; the rates that come out are
proved, each with a matrix of its own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lmi.arithmetic.balancing import Scaling
from lmi.arithmetic.balls import Exact, exact, to_float
from lmi.families import Edge
from lmi.find.cutting_plane import Proposal, propose
from lmi.prove.rates import SMALLEST, WORTH, Rates, approx_rates, propose_rates, prove_rate

Matrix = NDArray[np.float64]

# the search ends this close to where the margin is foretold to vanish, relative to the rate
_FINE = {"per_jump": 2e-3, "in_time": 5e-2}
# of the way to there, this much is left, so that there is something to prove
_LEFT, _STEPS = 0.1, 6


def largest_rates(
    F: ArrayLike, H: ArrayLike, P: ArrayLike, low: float, high: float
) -> Mapping[str, Any] | None:
    """The largest rates that some common P allows, nearly, proved; None if none are.

    F, H: (n, n) floats or exact rationals; P: (n, n) of a proof over the range.
    Result: {"per_jump", "in_time", "P_per_jump", "P_in_time"}; where nothing better is proved, the
    rates of the given P alone.
    """
    flow, jump = exact(F), exact(H)
    scaling = Scaling.of(flow, jump, high)
    given = scaling.form(np.asarray(P, dtype=np.float64))
    found = _largest(scaling.map(flow), scaling.map(jump), given, low, high)
    if found is None:
        return None
    names = [name for name in found if name.startswith("P_")]
    return found | {name: scaling.undone.form(np.array(found[name])).tolist() for name in names}


def _largest(F: Exact, H: Exact, given: Matrix, low: float, high: float) -> dict[str, Any] | None:
    """`largest_rates` of a balanced pair, with P given in its coordinates."""
    seen = approx_rates(F, H, {"P": given.tolist()}, low, high)
    if seen is None:
        return None
    edge = Edge(to_float(F), to_float(H), low, high)
    limits, unit = _limits(edge), np.eye(len(edge.F))
    with np.errstate(all="ignore"):
        first = propose(edge.F, edge.H, low, high, start=given)
    families = {
        "per_jump": lambda x: (edge.F, edge.H / x),
        "in_time": lambda x: (edge.F + x * unit, edge.H),
    }
    found: dict[str, Any] = {}
    for name, family in families.items():
        span = _Span(1.0 if name == "per_jump" else 0.0, getattr(seen, name), getattr(limits, name))
        for value, better in _towards(family, span, edge, given, first, _FINE[name]):
            rates = Rates(value, 0.0) if name == "per_jump" else Rates(0.5, value)
            certificate = {"P": better.tolist()}
            done = prove_rate(F, H, certificate, low, high, rates, math.inf, name, WORTH)
            if done.outcome == "proved":
                found |= {name: value, f"P_{name}": certificate["P"]}
                break
    if len(found) < 2 * len(families):
        usual = propose_rates(F, H, {"P": given.tolist()}, low, high)
        return None if usual is None else asdict(usual)
    return found


@dataclass(frozen=True)
class _Span:
    """What every stable system has, what its P seems to allow, and what none can exceed."""

    nothing: float
    seen: float
    limit: float


def _limits(edge: Edge) -> Rates:
    """Rates that no P can exceed: those of the worst constant dwell time."""
    with np.errstate(all="ignore"):
        thetas, maps = edge.grid()
        radii = np.clip(np.abs(np.linalg.eigvals(maps)).max(axis=1), SMALLEST, None)
    later = thetas > 0
    in_time = float(np.min(-np.log(radii[later]) / thetas[later], initial=math.inf))
    if math.isinf(edge.high):
        in_time = min(in_time, -float(np.linalg.eigvals(edge.F).real.max()))
    return Rates(float(radii.max()), in_time)


def _towards(
    family: Callable[[float], tuple[Matrix, Matrix]],
    span: _Span,
    edge: Edge,
    P: Matrix,
    first: Proposal,
    fine: float,
) -> list[tuple[float, Matrix]]:
    """Rates with a P that floats find for them, best first. first: what was found for no rate.

    Each try works in the coordinates of P, with the theta of the last success.
    """
    last, here, margin, bad = first, span.nothing, first.optimum, span.limit
    found = list[tuple[float, Matrix]]()
    if not (math.isfinite(bad) and margin > 0):
        return found
    following = span.seen + _LEFT * (here - span.seen)
    for _ in range(_STEPS):
        if abs(following - here) <= fine * abs(here):
            break
        with np.errstate(all="ignore"):
            proposal = propose(*family(following), edge.low, edge.high, seeds=last.thetas, start=P)
        if proposal.P is None:
            bad = following
            following = (here + bad) / 2
            continue
        fall = (margin - proposal.optimum) / (following - here)
        last, here, margin = proposal, following, proposal.optimum
        found.append((here, proposal.P))
        end = here + margin / fall if fall * (bad - here) > 0 else bad
        end = end if abs(end - here) < abs(bad - here) else bad
        following = end + _LEFT * (here - end)
    return found[::-1]
