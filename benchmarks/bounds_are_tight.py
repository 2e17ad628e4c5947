"""Widths of guaranteed bounds against the exact feasible set, on plants with random disturbances.

Mean and worst ratio of the widths to those of a linear program over the whole history (HiGHS), and
microseconds per row. Ours: the multiplier observer with windows of 8, 16 and 30 stages. Theirs: the
interval observer of this package (narrowest gains), and zonotopes with strips: the gain of least
Frobenius norm (T. Alamo, J. M. Bravo, E. F. Camacho, Automatica 41 (2005); C. Combastel, Automatica
55 (2015)), and the choice of least volume (J. M. Bravo, T. Alamo, E. F. Camacho, IEEE TAC 51
(2006)), reduced to order 20 and 6 (A. Girard, HSCC 2005). The zonotopes are in floats.

    python -m benchmarks.bounds_are_tight [PLANT ...]
"""

from __future__ import annotations

import functools
import sys
import time
from collections.abc import Callable

import numpy as np

import obsdesign
from benchmarks.cases import duration, row
from lmi.arithmetic.arrays import Matrix
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem
from obsdesign.runtime import from_design
from obsdesign.runtime.base import Sample
from obsdesign.workflow import NotProved
from tests.systems.feasible_set import exact_bounds
from tests.systems.set_membership import Case, bounds_of, cases, flow_integral, observer_of

FIRST_ROW = 9
SEARCH_SECONDS = 60.0  # for the gains of the interval observer
WINDOWS = (8, 16, 30)
# largest mean ratio by plant and window
LIMITS = {
    ("degue", 8): 1.005, ("doses", 8): 1.03, ("ball", 8): 1.03, ("sampled", 8): 1.02,
    ("crane", 8): 1.06, ("qcar", 8): 1.12, ("rand2_21", 16): 1.01, ("rand3_31", 16): 1.08,
    ("rand4_42", 16): 1.03, ("rand4_41", 16): 1.13, ("rand6_61", 30): 1.06, ("rand8_81", 30): 1.04,
}  # fmt: skip
PIECES = {"crane": 3, "qcar": 3, "ball": 3, "sampled": 6}
# states of less than 1e-3 of their size are beyond the oracle
_STATES = {"doses": slice(3, 6)}


class Zonotope:
    """centre + Z [-1, 1]^k through flows, jumps and strips, reduced to an order."""

    def __init__(self, case: Case, order: int, volume: bool) -> None:
        self.case, self.order, self.volume = case, order, volume
        self.centre = case.x0.mean(axis=0)
        self.Z = np.diag(np.ptp(case.x0, axis=0) / 2)
        self.t = 0.0
        self.flows: dict[float, tuple[Matrix, Matrix, Matrix]] = {}

    def step(self, sample: Sample) -> tuple[Matrix, Matrix]:
        """(lower, upper) after a row."""
        case = self.case
        if sample.t > self.t:
            Phi, drift, spread = self._flow(round(sample.t - self.t, 9))
            self.centre = Phi @ self.centre + drift
            self.Z = np.hstack([Phi @ self.Z, spread])
        if sample.y is not None:
            for c, y, V in zip(case.C, np.asarray(sample.y), case.V, strict=True):
                self._strip(c, float(y), float(V))
        if sample.jump:
            self.centre = case.G @ self.centre + case.c[0]
            self.Z = np.hstack([case.G @ self.Z, np.diag(case.c[1])])
        self._reduce()
        self.t = sample.t
        radius = np.abs(self.Z).sum(axis=1)
        return self.centre - radius, self.centre + radius

    def _flow(self, h: float) -> tuple[Matrix, Matrix, Matrix]:
        """Phi, drift, columns of a step: of the means on four pieces, and a box for the rest."""
        if h not in self.flows:
            case, count = self.case, 4
            radius = np.diag(case.b[1])[:, case.b[1] > 0]
            step, integral = flow_integral(case.A, h / count)
            middle, _ = flow_integral(case.A, h / count / 2)
            columns, rest, start = [], np.zeros(case.n), np.eye(case.n)
            for _ in range(count):
                columns.append(start @ integral @ radius)
                slope = np.abs(case.A @ start @ middle @ radius).sum(axis=1)
                rest = rest + (h / count) ** 2 / 4 * slope * (1 + np.abs(case.A).sum() * h / count)
                start = start @ step
            Phi, total = flow_integral(case.A, h)
            spread = np.hstack([*columns, np.diag(rest)])
            self.flows[h] = (Phi, total @ case.b[0], spread)
        return self.flows[h]

    def _strip(self, c: Matrix, y: float, V: float) -> None:
        Z, off = self.Z, c @ self.Z
        gains = [Z @ off / (off @ off + V * V)]
        if self.volume:
            gains = [np.zeros(len(c)), *(Z[:, j] / off[j] for j in np.flatnonzero(off))]
        options = []
        for gain in gains:
            columns = np.hstack([Z - np.outer(gain, off), gain[:, None] * V])
            options.append((self._volume(columns) if len(gains) > 1 else 0.0, gain, columns))
        _, gain, self.Z = min(options, key=lambda option: option[0])
        self.centre = self.centre + gain * (y - c @ self.centre)

    def _volume(self, Z: Matrix) -> float:
        """Logarithm of the volume of the reduced zonotope's outer parallelotope."""
        return float(np.linalg.slogdet(Z @ Z.T + 1e-300 * np.eye(len(Z)))[1])

    def _reduce(self) -> None:
        n = len(self.centre)
        most = self.order * n
        if self.Z.shape[1] <= most:
            return
        size = np.abs(self.Z).sum(axis=0) - np.abs(self.Z).max(axis=0)
        kept = np.argsort(size)[::-1]
        large, small = kept[: most - n], kept[most - n :]
        box = np.diag(np.abs(self.Z[:, small]).sum(axis=1))
        self.Z = np.hstack([self.Z[:, large], box])


def zonotope(case: Case, order: int, volume: bool) -> Callable[[], Matrix]:
    """Bounds of the whole record."""

    def run() -> Matrix:
        observer = Zonotope(case, order, volume)
        return np.array([observer.step(sample) for sample in case.record().samples])

    return run


def interval(case: Case) -> Callable[[], Matrix] | None:
    """Bounds of the interval observer with the narrowest gains; None where no design is proved."""
    steps = np.diff([s.t for s in case.record().samples])
    even = float(np.ptp(steps)) < 1e-9
    body = {
        "flow": {"A": case.A, "disturbance": _box(case.b)},
        "output": {
            "C": case.C, "noise_bound": case.V,
            **({"measured": "periodic", "period": round(float(steps[0]), 9)} if even else {}),
        },
        "observer": {"kind": "interval", "objective": "narrowest", "gain_limit": 20.0},
    }  # fmt: skip
    if case.jumps:
        times = np.array([s.t for s in case.record().samples if s.jump])
        gaps = np.diff(times) if len(times) > 1 else times
        dwell = [float(gaps.min()) * 0.999, float(gaps.max()) * 1.001]
        body["jump"] = {"G": case.G, "disturbance": _box(case.c), "dwell_time": dwell}
    try:
        design = obsdesign.design(Problem.from_dict(body), seconds=SEARCH_SECONDS)
    except (InputError, NotProved):
        return None
    if any(claim.verdict == "refuted" for claim in design.claims):
        return None
    observer = from_design(design)
    start = case.x0.T.reshape(-1).tolist()

    def run() -> Matrix:
        rows = observer.run(observer.start(0.0, start), case.record().samples)
        return np.array([[e.lower, e.upper] for e in rows])

    return run


def _box(pair: Matrix) -> dict[str, Matrix]:
    return {"lower": pair[0] - pair[1], "upper": pair[0] + pair[1]}


def compared(case: Case, exact: Matrix, run: Callable[[], Matrix]) -> tuple[float, float, float]:
    """(mean ratio, worst ratio, microseconds per row)."""
    start = time.process_time()
    bounds = run()
    seconds = time.process_time() - start
    states = _STATES.get(case.name, slice(None))
    width = np.ptp(bounds[FIRST_ROW:], axis=1)[:, states]
    ratio = width / np.ptp(exact, axis=1)[:, states]
    return float(ratio.mean()), float(ratio.max()), 1e6 * seconds / len(bounds)


def observers_of(case: Case) -> dict[str, Callable[[], Matrix] | None]:
    """Label -> bounds of the record, None where there is no design."""
    samples = case.record().samples
    runs = {"interval": interval(case)}
    runs |= {"zonotope": zonotope(case, 20, False), "volume": zonotope(case, 6, True)}
    for window in WINDOWS:
        observer = observer_of(case, window)
        bounds_of(observer, case, samples[:40])  # tables of equal steps are made once
        runs[f"window {window}"] = functools.partial(bounds_of, observer, case, samples)
    return runs


def main(names: list[str] | None = None) -> bool:
    """Print the table; whether all limits hold."""
    good = True
    limits = {(name, f"window {window}"): most for (name, window), most in LIMITS.items()}
    for name, case in cases().items():
        if names and name not in names:
            continue
        exact = exact_bounds(case, case.record().samples, PIECES.get(name, 2), FIRST_ROW)
        outside = np.array([each.outside for each in exact])
        for label, run in observers_of(case).items():
            if run is None:
                row(f"width to the exact one, {name}, {label}", "", "", "no design", "", True)
                continue
            mean, worst, cost = compared(case, outside, run)
            limit = limits.get((name, label), np.inf)
            what = f"width to the exact one, {name}, {label}, worst {worst:.1f}"
            required = "" if np.isinf(limit) else f"<= {limit:g}"
            good &= row(what, duration(1e-6 * cost), "", f"{mean:.3f}", required, mean <= limit)
    return good


if __name__ == "__main__":
    sys.exit(not main(sys.argv[1:]))
