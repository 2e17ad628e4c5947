"""Random plants with parameters never contradict a verdict: a sample of the long script."""

from __future__ import annotations

import numpy as np

from lmi.decide.uncertain_stability import decide_uncertain
from tests.lmi.parameter_examples import oscillator
from tests.long.random_parameters import contradiction, largest_ratio, replayed


def test_no_plant_contradicts_its_verdict() -> None:
    answers = [contradiction(seed) for seed in range(8)]
    assert [what for _, what in answers] == [""] * 8
    assert {"proved", "refuted"} <= {verdict for verdict, _ in answers}


def test_the_check_sees_a_form_that_grows() -> None:
    """The twin: the certificate of a narrow range, held against a wide one."""
    narrow = decide_uncertain(oscillator(0.1), 1.0, 3.0).evidence
    rng = np.random.default_rng(0)
    assert largest_ratio(oscillator(0.1), (1.0, 3.0), narrow, rng) < 1
    assert largest_ratio(oscillator(0.8), (1.0, 3.0), narrow, rng) > 1.1
    witness = decide_uncertain(oscillator(0.21), 1.0, 3.0).witness
    assert replayed(oscillator(0.21), witness) > 1
    assert replayed(oscillator(0.05), witness) < 1
