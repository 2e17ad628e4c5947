"""Constant dwell times at a glance, in floats: at which does the map contract?

The spectral radius of e^{F theta} H on a grid. Where it first reaches one, seen from the end of the
range that is kept, no dwell-time range can go on.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import Exact, to_float
from lmi.arithmetic.spectrum import spectral_radii
from lmi.families import Edge, horizon
from lmi.prove.hurwitz import prove_hurwitz

_SUBDIVISIONS, _REFINEMENTS = 33, 9
# a flow that does not decay may allow every finite dwell time: the look ends after this many
# doublings of its own time scale
_DOUBLINGS = 6


@dataclass(frozen=True)
class Scan:
    """Limits that constant dwell times put on the searched end of a range.

    crossing: the dwell time nearest to the fixed end at which the radius reaches 1, None if none
    does. last: the one furthest from the fixed end that was looked at. islands: [a, b] beyond the
    crossing in which the radius is below 1 again.
    """

    crossing: float | None
    last: float
    islands: tuple[tuple[float, float], ...]


def scan(F: Exact, H: Exact, fixed: float, shortest: bool) -> Scan:
    """Scan constant dwell times for the first at which the map does not contract.

    F, H: (n, n). fixed: the end of the range that is kept, the longest dwell time if `shortest`
    is what is searched for (it may be infinite then), else the shortest one.
    """
    flow, jump = to_float(F), to_float(H)
    if shortest:
        thetas, radii = _radii(Edge(flow, jump, 0.0, fixed))
    else:
        thetas, radii = _longer(F, flow, jump, fixed)
    crossing = _crossing(Edge(flow, jump, 0.0, 0.0), thetas, radii, shortest)
    last = float(thetas[0 if shortest else -1])
    return Scan(crossing, last, _islands(thetas, radii, crossing, shortest))


def _longer(F: Exact, flow: Matrix, jump: Matrix, low: float) -> tuple[Matrix, Matrix]:
    """Dwell times from `low` on, as far as a search for the longest one may have to go."""
    span = horizon(flow)
    for _ in range(_DOUBLINGS):
        thetas, radii = _radii(Edge(flow, jump, low, low + span))
        if not (radii < 1).all() or prove_hurwitz(F).outcome == "proved":
            break
        span *= 2
    return thetas, radii


def _radii(edge: Edge) -> tuple[Matrix, Matrix]:
    """(dwell times, spectral radius of the map at each), NaN where the map overflows."""
    with np.errstate(all="ignore"):
        thetas, maps = edge.grid()
        return thetas, spectral_radii(maps)


def _crossing(edge: Edge, thetas: Matrix, radii: Matrix, shortest: bool) -> float | None:
    outside = np.flatnonzero(~(radii < 1))
    if not len(outside):
        return None
    if shortest:
        k = int(outside[-1])
        return _refined(edge, float(thetas[k]), float(thetas[min(k + 1, len(thetas) - 1)]))
    k = int(outside[0])
    return _refined(edge, float(thetas[k]), float(thetas[max(k - 1, 0)]))


def _refined(edge: Edge, outside: float, inside: float) -> float:
    for _ in range(_REFINEMENTS):
        points = np.linspace(inside, outside, _SUBDIVISIONS)
        radii = spectral_radii(edge.maps(points))
        beyond = np.flatnonzero(~(radii < 1))
        k = int(beyond[0]) if len(beyond) else _SUBDIVISIONS - 1
        inside, outside = float(points[max(k - 1, 0)]), float(points[k])
    return outside


def _islands(
    thetas: Matrix, radii: Matrix, crossing: float | None, shortest: bool
) -> tuple[tuple[float, float], ...]:
    if crossing is None:
        return ()
    beyond = thetas < crossing if shortest else thetas > crossing
    inside = (radii < 1) & beyond & (thetas > 0)
    ends = np.flatnonzero(np.diff(np.concatenate([[0], inside.astype(int), [0]])))
    return tuple((float(thetas[a]), float(thetas[b - 1]))
                 for a, b in zip(ends[::2], ends[1::2], strict=True) if b - a > 1)  # fmt: skip
