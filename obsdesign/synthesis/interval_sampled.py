"""Widths with samples: proposals for samples as events, and for a continuous y that is sampled."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lmi.balls import exact, inverse, to_float
from lmi.hurwitz import rightmost
from lmi.interleaved import Bounds, Interleaved, prove_interleaved
from lmi.sampled_flow import sampled_flow
from obsdesign.equations.interval_sampling import slope_scheme
from obsdesign.equations.interval_width import WidthSystem
from obsdesign.synthesis.interval_tube import ROOM, least, moved, proved_width

Matrix = NDArray[np.float64]

_OFFSETS, _FINE, _MOST_PERIODS = 24, 400, 400
_HALVINGS = 14


def propose_samples(
    system: WidthSystem, approx: WidthSystem, period: float, ends: tuple[float, float], lost: bool
) -> dict[str, Any] | None:
    """Proved {"tube", "sampled", ("jumped",) "always"} for samples as events, or None.

    system, approx: exact and in floats, with K and k; ends: shortest and longest dwell time, inf
    without jumps; lost: no sample is taken at the time of a jump.
    """
    found = _propose(approx, period, ends, lost)
    if found is None:
        return None
    question = Interleaved.of(system, period, *ends, lost)
    jumped = exact(found["jumped"]) if "jumped" in found else None
    bounds = Bounds(exact(found["tube"]), exact(found["sampled"]), jumped, exact(found["always"]))
    verdict = prove_interleaved(question, exact(system.out), bounds)
    return found if verdict.outcome == "proved" else None


def _propose(system: WidthSystem, period: float, ends: tuple[float, float], lost: bool) -> Any:
    W, f, K, k = system.W, system.f, system.K, system.k
    assert K is not None
    assert k is not None
    with np.errstate(all="ignore"):
        s = np.linspace(0.0, period, _OFFSETS)
        flows, pushes = moved(W, f, s)
        Phi, c = K @ flows[-1], K @ pushes[-1] + k
        scale = float(max(c.max(initial=0.0), 0.0 if system.h is None else system.h.max())) or 1.0
        if not np.isfinite(Phi).all():
            return None
        if system.N is None:
            p = least(Phi[None], c[None], ROOM * scale)
            if p is None:
                return None
            sampled, jumped = p * (1 + ROOM), None
        else:
            result = _cycle_tube(system, period, ends, (flows, pushes, Phi, c), scale, lost)
            if result is None:
                return None
            p, sampled, jumped = result
        fine = moved(W, f, np.linspace(0.0, period, _FINE))
        top = _highest(system, sampled, *fine)
        if jumped is not None:
            top = np.maximum(top, _highest(system, jumped, *fine))
    found = {"tube": p, "sampled": sampled, "always": top * (1 + 1e-4) + ROOM * scale}
    if jumped is not None:
        found["jumped"] = jumped
    if not all(np.isfinite(x).all() for x in found.values()):
        return None
    return {name: x.tolist() for name, x in found.items()}


def _cycle_tube(
    system: WidthSystem, h: float, ends: tuple[float, float], step: Any, scale: float, lost: bool
) -> tuple[Matrix, Matrix, Matrix] | None:
    """(p, after samples, after jumps): the least p for offsets and numbers of periods on a grid."""
    low, high = ends
    flows, pushes, Phi, c = step
    N, j = system.at_jumps
    K, k = system.K, system.k
    if low < h or (math.isinf(high) and max(abs(np.linalg.eigvals(Phi))) >= 1):
        return None
    fewest = max(1, math.floor(low / h * (1 - 1e-12))) - 1
    if lost:  # not too few: more only asks for more
        fewest = max(math.ceil(low / h * (1 - 1e-12)) - 2, 0)
    most = _MOST_PERIODS if math.isinf(high) else min(math.ceil(high / h), _MOST_PERIODS)
    # psi(s) = K [e^{W (h - s)} (N u(s) + j) + g(h - s)] + k, on the grid s reversed is h - s
    late, rest = flows[::-1], pushes[::-1]
    maps = K @ (late @ (N @ flows))
    adds = (K @ ((late @ (N @ pushes[..., None] + j[:, None]))[..., 0] + rest)[..., None])[
        ..., 0
    ] + k
    if lost:  # the sample at the jump's time is missing: a whole period more
        whole = K @ flows[-1] @ N
        maps = np.concatenate([maps, (whole @ flows[-1])[None]])
        adds = np.concatenate(
            [adds, (whole @ pushes[-1] + K @ (flows[-1] @ j + pushes[-1]) + k)[None]]
        )
    powers, offsets = [np.eye(len(N))], [np.zeros(len(N))]
    for _ in range(most):
        powers.append(Phi @ powers[-1])
        offsets.append(Phi @ offsets[-1] + c)
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
    orbit = np.array([P @ p + q for P, q in zip(powers, offsets, strict=True)])
    sampled = orbit.max(axis=0) * (1 + 10 * ROOM) + ROOM * scale
    widest = orbit[list(chosen)].max(axis=0) * (1 + 5 * ROOM)
    jumped = ((flows @ widest + pushes) @ N.T + j).max(axis=0) * (1 + 1e-3) + ROOM * scale
    return p, sampled, jumped


def _highest(system: WidthSystem, start: Matrix, flows: Matrix, pushes: Matrix) -> Matrix:
    reached: Matrix = ((flows @ start + pushes) @ system.out.T).max(axis=0)
    return reached


def propose_spacing(
    gains: Mapping[str, Any], system: WidthSystem, low: float, high: float, period: float | None
) -> dict[str, Any] | None:
    """A step limit with its tube, proved, for a continuous y known at samples; None if L = 0.

    period: the spacing to prove if it can be; otherwise half of the largest one found by halving.
    """
    if not np.any(gains["L"]):
        return None
    parts = slope_scheme(gains, exact, inverse)
    slope = to_float(parts[0] @ parts[1])
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
