"""A fixed sample of tests/long/random_interval_forms.py: bounds hold, proved widths are not exceeded."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from obsdesign.data.simulation import simulate
from obsdesign.equations.estimation_error import flow_error_matrix, jump_error_matrix
from obsdesign.runtime.interval.observer import IntervalObserver
from tests.systems.interval import FORMS, ROUNDING, trial
from tests.systems.interval_runs import SIMULATION_ROUNDING, execute, random_observer, random_plant


@pytest.mark.parametrize("form", FORMS)
def test_random_plants_keep_what_was_proved(form: str) -> None:
    trials = [trial(form, seed) for seed in range(2)]
    assert max(each.beyond for each in trials) <= ROUNDING
    assert any(each.verdict == "proved" for each in trials)
    widths = [each.wider for each in trials if each.wider is not None]
    assert widths
    assert max(widths) <= ROUNDING


@pytest.mark.parametrize("has_T", [False, True])
def test_splits_of_the_wrong_sign_keep_the_bounds(has_T: bool) -> None:
    """A design whose claims of sign are refuted may run (`--allow-undecided`): bounds hold."""
    has_wrong_sign = False
    for seed in range(12):
        rng = np.random.default_rng([seed, has_T])
        plant = random_plant(rng)
        gains = random_observer(plant, rng).gains
        assert plant.jump is not None
        C, when = plant.output.C, plant.output.jump_measurement
        F = flow_error_matrix(plant.flow.A, gains.L, C)
        H = jump_error_matrix(plant.jump.G, gains.M, C, when)
        zero = np.zeros_like(F)
        # what `cooperative` stores: the matrices themselves, nonnegative or not
        gains = replace(gains, D0=F, D1=zero, Gp=H, Gn=zero)
        if has_T:
            gains = replace(
                gains, form="two_coordinates", S=np.eye(plant.n), S2=np.eye(plant.n), T=H
            )
        has_wrong_sign |= bool((H < 0).any())
        initial = rng.standard_normal(plant.n)
        record = simulate(plant, until=1.0, step=0.05, initial=initial, rng=rng)
        run = execute(IntervalObserver(gains), record, initial, rng, 0.1)
        assert (run.lower <= run.upper).all()
        assert run.violation() <= SIMULATION_ROUNDING
    assert has_wrong_sign
