"""Bounds of the width as time goes on: the least tube, by a linear program. Proposals only.

After a jump the width stays below v if N (e^{W theta} v + int_0^theta e^{W s} ds f) + h <= v for
every theta of the range. Such v are closed under minima, so that a program which minimises their
sum finds the least one; violated theta are added until none is left.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix, NewEntries
from lmi.arithmetic.balancing import Scaling
from lmi.arithmetic.balls import Exact, exact, to_float
from lmi.arithmetic.exponential import absolute_flow, expm
from lmi.bounds.tube import Tube, prove_tube
from lmi.families import Edge
from lmi.find.linear_program import minimise
from lmi.prove.hurwitz import rightmost
from lmi.solvers import Solvers
from obsdesign.equations.interval.width import WidthSystem

# room for a strict proof, relative to what enters the width from jump to jump
ROOM = 1e-6
# narrow first; a tube that is nearly touched while the width decays cannot be proved without more
_ROOMS = (ROOM, 1e-4, 1e-2)
_ROUNDS, _FINE = 12, 800


def nearest(system: WidthSystem) -> WidthSystem:
    """The exact system in floats, each entry rounded once: what cancels stays small."""
    entries: NewEntries = {
        name: None if X is None else to_float(exact(X)) for name, X in vars(system).items()
    }
    return WidthSystem(**entries)


def proved_width(
    system: WidthSystem, low: float, high: float, vanishing: bool = False
) -> dict[str, list[float]] | None:
    """Return the proposal of `propose_width` for an exact system, if it is proved.

    vanishing: also where nothing enters and the width tends to zero, to show just that.
    """
    approx = nearest(system)
    if system.N is None:
        return propose_limit(approx, vanishing)
    W, f, N, h, out = (exact(X) for X in (system.W, system.f, *system.at_jumps, system.out))
    names = ("tube", "after_jump", "before_jump", "always")
    for room in _ROOMS:
        certificate = propose_width(approx, low, high, vanishing, room)
        if certificate is None:
            return None
        tube = Tube(*(exact(certificate[name]) for name in names))
        if prove_tube(W, f, N, h, out, tube=tube, low=low, high=high).outcome == "proved":
            return certificate
    return None


def proved_tube(
    W: Exact,
    f: Exact,
    N: Exact | None,
    h: Exact | None,
    *,
    ends: tuple[float, float],
    vanishing: bool = False,
) -> dict[str, list[float]] | None:
    """The same for u' = W u + f, u+ = N u + h itself, exact; N, h None without jumps."""
    unit = exact(np.eye(len(W)))
    system = WidthSystem(W=W, f=f, N=N, h=h, K=None, k=None, out=unit)
    return proved_width(system, *ends, vanishing)


def solvers_of_tube(has_jumps: bool) -> Solvers:
    """Solvers of a proposed width: without jumps the limit is one linear system."""
    return ("HiGHS",) if has_jumps else ()


def propose_width(
    system: WidthSystem, low: float, high: float, vanishing: bool = False, share: float = ROOM
) -> dict[str, list[float]] | None:
    """{"tube": (n,) in z, "after_jump", "before_jump", "always": (n,) in x}; None without one.

    system: floats, with jumps; share: room for a strict proof, relative.
    Without disturbance and noise the width vanishes: None.
    """
    if math.isinf(high) and not rightmost(system.W).real < 0:
        return None
    with np.errstate(all="ignore"):
        units = Units.from_system(system, low, Edge(system.W, system.at_jumps[0], low, high).last)
        widths = _least_tube(units.rescaled(system), low, high, vanishing, share)
    return None if widths is None else units.restated(widths)


def _least_tube(
    system: WidthSystem, low: float, high: float, vanishing: bool, share: float
) -> dict[str, Matrix] | None:
    """The tube of `propose_width` for a system in units of its widths."""
    W, f = system.W, system.f
    N, h = system.at_jumps
    last = Edge(W, N, low, high).last
    thetas = np.unique(np.concatenate([np.linspace(low, last, _FINE), _graded(low, last)]))
    flows, pushes = width_flow(W, f, thetas)
    entering = pushes @ N.T + h
    scale = float(entering.max(initial=0.0)) or float(vanishing)
    if not (np.isfinite(flows).all() and np.isfinite(entering).all() and scale > 0):
        return None
    v = least(N @ flows, entering, share * scale)
    if v is None:
        return None
    grid = np.concatenate([np.linspace(0.0, low, _FINE), thetas])
    flows_all, pushes_all = width_flow(W, f, grid)
    reached = (flows_all @ v + pushes_all) @ system.out.T
    if math.isinf(high):
        reached = np.vstack([reached, np.linalg.solve(-W, f) @ system.out.T])
    room, grown = share * scale, 1.0 + 10 * share  # the grid misses the top by less
    before = reached[_FINE:]
    return {
        "tube": v,
        "after_jump": (system.out @ v) * (1.0 + share),
        "before_jump": before.max(axis=0) * grown + room,
        "always": reached.max(axis=0) * grown + room,
    }


def propose_limit(system: WidthSystem, vanishing: bool = False) -> dict[str, list[float]] | None:
    """{"tube": (n,) in z, "always": (n,) in x} of a plant without jumps; None without a limit."""
    if not rightmost(system.W).real < 0:
        return None
    units = Units.from_system(system, 1.0, 1.0)
    own = units.rescaled(system)
    scale = float(own.f.max(initial=0.0)) or float(vanishing)
    try:
        v: Matrix = np.asarray(np.linalg.solve(-own.W, own.f + ROOM * scale), np.float64)
    except np.linalg.LinAlgError:
        return None
    if not (scale > 0 and np.isfinite(v).all() and (v > 0).all()):
        return None
    return units.restated({"tube": v, "always": (own.out @ v) * (1.0 + ROOM)})


@dataclass(frozen=True)
class Units:
    """Powers of two like the widths of z and of x: a program's tolerances are absolute."""

    z: Scaling
    x: Scaling

    @staticmethod
    def from_system(system: WidthSystem, low: float, last: float) -> Units:
        """Of a width system in floats, from the limits that constant steps low and last lead to.

        Between events W, or A where samples are events; at their end N, else K, else nothing.
        """
        flow = system.W if system.A is None else system.A
        map_, added = np.eye(len(flow)), np.zeros(len(flow))
        if system.K is not None and system.k is not None:
            map_, added = system.K, system.k if system.h is None else np.maximum(system.k, system.h)
        elif system.N is not None and system.h is not None:
            map_, added = system.N, system.h
        first = Scaling.from_pair(exact(flow), exact(map_), last)
        sizes, pushes = absolute_flow(
            first.map(map_), first.map(flow), first.rows(system.f), np.array([low, last])
        )
        limits = [
            _limit(M, push + first.rows(added)) for M, push in zip(sizes, pushes, strict=True)
        ]
        z = Scaling(first.sizes * Scaling.like(np.max(limits, axis=0)).sizes)
        return Units(z, Scaling.like(system.out @ z.sizes))

    def rescaled(self, system: WidthSystem) -> WidthSystem:
        """The same system in these units."""
        arrays = dict(vars(system))
        for name in ("W", "N", "K", "A", "G"):
            arrays[name] = None if arrays[name] is None else self.z.map(arrays[name])
        for name in ("f", "h", "k"):
            arrays[name] = None if arrays[name] is None else self.z.rows(arrays[name])
        arrays["out"] = self.x.rows(self.z.columns(system.out))
        return WidthSystem(**arrays)

    def restated(self, widths: dict[str, Matrix]) -> dict[str, list[float]]:
        """Widths in the units of the plant, and of its observer's coordinates, as lists."""
        of_z = ("tube", "sampled", "jumped")
        return {
            name: (v * (self.z if name in of_z else self.x).sizes).tolist()
            for name, v in widths.items()
        }


def _limit(M: Matrix, entering: Matrix) -> Matrix:
    """The v = M v + entering; zero where there is none that is positive."""
    try:
        v: Matrix = np.asarray(np.linalg.solve(np.eye(len(M)) - M, entering), np.float64)
    except np.linalg.LinAlgError:
        return 0 * entering
    return v if np.isfinite(v).all() and (v >= 0).all() else 0 * entering


def width_flow(W: Matrix, f: Matrix, thetas: Matrix) -> tuple[Matrix, Matrix]:
    """(e^{W theta}, int_0^theta e^{W s} ds f) at each theta: (k, n, n), (k, n)."""
    n = len(W)
    Z = np.zeros((n + 1, n + 1))
    Z[:n, :n], Z[:n, n] = W, f
    whole = expm(Z * thetas[:, None, None])
    return whole[:, :n, :n], whole[:, :n, n]


def _graded(low: float, last: float) -> Matrix:
    """Return a grid that is finer near the start, where fast modes act."""
    return low + (last - low) * np.linspace(0.0, 1.0, 200) ** 3


def least(maps: Matrix, entering: Matrix, room: float) -> Matrix | None:
    """The least v with maps[k] v + entering[k] + room <= v for every k, by adding the worst k."""
    n = maps.shape[1]
    active = sorted({0, len(maps) // 2, len(maps) - 1})
    for _ in range(_ROUNDS):
        rows = (maps[active] - np.eye(n)).reshape(-1, n)
        limits = -(entering[active] + room).reshape(-1)
        sides = np.full(len(limits), -np.inf), limits
        v = minimise(np.ones(n), rows, sides, (np.zeros(n), np.full(n, np.inf)))
        if v is None:
            return None
        excess = (maps @ v + entering + 0.5 * room - v).max(axis=1)
        worst = int(np.argmax(excess))
        if excess[worst] <= 0:
            return v
        if worst in active:
            return None
        active = sorted({*active, worst})
    return None
