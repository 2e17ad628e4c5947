"""Random plants with noise of all sizes and units: impulses missed, false ones, errors over deviations.

n = 2..4; one to three outputs, their noise up to 1e7 apart, in units of 1e-6 to 1e6; `noise_cv` alone,
`noise_std` alone, both; every operator and norm, K open and stated; records that begin at rest and not.
A true impulse counts as missed in `ok` rows where no event is near and no row of its window has a doubt;
its deviation is the Cramer-Rao bound of all samples around it. python -m tests.long.noisy_impulses [PLANTS] [FIRST]
"""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import obsdesign
from lmi.arithmetic.exponential import expm
from obsdesign.runtime import from_design
from tests.systems.impulsive_input import events_of, record, rows_from

IMPULSES, SIGNIFICANT = 6, 8.0
OPERATORS: tuple[dict[str, Any], ...] = (
    {"operator": "integral"}, {"operator": "integral", "weighting": "plain"},
    {"operator": "samples"}, {"operator": "integral", "gains": {}},
    {"operator": "integral", "weighting": "plain", "gains": {}},
)  # fmt: skip
NOISES = ("std", "cv", "both")


@dataclass
class Tally:
    """Counts over records: true impulses, missed ones, false ones; errors over deviations."""

    true: int = 0
    missed: int = 0
    missed_ok: int = 0
    false: int = 0
    false_ok: int = 0
    ratios: list[tuple[float, float]] = field(default_factory=list)

    def line(self) -> str:
        """The numbers in words."""
        sizes = np.abs(np.array(self.ratios or [(0.0, 0.0)]))
        rms, worst = np.sqrt((sizes**2).mean(axis=0)), sizes.max(axis=0, initial=0.0)
        return (
            f"{self.true} impulses, missed {self.missed} ({self.missed_ok} in ok rows), false {self.false} "
            f"({self.false_ok} ok), ok {len(self.ratios)}: error/deviation rms {rms[0]:.2f} {rms[1]:.2f}, "
            f"worst {worst[0]:.1f} {worst[1]:.1f}, beyond 5: {int((sizes > 5).any(axis=1).sum())}"
        )


def flow(rng: np.random.Generator, n: int) -> np.ndarray:
    """A chain of compartments, one with feedback, or one that turns."""
    rates = rng.uniform(0.25, 1.2, n)
    A = -np.diag(rates) + np.diag(rates[:-1] * rng.uniform(0.5, 1.5, n - 1), -1)
    shape = rng.integers(3)
    if shape == 1:
        A[0, n - 1] = 0.1 * rates.min()
    if shape == 2:
        A[:2, :2] = [[-0.3, -rng.uniform(0.3, 1.0)], [rng.uniform(0.3, 1.0), -0.4]]
    return A


def plant(rng: np.random.Generator, seed: int) -> tuple[dict[str, Any], np.ndarray]:
    """(problem, state at first)."""
    n, p = int(rng.integers(2, 5)), int(rng.integers(1, 4))
    A, H = flow(rng, n), np.zeros((n, 1))
    H[0] = 1.0
    C = np.zeros((p, n))
    rows = rng.permutation(np.arange(1, n))
    for j in range(p):
        C[j, rows[j % len(rows)]] = 1.0
        if j or rng.random() < 0.3:
            C[j] += 0.5 * rng.standard_normal(n) * (np.arange(n) > 0)
    C[0] = np.where(np.arange(n) == n - 1, 1.0, 0.0) if rng.random() < 0.7 else C[0]
    slow = float(-np.linalg.eigvals(A).real.max())
    dwell = round(float(rng.uniform(2.5, 4)) / slow, 2)
    period = float(f"{dwell / rng.uniform(60, 160):.2g}")
    grid = expm(A * np.linspace(0, dwell, 80)[:, None, None]) @ H
    peak = np.abs(C @ grid)[..., 0].max(axis=0)
    options = dict(OPERATORS[(seed // 3) % len(OPERATORS)])
    units, states = 10 ** rng.uniform(-6, 6, p), 10 ** rng.uniform(-3, 3, n)
    if options["operator"] == "integral":  # `uniqueness` is hardly proved in other units of states
        states = np.ones(n)
    worst = 10 ** rng.uniform(-3, -1)
    relative = worst * 10 ** -rng.uniform(0, 7, p)
    relative[rng.integers(p)] = worst
    output: dict[str, Any] = {"measured": "periodic", "period": period}
    kind = NOISES[seed % 3]
    if kind != "cv":
        output["noise_std"] = (relative * peak * units).tolist()
    if kind != "std":
        output["noise_cv"] = (10 ** rng.uniform(-3, -1.2, p)).tolist()
    A, H, scaled = A * states[:, None] / states, H * states[:, None], C * units[:, None] / states
    output["C"] = scaled.tolist()
    if "gains" in options:
        for _ in range(100):
            K = rng.uniform(0, 1, (n, p)) * states[:, None] / units
            if np.linalg.eigvals(A - K @ scaled).real.max() < -0.6 * slow:
                break
        options["gains"] = {"K": K.tolist()}
    x0 = (
        np.zeros(n)
        if rng.random() < 0.5
        else (grid[rng.integers(80)][:, 0] * rng.uniform(0.2, 1)) * states
    )
    return {
        "flow": {"A": A.tolist()}, "jump": {"H": H.tolist(), "dwell_time": [dwell, "inf"]},
        "output": output, "observer": {"kind": "impulsive_input"} | options,
    }, x0  # fmt: skip


def simulated(body: dict[str, Any], rng: np.random.Generator, x0: Any) -> tuple[Any, ...]:
    """(t, y without noise, its deviations, y, impulses)."""
    dwell, period, output = body["jump"]["dwell_time"][0], body["output"]["period"], body["output"]
    moments = dwell * (0.7 + np.cumsum(rng.uniform(1.05, 1.7, IMPULSES)))
    weights = rng.choice([-1, 1], IMPULSES) * 10 ** rng.uniform(-0.5, 0.5, IMPULSES)
    train = list(zip(moments.tolist(), weights.tolist(), strict=True))
    t = np.round(period * np.arange(int((moments[-1] + 2.2 * dwell) / period)), 10)
    y = (
        record(np.array(body["flow"]["A"]), body["jump"]["H"], train, t, x0)
        @ np.array(output["C"]).T
    )
    std, cv = (
        np.array(output.get(name, np.zeros(y.shape[1]))) for name in ("noise_std", "noise_cv")
    )
    spread = np.hypot(std, cv * np.abs(y))
    return t, y, spread, y + spread * rng.standard_normal(y.shape), train


def bounds(body: dict[str, Any], t: Any, y: Any, spread: Any, train: Any) -> list[float]:
    """|weight| over its Cramer-Rao deviation, state and onset unknown, of each impulse."""
    A, H, C = (np.array(body[a][b]) for a, b in (("flow", "A"), ("jump", "H"), ("output", "C")))
    dwell, floor = body["jump"]["dwell_time"][0], 1e-3 * np.abs(y).max(axis=0)
    units = np.abs(A).max()
    result = []
    for moment, g in train:
        near = np.abs(t - moment) < 0.8 * dwell
        s = np.maximum(
            spread[near], np.where((spread > 0).all(axis=0), 0, 1e-3 * floor) + 1e-12 * floor
        )
        flows = expm(A * (t[near] - t[near][0])[:, None, None])
        late = (
            expm(A * np.maximum(t[near] - moment, 0)[:, None, None])
            * (t[near] >= moment)[:, None, None]
        )
        columns = np.concatenate([late @ H, late @ A @ H * g / units, flows], axis=2)
        J = (C @ columns / s[:, :, None]).reshape(s.size, -1)
        R = np.linalg.qr(J / np.linalg.norm(J, axis=0))[1]
        sizes = np.linalg.norm(np.linalg.pinv(R), axis=1) / np.linalg.norm(J, axis=0)
        result.append(float(abs(g) / sizes[0]))
    return result


def design_of(seed: int, body: dict[str, Any]) -> Any:
    """The design of a problem."""
    return obsdesign.design(obsdesign.Problem.from_dict(body))


def studied(seed: int, totals: dict[str, Tally], words: Counter[str]) -> None:
    """Add one plant to the tallies; print what is wrong with it."""
    rng = np.random.default_rng(seed)
    body, x0 = plant(rng, seed)
    options = body["observer"]
    kind = f"{options['operator']}{' plain' if 'weighting' in options else ''}"
    name = f"{kind}, {NOISES[seed % 3]}"
    try:
        design = design_of(seed, body)
    except (obsdesign.NotProved, obsdesign.InputError):
        words[f"{kind}: not proved"] += 1
        return
    t, exact, spread, y, train = simulated(body, rng, x0)
    guess = x0 if seed % 4 < 2 else np.zeros(len(x0))
    rows = rows_from(from_design(design), t, y, x=guess)
    events, left = events_of(rows), []
    period, window = body["output"]["period"], design.gains["window"]
    limits, own = bounds(body, t, exact, spread, train), Tally(true=len(train))
    left = list(events)
    for k, (moment, g) in enumerate(train):
        near = [
            e for e in left if abs(e.t - moment) < max(6 * (e.t_std or 0), 2 * period, 0.1 * window)
        ]
        if not near:
            doubted = any(r.status != "ok" for r in rows if moment <= r.t <= moment + 1.5 * window)
            own.missed += 1
            own.missed_ok += not doubted and limits[k] > SIGNIFICANT
            print(f"   seed {seed} {name}: missed t {moment:.4g} g {g:.3g}, bound {limits[k]:.3g} deviations"
                  f"{'' if doubted else ' ok rows'}")  # fmt: skip
            continue
        event = min(near, key=lambda e: abs(e.t - moment))
        left.remove(event)
        if event.status == "ok":
            least = 1e-12 * np.array([moment, abs(g)])
            z = ((event.t - moment) / max(event.t_std, least[0]),
                 (event.weights[0] - g) / max(event.weights_std[0], least[1]))  # fmt: skip
            own.ratios.append(z)
            if np.abs(z).max() > 5:
                print(f"   seed {seed} {name}: t {moment:.4g} {event.t_std:.2g} g {g:.3g} "
                      f"{event.weights_std[0]:.2g} off by {z[0]:.3g} {z[1]:.3g} deviations, bound {limits[k]:.2g}")  # fmt: skip
        else:
            words[f"{kind}: status {event.status[:40]}"] += 1
    own.false, own.false_ok = len(left), sum(e.status == "ok" for e in left)
    for e in left:
        print(
            f"   seed {seed} {name}: false t {e.t:.5g} g {e.weights[0]:.3g} std {e.weights_std[0]:.2g} {e.status}"
        )
    for tally in (totals.setdefault(name, Tally()), totals.setdefault("all", Tally())):
        tally.true, tally.missed = tally.true + own.true, tally.missed + own.missed
        tally.missed_ok, tally.ratios = tally.missed_ok + own.missed_ok, tally.ratios + own.ratios
        tally.false, tally.false_ok = tally.false + own.false, tally.false_ok + own.false_ok
    sys.stdout.flush()


def main() -> None:
    plants = int(sys.argv[1]) if len(sys.argv) > 1 else 90
    first = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    totals: dict[str, Tally] = {}
    words: Counter[str] = Counter()
    for seed in range(first, first + plants):
        studied(seed, totals, words)
    for name in sorted(totals):
        print(f"{name:22s} {totals[name].line()}")
    for word, count in words.most_common():
        print(f"{count:4d} {word}")


if __name__ == "__main__":
    main()
