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
from lmi.decide.dwell_problem import DwellProblem
from lmi.families import Edge, horizon
from lmi.prove.hurwitz import prove_hurwitz

_SUBDIVISIONS, _REFINEMENTS = 33, 9
# a flow that does not decay may allow every finite dwell time: the look ends after this many
# doublings of its own time scale
_DOUBLINGS = 6


@dataclass(frozen=True)
class Scan:
    """Limits that constant dwell times put on the searched end of a range.

    crossing: the dwell time nearest to the kept end at which the radius reaches 1, None if none
    does. last: the one furthest from the kept end that was looked at. islands: [a, b] beyond the
    crossing in which the radius is below 1 again.
    """

    crossing: float | None
    last: float
    islands: tuple[tuple[float, float], ...]


def scan(problem: DwellProblem) -> Scan:
    """Scan constant dwell times for the first at which the map does not contract."""
    flow, jump = to_float(problem.F), to_float(problem.H)
    if problem.is_shortest:
        thetas, radii = _radii(Edge(flow, jump, 0.0, problem.kept))
    else:
        thetas, radii = _longer(problem.F, flow, jump, problem.kept)
    # from the end that is kept outwards
    order = slice(None, None, -1 if problem.is_shortest else 1)
    outwards, radii = thetas[order], radii[order]
    crossing = _crossing(Edge(flow, jump, 0.0, 0.0), outwards, radii)
    return Scan(crossing, float(outwards[-1]), _islands(outwards, radii, crossing))


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


def _crossing(edge: Edge, outwards: Matrix, radii: Matrix) -> float | None:
    """The first of these dwell times at which the radius reaches 1, refined."""
    expanding = np.flatnonzero(~(radii < 1))
    if not len(expanding):
        return None
    k = int(expanding[0])
    inside, outside = float(outwards[max(k - 1, 0)]), float(outwards[k])
    for _ in range(_REFINEMENTS):
        points = np.linspace(inside, outside, _SUBDIVISIONS)
        beyond = np.flatnonzero(~(spectral_radii(edge.maps(points)) < 1))
        k = int(beyond[0]) if len(beyond) else _SUBDIVISIONS - 1
        inside, outside = float(points[max(k - 1, 0)]), float(points[k])
    return outside


def _islands(
    outwards: Matrix, radii: Matrix, crossing: float | None
) -> tuple[tuple[float, float], ...]:
    """Ranges of dwell times beyond the crossing in which the radius is below 1, in rising order."""
    if crossing is None:
        return ()
    beyond = np.abs(outwards - outwards[0]) > abs(crossing - outwards[0])
    inside = (radii < 1) & beyond & (outwards > 0)
    ends = np.flatnonzero(np.diff(np.concatenate([[0], inside.astype(int), [0]])))
    pairs = ((float(outwards[a]), float(outwards[b - 1]))
             for a, b in zip(ends[::2], ends[1::2], strict=True) if b - a > 1)  # fmt: skip
    return tuple(sorted((min(pair), max(pair)) for pair in pairs))
