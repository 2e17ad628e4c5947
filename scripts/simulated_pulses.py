"""Pulses in simulated hormone records, sampled every 10 minutes: how many are found, how well.

Two compartments (half-life 50 min, release 5 min, basal level 1.4), gaps 45 min + Gamma (mean 75),
log-normal weights (mean 1.8, cv 35 %), proportional noise, rounding to 0.1, 48 samples; matched
within 15 min, pulses after 435 min not scored. The observer knows the model: python
scripts/simulated_pulses.py [records] [cv]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import obsdesign
from lmi.exponential import expm
from obsdesign.runtime import from_design
from obsdesign.runtime.base import rows_of

EXAMPLE = Path(__file__).parent.parent / "examples" / "luteinizing_hormone.toml"
BASAL, PERIOD, LAST, TOLERANCE, EIGHT_HOURS = 1.4, 10.0, 435.0, 15.0, 480.0


def train(rng: np.random.Generator) -> list[tuple[float, float]]:
    sigma = np.sqrt(np.log(1 + 0.35**2))
    moment, found = -float(rng.uniform(0, 75)) - 200, []
    while moment < 470:
        found.append((moment, float(1.8 * np.exp(sigma * rng.standard_normal() - sigma**2 / 2))))
        moment += 45 + float(rng.gamma(2.0, 15.0))
    return found


def main() -> None:
    records = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    cv = float(sys.argv[2]) if len(sys.argv) > 2 else 0.05
    body = obsdesign.load_problem(EXAMPLE).to_dict()
    A, H = np.array(body["flow"]["A"]), np.array(body["jump"]["H"])[:, 0]
    feed = -A[1, 1] * BASAL
    body["flow"]["disturbance"] = {"lower": [0, feed], "upper": [0, feed]}
    body["output"] |= {"noise_cv": [cv], "noise_std": [0.05]}
    observer = from_design(obsdesign.design(obsdesign.Problem.from_dict(body)))
    t = PERIOD * np.arange(48)
    hits, scored, false, moments, weights, scaled = 0, 0, 0, [], [], []
    for seed in range(records):
        rng = np.random.default_rng(seed)
        pulses = train(rng)
        clean = np.full(48, BASAL)
        for moment, weight in pulses:
            after = t >= moment
            clean[after] += weight * (expm(A * (t[after] - moment)[:, None, None]) @ H)[:, 1]
        y = np.round(clean * (1 + cv * rng.standard_normal(48)), 1)
        state = observer.init(0.0, x=[0, y[0]], covariance=np.diag([0.25, 1.0]))
        rows = list(observer.run(state, rows_of(t, y)))
        events = [event for row in rows for event in row.events]
        taken: set[int] = set()
        for moment, weight in ((m, g) for m, g in pulses if m > 0):
            near = [i for i, e in enumerate(events)
                    if abs(e.t - moment) <= TOLERANCE and i not in taken]  # fmt: skip
            if near:
                best = min(near, key=lambda i, m=moment: abs(events[i].t - m))
                taken.add(best)
            if moment > LAST:
                continue
            scored += 1
            if near:
                hits += 1
                moments.append(events[best].t - moment)
                weights.append(events[best].weights[0] / weight - 1)
                scaled.append(moments[-1] / events[best].t_std)
        false += sum(1 for i, e in enumerate(events) if i not in taken and e.t <= LAST)
    late, off, ratio = (np.sqrt(np.mean(np.square(v))) for v in (moments, weights, scaled))
    often = false / records * EIGHT_HOURS / 470
    print(f"{records} records, cv {cv:g}: detected {hits / scored:.3f}, false per 8 h {often:.3f}, "
          f"rmse {late:.2f} min, weights {off:.3f}, error/deviation {ratio:.2f}")  # fmt: skip


if __name__ == "__main__":
    main()
