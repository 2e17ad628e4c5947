"""Constant parameters for which a dwell time, or the flow alone, is closest to unstable.

Corners of the box, its middle and points inside are tried: a plant may be stable at every corner
and unstable between them. Floats only: `lmi.refute.parameter_words` proves.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Array
from lmi.arithmetic.exponential import expm
from lmi.arithmetic.spectrum import finite_spectral_radii
from lmi.families import Edge
from lmi.parameters import AffineFamily, Point

# points inside the box, and candidates whose p and dwell time are moved
_INSIDE, _REFINED = 64, 3
_SEED = 20164  # the search repeats itself exactly


@dataclass(frozen=True)
class ConstantPoint:
    """p, a dwell time, and the radius of e^{A(p) theta} G(p).

    theta is None for a flow alone: then e^{abscissa} over the time unit of the flow.
    """

    p: Point
    theta: float | None
    radius: float


def worst_points(family: AffineFamily, low: float, high: float) -> list[ConstantPoint]:
    """Points with the largest radii, in falling order, each moved to a maximum nearby."""
    A, G = family.floats()
    rng = np.random.default_rng(_SEED)
    q = family.count
    corners = list(family.corners()) if q <= 8 else []
    points = [(0.0,) * q, *corners, *map(tuple, rng.uniform(-1, 1, (_INSIDE, q)).tolist())]
    with np.errstate(all="ignore"):
        candidates = [worst_dwell_time(family, p, low, high) for p in dict.fromkeys(points)]
        best = sorted(candidates, key=lambda entry: -entry.radius)[:_REFINED]
        refined = [_refined(A, G, entry, (low, high)) for entry in best]
        if math.isinf(high):
            flows = np.array([_at(A, p) for p in points])
            abscissas = np.nan_to_num(np.linalg.eigvals(flows).real.max(axis=1), nan=-np.inf)
            k = int(np.argmax(abscissas))
            unit = 1 / max(float(np.abs(flows[k]).max()), 1e-300)
            refined.append(ConstantPoint(points[k], None, math.exp(abscissas[k] * unit)))
    return sorted([*best, *refined], key=lambda entry: -entry.radius)


def _at(parts: Array, p: Point) -> Array:
    return np.asarray(parts[0] + np.tensordot(np.array(p), parts[1:], 1))


def worst_dwell_time(family: AffineFamily, p: Point, low: float, high: float) -> ConstantPoint:
    """The dwell time of the largest radius at this p, on a grid."""
    A, G = family.floats()
    with np.errstate(all="ignore"):
        thetas, maps = Edge(_at(A, p), _at(G, p), low, high).grid()
    radii = finite_spectral_radii(maps)
    k = int(np.argmax(radii))
    return ConstantPoint(p, float(thetas[k]), float(radii[k]))


def _refined(A: Array, G: Array, start: ConstantPoint, ends: tuple[float, float]) -> ConstantPoint:
    """Quasi-Newton ascent of the radius in p and theta, by differences."""
    from scipy.optimize import minimize

    low, last = ends[0], Edge(_at(A, start.p), _at(G, start.p), *ends).last
    theta = last if start.theta is None else start.theta
    width = last - low

    def radius(z: Array) -> float:
        p, stay = tuple(z[:-1].tolist()), low + float(z[-1]) * width
        return float(finite_spectral_radii(expm(_at(A, p) * stay) @ _at(G, p)))

    first = np.array([*start.p, (theta - low) / width if width > 0 else 0.0])
    bounds = [(-1.0, 1.0)] * len(start.p) + [(0.0, 1.0)]
    result = minimize(
        lambda z: -math.log(max(radius(z), 1e-300)), first, bounds=bounds, method="L-BFGS-B",
        options={"maxiter": 30},
    )  # fmt: skip
    z = np.clip(result.x, [low for low, _ in bounds], [high for _, high in bounds])
    stay = min(max(low + float(z[-1]) * width, low), last)
    return ConstantPoint(tuple(float(x) for x in z[:-1]), stay, radius(z))
