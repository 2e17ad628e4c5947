"""Interval observers of plants with modes: gains for each mode, one certificate, one tube.

Gains of a mode are those of its flow alone. Where it grows by itself and y does not see it, they
are those of the flow slowed down: other modes have to make up for it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from lmi.arithmetic.arrays import Array, Entries, Matrix
from lmi.arithmetic.balls import Exact, exact, to_float
from lmi.arithmetic.exponential import expm
from lmi.bounds.mode_tube import prove_mode_tube
from lmi.modes import Modes
from lmi.time_budget import UNLIMITED, Remark, TimeBudget
from obsdesign.analysis.modes import graph_of
from obsdesign.equations.estimation_error import flow_error_matrix
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.equations.interval.width import WidthSystem
from obsdesign.equations.modes import SwitchedGains
from obsdesign.problem.modes import spans_of
from obsdesign.problem.options import IntervalOptions
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate, Certificates
from obsdesign.synthesis.interval.descent import best_gains
from obsdesign.synthesis.interval.forms import gains_of_form
from obsdesign.synthesis.interval.task import GainSearch
from obsdesign.synthesis.modes import require_served, stability_certificates

_GRID, _ROUNDS = 1000, 60
# room of a tube beyond the widths that it bounds, relative to the largest
_ROOM = (2e-6, 2e-5, 1e-3)


def synthesize(problem: Problem, budget: TimeBudget = UNLIMITED) -> Iterator[Candidate]:
    """Yield one candidate; InputError where the given gains cannot be used."""
    require_served(problem)
    gains, remarks = [], list[Remark]()
    for k in range(len(problem.plant.modes)):
        own, more = _gains_of_mode(problem, k, budget)
        gains.append(own)
        remarks += more
    switched = SwitchedGains(spans_of(problem.plant.modes), tuple(gains))
    systems = [WidthSystem.from_gains(own, exact, np.asarray) for own in gains]
    modes = graph_of(problem, [one.W for one in systems], [one.N for one in systems])
    certificates = stability_certificates("mode_stability", modes, budget)
    if "cells" in certificates.evidence["mode_stability"]:
        width = propose_tube(modes, [one.f for one in systems])
        if width is not None:
            certificates = certificates.joined(Certificates({"mode_width": width}))
    searched = any("L" not in own.gains for own in problem.in_modes)
    yield Candidate(
        "one gain for each mode", switched, certificates.evidence, searched,
        remarks=tuple(remarks), solvers=certificates.solvers,
    )  # fmt: skip


def _gains_of_mode(
    problem: Problem, place: int, budget: TimeBudget
) -> tuple[IntervalGains, tuple[Remark, ...]]:
    """L of a mode, given or searched, in the first form that it fits."""
    own, plant = problem.in_modes[place], problem.plant.in_mode(place, entered=True)
    L, remarks = own.gains.get("L"), tuple[Remark, ...]()
    form = problem.options_as(IntervalOptions).form
    if L is None:
        L, remarks = _searched(own, form, budget)
    F = flow_error_matrix(exact(own.plant.flow.A), exact(L), exact(own.plant.output.C))
    is_positive = all(x >= 0 for x in F[~np.eye(len(F), dtype=bool)])
    if plant.jump is not None:
        is_positive = is_positive and bool((plant.jump.G >= 0).all())
    if form == "auto":
        form = "cooperative" if is_positive else "split"
    entered = own if plant.jump is None else _with_plant(own, problem, place)
    zero = np.zeros((plant.n, plant.p))
    return gains_of_form(entered, form, np.asarray(L), zero, {}), remarks


def _with_plant(own: Problem, problem: Problem, place: int) -> Problem:
    """The problem of a mode with the map on entry as its jump."""
    G = problem.plant.in_mode(place, entered=True).jump
    assert G is not None
    body = own.to_dict()
    if "sensor" in body:
        body["event"] = [{"name": "entry", "G": G.G.tolist()}]
    else:
        body["jump"] = {"G": G.G.tolist()}
    return Problem.from_dict(body)


def _searched(
    own: Problem, form: str, budget: TimeBudget
) -> tuple[Matrix, tuple[Remark, ...]]:  # fmt: skip
    """The gain of least width of a mode, of its flow slowed down where it has none."""
    growth = max(float(np.linalg.eigvals(own.plant.flow.A).real.max()), 0.0)
    size = float(np.abs(own.plant.flow.A).max()) or 1.0
    remarks: tuple[Remark, ...] = ()
    for slowed in (0.0, growth + 0.05 * size, 2 * growth + 0.5 * size):
        problem = own if slowed == 0 else _slowed(own, slowed)
        search, results = GainSearch(problem, {}, budget), []
        for positive in (True, False):
            if form in ("auto", "cooperative" if positive else "split"):
                task = search.task(positive, None)
                (value, L, M), more = best_gains(task, "narrowest", budget)
                remarks += more
                results.append((value, task.gains(L, M)[0]))
        value, L = min(results, key=lambda one: one[0])
        if math.isfinite(value):
            return L, remarks
    return np.zeros((own.plant.n, own.plant.p)), remarks


def _slowed(own: Problem, rate: float) -> Problem:
    body = own.to_dict()
    body["flow"]["A"] = (own.plant.flow.A - rate * np.eye(own.plant.n)).tolist()
    return Problem.from_dict(body)


def propose_tube(modes: Modes, inputs: list[Exact]) -> Entries | None:
    """Widths at entry into each mode, and at any time in it, a little wider than their limits.

    inputs: f of each mode, (n,). The narrowest that is proved; None where none is.
    """
    floats = [to_float(f) for f in inputs]
    for room in _ROOM:
        tube = _tube(modes, floats, room)
        if tube is None:
            return None
        bounds = {name: exact(values) for name, values in tube.items()}
        if prove_mode_tube(modes, inputs, **bounds).outcome == "proved":
            return tube
    return None


def _tube(modes: Modes, inputs: list[Array], room: float) -> dict[str, list[list[float]]] | None:
    """Entry and always of a tube that has this room, in floats; None where floats know none."""
    try:
        with np.errstate(all="ignore"):
            entry = _widths_at_entry(modes, inputs, room)
            always = None if entry is None else _widths_within(modes, inputs, entry, room)
    except np.linalg.LinAlgError:  # overflow
        return None
    if entry is None or always is None:
        return None
    bounds = {"entry": entry, "always": always}
    if not all(np.isfinite(v).all() and (v > 0).all() for v in bounds.values()):
        return None
    return {name: v.tolist() for name, v in bounds.items()}


def _widths_at_entry(modes: Modes, inputs: list[Array], room: float) -> Array | None:
    """The largest widths on entry (modes, n), and a room beyond; None where they grow.

    Policy iteration: of each bound the edge and the stay that make it largest.
    """
    n, count, edges = len(inputs[0]), len(modes), []
    for i, (F, f) in enumerate(zip(modes.flows, inputs, strict=True)):
        maps, pushes = _responses(to_float(F), f, modes.stays[i][0], modes.horizons[i])
        for j in modes.following[i]:
            N = np.abs(to_float(modes.entry[j]))
            edges.append((i, j, N @ maps, pushes @ N.T))
    v, extra = np.zeros((count, n)), 0.0
    for _ in range(_ROUNDS):
        M, c = np.zeros((count * n, count * n)), np.full(count * n, extra)
        best = np.full((count, n), -np.inf)
        for i, j, maps, pushes in edges:
            values = maps @ v[i] + pushes
            for row, k in enumerate(np.argmax(values, axis=0)):
                if values[k, row] > best[j, row]:
                    best[j, row], place = values[k, row], j * n + row
                    M[place] = 0.0
                    M[place, i * n : (i + 1) * n] = maps[k, row]
                    c[place] = pushes[k, row] + extra
        if np.abs(np.linalg.eigvals(M)).max(initial=0.0) >= 1:
            return None
        before, v = v, np.linalg.solve(np.eye(count * n) - M, c).reshape(count, n)
        if np.allclose(before, v, rtol=1e-13, atol=0.0):
            if extra > 0:
                break
            extra = room * float(v.max() or 1.0)
    return v


def _widths_within(modes: Modes, inputs: list[Array], entry: Array, room: float) -> Array:
    """The largest widths at any time in each mode (modes, n), and a room beyond."""
    always = []
    for F, f, v, last in zip(modes.flows, inputs, entry, modes.horizons, strict=True):
        maps, pushes = _responses(to_float(F), f, 0.0, last)
        largest = (maps @ v + pushes).max(axis=0)
        always.append(largest * (1 + 10 * room) + room * largest.max())
    return np.array(always)


def _responses(W: Array, f: Array, low: float, last: float) -> tuple[Array, Array]:
    """e^(W theta) and what f adds until theta, on a grid; (k, n, n), (k, n)."""
    n = len(f)
    Z = np.zeros((n + 1, n + 1))
    Z[:n, :n], Z[:n, n] = W, f
    thetas = np.unique(np.linspace(low, last, _GRID))
    flows = expm(Z * thetas[:, None, None])
    return flows[:, :n, :n], flows[:, :n, n]
