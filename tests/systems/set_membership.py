"""Plants and records on which set-membership bounds are compared with the exact feasible set.

A record is drawn from one seed in a fixed order, so that its sums are known numbers.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import expm

import obsdesign
from lmi.arithmetic.arrays import Matrix
from obsdesign.equations.set_membership.gains import SetMembershipGains
from obsdesign.problem.flow import Flow
from obsdesign.problem.output import Output
from obsdesign.problem.plant import Jump, Plant
from obsdesign.runtime.base import Sample
from obsdesign.runtime.set_membership.model import observer_model
from obsdesign.runtime.set_membership.observer import SetMembershipObserver
from obsdesign.runtime.set_membership.stages import Window, window_of
from obsdesign.runtime.set_membership.state import SetMembershipState
from obsdesign.runtime.set_membership.tables import Tables

EXAMPLES = Path(__file__).parents[2] / "examples"


@dataclass(frozen=True)
class Case:
    """A plant and how its record is drawn.

    x0: (2, n) box of the initial state; b, c: middle and radius, (2, n); V: radius of the noise;
    jumps: rows with a jump.
    """

    name: str
    A: Matrix
    C: Matrix
    G: Matrix
    x0: Matrix
    b: Matrix
    c: Matrix
    V: Matrix
    times: Any
    jumps: tuple[int, ...] = ()
    missing: float = 0.0
    seed: int = 1

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.A)

    @property
    def plant(self) -> Plant:
        """The plant as a problem states it."""
        jump = Jump(self.G, None, None, self.c[0] - self.c[1], self.c[0] + self.c[1])
        flow = Flow(self.A, None, None, self.b[0] - self.b[1], self.b[0] + self.b[1])
        return Plant(flow, jump if self.jumps else None, Output(self.C, noise_bound=self.V))

    def record(self, extreme: bool = False, seed: int | None = None) -> Record:
        """The rows, the measurement at time 0 first; seed: another stream of the same plant."""
        seed = self.seed if seed is None else seed
        times, x = _initial(seed, self.x0, self.times)
        return _simulated(self, x, times, seed, extreme)


@dataclass(frozen=True)
class Record:
    """samples: the rows, at time 0 first; truth: the state after each, (rows, n)."""

    samples: tuple[Sample, ...]
    truth: Matrix

    @property
    def y_sum(self) -> float:
        """Sum of all measurements."""
        return float(sum(np.sum(s.y) for s in self.samples if s.y is not None))


def _initial(seed: int, box: Matrix, times: Any) -> tuple[Matrix, Matrix]:
    rng = np.random.default_rng(seed + 1000)
    if isinstance(times, tuple):
        low, high, count = times
        times = np.round(np.cumsum(rng.uniform(low, high, count)), 4)
    return times, box[0] + (box[1] - box[0]) * rng.uniform(0.2, 0.8, len(box[0]))


def _simulated(case: Case, x: Matrix, times: Matrix, seed: int, extreme: bool) -> Record:
    rng = np.random.default_rng(seed)

    def drawn(r: Matrix) -> Matrix:
        is_extreme = rng.random(len(r)) < (1.0 if extreme else 0.5)
        signs = np.sign(rng.uniform(-1, 1, len(r)))
        return r * np.where(is_extreme, signs, rng.uniform(-1, 1, len(r)))

    samples = [Sample(0.0, case.C @ x + drawn(case.V))]
    truth = [x]
    b, t = drawn(case.b[1]), 0.0
    for k, now in enumerate(times):
        Phi, integral = flow_integral(case.A, (now - t) / 4)
        for _ in range(4):
            b = drawn(case.b[1]) if rng.random() < 0.3 else b
            x = Phi @ x + integral @ (case.b[0] + b)
        y = case.C @ x + drawn(case.V)
        is_missing, jump = rng.random() < case.missing, k in case.jumps
        if jump:
            x = case.G @ x + case.c[0] + drawn(case.c[1])
        samples.append(Sample(float(now), None if is_missing else y, jump=jump))
        truth.append(x)
        t = now
    return Record(tuple(samples), np.array(truth))


def flow_integral(A: Matrix, h: float) -> tuple[Matrix, Matrix]:
    """e^{A h} and its integral over [0, h]."""
    n = len(A)
    block = np.zeros((2 * n, 2 * n))
    block[:n, :n], block[:n, n:] = A, np.eye(n)
    whole = expm(block * h)
    return whole[:n, :n], whole[:n, n:]


def random_case(n: int, seed: int, p: int, unstable: float, rows: int = 60) -> Case:
    """A random plant whose fastest mode grows at the rate `unstable`."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n, n)) / np.sqrt(n)
    A = np.round(A - (np.linalg.eigvals(A).real.max() - unstable) * np.eye(n), 3)
    C = np.round(rng.normal(size=(p, n)), 2)
    G = np.round(np.eye(n) + 0.3 * rng.normal(size=(n, n)), 2)
    b, c = np.round(0.2 * rng.random(n), 2), np.round(0.1 * rng.random(n), 2)
    zero, one = np.zeros(n), np.ones(n)
    return Case(
        f"rand{n}_{seed}", A, C, G, np.array([-one, one]), np.array([zero, b]),
        np.array([zero, c]), np.full(p, 0.05), (0.05, 0.15, rows), tuple(range(9, rows, 10)),
        missing=0.1, seed=seed,
    )  # fmt: skip


def _example(name: str) -> Plant:
    return obsdesign.load_problem(EXAMPLES / name).plant


def _pair(lower: Any, upper: Any) -> Matrix:
    return np.array([lower, upper], dtype=float)


def cases() -> dict[str, Case]:
    """All plants by name."""
    degue, crane, qcar, doses, sampled, ball = (
        _example(f"{name}.toml")
        for name in (
            "degue_4_1", "gantry_crane", "quarter_car", "oral_doses", "sampled_data", "degue_4_2",
        )
    )  # fmt: skip
    zero = {n: np.zeros(n) for n in (2, 3, 4, 6)}
    grid = {"degue": 0.1 * np.arange(1, 151), "qcar": 0.005 * np.arange(1, 81)}
    grid |= {"doses": 0.5 * np.arange(1, 81), "ball": 0.02 * np.arange(1, 160)}

    def middle(low: Matrix, high: Matrix) -> Matrix:
        return np.array([(low + high) / 2, (high - low) / 2])

    assert degue.jump is not None
    assert doses.jump is not None
    assert sampled.jump is not None
    assert ball.jump is not None
    listed = [
        Case(
            "degue", degue.flow.A, degue.output.C, degue.jump.G, _pair([0, 0], [2, 2]),
            _pair(zero[2], [0.1, 0.1]), _pair(zero[2], [0.3, 0.3]), np.array([0.03]),
            grid["degue"], (49, 99),
        ),
        Case(
            "crane", crane.flow.A, crane.output.C, np.eye(4), _pair([-0.1] * 4, [0.1] * 4),
            _pair(zero[4], [0, 0.1, 0, 0.1667]), np.zeros((2, 4)), np.array([0.01, 0.02]),
            (0.05, 0.25, 60), missing=0.1,
        ),
        Case(
            "qcar", qcar.flow.A, qcar.output.C, np.eye(4),
            _pair([-0.01, -0.1, -0.01, -0.1], [0.01, 0.1, 0.01, 0.1]),
            _pair(zero[4], [0, 0.667, 0, 3.333]), np.zeros((2, 4)), np.array([0.003, 0.0003]),
            grid["qcar"],
        ),
        Case(
            "doses", doses.flow.A, doses.output.C, doses.jump.G,
            _pair([0] * 6, [10, 10, 10, 20, 40, 40]), middle(doses.flow.lower, doses.flow.upper),
            middle(doses.jump.lower, doses.jump.upper), np.array([0.02]), grid["doses"],
            (11, 29, 49, 65),
        ),
        Case(
            "sampled", sampled.flow.A, sampled.output.C, sampled.jump.G,
            _pair([-1] * 3, [1] * 3), _pair(zero[3], [0.01, 0.05, 0]), np.zeros((2, 3)),
            np.array([0.02]), (0.4, 1.8, 40), tuple(range(40)),
        ),
        Case(
            "ball", ball.flow.A, ball.output.C, ball.jump.G, _pair([4.5, -1], [5.5, 1]),
            _pair([0, -9.81], [0, 0.5]), _pair([0, 0], [0, 0.5]), np.array([0.01]), grid["ball"],
            (50, 120),
        ),
        random_case(2, 21, 1, 0.3), random_case(3, 31, 1, 0.2), random_case(4, 41, 1, 0.2),
        random_case(4, 42, 2, 0.5), random_case(6, 61, 2, 0.2), random_case(8, 81, 2, 0.1, 40),
    ]  # fmt: skip
    return {case.name: case for case in listed}


# sums of all measurements but the one at time 0
ROW_SUMS = {
    "degue": 7.56357518, "rand2_21": -30.1639188, "rand4_42": -448.658577, "doses": 163.861446,
}  # fmt: skip


def observer_of(case: Case, window: int, steps: int = 20, **entries: Any) -> SetMembershipObserver:
    """The multiplier observer of a plant."""
    gains = SetMembershipGains.from_plant(case.plant, window=window, steps=steps, **entries)
    return SetMembershipObserver(gains)


def bounds_of(observer: SetMembershipObserver, case: Case, samples: Iterable[Sample]) -> Matrix:
    """Bounds after every row, (rows, 2, n)."""
    state = observer.init(0.0, lower=case.x0[0], upper=case.x0[1])
    return np.array([[e.lower, e.upper] for e in observer.run(state, samples)])


def window_after(case: Case, rows: int) -> tuple[Window, SetMembershipState, Matrix]:
    """The window of the first rows of a record, the state after them, and its scales."""
    observer = observer_of(case, 40)
    state = observer.init(0.0, lower=case.x0[0], upper=case.x0[1])
    for sample in case.record().samples[:rows]:
        state, _ = observer.step(state, sample)
    model = observer_model(observer.gains)
    size = np.abs(state.box).max(axis=0)
    window = window_of(model, Tables(model), state.start, state.stages, size)
    return window, state, model.scales
