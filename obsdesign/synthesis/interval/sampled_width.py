"""Proposed widths for samples as events, and for samples of a continuous y."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from lmi.arithmetic.arrays import Array, Matrix, NewEntries
from lmi.arithmetic.balancing import Scaling
from lmi.arithmetic.balls import exact, inverse, to_float
from lmi.arithmetic.exponential import absolute_flow
from lmi.arithmetic.spectrum import spectral_radius
from lmi.bounds.interleaved import Bounds, prove_interleaved
from lmi.bounds.sampled_flow import sampled_flow
from lmi.prove.hurwitz import rightmost
from obsdesign.analysis.interval.interleaved import interleaved
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.equations.interval.width import SAMPLED_MAPS, WidthSystem, slope_scheme
from obsdesign.synthesis.tube import ROOM, Units, least, nearest, proved_width

_OFFSETS, _FINE, _MOST_PERIODS = 24, 400, 400
_HALVINGS = 14


@dataclass(frozen=True)
class SampledTube:
    """A tube for samples as events, in floats: bounds of the width at four kinds of instants.

    tube (n,): in z, just after the sample that follows a jump; sampled, jumped (n,): in z, just
    after any sample and any jump (None without jumps); always (n,): in x, at any time.
    """

    tube: Matrix
    sampled: Matrix
    jumped: Matrix | None
    always: Matrix

    def to_certificate(self) -> dict[str, list[float]]:
        """Return the entries that verification checks."""
        vectors = {"tube": self.tube, "sampled": self.sampled, "always": self.always}
        vectors |= {} if self.jumped is None else {"jumped": self.jumped}
        return {name: vector.tolist() for name, vector in vectors.items()}

    def exact_bounds(self) -> Bounds:
        """Return the same in exact numbers, to be proved."""
        jumped = None if self.jumped is None else exact(self.jumped)
        return Bounds(exact(self.tube), exact(self.sampled), jumped, exact(self.always))


def propose_samples(gains: IntervalGains, system: WidthSystem) -> NewEntries:
    """Return {"maps"} and, where it is proved, {"tube", "sampled", ("jumped",) "always"}.

    For samples as events. system: exact, with A, K and k.
    """
    assert gains.period is not None
    maps = {"maps": SAMPLED_MAPS}
    ends = gains.dwell_ends
    proposal = sampled_tube(nearest(system), gains.period, ends, gains.skips_jumps)
    if proposal is None:
        return maps
    question = interleaved(system, gains.period, *ends, gains.skips_jumps)
    verdict = prove_interleaved(question, exact(system.out), proposal.exact_bounds())
    return {**maps, **proposal.to_certificate()} if verdict.outcome == "proved" else maps


@dataclass(frozen=True)
class _Steps:
    """Maps over times s on a grid of [0, period]: r -> sizes r + added, (k, n, n) and (k, n).

    jumped: over s, with a jump at its end; late: over the rest of the period, with its sample.
    """

    jumped: tuple[Matrix, Matrix] | None
    late: tuple[Matrix, Matrix]

    @staticmethod
    def from_system(system: WidthSystem, period: float) -> _Steps:
        """Return the maps of a width system in floats."""
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
    def is_finite(self) -> bool:
        """Has nothing overflowed?"""
        return all(np.isfinite(x).all() for x in (*(self.jumped or ()), *self.late))

    @property
    def period(self) -> tuple[Matrix, Matrix]:
        """(sizes, added) of the map from sample to sample."""
        return self.late[0][0], self.late[1][0]


def sampled_tube(
    system: WidthSystem, period: float, ends: tuple[float, float], skips_jumps: bool
) -> SampledTube | None:
    """Return a tube for samples as events, in floats, not proved; None where there is none.

    ends: shortest and longest dwell time, inf without jumps; skips_jumps: no sample is taken at the
    time of a jump.
    """
    with np.errstate(all="ignore"):
        units = Units.from_system(system, period, period)
        system = units.rescaled(system)
        steps = _Steps.from_system(system, period)
        P, c = steps.period
        scale = float(max(c.max(initial=0.0), 0.0 if system.h is None else system.h.max())) or 1.0
        if not steps.is_finite:
            return None
        if steps.jumped is None:
            p = least(P[None], c[None], ROOM * scale)
            if p is None:
                return None
            sampled, jumped = p * (1 + ROOM), None
        else:
            cycle = _cycle_tube(period, ends, steps, scale, skips_jumps)
            if cycle is None:
                return None
            p, sampled, jumped = cycle
        top = _highest(system, period, [q for q in (sampled, jumped) if q is not None])
    always = top * (1 + 1e-4) + ROOM * scale
    vectors = (p, sampled, always) if jumped is None else (p, sampled, always, jumped)
    if not all(np.isfinite(vector).all() for vector in vectors):
        return None
    z, x = units.z.sizes, units.x.sizes
    return SampledTube(p * z, sampled * z, None if jumped is None else jumped * z, always * x)


def _cycle_tube(
    h: float, ends: tuple[float, float], steps: _Steps, scale: float, skips_jumps: bool
) -> tuple[Matrix, Matrix, Matrix] | None:
    """(p, after samples, after jumps): the least p for offsets and numbers of periods on a grid."""
    low, high = ends
    assert steps.jumped is not None
    (sizes, kicks), (late, late_added), (P, c) = steps.jumped, steps.late, steps.period
    if low < h or (math.isinf(high) and not spectral_radius(P) < 1):
        return None
    fewest = max(1, math.floor(low / h * (1 - 1e-12))) - 1
    if skips_jumps:  # not too few: more only asks for more
        fewest = max(math.ceil(low / h * (1 - 1e-12)) - 2, 0)
    most = _MOST_PERIODS if math.isinf(high) else min(math.ceil(high / h), _MOST_PERIODS)
    maps = late @ sizes
    adds = (late @ kicks[..., None])[..., 0] + late_added
    if skips_jumps:  # the sample at the jump's time is missing: a whole period more
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
    """Return the largest width of x on the way from each of some boxes of z, over a period."""
    assert system.A is not None
    s = np.linspace(0.0, period, _FINE)
    flows, pushes = absolute_flow(np.eye(len(system.f)), system.A, system.f, s)
    reached = [((flows @ start + pushes) @ system.out.T).max(axis=0) for start in starts]
    highest: Matrix = np.max(reached, axis=0)
    return highest


def propose_spacing(
    gains: IntervalGains, system: WidthSystem, low: float, high: float, period: float | None
) -> NewEntries | None:
    """Return a step limit with its tube, proved, for samples of a continuous y; None if L = 0.

    period: the spacing to prove if it can be; otherwise the first provable one by halving.
    """
    if not np.any(gains.L):
        return None
    parts = slope_scheme(gains, exact, inverse)
    W = exact(system.W)
    jump = 0 * W if system.N is None else exact(system.N)
    slope = Scaling.from_pair(W, jump, min(high, 1e300)).map(to_float(parts[0] @ parts[1]))
    unit = 1.0 / max(float(np.abs(slope).sum(axis=1).max()), 1e-300)
    spacings = [period] if period is not None else []
    spacings += [unit * 2.0**-i for i in range(1, _HALVINGS)]
    for spacing in spacings:
        tube = spaced_tube(parts, system, spacing, low, high)
        if tube is not None:
            return {"step_limit": spacing, **tube}
    return None


def spaced_tube(
    parts: tuple[Array, ...], system: WidthSystem, spacing: float, low: float, high: float
) -> NewEntries | None:
    """Return the proved tube of the width system for samples at most `spacing` apart, or None."""
    L, CA, A, C, b = parts
    added = sampled_flow(exact(system.W), L, CA=CA, A=A, C=C, b=b, h=spacing)
    if added is None:
        return None
    more, drift = added
    spaced = replace(system, W=system.W + more, f=system.f + drift)
    W = nearest(spaced).W
    if not np.isfinite(W).all() or (math.isinf(high) and not rightmost(W).real < 0):
        return None
    return proved_width(spaced, low, high, vanishing=True)
