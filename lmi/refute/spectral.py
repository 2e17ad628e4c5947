"""Dwell times that destabilise: maps, or products of maps, with spectral radius >= 1.

M(theta) = e^{F theta} H. A float scan proposes theta; the proof is one of: det(I - M) < 0 (a real
eigenvalue above 1), det(I + M) < 0 (one below -1), the Schur-Cohn test of M in balls, or a vector,
or a quadratic form, that every M(theta) leaves in place, exactly. One dwell time alone is decided
by the same test.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balancing import Scaling
from lmi.arithmetic.balls import (
    PRECISIONS,
    Balls,
    Exact,
    ball,
    exact,
    exp_times,
    fixed_vector,
    identity,
    precision,
    rational,
    to_float,
)
from lmi.arithmetic.exponential import expm
from lmi.arithmetic.spectrum import spectral_radii, spectral_radius
from lmi.families import Edge
from lmi.prove.hurwitz import exactly_schur, schur
from lmi.refute.invariant_form import invariant_form
from lmi.verdict import Verdict, proved, refuted, undecided

_TRIED = 6
# floats may put a spectral radius above 1 so far below it
_ROUNDING = 1e-6


def refute_spectral(
    F: ArrayLike, H: ArrayLike, low: float, high: float, seeds: Sequence[float] = ()
) -> Verdict:
    """Refuted when some theta in [low, high] has spectral radius >= 1; otherwise undecided.

    F, H: (n, n) floats or exact rationals. The witness holds theta (a float, taken exactly), the
    radius (float, for reading) and the method of proof. seeds: theta to look at besides the scan's.
    """
    F_exact, H_exact = exact(F), exact(H)
    if (fixed := _fixed(F_exact, H_exact, float(low))) is not None:
        return fixed
    if low == 0 and not exactly_schur(H_exact):
        radius = max(1.0, spectral_radius(to_float(H_exact)))  # floats that overflow give 1
        reason = f"at dwell time 0 the jump alone has spectral radius {radius:.9g} >= 1"
        return refuted({"theta": 0.0, "spectral_radius": radius, "reason": reason,
                        "method": "exact Schur test"})  # fmt: skip
    scaling = Scaling.from_pair(F_exact, H_exact, high)
    flow, jump = scaling.map(F_exact), scaling.map(H_exact)
    candidates = _worst_thetas(to_float(flow), to_float(jump), low, high, seeds)
    for theta, radius in candidates:
        if radius < 1 - _ROUNDING and low < high:
            break
        inside, method, _ = _settled(flow, jump, theta)
        if inside is False:
            radius = max(radius, 1.0)  # floats may have put it a little below
            reason = f"at dwell time {theta!r} a jump and the flow after it have spectral radius "
            reason += f"{radius:.9g} >= 1"
            return refuted({"theta": theta, "spectral_radius": radius, "method": method,
                            "reason": reason})  # fmt: skip
    if (form := invariant_form(F_exact, H_exact)) is not None:
        reason = (
            "x'Qx is the same along the flow, and up to its sign at jumps, for a Q != 0 and every "
            "theta: a state at which it is not zero never decays"
        )
        return refuted({"theta": float(low), "spectral_radius": 1.0, "Q": form.tolist(),
                        "reason": reason, "method": "exact invariant form"})  # fmt: skip
    theta, radius = candidates[0] if candidates else (low, math.nan)
    return undecided(f"largest spectral radius seen is {radius:.9g} at dwell time {theta!r}",
                     theta=theta, spectral_radius=radius)  # fmt: skip


def decide_constant(F: ArrayLike, H: ArrayLike, theta: float) -> Verdict:
    """Decide one dwell time: proved where M(theta) has spectral radius < 1, else refuted.

    F, H: (n, n) floats or exact rationals; theta >= 0 a float, taken exactly. Undecided only where
    the radius is 1, or too close to it for the largest precision.
    """
    F_exact, H_exact = exact(F), exact(H)
    scaling = Scaling.from_pair(F_exact, H_exact, theta)
    flow, jump = scaling.map(F_exact), scaling.map(H_exact)
    inside, method, bits = _settled(flow, jump, theta)
    if inside:
        return proved(method=method, theta=theta, bits=bits)
    if inside is False:
        return refute_word(F_exact, H_exact, (theta,))
    reason = f"the spectral radius at dwell time {theta!r} is 1, or cannot be told from it"
    return undecided(f"{reason} with {PRECISIONS[-1]} bits", theta=theta)


def _fixed(F: Exact, H: Exact, theta: float) -> Verdict | None:
    """Refuted by v ("right") with F v = 0 and H v = v or -v, or such a row vector ("left")."""
    unit = exact(np.eye(len(H)))
    pairs = (("right", F, H - unit), ("left", F.T, H.T - unit),
             ("right", F, H + unit), ("left", F.T, H.T + unit))  # fmt: skip
    for side, flow, jump in pairs:
        vector = fixed_vector([flow, jump])
        if vector is not None:
            reason = "M(theta) has an eigenvalue 1 or -1 for every theta: a state that never decays"
            return refuted({"theta": theta, "spectral_radius": 1.0, "vector": vector, "side": side,
                            "reason": reason, "method": "exact invariant vector"})  # fmt: skip
    return None


def _worst_thetas(
    F: Matrix, H: Matrix, low: float, high: float, seeds: Sequence[float]
) -> list[tuple[float, float]]:
    """Dwell times with the largest spectral radii, in falling order: ends and refined maxima."""
    with np.errstate(all="ignore"):
        edge = Edge(F, H, low, high)
        last = edge.last
        thetas, maps = edge.grid()
        radii = spectral_radii(maps)
        inner = np.flatnonzero((radii[1:-1] >= radii[:-2]) & (radii[1:-1] >= radii[2:])) + 1
        best = sorted(inner, key=lambda k: -radii[k])[:_TRIED]
        chosen = [low, last, *(theta for theta in seeds if low <= theta <= high)]
        pairs = [(theta, spectral_radius(expm(F * theta) @ H)) for theta in chosen]
        for k in best:
            pairs.append(_refined(F, H, float(thetas[k - 1]), float(thetas[k + 1])))
    finite = [(theta, radius) for theta, radius in pairs if math.isfinite(radius)]
    return sorted(finite, key=lambda entry: -entry[1])


def _refined(F: Matrix, H: Matrix, left: float, right: float) -> tuple[float, float]:
    """Maximum of the radius between two points, by repeated subdivision."""
    for _ in range(6):
        thetas = np.linspace(left, right, 17)
        radii = spectral_radii(expm(F * thetas[:, None, None]) @ H)
        k = int(np.nanargmax(radii)) if np.isfinite(radii).any() else 8
        left, right = float(thetas[max(k - 1, 0)]), float(thetas[min(k + 1, 16)])
    return float(thetas[k]), float(radii[k])


def refute_word(F: ArrayLike, H: ArrayLike, thetas: Sequence[float]) -> Verdict:
    """Refuted when these dwell times, repeated in turn, make a solution grow or persist.

    The product M(theta_k) ... M(theta_1) has spectral radius >= 1, proved in balls; F, H (n, n)
    floats or exact rationals, thetas floats taken exactly.
    """
    F_exact, H_exact = exact(F), exact(H)
    scaling = Scaling.from_pair(F_exact, H_exact, max(thetas))
    F_exact, H_exact = scaling.map(F_exact), scaling.map(H_exact)
    with np.errstate(all="ignore"):
        product = np.eye(len(F_exact))
        for M in Edge(to_float(F_exact), to_float(H_exact), 0.0, 0.0).maps(thetas):
            product = M @ product
        radius = spectral_radius(product)
    inside, method, _ = _settled(F_exact, H_exact, *thetas)
    if inside is False:
        radius = max(radius, 1.0)
        return refuted({"thetas": list(thetas), "spectral_radius": radius, "method": method,
                        "growth_per_jump": radius ** (1 / len(thetas)),
                        "reason": _word_reason(thetas, radius)})  # fmt: skip
    return undecided(f"the product of these {len(thetas)} maps is not proved to grow",
                     thetas=list(thetas), spectral_radius=radius)  # fmt: skip


def steps_within(thetas: Sequence[float], jitter: float) -> bool:
    """Decide exactly whether no step of the repeated sequence is larger than `jitter`."""
    if math.isinf(jitter):
        return True
    numbers = [rational(theta) for theta in thetas]
    following = [*numbers[1:], numbers[0]]
    return all(abs(b - a) <= rational(jitter) for a, b in zip(numbers, following, strict=True))


def _word_reason(thetas: Sequence[float], radius: float) -> str:
    runs = [(theta, len(list(run))) for theta, run in itertools.groupby(thetas)]
    word = ", ".join(f"{theta!r}" + f" ({k} times)" * (k > 1) for theta, k in runs)
    return (
        f"the dwell times {word}, repeated in turn, give a product of maps with spectral radius "
        f"{radius:.9g} >= 1"
    )


def _settled(F: Exact, H: Exact, *thetas: float) -> tuple[bool | None, str, int]:
    """(is the spectral radius of the product < 1, by which test, with how many bits).

    None where no precision tells.
    """

    def product() -> Balls:
        maps = {theta: exp_times(F, theta) * ball(H) for theta in set(thetas)}
        M = maps[thetas[0]]
        for theta in thetas[1:]:
            M = maps[theta] * M
        return M

    return decide_radius(product, len(H))


def decide_radius(product: Callable[[], Balls], n: int) -> tuple[bool | None, str, int]:
    """(is the spectral radius < 1, by which test, with how many bits); None if none tells.

    product: of n x n matrices, in the precision that is set when it is called.
    """
    unit = identity(n)
    for bits in PRECISIONS:
        with precision(bits), np.errstate(all="ignore"):
            M = product()
            if (unit - M).det() < 0:
                return False, "det(I - M) < 0: a real eigenvalue above 1", bits
            if (unit + M).det() < 0:
                return False, "det(I + M) < 0: a real eigenvalue below -1", bits
            inside = schur(M)
        if inside is not None:
            return inside, "Schur-Cohn test", bits
    return None, "", PRECISIONS[-1]
