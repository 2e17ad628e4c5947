"""Every shipped problem file: designed, verified, simulated, run; states stay in their bounds."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.cli.summary import show_summary
from obsdesign.data.simulation import simulate
from obsdesign.kinds import GIVING_BOUNDS
from obsdesign.problem.options import ImpulsiveOptions, SetMembershipOptions
from obsdesign.runtime import from_design
from obsdesign.runtime.base import rows_of
from obsdesign.studies.typical import with_typical
from tests.systems.designs import investigated_file, paranoid_verdict
from tests.systems.impulsive_input import record

EXAMPLES = sorted((Path(__file__).parent.parent / "examples").glob("*.toml"))


KIND = {path: obsdesign.load_problem(path).kind for path in EXAMPLES}


def of_kind(kind: str) -> list[Path]:
    return [path for path in EXAMPLES if KIND[path] == kind]


@pytest.mark.parametrize(
    "path",
    [path for path in EXAMPLES if path not in of_kind("impulsive_input")],  # rows come late: there
    ids=lambda p: p.stem,
)
def test_an_example_is_proved_and_runs(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    problem = obsdesign.load_problem(path)
    outcome = investigated_file(path)
    design = outcome.design
    assert design is not None
    show_summary(with_typical(outcome), problem.name)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= 13  # two more say what was written and what is next
    assert "PROVED" in lines[0]
    assert not any("Theorem" in line for line in lines[1:])
    assert len([line for line in lines if line.startswith("x")]) == problem.plant.n
    assert obsdesign.verify(design).verdict == "proved"
    record = simulate(problem.plant, rng=np.random.default_rng(2))
    observer = from_design(design)
    x = record.block("x")[0]
    bounds = np.column_stack([x - 3.0, x + 2.0]).ravel().tolist()
    initial = bounds if design.kind in GIVING_BOUNDS else None
    state = observer.start(float(record.t[0]), initial)
    given = {letter: record.block(letter) for letter in "uw" if record.block(letter).size}
    jump = record.happened
    if jump is not None and len(problem.plant.events) == 1:
        jump = jump[:, 0]
    samples = rows_of(record.t, record.block("y"), **given, jump=jump, mode=record.mode)
    estimates = list(observer.run(state, samples))
    assert len(estimates) == len(record.t)
    assert estimates[-1].status == "ok"


@pytest.mark.parametrize("name", ["mattsson_medvedev_open", "mattsson_medvedev_threshold"])
def test_an_example_of_impulses_is_proved_and_finds_them(name: str) -> None:
    problem = obsdesign.load_problem(EXAMPLES[0].parent / f"{name}.toml")
    design, plant = obsdesign.design(problem), problem.plant
    assert obsdesign.verify(design).verdict == "proved"
    t, train = np.round(0.01 * np.arange(11001), 10), ((25.005, 5.0), (70.123, -2.5))
    y = record(plant.flow.A, problem.require("jump.H"), train, t, np.zeros(3)) @ plant.output.C.T
    std = plant.output.noise_std
    y = y + std * np.random.default_rng(3).standard_normal(y.shape)
    events = from_design(design).run_batch(t, y).events
    assert [event.status for event in events] == ["ok", "ok"]
    for event, (time, weight) in zip(events, train, strict=True):
        assert abs(event.t - time) < (4 * event.t_std if std.any() else 1e-4)
        assert event.weights[0] == pytest.approx(weight, rel=0.02 if std.any() else 1e-4)


PLANTS = {path: obsdesign.load_problem(path).plant for path in of_kind("interval")}
ONE_CLOCK = [path for path, plant in PLANTS.items() if plant.has_one_clock and not plant.modes]
SEVERAL_CLOCKS = [path for path, plant in PLANTS.items() if not plant.has_one_clock]


@pytest.mark.parametrize("disturbance", ["extreme", "random"])
@pytest.mark.parametrize("path", SEVERAL_CLOCKS, ids=lambda p: p.stem)
def test_an_example_of_several_clocks_keeps_its_certified_width(
    path: Path, disturbance: str
) -> None:
    problem = obsdesign.load_problem(path)
    outcome = investigated_file(path)
    assert outcome.verdict == "proved"
    widths = np.array([row["width"] for row in outcome.result["states"]])
    until = 10.0 if problem.name.startswith("motor") else 60.0
    record = simulate(
        problem.plant, until=until, disturbance=disturbance, rng=np.random.default_rng(1)
    )
    x, observer = record.block("x"), from_design(outcome.design)
    start = np.column_stack([x[0] - 0.4 * widths, x[0] + 0.4 * widths]).ravel()
    given = {letter: record.block(letter) for letter in "uw" if record.block(letter).size}
    samples = rows_of(record.t, record.block("y"), **given, jump=record.happened)
    rows = list(observer.run(observer.start(record.t[0], start.tolist()), samples))
    assert {row.status for row in rows} == {"ok"}
    low, high = (np.array([getattr(row, end) for row in rows]) for end in ("lower", "upper"))
    assert ((low <= x) & (x <= high)).all()
    late = record.t > until / 2
    for event in problem.plant.events:  # an event may have happened or not: no width is claimed
        assert record.happened is not None
        stamps = record.t[record.happened.any(axis=1)]
        late &= np.abs(record.t[:, None] - stamps).min(axis=1) > event.stamp_error * (1 + 1e-6)
    assert ((high - low)[late] <= widths * (1 + 1e-9)).all()
    assert late.sum() > 2


@pytest.mark.parametrize("disturbance", ["zero", "extreme", "random", "sine"])
@pytest.mark.parametrize("path", ONE_CLOCK, ids=lambda p: p.stem)
def test_an_example_from_file_to_bounds(path: Path, disturbance: str) -> None:
    problem, design = obsdesign.load_problem(path), investigated_file(path).design
    assert design is not None
    assert paranoid_verdict(path) == "proved"
    initial, box = np.resize([5.0, -1.0], problem.plant.n), problem.plant.state
    if box is not None:
        initial = 0.6 * box.lower + 0.4 * box.upper
    step = 0.02 if problem.plant.output.measured == "continuous" else None
    record = simulate(
        problem.plant, until=25.0, step=step, initial=initial, disturbance=disturbance,
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


@pytest.mark.parametrize("disturbance", ["extreme", "random"])
@pytest.mark.parametrize("path", of_kind("set_membership"), ids=lambda p: p.stem)
def test_an_example_of_tight_bounds_keeps_its_certified_width(path: Path, disturbance: str) -> None:
    problem = obsdesign.load_problem(path)
    plant = problem.plant
    outcome = investigated_file(path)
    states = outcome.result["states"]
    assert all(row["best"] <= row["width"] <= 1.2 * row["best"] for row in states)
    record = simulate(
        plant, until=5.0, dwell="shortest", disturbance=disturbance, rng=np.random.default_rng(1)
    )
    x, observer = record.block("x"), from_design(outcome.design)
    state = observer.start(record.t[0], np.column_stack([x[0] - 1, x[0] + 2]).ravel())
    samples = rows_of(record.t, record.block("y"), record.block("u"), jump=record.columns["jump"])
    rows = list(observer.run(state, samples))
    assert {row.status for row in rows} == {"ok"}
    low, high = (np.array([getattr(row, end) for row in rows]) for end in ("lower", "upper"))
    assert ((low <= x) & (x <= high)).all()
    along = x @ np.transpose(problem.options_as(SetMembershipOptions).directions)
    ends = np.array([row.directions for row in rows])
    assert ((ends[:, 0] <= along) & (along <= ends[:, 1])).all()
    certified = [row["width"] for row in states]
    assert ((high - low)[-20:] <= np.multiply(certified, 1 + 1e-6)).all()


def script(name: str) -> Any:
    path = Path(__file__).parent.parent / "examples" / f"{name}.py"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_ball_bounces_inside_its_bounds(tmp_path: Path, capsys: Any) -> None:
    ball = script("bouncing_ball")
    t, p, v, impact = ball.flight(np.random.default_rng(4))
    # it stays above the floor, meets it only at impacts, and the record ends before they pile up
    assert p.min() >= 0.0
    assert np.all((p == 0.0) == (impact == 1))
    assert np.all(np.diff(t[impact == 1]) >= 2 * ball.SAMPLE)
    assert np.all(v[impact == 1] > 0)
    ball.main(str(tmp_path))
    assert "inside the bounds: True" in capsys.readouterr().out
    assert (tmp_path / "ball.png").stat().st_size > 10_000


def test_cut_bounds_are_below_the_widths_of_either_gains(tmp_path: Path) -> None:
    examples = script("narrowest_bounds")
    means = examples.compared(tmp_path / "a.png")
    # 0.6408 and 0.4621 without the cut, for a continuous y
    assert means["gains of the paper"] == pytest.approx(0.436, abs=1e-3)
    assert means["narrowest"] == pytest.approx(0.436, abs=1e-3)
    assert examples.doses(tmp_path / "b.png")


@pytest.mark.parametrize("path", of_kind("impulsive"), ids=lambda p: p.stem)
def test_an_impulsive_example_from_file_to_estimates(path: Path) -> None:
    problem, design = obsdesign.load_problem(path), investigated_file(path).design
    assert design is not None
    assert paranoid_verdict(path) == "proved"
    until = 60 * float(np.mean(problem.require_dwell_time()))
    record = simulate(problem.plant, until=until, step=until / 400, rng=np.random.default_rng(1))
    observer: Any = from_design(design)
    batch = observer.run_batch(
        record.t, record.block("y"), record.block("u"), np.nan_to_num(record.block("w")),
        record.columns["jump"],
    )  # fmt: skip
    assert set(batch.status) == {"ok"}
    error = np.abs(batch.x - record.block("x"))
    late = error[len(error) // 2 :]
    if np.any(problem.plant.output.noise_std):
        target = np.array(problem.options_as(ImpulsiveOptions).noise_target)
        impulses = record.columns["jump"][len(error) // 2 :] == 1
        assert np.all(np.sqrt(np.mean(late[impulses] ** 2, axis=0)) < 1.5 * target)
    else:
        assert late.max() < 1e-6 * max(1.0, np.abs(record.block("x")).max())


@pytest.mark.parametrize("path", of_kind("finite_time"), ids=lambda p: p.stem)
def test_a_finite_time_example_from_file_to_estimate(path: Path) -> None:
    problem, design = obsdesign.load_problem(path), investigated_file(path).design
    assert design is not None
    assert paranoid_verdict(path) == "proved"
    record = simulate(problem.plant, until=25.0, rng=np.random.default_rng(1))
    batch = from_design(design).run_batch(record.t, record.block("y"), record.block("u"))
    full = np.array([status == "ok" for status in batch.status])
    factor = {claim.id: claim for claim in design.claims}["error_identity"].evidence["factor"]
    x = record.block("x")
    error = np.linalg.norm(batch.x - x, axis=1)[full]
    assert full.sum() > 300
    assert error.max() <= factor * np.linalg.norm(x, axis=1).max()
