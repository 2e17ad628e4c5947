"""Every shipped problem file: designed, verified, simulated, run; states stay in their bounds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import obsdesign
from obsdesign.runtime import from_design
from obsdesign.runtime.base import rows_of, run
from obsdesign.simulation import simulate

EXAMPLES = sorted((Path(__file__).parent.parent / "examples").glob("*.toml"))
BOUNDING = [path for path in EXAMPLES if obsdesign.load_problem(path).kind == "interval"]


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda p: p.stem)
def test_an_example_is_proved_and_runs(path: Path) -> None:
    problem = obsdesign.load_problem(path)
    design = obsdesign.design(problem)
    assert obsdesign.verify(design).verdict == "proved"
    record = simulate(problem.plant, rng=np.random.default_rng(2))
    observer = from_design(design)
    n = problem.plant.n
    initial = [-3.0, 3.0] * n if design.kind == "interval" else None
    state = observer.start(float(record.t[0]), initial)
    given = {letter: record.block(letter) for letter in "uw" if record.block(letter).size}
    samples = rows_of(record.t, record.block("y"), **given, jump=record.columns.get("jump"))
    estimates = list(run(observer, state, samples))
    assert len(estimates) == len(record.t)
    assert estimates[-1].status == "ok"


@pytest.mark.parametrize("disturbance", ["zero", "extreme", "random", "sine"])
@pytest.mark.parametrize("path", BOUNDING, ids=lambda p: p.stem)
def test_an_example_from_file_to_bounds(path: Path, disturbance: str) -> None:
    problem = obsdesign.load_problem(path)
    design = obsdesign.design(problem)
    assert obsdesign.verify(design, paranoid=True).verdict == "proved"
    initial = np.array([5.0, -1.0])
    record = simulate(
        problem.plant, until=25.0, step=0.02, initial=initial, disturbance=disturbance,
        rng=np.random.default_rng(1),
    )  # fmt: skip
    assert record.columns["jump"].sum() >= 2
    batch = from_design(design).run_batch(
        record.t, record.block("y"), jump=record.columns["jump"],
        lower=initial - 0.5, upper=initial + 0.5,
    )  # fmt: skip
    x = record.block("x")
    assert np.all(batch.lower <= x)
    assert np.all(x <= batch.upper)
    assert set(batch.status) == {"ok"}
    # bounds that say nothing would pass as well: after a while they are no wider than the motion
    width = (batch.upper - batch.lower)[-50:].max()
    assert width < 20.0
