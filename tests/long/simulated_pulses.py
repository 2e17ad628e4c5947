"""Pulses in simulated hormone records, sampled every 10 minutes: how many are found, how well.

Two compartments (half-life 50 min, release 5 min, basal level 1.4), gaps 45 min + Gamma (mean 75),
log-normal weights (mean 1.8, cv 35 %), proportional noise, rounding to 0.1, 48 samples; matched
within 15 min, pulses after 435 min not scored. Observer and deconvolution know the model, rules of
a rise do not; deconvolution looks at the whole record at once.

python -m tests.long.simulated_pulses [RECORDS] [CV]     a line for each method
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import obsdesign
from lmi.arithmetic.exponential import expm
from obsdesign.runtime import from_design
from tests.long.pulse_rules import EXAMPLE, Pulses, methods, observed

BASAL, PERIOD, LAST, TOLERANCE, EIGHT_HOURS = 1.4, 10.0, 435.0, 15.0, 480.0


@dataclass
class Score:
    """Pulses that were there, hits, events of no pulse; errors of onsets and relative weights."""

    scored: int = 0
    false: int = 0
    late: list[float] = field(default_factory=list)
    weights: list[float] = field(default_factory=list)

    def add(self, true: Pulses, found: Pulses) -> dict[int, float]:
        """Count one record; event -> the onset it was taken for."""
        taken: dict[int, float] = {}
        for moment, weight in ((m, g) for m, g in true if m > 0):
            near = [i for i, (t, _) in enumerate(found)
                    if abs(t - moment) <= TOLERANCE and i not in taken]  # fmt: skip
            if near:
                best = min(near, key=lambda i, m=moment: abs(found[i][0] - m))
                taken[best] = moment
            if moment <= LAST:
                self.scored += 1
                if near:
                    self.late.append(found[best][0] - moment)
                    self.weights.append(found[best][1] / weight - 1)
        self.false += sum(i not in taken and t <= LAST for i, (t, _) in enumerate(found))
        return taken

    def line(self, records: int) -> str:
        late, off = (float(np.sqrt(np.mean(np.square(v)))) for v in (self.late, self.weights))
        often = self.false / records * EIGHT_HOURS / 470
        return (f"detected {len(self.late) / self.scored:.3f}, false per 8 h {often:.3f}, "
                f"rmse {late:.2f} min, weights {off:.3f}")  # fmt: skip


def train(rng: np.random.Generator) -> Pulses:
    sigma = np.sqrt(np.log(1 + 0.35**2))
    moment, found = -float(rng.uniform(0, 75)) - 200, []
    while moment < 470:
        found.append((moment, float(1.8 * np.exp(sigma * rng.standard_normal() - sigma**2 / 2))))
        moment += 45 + float(rng.gamma(2.0, 15.0))
    return found


def record(rng: np.random.Generator, A: Any, H: Any, cv: float) -> tuple[Pulses, Any, Any]:
    """(pulses, times, measurements)."""
    t, pulses = PERIOD * np.arange(48), train(rng)
    clean = np.full(48, BASAL)
    for moment, weight in pulses:
        after = t >= moment
        clean[after] += weight * (expm(A * (t[after] - moment)[:, None, None]) @ H)[:, 1]
    return pulses, t, np.round(clean * (1 + cv * rng.standard_normal(48)), 1)


def main() -> None:
    records = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    cv = float(sys.argv[2]) if len(sys.argv) > 2 else 0.05
    body = obsdesign.load_problem(EXAMPLE).to_dict()
    A, H = np.array(body["flow"]["A"]), np.array(body["jump"]["H"])[:, 0]
    feed = -A[1, 1] * BASAL
    body["flow"]["disturbance"] = {"lower": [0, feed], "upper": [0, feed]}
    body["output"] |= {"noise_cv": [cv], "noise_std": [0.05]}
    observer = from_design(obsdesign.design(obsdesign.Problem.from_dict(body)))
    ways = methods(observer, BASAL, cv)
    scores, scaled = {name: Score() for name in ways}, []
    for seed in range(records):
        pulses, t, y = record(np.random.default_rng(seed), A, H, cv)
        events = observed(observer, t, y)
        mine = [(e.t, float(e.weights[0])) for e in events]
        taken = scores["observer"].add(pulses, mine)
        scaled += [(events[i].t - m) / events[i].t_std for i, m in taken.items() if m <= LAST]
        for name in list(ways)[1:]:
            scores[name].add(pulses, ways[name](t, y))
    print(f"{records} records, cv {cv:g}")
    for name, score in scores.items():
        print(f"{name:14s} {score.line(records)}")
    ratio = float(np.sqrt(np.mean(np.square(scaled))))
    print(f"observer: error of onsets over their deviation {ratio:.2f}")


if __name__ == "__main__":
    main()
