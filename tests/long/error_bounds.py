"""Random uncertain plants with adversarial parameters: no error beyond the claim `error_bound`.

    python -m tests.long.error_bounds [ROWS] [SEED]

Parameter, disturbance and noise take the signs that drive one state of the error farthest at the
end, by its costate; the box of the state is what the state then comes to. The error starts at zero, so that
every row counts. Runs until ROWS rows are checked.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from lmi.arithmetic.arrays import Matrix, NewEntries
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem
from obsdesign.workflow import investigate

_STEP, _END = 0.01, 30.0


@dataclass(frozen=True)
class Case:
    """A problem without its box, and the times of jumps."""

    body: NewEntries
    jumps: frozenset[int]


def random_case(rng: np.random.Generator) -> Case:
    """Two or three states, one or two parameters in A, C or G; with jumps every other time."""
    n, p = int(rng.integers(2, 4)), 1
    A = rng.normal(size=(n, n))
    A -= (np.linalg.eigvals(A).real.max() + rng.uniform(0.1, 0.6)) * np.eye(n)
    C = rng.normal(size=(p, n))
    body: NewEntries = {
        "flow": {"A": A.tolist(), "disturbance": _box(rng, n)},
        "output": {"C": C.tolist(), "noise_bound": [float(rng.uniform(0, 0.1))]},
        "parameter": [],
        "observer": {"kind": "luenberger", "gains": {"L": (0.4 * rng.normal(size=(n, p))).tolist()}},
    }  # fmt: skip
    jumps = frozenset[int]()
    has_jumps = rng.uniform() < 0.6
    if has_jumps:
        low = float(rng.uniform(0.5, 2))
        high = low * float(rng.uniform(1.05, 2))
        body["jump"] = {
            "G": (np.diag(rng.uniform(-1, 1, n)) + 0.2 * rng.normal(size=(n, n))).tolist(),
            "dwell_time": [low, high if rng.uniform() < 0.6 else "inf"],
            "disturbance": _box(rng, n),
        }
        body["output"]["jump_measurement"] = str(rng.choice(["before", "after", "none"]))
        if body["output"]["jump_measurement"] != "none":
            body["observer"]["gains"]["M"] = (0.2 * rng.normal(size=(n, p))).tolist()
        jumps = _times(rng, low, high)
    for i in range(int(rng.integers(1, 3))):
        entry: NewEntries = {"name": "ab"[i], "range": [float(-rng.uniform(0, 1)), 1.0]}
        entry["A"] = _effect(rng, n, n)
        if rng.uniform() < 0.4:
            entry["C"] = _effect(rng, p, n)
        if has_jumps and rng.uniform() < 0.5:
            entry["G"] = _effect(rng, n, n)
        body["parameter"].append(entry)
    return Case(body, jumps)


def _effect(rng: np.random.Generator, rows: int, n: int) -> list[list[float]]:
    """Of rank one every other time."""
    X = rng.normal(size=(rows, n))
    if rng.uniform() < 0.5:
        X = np.outer(rng.normal(size=rows), rng.normal(size=n))
    return (0.3 * X).tolist()


def _box(rng: np.random.Generator, n: int) -> NewEntries:
    size, middle = rng.uniform(0, 0.3, n), 0.2 * rng.normal(size=n)
    return {"lower": (middle - size).tolist(), "upper": (middle + size).tolist()}


def _times(rng: np.random.Generator, low: float, high: float) -> frozenset[int]:
    """Steps at which jumps happen: the ends of the range, or anything between."""
    times, step = set[int](), 0
    while step * _STEP < _END:
        dwell = rng.choice([low, high, rng.uniform(low, high)])
        step += max(int(np.ceil(low / _STEP)), int(dwell / _STEP))
        times.add(step)
    return frozenset(times)


class Run:
    """State and estimate, driven to push state `target` of the error as far as it goes."""

    def __init__(self, case: Case, rng: np.random.Generator) -> None:
        plant = Problem.from_dict(case.body).plant
        self.plant, self.jumps, self.rng = plant, case.jumps, rng
        gains = case.body["observer"]["gains"]
        self.middle = [sum(each.range) / 2 for each in plant.parameters]
        self.half = [(each.range[1] - each.range[0]) / 2 for each in plant.parameters]
        self.L = np.array(gains["L"])
        self.M = np.array(gains.get("M", np.zeros(self.L.shape)))
        self.A, self.C = self.nominal("A", plant.flow.A), self.nominal("C", plant.output.C)
        self.G = None if plant.jump is None else self.nominal("G", plant.jump.G)
        self.V = float(plant.output.noise_bound[0])

    def nominal(self, key: str, value: Matrix) -> Matrix:
        """A matrix with every parameter in the middle of its range."""
        pairs = zip(self.plant.parameters, self.middle, strict=True)
        return value + sum(m * each.effects.get(key, 0 * value) for each, m in pairs)

    def at(self, key: str, nominal: Matrix, d: Matrix) -> Matrix:
        """The matrix with parameters at d, in [-1, 1] each."""
        pairs = zip(self.plant.parameters, self.half, d, strict=True)
        return nominal + sum(h * s * each.effects.get(key, 0 * nominal) for each, h, s in pairs)

    def costates(self, target: int) -> list[Matrix]:
        """Gradient of the final error with respect to that after each step, before its jump."""
        flow = expm((self.A - self.L @ self.C) * _STEP)
        count = int(_END / _STEP)
        row, rows = np.eye(len(self.A))[target], []
        for k in range(count, 0, -1):
            rows.append(row)
            if k in self.jumps:
                row = row @ self.error_jump()
            row = row @ flow
        return rows[::-1]

    def error_jump(self) -> Matrix:
        """H of the nominal error."""
        when = self.plant.output.jump_measurement
        if when == "before":
            return self.G - self.M @ self.C
        return self.G - self.M @ self.C @ self.G if when == "after" else self.G

    def course(self, target: int) -> tuple[Matrix, Matrix, Matrix]:
        """(x, e) after each step and each jump, and x just before jumps too."""
        n = len(self.A)
        low, high = self.plant.flow.b_bounds
        x, e = np.zeros(n), np.zeros(n)
        states, errors, before = [x], [e], [x]
        for k, row in enumerate(self.costates(target), start=1):
            after = row @ self.error_jump() if k in self.jumps else row
            d = np.array([
                np.sign(after @ (each.effects.get("A", 0 * self.A) - self.L @ each.effects.get("C", 0 * self.C)) @ x)
                or 1.0 for each in self.plant.parameters
            ])  # fmt: skip
            if self.rng.uniform() < 0.02:
                d = self.rng.uniform(-1, 1, len(d))
            b = np.where(after > 0, high, low)
            v = -np.sign(after @ self.L) * self.V
            x, e = self.step(x, e, d, b, v)
            states.append(x)
            errors.append(e)
            if k in self.jumps:
                before.append(x)
                x, e = self.jump(x, e, row)
                states.append(x)
                errors.append(e)
        return np.array(states), np.array(errors), np.array(before)

    def step(self, x: Matrix, e: Matrix, d: Matrix, b: Matrix, v: Matrix) -> tuple[Matrix, Matrix]:
        """x and estimate for one step with constant inputs, exact."""
        n = len(x)
        A, C = self.at("A", self.A, d), self.at("C", self.C, d)
        drift = sum(self.plant.flow.b_bounds) / 2
        Z = np.zeros((2 * n + 1, 2 * n + 1))
        Z[:n, :n], Z[:n, -1] = A, b
        Z[n:-1, :n], Z[n:-1, n:-1] = self.L @ C, self.A - self.L @ self.C
        Z[n:-1, -1] = drift + self.L @ v
        z = expm(Z * _STEP) @ np.concatenate([x, x - e, [1.0]])
        return z[:n], z[:n] - z[n:-1]

    def jump(self, x: Matrix, e: Matrix, row: Matrix) -> tuple[Matrix, Matrix]:
        """x and error after a jump, with parameters and disturbance of the worst signs."""
        when, estimate = self.plant.output.jump_measurement, x - e
        low, high = self.plant.jump.c_bounds
        d = np.array([
            np.sign(row @ each.effects.get("G", 0 * self.A) @ x) or 1.0
            for each in self.plant.parameters
        ])  # fmt: skip
        v = -np.sign(row @ self.M) * self.V
        following = self.at("G", self.G, d) @ x + np.where(row > 0, high, low)
        predicted = self.G @ estimate + (low + high) / 2
        C = self.at("C", self.C, d)
        if when == "before":
            predicted = predicted + self.M @ (C @ x + v - self.C @ estimate)
        if when == "after":
            predicted = predicted + self.M @ (C @ following + v - self.C @ predicted)
        return following, following - predicted


def main(rows: int, seed: int) -> int:
    """Check so many rows; the number of rows outside."""
    rng, checked, outside, plants, ratios = np.random.default_rng(seed), 0, 0, 0, list[float]()
    while checked < rows:
        case = random_case(rng)
        run = Run(case, rng)
        states, errors, _ = run.course(int(rng.integers(len(run.A))))
        size = np.abs(states).max(axis=0) * (1 + 1e-9)
        if not np.isfinite(size).all() or size.max() > 1e3:
            continue
        body = case.body | {"state": {"lower": (-size).tolist(), "upper": size.tolist()}}
        try:
            result = investigate(Problem.from_dict(body))
        except InputError:
            continue
        claims = [c for c in result.claims if c.id == "error_bound" and c.verdict == "proved"]
        if not claims:
            continue
        bound = np.array(claims[0].evidence["always"])
        excess = np.abs(errors) - bound * (1 + 1e-9)
        plants, checked = plants + 1, checked + len(errors)
        outside += int((excess > 0).any(axis=1).sum())
        ratios.append(float((np.abs(errors).max(axis=0) / bound).max()))
        if (excess > 0).any():
            print("OUTSIDE", body, excess.max(), flush=True)
    spread = np.quantile(ratios, [0.1, 0.5, 0.9, 1.0]).round(3).tolist()
    print(f"{checked} rows of {plants} plants, {outside} outside; of the bound reached {spread}")
    return outside


if __name__ == "__main__":
    numbers = [int(text) for text in sys.argv[1:3]]
    sys.exit(main(*(numbers + [50_000, 1][len(numbers) :])) > 0)
