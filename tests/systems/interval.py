"""Random plants for each form, their designs, and runs that try to break what was proved."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import obsdesign
from obsdesign.data.simulation import Simulation, simulate
from obsdesign.problem.plant import Plant
from obsdesign.runtime import from_design

FORMS = ("cooperative", "split", "coordinates", "two_coordinates", "samples")

# the simulated truth and the floats of a width are rounded, relative to the largest of a run
ROUNDING = 1e-11
_WORST_CONDITION = 50.0


@dataclass(frozen=True)
class Trial:
    """What a run of a random plant showed: by how much the state left its bounds, and the width the
    proved one, relative to the run's size; how long the guarantees were proved."""

    verdict: str
    beyond: float
    wider: float | None


def trial(form: str, seed: int, corners: int = 2) -> Trial:
    """Design a random plant in a form, run it under random and extreme disturbances.

    corners: sign patterns of b that are held, as many as there are at most; then all signals
    switch from corner to corner.
    """
    rng = np.random.default_rng([seed, FORMS.index(form)])
    outcome = obsdesign.investigate(random_problem(form, rng))
    design = outcome.design
    assert design is not None
    plant = obsdesign.Problem.from_dict(design.problem).plant
    always, step = _claimed(design, plant.output.period)
    observer = from_design(design)
    beyond, wider = 0.0, None
    for held, kind, source in _disturbances(plant, corners, rng):
        x = rng.standard_normal(plant.n) * rng.choice([0.0, 1.0, 10.0])
        record = simulate(held, until=80 * step, step=step, initial=x, disturbance=kind,
                          dwell=rng.uniform(0.3, 2.0, 400).tolist(), rng=source)  # fmt: skip
        y = record.block("y")
        if held is not plant:  # noise at a corner of its own
            y = y + plant.output.noise_bound * rng.choice([-1.0, 1.0], plant.p)
        size = 1.0 + float(np.abs(record.block("x")).max())
        lower, upper = _bounds(observer, record, y, x)
        truth = record.block("x")
        beyond = max(beyond, float(np.maximum(lower - truth, truth - upper).max()) / size)
        if always is not None:  # from no width at all, the width stays below what is proved
            excess = float((upper - lower - always).max()) / size
            wider = excess if wider is None else max(wider, excess)
    return Trial(outcome.verdict, beyond, wider)


def _disturbances(plant: Any, corners: int, rng: Any) -> Iterator[tuple[Any, str, Any]]:
    """(plant, kind of disturbance, source of chance): held corners, switching, random."""
    signs = list(itertools.product((0.0, 1.0), repeat=plant.n))
    chosen = rng.permutation(len(signs))[:corners]
    for k in chosen:
        flow, jump = (_at_corner(block, np.array(signs[k])) for block in (plant.flow, plant.jump))
        if rng.random() < 0.5:  # at jumps the same corner, or any
            jump = _at_corner(plant.jump, rng.integers(0, 2, plant.n))
        yield Plant(flow, jump, plant.output), "zero", rng
    for _ in range(max(corners // 8, 1)):
        yield plant, "random", Corners(rng)
    yield plant, "random", rng


def _at_corner(block: Any, signs: Any) -> Any:
    corner = np.where(signs > 0, block.upper, block.lower)
    return replace(block, lower=corner, upper=corner)


@dataclass(frozen=True)
class Corners:
    """A source of chance whose uniform numbers are ends: what is drawn in a box is a corner."""

    rng: np.random.Generator

    def uniform(self, low: float, high: float, size: Any) -> Any:
        """Low or high."""
        return self.rng.choice([low, high], size)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.rng, name)


def _claimed(design: Any, period: float | None) -> tuple[Any, float]:
    """(proved bound of the width at any time or None, the spacing of samples it is for)."""
    for claim in design.claims:
        if claim.verdict == "proved" and claim.id in ("sampled_stability", "sampled_width"):
            step = claim.evidence.get("step_limit", period)
            if step == math.inf:
                return np.array(claim.evidence["always"]), 0.1
            if claim.id == "sampled_width":  # a shorter step of two digits
                step = float(f"{0.9 * step:.2g}")
            return np.array(claim.evidence["always"]), float(step)
    return None, float(period or 0.02)


def _bounds(observer: Any, record: Simulation, y: Any, x: Any) -> tuple[Any, Any]:
    batch = observer.run_batch(record.t, y, jump=record.columns["jump"], lower=x, upper=x)
    assert not any("outside" in text or "void" in text for text in batch.status)
    return batch.lower, batch.upper


def random_problem(form: str, rng: np.random.Generator) -> obsdesign.Problem:
    """n = 2..6 states, several outputs; made so that the form fits."""
    n = int(rng.integers(2, 7))
    p = int(rng.integers(1, n))
    C = rng.standard_normal((p, n))
    L, M = 0.3 * rng.standard_normal((2, n, p))
    S = _basis(rng, n)
    S2 = S @ (np.eye(n) + 0.1 * rng.standard_normal((n, n)))  # far from S nothing is stable
    F = rng.random((n, n))
    if form != "two_coordinates":  # S^-1 F S has no exact zeros: R would miss its sign by rounding
        F *= rng.random((n, n)) < 0.7
    if form in ("split", "samples"):
        F = F * np.sign(rng.standard_normal((n, n)))
    F = F - np.diag(np.abs(F).sum(axis=1) + rng.uniform(0.2, 2.0, n))
    H = rng.random((n, n)) * rng.uniform(0.1, 0.9) / n
    if form != "cooperative" and form != "two_coordinates":
        H = H * np.sign(rng.standard_normal((n, n)))
    gains: dict[str, Any] = {"L": L, "M": M}
    if form in ("coordinates", "two_coordinates"):
        gains["S"] = S
        F = S @ F @ np.linalg.inv(S)
    if form == "two_coordinates":
        gains["S2"] = S2
        H = S2 @ H @ np.linalg.inv(S2)
    elif form == "coordinates":
        H = S @ H @ np.linalg.inv(S)
    exactly = form == "cooperative"  # there rounding must not spoil a zero: keep zeros off C
    A, G = F + L @ C, H + M @ C
    if exactly:
        A, G = A + 1e-9 * (1 - np.eye(n)), G + 1e-9
    if form == "samples":
        A, G, gains = F, H, {}
    middle = rng.standard_normal((2, n))
    size = rng.uniform(0.0, 0.5, (2, n)) * (rng.random((2, n)) < 0.8)
    output = {"C": C, "noise_bound": rng.uniform(0.0, 0.1, p)}
    if form == "samples":
        output |= {"measured": "periodic", "period": 0.05}
    observer = {"kind": "interval", "gains": gains}
    observer |= {} if form == "samples" else {"form": form}
    return obsdesign.Problem(
        flow={"A": A, "disturbance": {"lower": middle[0] - size[0], "upper": middle[0] + size[0]}},
        jump={"G": G, "dwell_time": [0.3, 2.0],
              "disturbance": {"lower": middle[1] - size[1], "upper": middle[1] + size[1]}},
        output=output, observer=observer,
    )  # fmt: skip


def _basis(rng: np.random.Generator, n: int) -> Any:
    while True:
        S = rng.standard_normal((n, n)) + 1.5 * np.eye(n)
        if np.linalg.cond(S) < _WORST_CONDITION:
            return S
