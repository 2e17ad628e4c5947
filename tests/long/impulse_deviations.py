"""How often errors of weights lie within 1, 2, 3 and 5 stated deviations, and how many say `ok`.

python -m tests.long.impulse_deviations [RECORDS]     40 impulses each; a line for plant and operator
"""

from __future__ import annotations

import copy
import sys
from pathlib import Path

import numpy as np

import obsdesign
from tests.runtime.impulsive_input.test_residuals import TWO, scores

EXAMPLE = Path(__file__).parents[2] / "examples" / "luteinizing_hormone.toml"


def main() -> None:
    records = int(sys.argv[1]) if len(sys.argv) > 1 else 6
    hormone = obsdesign.load_problem(EXAMPLE).to_dict()
    precise = copy.deepcopy(hormone)
    precise["output"]["noise_cv"] = [0.01]
    for name, body in (("hormone, 9 %", hormone), ("hormone, 1 %", precise), ("integral", TWO)):
        A = np.array(body["flow"]["A"])
        decay = np.zeros_like(A)
        decay[1, 1] = 0.1 * A[1, 1]
        for plant, wrong in (("right", 0 * A), ("decay + 10 %", decay), ("A + 10 %", 0.1 * A)):
            found = [scores(body, wrong, seed) for seed in range(records)]
            sizes = np.abs(np.concatenate([errors for errors, _ in found]))
            fine = np.array([word == "ok" for _, status in found for word in status])
            within = "  ".join(f"{k}: {np.mean(sizes <= k):.3f}" for k in (1, 2, 3))
            print(f"{name:13s} {plant:13s} {len(sizes)} impulses, within {within}  beyond 5: "
                  f"{np.sum(sizes > 5)}, of them ok: {np.sum(fine & (sizes > 5))}; "
                  f"ok: {np.sum(fine)}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
