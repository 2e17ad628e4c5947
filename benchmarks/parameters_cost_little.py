"""One parameter, n <= 3: a certificate for it takes at most 0.5 s, its exact proof 50 ms."""

from __future__ import annotations

import sys
from functools import partial

import numpy as np

from benchmarks.cases import duration, row, seconds
from lmi.find.clock_matrix import find_clock_matrix
from lmi.parameters import AffineFamily
from lmi.prove.parameter_cells import prove_cells
from tests.lmi.parameter_examples import from_ranges

MOST_FIND, MOST_PROVE = 0.5, 0.05


def families() -> dict[str, tuple[AffineFamily, float, float]]:
    """An oscillator, a plant with two limits, and a sampled one (Briat 2013, Table 5, row 1)."""
    none, speed = np.zeros((2, 2)), np.zeros((3, 3))
    stiffness, growth = np.array([[0, 0], [-1, 0]]), np.array([[0, 0], [0, 1]])
    plant, jump = np.zeros((3, 3)), np.diag([1.0, 1.0, 0.0])
    speed[:2, :2] = np.array([[0, 1], [0, -0.1]])
    plant[1, 2], jump[2] = 0.1, np.array([-0.0757, -0.7306, -0.0006])
    oscillator = from_ranges(
        np.array([[0, 1], [-1, -0.1]]), np.diag([1, 0.8]), [(stiffness, none)], [(-0.142, 0.142)]
    )
    limits = from_ranges(
        np.array([[-1, 0.1], [0, 1.2]]), np.diag([1.2, 0.5]), [(growth, none)], [(-0.1, 0.1)]
    )
    sampled = from_ranges(plant, jump, [(speed, np.zeros((3, 3)))], [(1.0, 5.0)])
    return {
        "oscillator": (oscillator, 1.0, 3.0), "two limits": (limits, 0.1825, 0.5325),
        "sampled": (sampled, 0.001, 10.0),
    }  # fmt: skip


def main() -> bool:
    good = True
    for name, (family, low, high) in families().items():
        find, verdict = seconds(partial(find_clock_matrix, family, low, high), 3)
        prove, again = seconds(partial(prove_cells, family, low, high, verdict.evidence), 3)
        is_proved = verdict.outcome == again.outcome == "proved"
        passed = is_proved and find <= MOST_FIND and prove <= MOST_PROVE
        kind = f"uncertain {name}"
        row(f"{kind}, certificate", duration(find), "", duration(find),
            f"<= {duration(MOST_FIND)}", is_proved and find <= MOST_FIND)  # fmt: skip
        row(f"{kind}, proof", duration(prove), "", duration(prove),
            f"<= {duration(MOST_PROVE)}", is_proved and prove <= MOST_PROVE)  # fmt: skip
        good &= passed
    return good


if __name__ == "__main__":
    sys.exit(not main())
