"""How often errors of weights lie within 1, 2, 3 and 5 stated deviations, and how many say `ok`.

python -m tests.long.impulse_deviations [RECORDS]     40 impulses each; a line for plant and operator

First, errors over deviations (rms) of times and weights, where samples show onsets or only their
interval, for every operator and norm.
"""

from __future__ import annotations

import copy
import sys
from pathlib import Path

import numpy as np

import obsdesign
from tests.runtime.impulsive_input.test_onsets import BESIDE, FAST, ONE, errors_of, plant
from tests.runtime.impulsive_input.test_residuals import TWO, scores

EXAMPLE = Path(__file__).parents[2] / "examples" / "luteinizing_hormone.toml"


OPTIONS: tuple[dict[str, str], ...] = ({}, {"operator": "integral"}, {"weighting": "plain"})
ALONG = ([[-0.7, 0.0], [0.0, -2.0]], [[1.0], [0.0]], [[1.0, 1.0]])
SMOOTH = ([[-0.7, 0.0], [1.0, -2.0]], [[1.0], [0.0]], [[0.0, 1.0]])
KICKED = ([[0.0, 1.0], [-6.29, -0.4]], [[1.0], [0.0]], [[1.0, 0.0]])
PLANTS = {"one compartment": ONE, "H along a mode": ALONG, "H along the fast one": FAST,
          "H beside the modes": BESIDE, "no jump": SMOOTH, "oscillator": KICKED}  # fmt: skip


def onsets(records: int) -> None:
    """Print rms of errors over deviations of impulses, a line for plant, noise and options."""
    for name, matrices in PLANTS.items():
        for noise, period in ((0.1, 0.1), (0.01, 0.1), (0.001, 0.1), (0.01, 0.25)):
            for options in OPTIONS:
                try:
                    runs = [
                        errors_of(plant(matrices, noise, period, **options), 40, seed)
                        for seed in range(records)
                    ]
                except (obsdesign.NotProved, obsdesign.InputError) as refusal:
                    print(f"{name:21s} {options}: {refusal}")
                    continue
                size = np.sqrt((np.concatenate([run[0] for run in runs]) ** 2).mean(axis=0))
                print(f"{name:21s} noise {noise} period {period} {runs[0][2]:8s} {options}: "
                      f"time {size[0]:.2f} weight {size[1]:.2f}", flush=True)  # fmt: skip


def main() -> None:
    records = int(sys.argv[1]) if len(sys.argv) > 1 else 6
    onsets(records)
    hormone = obsdesign.load_problem(EXAMPLE).to_dict()
    precise = copy.deepcopy(hormone)
    precise["output"]["noise_cv"] = [0.01]
    for name, body in (("hormone, 9 %", hormone), ("hormone, 1 %", precise), ("integral", TWO)):
        A = np.array(body["flow"]["A"])
        decay = np.zeros_like(A)
        decay[1, 1] = 0.1 * A[1, 1]
        for label, wrong in (("right", 0 * A), ("decay + 10 %", decay), ("A + 10 %", 0.1 * A)):
            scored = [scores(body, wrong, seed) for seed in range(records)]
            sizes = np.abs(np.concatenate([errors for errors, _ in scored]))
            fine = np.array([word == "ok" for _, status in scored for word in status])
            within = "  ".join(f"{k}: {np.mean(sizes <= k):.3f}" for k in (1, 2, 3))
            print(f"{name:13s} {label:13s} {len(sizes)} impulses, within {within}  beyond 5: "
                  f"{np.sum(sizes > 5)}, of them ok: {np.sum(fine & (sizes > 5))}; "
                  f"ok: {np.sum(fine)}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
