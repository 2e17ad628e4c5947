"""The search for multipliers: where it ends, and the set that it searches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog

from lmi.arithmetic.arrays import Matrix
from obsdesign.problem.options import SetMembershipOptions
from obsdesign.runtime.set_membership.condensed import Condensed, condensed
from obsdesign.runtime.set_membership.model import observer_model
from obsdesign.runtime.set_membership.proposals import propose
from obsdesign.runtime.set_membership.stages import Targets, Window, window_of
from obsdesign.runtime.set_membership.tables import Tables
from tests.systems.set_membership import cases, observer_of

STEPS = SetMembershipOptions().steps


def _windows(name: str, count: int, rows: list[int]) -> list[Window]:
    """Windows of a record after some rows."""
    case = cases()[name]
    observer = observer_of(case, count)
    model = observer_model(observer.gains)
    state, windows = observer.init(0.0, lower=case.x0[0], upper=case.x0[1]), []
    for k, sample in enumerate(case.record().samples[: rows[-1] + 1]):
        state, _ = observer.step(state, sample)
        if k in rows:
            windows.append(window_of(model, Tables(model), state.start, state.stages, None))
    return windows


def _program(window: Window) -> Condensed:
    n = window.drift.shape[1]
    rows = np.vstack([-np.eye(n), np.eye(n)])
    return condensed(window, Targets(rows, np.full(2 * n, len(window) - 1)))


def _values(program: Condensed, steps: int) -> Matrix:
    """Upper bounds by the proposed multipliers, in floats."""
    count = len(program.objective)
    opposite = np.roll(np.arange(count), count // 2)
    strips = (program.H, program.residual, program.V)
    mu = propose(strips, program.objective, opposite, steps)
    added = np.abs(program.objective - mu @ program.H).sum(axis=1)
    return added + mu @ program.residual + np.abs(mu) @ program.V


def _optimum(program: Condensed, g: Matrix) -> float:
    H = program.H
    scale = np.abs(H).sum(axis=1) + program.V
    size = np.abs(g).sum()
    sides = np.concatenate(
        [(program.residual + program.V) / scale, (program.V - program.residual) / scale]
    )
    rows = np.vstack([H, -H]) / np.concatenate([scale, scale])[:, None]
    solved = linprog(-g / size, A_ub=rows, b_ub=sides, bounds=(-1, 1), method="highs")
    assert solved.status == 0
    return float(-solved.fun * size)


@pytest.mark.parametrize(
    ("name", "count"), [("crane", 16), ("qcar", 16), ("ball", 16), ("rand4_42", 16), ("doses", 8)]
)
def test_the_search_ends_within_a_thousandth_of_the_width(name: str, count: int) -> None:
    """Of stiff plants and accurate sensors too, with the steps that are the default."""
    for window in _windows(name, count, [12, 25, 38]):
        program = _program(window)
        values = _values(program, STEPS)
        best = np.array([_optimum(program, g) for g in program.objective])
        half = len(best) // 2
        width = np.tile(best[:half] + best[half:], 2)
        slack = 1e-6 * np.abs(program.objective).sum(axis=1)  # of the linear program's solver
        assert (values >= best - slack).all()
        assert (values <= best + 1e-3 * width + slack).all()
        assert (_values(program, 50) <= values + slack).all()


@pytest.mark.parametrize(("name", "most"), [("rand4_42", 6e-4), ("crane", 8e-3)])
def test_few_steps_come_near_the_optimum(name: str, most: float) -> None:
    """The mean excess after 8 steps: twice as much with one length for state and multipliers."""
    excess = []
    for window in _windows(name, 16, [12, 25, 38]):
        program = _program(window)
        best = np.array([_optimum(program, g) for g in program.objective])
        half = len(best) // 2
        width = np.tile(best[:half] + best[half:], 2)
        excess.append((_values(program, 8) - best) / width)
    assert -1e-6 < np.mean(excess) < most


@pytest.mark.parametrize("name", ["rand4_42", "degue", "crane", "rand8_81"])
def test_generators_contain_the_box_beside_them(name: str) -> None:
    """Along every direction, the generators that were made longer for it too."""
    case = cases()[name]
    observer = observer_of(case, 4)
    model, n = observer_model(observer.gains), case.n
    tables = Tables(model)
    state = observer.init(0.0, lower=case.x0[0], upper=case.x0[1])
    for sample in case.record().samples[:3]:
        state, _ = observer.step(state, sample)
    stage = state.stages[-1]
    table, radius = tables.for_step(stage.h, stage.size), stage.radius
    window = window_of(model, tables, np.zeros((2, n)), [stage], None)
    window = replace(  # all states are measured: no generator is left out
        window, C=np.eye(n), strips=np.zeros((1, 2, n)), sampled=np.ones((1, n), dtype=bool)
    )
    rows = np.random.default_rng(2).choice([-1.0, 0.0, 1.0, 0.1], size=(200, n))
    program = condensed(window, Targets(rows, np.zeros(200, dtype=int)))
    inner = np.abs(rows @ (table.generators * radius[table.units])).sum(axis=1)
    box = np.abs(rows) @ (table.remainder @ radius)
    whole = np.abs(program.objective).sum(axis=1)
    assert (whole >= (inner + box) * (1 - 1e-12)).all()
    assert (whole <= 1.5 * (inner + box)).all()
