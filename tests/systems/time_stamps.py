"""Random records with stamps up to 1.7e18 and steps from one ulp on, and their exact states.

The truth lives at instants within half an ulp of the stamps: at the stamps themselves, at decimal
times of which they are the nearest binary64 numbers, or anywhere between. It is computed by
python-flint with 50 digits and more.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

import numpy as np
from flint import arb, arb_mat, ctx, fmpq

import obsdesign
from obsdesign.equations.estimation_error import flow_error_matrix
from obsdesign.equations.gains import plant_data
from obsdesign.problem.flow import Flow
from obsdesign.problem.output import Output
from obsdesign.problem.plant import Jump, Plant
from obsdesign.runtime import Sample, from_design
from obsdesign.runtime.interval.fleet import Fleet
from obsdesign.runtime.interval.observer import IntervalObserver
from obsdesign.runtime.luenberger.observer import LuenbergerObserver
from tests.runtime.interval.test_samples import sampled_observer
from tests.systems.interval_runs import observer_for

ORIGINS = (0.0, -1.7e9, 1.7e9, 1.7e18)
STEPS = (1, 2, 3, 10, 16, 100, 127, 128, 129, 1000, 12345, 10**6, 10**9)  # in ulps of the origin
MODES = ("continuous", "periodic", "at_jumps")
# statuses that refute bounds of an admissible record
_REFUTED = ("outside", "crossed", "void")


@contextmanager
def fifty_digits() -> Iterator[None]:
    old, ctx.prec = ctx.prec, 192
    try:
        yield
    finally:
        ctx.prec = old


@dataclass(frozen=True)
class Stamps:
    """Stamps of rows, the exact instants they stand for, and the usual step."""

    t: list[float]
    instants: list[Fraction]
    step: float


def ulp_stamps(rng: np.random.Generator, origin: float, rows: int, regular: bool) -> Stamps:
    """Steps of whole ulps; instants at the stamps or anywhere within half an ulp of them."""
    first = origin or float(rng.choice([1e-3, 1.0, 1e3]))
    u = math.ulp(first)
    count = int(rng.choice(STEPS))
    sizes = np.full(rows - 1, count) if regular else rng.choice(STEPS, rows - 1)
    t = [first + u * int(k) for k in np.concatenate([[0], np.cumsum(sizes)])]
    if not origin:
        t = [0.0, *t[:-1]]
    spread = float(rng.choice([0.0, 1.0]))
    instants = [
        Fraction(s) + Fraction(_half_ulp(s, spread * r))
        for s, r in zip(t, rng.uniform(-1, 1, rows), strict=True)
    ]
    instants[1:] = [max(a, b) for a, b in zip(instants[1:], instants[:-1], strict=True)]
    return Stamps(t, instants, u * float(np.exp(np.mean(np.log(sizes)))))


def decimal_stamps(rng: np.random.Generator, origin: float, rows: int) -> Stamps:
    """Multiples of a decimal step, of at least twenty ulps, rounded to the nearest number."""
    choices = {0.0: ["0.1", "0.05", "0.001", "1e-7"], 1.7e9: ["0.1", "0.05", "0.001", "1e-5"],
               1.7e18: ["1e6", "5e4", "5000", "12345"]}[abs(origin)]  # fmt: skip
    step = Fraction(str(rng.choice(choices)))
    instants = [Fraction(origin) + k * step for k in range(rows)]
    return Stamps([float(s) for s in instants], instants, float(step))


def _half_ulp(t: float, part: float) -> float:
    above, below = math.nextafter(t, math.inf) - t, t - math.nextafter(t, -math.inf)
    return 0.5 * part * (above if part > 0 else below)


@dataclass
class Tally:
    """Rows, rows with status ok, violations, and their statuses."""

    rows: int = 0
    ok: int = 0
    violations: int = 0
    words: Counter[str] = field(default_factory=Counter)
    kinds: Counter[str] = field(default_factory=Counter)

    def add(self, kind: str, status: str, inside: bool) -> None:
        self.rows += 1
        self.ok += status == "ok"
        self.kinds[kind] += status == "ok"
        self.words[status.split(" ")[0]] += status != "ok"
        overflowed = "overflowed" in status
        if (not inside and not overflowed) or any(word in status for word in _REFUTED):
            self.violations += 1


def exact(values: Any) -> arb_mat:
    return arb_mat([[arb(float(v))] for v in values])


class Truth:
    """Exact states of a plant with disturbances that are constant over each step."""

    def __init__(self, plant: Plant, x: np.ndarray) -> None:
        self.plant, self.x = plant, exact(x)
        self.flows: dict[Any, arb_mat] = {}

    def flow(self, h: Fraction, b: np.ndarray) -> None:
        n = len(b)
        key = (h, *b)
        if key not in self.flows:
            size = arb(fmpq(h.numerator, h.denominator))
            rows = [
                [arb(float(a)) * size for a in row] + [arb(float(v)) * size]
                for row, v in zip(self.plant.flow.A, b, strict=True)
            ]
            self.flows[key] = arb_mat([*rows, [arb(0)] * (n + 1)]).exp()
        whole = self.flows[key] * arb_mat([*([self.x[i, 0]] for i in range(n)), [arb(1)]])
        self.x = arb_mat([[whole[i, 0]] for i in range(n)])

    def hold(self, first: int, values: np.ndarray) -> None:
        """Set states, from the index `first` on, to these numbers."""
        for i, value in enumerate(values):
            self.x[first + i, 0] = arb(float(value))

    def jump(self, c: np.ndarray) -> None:
        assert self.plant.jump is not None
        G = arb_mat([[arb(float(g)) for g in row] for row in self.plant.jump.G])
        self.x = G * self.x + exact(c)

    def measured(self, rng: np.random.Generator) -> np.ndarray:
        """Rounded to binary64; at the ends of the noise bound, but for that rounding."""
        C, V = self.plant.output.C, self.plant.output.noise_bound
        y = arb_mat([[arb(float(c)) for c in row] for row in C]) * self.x
        values = np.array([float(y[i, 0].mid()) for i in range(len(C))])
        room = np.maximum(V - 4 * np.spacing(np.abs(values) + V), 0.0)
        return values + room * rng.choice([-1.0, 0.0, 1.0], len(V))

    def inside(self, lower: np.ndarray, upper: np.ndarray) -> bool:
        return all(
            math.isfinite(low) and math.isfinite(high)
            and bool(arb(float(low)) <= self.x[i, 0]) and bool(self.x[i, 0] <= arb(float(high)))
            for i, (low, high) in enumerate(zip(lower, upper, strict=True))
        )  # fmt: skip


def random_case(
    rng: np.random.Generator, mode: str, step: float
) -> tuple[Plant, list[IntervalObserver]]:
    """A plant whose usual step takes it a part of its time constant, and observers of any gains."""
    n, p = int(rng.integers(1, 4)), int(rng.integers(1, 3))
    rate = float(rng.choice([1e-3, 0.05, 0.5])) / step
    A = rate * (rng.standard_normal((n, n)) - rng.uniform(0.5, 2.5) * np.eye(n))
    size = float(rng.choice([0.0, 1e-6, 0.3])) * rng.random((2, n))
    centre = rng.standard_normal((2, n)) * float(rng.choice([0.0, 1.0]))
    flow = Flow(A, lower=rate * (centre[0] - size[0]), upper=rate * (centre[0] + size[0]))
    jump = Jump(
        0.7 * rng.standard_normal((n, n)),
        lower=centre[1] - size[1],
        upper=centre[1] + size[1],
        dwell_time=(0.0, math.inf),
    )
    C = rng.standard_normal((p, n))
    C[0] = np.eye(1, n) if rng.random() < 0.5 else C[0]
    V = float(rng.choice([1e-9, 1e-3, 0.2])) * np.ones(p)
    when = str(
        rng.choice(["before", "after"] if mode == "at_jumps" else ["before", "after", "none"])
    )
    output = Output(
        C,
        noise_bound=V,
        measured=mode,
        jump_measurement=when,
        period=step if mode == "periodic" else None,
    )
    plant = Plant(flow, jump, output)
    observers = []
    for _ in range(2):
        L = rng.standard_normal((n, p)) * float(rng.choice([0.0, 0.5, 1.0]))
        M = 0.5 * rng.standard_normal((n, p)) * (when != "none")
        if mode == "periodic":
            observers.append(sampled_observer(plant, L, M))
        else:
            observers.append(observer_for(plant, (0.0 if mode == "at_jumps" else rate) * L, M))
    return plant, observers


def bounds_run(seed: int, origin: float, rows: int, tally: Tally, mode: str | None = None) -> None:
    """One record, run by an observer, by two for one plant, at once, and by a fleet."""
    rng = np.random.default_rng(seed)
    mode = str(rng.choice(MODES)) if mode is None else mode
    style = rng.integers(0, 3)
    stamps = (
        decimal_stamps(rng, origin, rows)
        if style == 2
        else ulp_stamps(rng, origin, rows, style == 0)
    )
    plant, observers = random_case(rng, mode, stamps.step)
    when, n = plant.output.jump_measurement, plant.n
    x0 = rng.standard_normal(n) * float(rng.choice([1.0, 100.0]))
    width = rng.random((2, n)) * float(rng.choice([0.0, 1e-6, 0.1]))
    box = {"lower": x0 - width[0], "upper": x0 + width[1]}
    jumps = rng.random(rows) < (0.7 if mode == "at_jumps" else rng.choice([0.0, 0.1]))
    missing = rng.random(rows) < rng.choice([0.0, 0.2])
    pair, truth = Fleet(tuple(observers)), Truth(plant, x0)
    state, states = observers[0].init(stamps.t[0], **box), pair.init(stamps.t[0], **box)
    ys, path, before = np.full((rows, plant.p), np.nan), [], stamps.instants[0]
    for k, (t, instant) in enumerate(zip(stamps.t, stamps.instants, strict=True)):
        if k:
            truth.flow(instant - before, _extreme(rng, plant.flow))
            before = instant
        y = truth.measured(rng)
        if jumps[k]:
            truth.jump(_extreme(rng, plant.jump))
            y = truth.measured(rng) if when == "after" else y
        absent = (
            missing[k] or (mode == "at_jumps" and not jumps[k]) or (jumps[k] and when == "none")
        )
        if not absent:
            ys[k] = y
        sample = Sample(t, None if absent else y, jump=bool(jumps[k]))
        state, estimate = observers[0].step(state, sample)
        assert estimate.lower is not None
        assert estimate.upper is not None
        tally.add(mode, estimate.status, truth.inside(estimate.lower, estimate.upper))
        states, bounds = pair.step(states, t, sample.y, jump=sample.jump)
        both = pair.intersection(bounds)
        assert both.lower is not None
        assert both.upper is not None
        tally.add("intersection", both.status, truth.inside(both.lower, both.upper))
        path.append(truth.x)
    batch = observers[0].run_batch(stamps.t, ys, jump=jumps, **box)
    assert batch.lower is not None
    assert batch.upper is not None
    for k, x in enumerate(path):
        truth.x = x
        tally.add("batch", batch.status[k], truth.inside(batch.lower[k], batch.upper[k]))
    if mode != "at_jumps":
        _fleet_run(rng, plant, observers[0], stamps, tally)


def _fleet_run(
    rng: np.random.Generator, plant: Plant, observer: IntervalObserver, stamps: Stamps, tally: Tally
) -> None:
    plants = 9
    fleet = Fleet((observer,) * plants)
    centre = rng.standard_normal((plant.n, plants))
    state = fleet.init(stamps.t[0], lower=centre - 0.01, upper=centre + 0.01)
    truths = [Truth(plant, x) for x in centre.T]
    for one in truths:
        one.flows = truths[0].flows
    for k in range(1, len(stamps.t)):
        for one in truths:
            one.flow(stamps.instants[k] - stamps.instants[k - 1], _extreme(rng, plant.flow))
        y = np.column_stack([one.measured(rng) for one in truths])
        state, many = fleet.step(state, stamps.t[k], y)
        for i, one in enumerate(truths):
            inside = one.inside(many.lower[:, i], many.upper[:, i])
            tally.add("fleet", many.plant(i).status, inside)


def _extreme(rng: np.random.Generator, part: Any) -> np.ndarray:
    """Any corner or the centre of the disturbance's box."""
    ends = np.array([part.lower, part.upper])
    return ends[rng.integers(0, 2, ends.shape[1]), np.arange(ends.shape[1])]


# --- point estimates ----------------------------------------------------------------------------


def luenberger_run(seed: int, origin: float, rows: int) -> float:
    """Largest distance from the exact recursion on the stamps as stored, of the largest state."""
    rng = np.random.default_rng(seed)
    stamps = ulp_stamps(rng, origin, rows, bool(rng.integers(0, 2)))
    longest = max(np.diff(stamps.t))  # the exponential of a stiff step loses digits of its own
    n, rate = int(rng.integers(1, 4)), min(0.05 / stamps.step, 5.0 / longest)
    A = rate * (0.5 * rng.standard_normal((n, n)) - 2.5 * np.eye(n))
    drift, C = rate * rng.standard_normal(n), rng.standard_normal((1, n))
    plant = Plant(
        Flow(A, lower=drift, upper=drift),
        Jump(0.3 * rng.standard_normal((n, n)), dwell_time=(0.0, math.inf)), Output(C),
    )  # fmt: skip
    gains = plant_data(plant) | {
        "L": 0.3 * rate * rng.standard_normal((n, 1)),
        "M": 0.3 * rng.standard_normal((n, 1)),
    }
    observer = LuenbergerObserver.from_gains(gains)
    F = exact_matrix(flow_error_matrix(A, gains["L"], C))
    L, M, G = (exact_matrix(X) for X in (gains["L"], gains["M"], plant.jump.G if plant.jump else A))
    state, x = observer.init(stamps.t[0], x=np.ones(n)), exact(np.ones(n))
    start, before, worst, largest = None, Fraction(stamps.t[0]), 0.0, 1.0
    for t in stamps.t:
        y, jump = rng.standard_normal(1), bool(rng.random() < 0.2)
        if Fraction(t) > before:
            flow, once, ramp = exact_responses(F, Fraction(t) - before)
            begin = y if start is None else start
            x = flow * x + once * (L * exact(begin) + exact(drift)) + ramp * (L * exact(y - begin))
            before = Fraction(t)
        start = y
        if jump:
            x = G * x + M * (exact(y) - exact_matrix(C) * x)
            start = None
        state, estimate = observer.step(state, Sample(t, y, jump=jump))
        assert estimate.x is not None
        assert estimate.status == "ok"
        truth = np.array([float(x[i, 0].mid()) for i in range(n)])
        worst, largest = (
            max(worst, np.abs(estimate.x - truth).max()),
            max(largest, np.abs(truth).max()),
        )
    return worst / largest


def exact_matrix(X: Any) -> arb_mat:
    return arb_mat([[arb(float(a)) for a in row] for row in X])


def exact_responses(F: arb_mat, h: Fraction) -> tuple[arb_mat, ...]:
    """e^{Fh}, its integral, and the response to a ramp from 0 to 1 over h."""
    n, size = F.nrows(), arb(fmpq(h.numerator, h.denominator))
    rows = [[arb(0)] * (3 * n) for _ in range(3 * n)]
    for i in range(n):
        rows[i][:n] = [F[i, j] * size for j in range(n)]
        rows[i][n + i], rows[n + i][2 * n + i] = size, arb(1)
    whole = arb_mat(rows).exp()
    return tuple(
        arb_mat([[whole[i, k * n + j] for j in range(n)] for i in range(n)]) for k in range(3)
    )


def finite_time_run(seed: int, origin: float, rows: int, tally: Tally) -> None:
    """Samples exactly a period apart, with stamps that are rounded."""
    rng = np.random.default_rng(seed)
    periods = {0.0: ["0.05", "0.001"], 1.7e9: ["0.05", "1e-4"], 1.7e18: ["4096", "5000", "1e6"]}
    step = Fraction(str(rng.choice(periods[abs(origin)])))
    rate = 0.1 / float(step)
    A = rate * np.array([[0.0, 1.0], [-1.0, -0.1]]) * rng.uniform(0.3, 1.5)
    push, V = (
        rate * np.array([0.0, float(rng.choice([0.0, 1e-3]))]),
        float(rng.choice([1e-9, 1e-2])),
    )
    design = obsdesign.design(obsdesign.Problem(
        flow={"A": A, "disturbance": {"lower": -push, "upper": push}},
        output={"C": [[1.0, 0.0]], "noise_bound": [V], "measured": "periodic", "period": float(step)},
        observer={"kind": "finite_time", "window": 6 * float(step), "method": str(rng.choice(["least_squares", "minimax"]))},
    ))  # fmt: skip
    observer: Any = from_design(design)
    plant = Plant(
        Flow(A, lower=-push, upper=push), None, Output(np.eye(1, 2), noise_bound=np.array([V]))
    )
    truth = Truth(plant, rng.standard_normal(2))
    state = observer.init(origin)
    for k in range(rows):
        if k:
            truth.flow(step, _extreme(rng, plant.flow))
        state, estimate = observer.step(
            state, Sample(float(Fraction(origin) + k * step), truth.measured(rng))
        )
        if estimate.status == "ok":
            tally.add("finite_time", "ok", truth.inside(estimate.lower, estimate.upper))
        else:
            tally.add("finite_time", estimate.status, True)
