"""Widths that one P does not bound: windows of dwell times, and dwell times that change slowly."""

from __future__ import annotations

import numpy as np
import pytest

import obsdesign


def problem(A: list, G: list, jitter: float = np.inf, **options: object) -> obsdesign.Problem:
    zeros = np.zeros((len(A), 1)).tolist()
    return obsdesign.Problem(
        flow={"A": A},
        jump={"G": G, "dwell_time": [0.1, 2.0], "dwell_jitter": jitter},
        output={"C": [[1.0] + [0.0] * (len(A) - 1)], "noise_bound": 0},
        observer={"kind": "interval", "gains": {"L": zeros, "M": zeros}, **options},
    )


# neither one P nor one vector bounds this one
NARROW = (
    [[-0.5, 1.28, 0.26], [0.23, -0.03, 1.71], [0.4, 0.0, -2.93]],
    [[0.0, 0.0, 0.0], [0.0, 0.011, 0.715], [0.219, 0.54, 0.0]],
)
# constant dwell times are stable, some that change quickly are not
SLOW = (
    [[0.42, 0.0, 0.0], [0.0, -1.23, 0.35], [1.58, 0.0, -1.27]],
    [[0.0, 0.511, 0.0], [0.535, 0.0, 0.441], [0.751, 0.199, 0.685]],
)


def test_windows_bound_the_width() -> None:
    design = obsdesign.design(problem(*NARROW))
    claim = next(c for c in design.claims if c.id == "dwell_stability")
    assert "windows" in claim.evidence
    assert "window" in claim.source
    assert obsdesign.verify(design, paranoid=True).verdict == "proved"
    assert obsdesign.investigate(problem(*NARROW, memory=0)).verdict == "undecided"


def test_slow_changes_bound_the_width_where_quick_ones_do_not() -> None:
    quick = obsdesign.investigate(problem(*SLOW, form="split"))
    assert quick.verdict == "refuted"
    slow = obsdesign.investigate(problem(*SLOW, jitter=0.2, form="split"))
    assert slow.verdict == "proved"
    claim = next(c for c in slow.claims if c.id == "dwell_stability")
    assert "[0.1, 2.0] that change by at most 0.2 from one to the next" in claim.statement


@pytest.mark.parametrize("memory", [0, 1, "auto"])
def test_memory_never_costs_a_proof(memory: object) -> None:
    outcome = obsdesign.investigate(problem([[-1.0]], [[0.9]], memory=memory))
    assert outcome.verdict == "proved"
