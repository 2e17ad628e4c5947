"""Samples a period apart: plants that |(I - LC) e^(Ah)| proves and |I - LC| e^(Mz(A) h) does not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.runtime import Sample, from_design
from tests.long.periodic_plants import random_problem


def problem(A: Any, G: Any, C: Any, period: float, dwell: Any, **observer: Any) -> Any:
    n, p = len(A), len(C)
    return obsdesign.Problem(
        flow={"A": A, "disturbance": {"lower": [-0.01] * n, "upper": [0.01] * n}},
        jump={"G": G, "dwell_time": dwell},
        output={"C": C, "noise_bound": [0.01] * p, "measured": "periodic", "period": period},
        observer={"kind": "interval", **observer},
    )


def test_dead_beat_samples_need_no_strict_fall() -> None:
    plant = ([[0.5]], [[1]], [[1]], 0.1, [0.36, "inf"])
    design = obsdesign.design(problem(*plant, gains={"L": [[1]]}))
    assert obsdesign.verify(design).verdict == "proved"
    # the twin: a gain that overshoots by more than it corrects
    assert obsdesign.investigate(problem(*plant, gains={"L": [[2.1]]})).verdict != "proved"


@pytest.mark.parametrize("objective", ["feasible", "narrowest"])
def test_a_double_integrator_with_jumps(objective: str) -> None:
    plant = problem([[0, 1], [0, 0]], np.diag([1, 0.9]), [[1, 0]], 0.2, [1, 2], objective=objective)
    outcome = obsdesign.investigate(plant)
    assert outcome.verdict == "proved"
    assert obsdesign.verify(outcome.design).verdict == "proved"


def test_unstable_plants_are_rarely_undecided() -> None:
    """The first of `tests.long.periodic_plants`; of 260 plants of three seeds, ten are undecided."""
    rng = np.random.default_rng(7)
    verdicts = [obsdesign.investigate(random_problem(rng)).verdict for _ in range(10)]
    assert verdicts.count("proved") >= 9


@pytest.mark.parametrize("when", ["before", "after", "none"])
@pytest.mark.parametrize("offset", [0.0, 0.25, 0.5, 0.75, 0.99])
def test_jumps_between_samples_stay_within_what_is_claimed(when: str, offset: float) -> None:
    """G e^(A s) contracts, |G| |e^(A s)| does not: proof and runtime have to take the same map."""
    body = problem(
        [[0.4053, 1.393], [0.1991, 0.6013]], [[0.054, -0.0743], [0.3299, -0.3989]],
        [[0.6654, -0.033]], 1.0, [1.0, 1.0], form="split",
        gains={"L": [[1.5694], [1.3872]], "M": [[0], [0]]},
    ).to_dict()  # fmt: skip
    body["output"]["jump_measurement"] = when
    outcome = obsdesign.investigate(obsdesign.Problem.from_dict(body))
    if outcome.verdict != "proved":
        assert when == "none"  # a jump on every sample leaves nothing to see
        return
    evidence = {claim.id: claim.evidence for claim in outcome.claims}["sampled_stability"]
    always = np.array(evidence["always"])
    observer = from_design(outcome.design)
    state = observer.init(0.0, lower=-0.1 * always, upper=0.1 * always)
    for k in range(60):
        on_sample = offset == 0.0 and k > 0
        state, estimate = observer.step(state, Sample(float(k), y=[0.0], jump=on_sample))
        rows = [estimate]
        if offset:
            state, estimate = observer.step(state, Sample(k + offset, jump=True))
            rows.append(estimate)
        if k > 20:
            for row in rows:
                assert row.status == "ok"
                assert np.all(row.upper - row.lower <= always * (1 + 1e-9))
