"""Widths with samples: proposals for samples as events, and for a continuous y that is sampled."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.balancing import Scaling
from lmi.arithmetic.balls import exact, inverse, to_float
from lmi.arithmetic.exponential import absolute_flow
from lmi.bounds.interleaved import Bounds, Interleaved, prove_interleaved, sampled_flow
from lmi.prove.hurwitz import rightmost
from obsdesign.equations.interval.width import SAMPLED_MAPS, WidthSystem, slope_scheme
from obsdesign.synthesis.interval.tube import ROOM, Units, least, proved_width

Matrix = NDArray[np.float64]

_OFFSETS, _FINE, _MOST_PERIODS = 24, 400, 400
_HALVINGS = 14


def propose_samples(
    system: WidthSystem, approx: WidthSystem, period: float, ends: tuple[float, float], lost: bool
) -> dict[str, Any]:
    """{"maps"} and, where it is proved, {"tube", "sampled", ("jumped",) "always"}.

    For samples as events. system, approx: exact and in floats, with A, K and k; ends: shortest and
    longest dwell time, inf without jumps; lost: no sample is taken at the time of a jump.
    """
    maps = {"maps": SAMPLED_MAPS}
    found = sampled_tube(approx, period, ends, lost)
    if found is None:
        return maps
    question = Interleaved.of(system, period, *ends, lost)
    jumped = exact(found["jumped"]) if "jumped" in found else None
    bounds = Bounds(exact(found["tube"]), exact(found["sampled"]), jumped, exact(found["always"]))
    verdict = prove_interleaved(question, exact(system.out), bounds)
    return {**maps, **found} if verdict.outcome == "proved" else maps


@dataclass(frozen=True)
class _Steps:
    """Maps over times s on a grid of [0, period]: r -> sizes r + added, (k, n, n) and (k, n).

    jumped: over s, with a jump at its end; late: over the rest of the period, with its sample.
    """

    jumped: tuple[Matrix, Matrix] | None
    late: tuple[Matrix, Matrix]

    @staticmethod
    def of(system: WidthSystem, period: float) -> _Steps:
        """Of a width system in floats."""
        assert system.A is not None
        assert system.K is not None
        assert system.k is not None
        s = np.linspace(0.0, period, _OFFSETS)
        sizes, added = absolute_flow(system.K, system.A, system.f, period - s)
        late = sizes, added + system.k
        if system.G is None or system.h is None:
            return _Steps(None, late)
        sizes, added = absolute_flow(system.G, system.A, system.f, s)
        return _Steps((sizes, added + system.h), late)

    @property
    def finite(self) -> bool:
        """Has nothing overflowed?"""
        return all(np.isfinite(x).all() for x in (*(self.jumped or ()), *self.late))

    @property
    def period(self) -> tuple[Matrix, Matrix]:
        """From sample to sample."""
        return self.late[0][0], self.late[1][0]


def sampled_tube(
    system: WidthSystem, period: float, ends: tuple[float, float], lost: bool
) -> dict[str, Any] | None:
    """The tube of `propose_samples` in floats, not proved; None where there is none."""
    with np.errstate(all="ignore"):
        units = Units.of(system, period, period)
        system = units.of_system(system)
        steps = _Steps.of(system, period)
        P, c = steps.period
        scale = float(max(c.max(initial=0.0), 0.0 if system.h is None else system.h.max())) or 1.0
        if not steps.finite:
            return None
        if steps.jumped is None:
            p = least(P[None], c[None], ROOM * scale)
            if p is None:
                return None
            sampled, jumped = p * (1 + ROOM), None
        else:
            result = _cycle_tube(period, ends, steps, scale, lost)
            if result is None:
                return None
            p, sampled, jumped = result
        top = _highest(system, period, [q for q in (sampled, jumped) if q is not None])
    found = {"tube": p, "sampled": sampled, "always": top * (1 + 1e-4) + ROOM * scale}
    if jumped is not None:
        found["jumped"] = jumped
    if not all(np.isfinite(x).all() for x in found.values()):
        return None
    return units.restated(found)


def _cycle_tube(
    h: float, ends: tuple[float, float], steps: _Steps, scale: float, lost: bool
) -> tuple[Matrix, Matrix, Matrix] | None:
    """(p, after samples, after jumps): the least p for offsets and numbers of periods on a grid."""
    low, high = ends
    assert steps.jumped is not None
    (sizes, kicks), (late, rest), (P, c) = steps.jumped, steps.late, steps.period
    if low < h or (math.isinf(high) and max(abs(np.linalg.eigvals(P))) >= 1):
        return None
    fewest = max(1, math.floor(low / h * (1 - 1e-12))) - 1
    if lost:  # not too few: more only asks for more
        fewest = max(math.ceil(low / h * (1 - 1e-12)) - 2, 0)
    most = _MOST_PERIODS if math.isinf(high) else min(math.ceil(high / h), _MOST_PERIODS)
    maps = late @ sizes
    adds = (late @ kicks[..., None])[..., 0] + rest
    if lost:  # the sample at the jump's time is missing: a whole period more
        maps = np.concatenate([maps, (P @ sizes[-1])[None]])
        adds = np.concatenate([adds, (P @ kicks[-1] + c)[None]])
    powers, offsets = [np.eye(len(P))], [np.zeros(len(P))]
    for _ in range(most):
        powers.append(P @ powers[-1])
        offsets.append(P @ offsets[-1] + c)
        if np.abs(powers[-1]).max() < 1e-9:
            break
    chosen = range(min(fewest, len(powers) - 1), len(powers))
    every = np.concatenate([maps @ powers[m] for m in chosen])
    entering = np.concatenate([adds + maps @ offsets[m] for m in chosen])
    for share in (3e-4, 3e-3, 3e-2):  # room for what lies between grid points
        p = least(every * (1 + share), entering * (1 + share), ROOM * scale)
        if p is not None:
            break
    else:
        return None
    orbit = np.array([M @ p + q for M, q in zip(powers, offsets, strict=True)])
    sampled = orbit.max(axis=0) * (1 + 10 * ROOM) + ROOM * scale
    widest = orbit[list(chosen)].max(axis=0) * (1 + 5 * ROOM)
    jumped = (sizes @ widest + kicks).max(axis=0) * (1 + 1e-3) + ROOM * scale
    return p, sampled, jumped


def _highest(system: WidthSystem, period: float, starts: list[Matrix]) -> Matrix:
    """The largest width of x on the way from each of some boxes of z, over a period."""
    assert system.A is not None
    s = np.linspace(0.0, period, _FINE)
    flows, pushes = absolute_flow(np.eye(len(system.f)), system.A, system.f, s)
    reached = [((flows @ start + pushes) @ system.out.T).max(axis=0) for start in starts]
    highest: Matrix = np.max(reached, axis=0)
    return highest


def propose_spacing(
    gains: Mapping[str, Any], system: WidthSystem, low: float, high: float, period: float | None
) -> dict[str, Any] | None:
    """A step limit with its tube, proved, for a continuous y known at samples; None if L = 0.

    period: the spacing to prove if it can be; otherwise half of the largest one found by halving.
    """
    if not np.any(gains["L"]):
        return None
    parts = slope_scheme(gains, exact, inverse)
    W = exact(system.W)
    jump = 0 * W if system.N is None else exact(system.N)
    slope = Scaling.of(W, jump, min(high, 1e300)).map(to_float(parts[0] @ parts[1]))
    unit = 1.0 / max(float(np.abs(slope).sum(axis=1).max()), 1e-300)
    tries = [period] if period is not None else []
    tries += [unit * 2.0**-i for i in range(1, _HALVINGS)]
    for spacing in tries:
        found = spaced_tube(parts, system, spacing, low, high)
        if found is not None:
            return {"step_limit": spacing, **found}
    return None


def spaced_tube(
    parts: Any, system: WidthSystem, spacing: float, low: float, high: float
) -> dict[str, Any] | None:
    """The tube of the width system for samples at most `spacing` apart, proved; or None."""
    L, CA, A, C, b = parts
    added = sampled_flow(exact(system.W), L, CA, A, C, b, spacing)
    if added is None:
        return None
    more, drift = added
    spaced = replace(system, W=system.W + more, f=system.f + drift)
    arrays: dict[str, Any] = {
        name: None if value is None else to_float(exact(value))
        for name, value in vars(spaced).items()
    }
    approx = WidthSystem(**arrays)
    if not np.isfinite(approx.W).all():
        return None
    if math.isinf(high) and not rightmost(approx.W).real < 0:
        return None
    return proved_width(spaced, approx, low, high, vanishing=True)
