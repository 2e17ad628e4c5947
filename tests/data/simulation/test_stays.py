"""Simulated stays in modes, and the events within them."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from obsdesign.data.simulation import simulate
from obsdesign.errors import InputError
from tests.systems.switched import random_switched, valve


@pytest.mark.parametrize("dwell", ["random", "shortest"])
def test_stays_and_successors_are_those_of_the_problem(dwell: str) -> None:
    for seed in range(4):
        rng = np.random.default_rng(seed)
        plant = random_switched(rng, "interval").plant
        run = simulate(plant, until=60, step=0.25, dwell=dwell, rng=rng)
        modes, names = {mode.name: mode for mode in plant.modes}, run.mode or []
        changes = [0, *(k for k in range(1, len(names)) if names[k] != names[k - 1])]
        assert len(changes) > 5
        for a, b in itertools.pairwise(changes):
            low, high = modes[names[a]].every
            stay = run.t[b] - run.t[a]
            assert low - 1e-9 <= stay <= high + 1e-9
            assert dwell == "random" or stay == pytest.approx(low)
            allowed = modes[names[a]].next
            assert allowed is None or names[b] in allowed


def test_the_state_follows_the_flow_of_its_mode() -> None:
    plant = valve().plant
    run = simulate(plant, until=60, step=0.01, disturbance="zero")
    x, names = run.block("x"), run.mode or []
    for k in range(0, len(run.t) - 1, 97):
        A = plant.modes[0 if names[k] == "open" else 1].A
        h = run.t[k + 1] - run.t[k]
        np.testing.assert_allclose(x[k + 1] - x[k], h * (A @ x[k]), atol=3e-4 * np.abs(x[k]).max())


def test_dwell_of_modes_is_a_word() -> None:
    with pytest.raises(InputError, match="dwell must be random or shortest for modes"):
        simulate(valve().plant, dwell=2.0)


@pytest.mark.parametrize("dwell", ["random", "shortest"])
def test_events_come_in_their_modes_alone(dwell: str) -> None:
    plant = valve(strokes=True).plant
    for seed in range(4):
        run = simulate(plant, until=200, step=0.5, dwell=dwell, rng=np.random.default_rng(seed))
        assert run.happened is not None
        rows = np.flatnonzero(run.happened[:, 0])
        assert len(rows) > 5
        assert (np.diff(run.t[rows]) >= 5 - 1e-9).all()
        # the mode before a row is that of its events
        assert {(run.mode or [])[k - 1] for k in rows} == {"open"}
