"""Random plants with events at uncertain times, and their states in fifty digits."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from flint import arb, arb_mat, fmpq

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import Exact, exact, exp_times
from obsdesign.equations.interval.clock_gains import ClockedIntervalGains
from obsdesign.problem.plant import Jump
from obsdesign.problem.problem import Problem
from obsdesign.runtime.base import Sample
from obsdesign.runtime.interval.uncertain_times import UncertainTimesObserver
from obsdesign.runtime.load import observer_class

_PART = 0.999  # of the noise's bound: a measurement is rounded to a float


@dataclass(frozen=True)
class Record:
    """Rows, and the states at them in balls; start: bounds of the first one."""

    problem: Problem
    observer: UncertainTimesObserver
    rows: list[Sample]
    states: list[list[arb]]
    start: tuple[Matrix, Matrix]

    def outside(self, rows: list[Sample] | None = None) -> list[float]:
        """Times of the rows whose bounds certainly do not hold the state."""
        times = []
        listed = self.observer.run(
            self.observer.init(self.rows[0].t, lower=self.start[0], upper=self.start[1]),
            self.rows if rows is None else rows,
        )
        for estimate, x in zip(listed, self.states, strict=True):
            assert estimate.lower is not None
            assert estimate.upper is not None
            ends = zip(estimate.lower.tolist(), x, estimate.upper.tolist(), strict=True)
            if any(arb(low) > value or value > arb(high) for low, value, high in ends):
                times.append(estimate.t)
        return times

    def statuses(self) -> set[str]:
        """Words of the statuses of all rows."""
        state = self.observer.init(self.rows[0].t, lower=self.start[0], upper=self.start[1])
        return {estimate.status for estimate in self.observer.run(state, self.rows)}


def random_body(rng: np.random.Generator, *, plain: bool = False) -> dict[str, Any]:
    """A plant of one to three events, of which the first is at uncertain times.

    plain: with G = I and one event.
    """
    n = int(rng.integers(1, 5))
    flow = {"A": rng.normal(size=(n, n)) - np.eye(n) * rng.uniform(0, 2.5)}
    flow |= {"disturbance": _box(rng, n)}
    flow |= {"B": rng.normal(size=(n, 1))} if rng.random() < 0.4 else {}
    events = []
    for k in range(1 if plain else int(rng.integers(1, 4))):
        low = float(rng.uniform(0.3, 1.5))
        own = {"name": f"event_{k}", "disturbance": _box(rng, n), "every": [low, 3 * low]}
        if rng.random() < 0.5 and not plain:
            own["G"] = np.eye(n) + 0.3 * rng.normal(size=(n, n))
        if rng.random() < 0.5:
            own["E"] = rng.normal(size=(n, int(rng.integers(1, 3))))
        if k == 0 or rng.random() < 0.6:
            own["time_error"] = float(rng.uniform(0.02, 0.49)) * low
        events.append(own)
    sensors = [_sensor(rng, n, k) for k in range(rng.integers(1, 3))]
    return {"flow": flow, "event": events, "sensor": sensors, "observer": {"kind": "interval"}}


def _box(rng: np.random.Generator, n: int) -> dict[str, Matrix]:
    middle, radius = rng.normal(size=n), rng.uniform(0, 0.5, n) * (rng.random(n) < 0.7)
    return {"lower": middle - radius, "upper": middle + radius}


def _sensor(rng: np.random.Generator, n: int, k: int) -> dict[str, Any]:
    p, every = int(rng.integers(1, 3)), float(rng.uniform(0.1, 0.6))
    noise = [[-float(a), float(b)] for a, b in rng.uniform(0, 0.1, (p, 2))]
    return {
        "name": f"sensor_{k}", "C": rng.normal(size=(p, n)), "noise_bound": noise,
        "sees": ("before", "after")[rng.integers(2)], "every": [0.3 * every, 2 * every],
    }  # fmt: skip


def observer_of(problem: Problem, rng: np.random.Generator) -> UncertainTimesObserver:
    """The observer of a plant with gains of sensors that are anything."""
    n, p, e = problem.plant.n, problem.plant.p, len(problem.plant.events)
    gains = ClockedIntervalGains.from_plant(
        problem.plant, L=0.3 * rng.normal(size=(n, p)), M=np.zeros((e, n, p))
    )
    made = observer_class("interval", gains.to_document()).from_gains(gains.to_document())
    assert isinstance(made, UncertainTimesObserver)
    return made


def record(
    seed: int, until: float = 5.0, *, beyond: float = 1.0, plain: bool = False, since: float = 0.0,
    fast: float = 1.0,
) -> Record:  # fmt: skip
    """A random plant and its rows; call it with fifty digits.

    beyond: times of events are off by up to this many time errors; since: time of the first row;
    fast: how many times faster the first state moves.
    """
    rng = np.random.default_rng(seed)
    body = random_body(rng, plain=plain)
    if fast != 1.0:
        A = body["flow"]["A"]
        A[0] = fast * np.where(np.arange(len(A)) == 0, -np.abs(A[0]), A[0])
    problem = Problem(**body)
    truth = _Truth(problem, rng, since)
    rows, states = [], []
    stamps = truth.stamps(until, beyond)
    first = [float(value.mid()) for value in truth.x]
    for t in sorted({since, *truth.sample_times(until), *stamps}):
        truth.advance(t)
        rows.append(truth.row(t, stamps.get(t, [])))
        truth.exact_events(t)
        states.append(list(truth.x))
    reach = 1.0 + np.abs(first)
    start = np.array(first) - reach, np.array(first) + reach
    return Record(problem, observer_of(problem, rng), rows, states, start)


class _Truth:
    """The state of a plant on its way, in balls, under disturbances at the ends of their bounds."""

    def __init__(self, problem: Problem, rng: np.random.Generator, since: float) -> None:
        self.plant, self.rng, self.t = problem.plant, rng, Fraction(since)
        self.since, flow = since, problem.plant.flow
        self.x = [arb(float(value)) for value in rng.normal(size=problem.plant.n)]
        self.u = np.zeros(0 if flow.B is None else 1)
        self.b = rng.choice([0, 1], problem.plant.n) * (flow.upper - flow.lower) + flow.lower
        self.pending: list[tuple[Fraction, int, Exact]] = []
        self.inputs_at: dict[tuple[float, int], Matrix] = {}

    def sample_times(self, until: float) -> list[float]:
        """Times of rows with samples, and of some without."""
        return [self.since + t for t in np.cumsum(self.rng.uniform(0.02, 0.5, int(until / 0.2)))
                if t <= until]  # fmt: skip

    def stamps(self, until: float, beyond: float) -> dict[float, list[int]]:
        """Events by their stamps."""
        listed: dict[float, list[int]] = {}
        for k, event in enumerate(self.plant.events):
            assert event.dwell_time is not None
            t = self.since
            while (t := t + float(self.rng.uniform(*event.dwell_time))) <= self.since + until:
                off = Fraction(event.stamp_error) * Fraction(float(self.rng.uniform(-1, 1)))
                if beyond != 1.0:
                    off = Fraction(event.stamp_error) * Fraction(beyond)
                true = max(Fraction(t) + off, Fraction(self.since))
                w = self.rng.uniform(-2, 2, event.inputs)
                self.pending.append((true, k, self._added(event, w)))
                self.inputs_at[t, k] = w
                listed.setdefault(t, []).append(k)
        self.pending.sort(key=lambda entry: entry[0])
        return listed

    def _added(self, event: Jump, w: Matrix) -> Exact:
        """E w + c of an event."""
        c = self.rng.choice([0, 1], len(event.lower)) * (event.upper - event.lower) + event.lower
        added: Exact = exact(c) if event.E is None else exact(c) + exact(event.E) @ exact(w)
        return added

    def advance(self, t: float) -> None:
        """Flow to a time, with the events of uncertain times on the way."""
        while self.pending and self.pending[0][0] <= Fraction(t):
            true, k, _ = self.pending[0]
            if not self.plant.events[k].stamp_error and true == Fraction(t):
                break
            self._flow(true)
            self._jump(k, self.pending.pop(0)[2])
        self._flow(Fraction(t))

    def exact_events(self, t: float) -> None:
        """Events of exact stamps at a time, in the order of the plant."""
        while self.pending and self.pending[0][0] == Fraction(t):
            _, k, added = self.pending.pop(0)
            self._jump(k, added)

    def row(self, t: float, events: list[int]) -> Sample:
        """The row of a time: its measurements before the exact events, at random."""
        output, p = self.plant.outputs, self.plant.p
        y = np.full(p, np.nan)
        exact_here = [k for k in events if not self.plant.events[k].stamp_error]
        bounds = output.noise_bound
        assert bounds is not None
        for i, row in enumerate(exact(output.C)):
            if exact_here or self.rng.random() < 0.4:
                continue
            value = sum((arb(c) * x for c, x in zip(row, self.x, strict=True)), arb(0))
            low, high = bounds[i]
            y[i] = float(value.mid()) + _PART * float(self.rng.choice([low, high]))
        if self.rng.random() < 0.2 and len(self.u):
            self.u = self.rng.uniform(-1, 1, 1)
        w = [self.inputs_at[t, k] if k in events else np.full(event.inputs, np.nan)
             for k, event in enumerate(self.plant.events)]  # fmt: skip
        u = self.u.copy() if len(self.u) else None
        return Sample(t, y, u, np.concatenate(w), bool(events), None, tuple(sorted(events)))

    def _flow(self, t: Fraction) -> None:
        if t <= self.t:
            return
        n, flow = self.plant.n, self.plant.flow
        push = exact(self.b)
        if flow.B is not None:
            push = push + exact(flow.B) @ exact(self.u)
        Z = exact(np.zeros((n + 1, n + 1)))
        Z[:n, :n], Z[:n, n] = exact(flow.A), push
        h = t - self.t
        whole = exp_times(Z, fmpq(h.numerator, h.denominator))
        after = whole * arb_mat([[value] for value in [*self.x, arb(1)]])
        self.x, self.t = [after[i, 0] for i in range(n)], t

    def _jump(self, k: int, added: Exact) -> None:
        G = exact(self.plant.events[k].G)
        self.x = [
            sum((arb(g) * x for g, x in zip(row, self.x, strict=True)), arb(0)) + arb(c)
            for row, c in zip(G, added, strict=True)
        ]
