"""An unknown input with bounds: as directions of b, and with a rate bounds of its own."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import obsdesign
from obsdesign import InputError
from obsdesign.cli.commands import cli
from obsdesign.data.simulation import simulate
from obsdesign.document import jsonable
from obsdesign.interop.frames import to_columns
from obsdesign.problem.problem import Problem
from obsdesign.runtime import Sample, from_design
from obsdesign.runtime.bounds import Bounds
from tests.long.input_bounds import violations
from tests.systems.clocks import DOSES
from tests.systems.designs import designed

# theory: 2V (1 + e^-T)/(1 - e^-T) + rate T at its least, and the linear program over all data
TWO_SAMPLES, LEAST = 0.2843, 0.2768


def filtered(**changes: Any) -> dict[str, Any]:
    """x' = -x + d, y = x + v, |v| <= .01, |d'| <= .5."""
    return {
        "name": "first order", "flow": {
            "A": [[-1.0]], "D": [[1.0]],
            "d_bounds": {"lower": [-4.0], "upper": [6.0], "rate": [0.5]} | changes,
        },
        "output": {"C": [[1.0]], "noise_bound": 0.01},
        "observer": {"kind": "set_membership", "window": 14},
    }  # fmt: skip


def observer_of(body: dict[str, Any]) -> Any:
    return from_design(designed(body))


def last(body: dict[str, Any], rows: int = 60, step: float = 0.04, **row: Any) -> Any:
    observer = observer_of(body)
    n = len(body["flow"]["A"])
    state = observer.init(0.0, lower=np.full(n, -5.0), upper=np.full(n, 5.0))
    for k in range(rows):
        state, estimate = observer.step(state, Sample(step * (k + 1), **row))
    return estimate


def test_the_bounds_of_d_are_as_narrow_as_they_can_be() -> None:
    estimate = last(filtered(), y=[0.0])
    assert estimate.status == "ok"
    width = float(np.diff(estimate.d_bounds, axis=0)[0, 0])
    assert LEAST * (1 - 1e-3) <= width <= LEAST * 1.005
    assert width < TWO_SAMPLES


def test_a_slower_input_is_known_better_and_a_free_one_not_at_all() -> None:
    slow = last(filtered(rate=[0.1]), y=[0.0]).d_bounds
    fast = last(filtered(rate=[5.0]), y=[0.0]).d_bounds
    assert np.diff(slow, axis=0) < 0.5 * LEAST
    assert np.diff(fast, axis=0) > 2 * LEAST
    still = last(filtered(rate=[0.0]), y=[0.0]).d_bounds
    assert np.diff(still, axis=0) < np.diff(slow, axis=0)
    body = filtered()
    del body["flow"]["d_bounds"]["rate"]
    design = designed(body)
    assert from_design(design).names == ("x1_lo", "x1_hi")
    assert any("a short spike of d leaves no trace" in text for text in design.warnings)
    rated = designed(filtered())
    assert not any("spike" in text for text in rated.warnings)
    assert any("The bounds of d contain" in g.statement for g in rated.guarantees)


def test_the_declared_bounds_hold_where_nothing_is_measured() -> None:
    estimate = last(filtered())
    assert estimate.d_bounds.ravel() == pytest.approx([-4.0, 6.0], abs=1e-9)
    tight = last(filtered(lower=[-0.05], upper=[0.05]), y=[0.0])
    assert (np.abs(tight.d_bounds) <= 0.05 + 1e-12).all()


@pytest.mark.parametrize("seed", range(12))
def test_the_truth_is_inside(seed: int) -> None:
    """Slopes at their extremes, noise at its ends, jumps; `tests.long.input_bounds` runs more."""
    assert violations(seed) == 0


def test_an_input_that_is_faster_than_stated_is_caught() -> None:
    """The twin: with a fifth of the true rate the truth leaves, or the bounds cross."""
    assert sum(violations(seed, stated=0.2) > 0 for seed in range(12)) >= 4


# (A, directions, width of the box that the state stays in for ever), of the theory's table
DIRECTIONS = [
    ([[-0.5, 0.2], [0.3, -0.4]], [[1], [-1]], [2.857, 2.857]),
    ([[0, 1], [-2, -3]], [[1], [-1]], [2.0, 2.0]),
    ([[-1, 1, 0], [0, -2, 1], [0, 0, -3]], [[1, 0], [-1, 1], [0, -1]], [1.667, 1.667, 0.667]),
]


@pytest.mark.parametrize("form", ["d_bounds", "disturbance_matrix"])
@pytest.mark.parametrize(("A", "columns", "widths"), DIRECTIONS)
def test_directions_are_used_as_they_are(A: Any, columns: Any, widths: Any, form: str) -> None:
    """With useless samples the bounds come to the box of the reachable set, exactly."""
    n, q = np.shape(columns)
    ends = {"lower": [-1.0] * q, "upper": [1.0] * q}
    flow = {"A": A} | (
        {"D": columns, "d_bounds": ends} if form == "d_bounds"
        else {"disturbance_matrix": columns, "disturbance": ends}
    )  # fmt: skip
    body = {
        "name": "directions", "flow": flow, "output": {"C": np.eye(n).tolist(), "noise_bound": 1e3},
        "observer": {"kind": "set_membership", "window": 40},
    }  # fmt: skip
    estimate = last(body, 60, 1.2, y=np.zeros(n))
    width = estimate.upper - estimate.lower
    assert width == pytest.approx(widths, rel=1e-3)


def test_events_have_directions_too() -> None:
    """c = W w of an event: narrower than the box around it, and the state stays inside."""
    body = copy.deepcopy(DOSES)
    event, W = body["event"][1], [[1], [-1], [0.5]]
    event |= {
        "disturbance_matrix": W,
        "disturbance": {"lower": [-2], "upper": [3]},
        "every": [2, 4],
    }
    boxed = copy.deepcopy(body)
    del boxed["event"][1]["disturbance_matrix"]
    boxed["event"][1]["disturbance"] = {"lower": [-2, -3, -1], "upper": [3, 2, 1.5]}
    run = simulate(Problem.from_dict(body).plant, until=30.0, rng=np.random.default_rng(1))
    assert run.happened is not None
    widths = []
    for one in (body, boxed):
        one["observer"] |= {"window": 8}
        observer = observer_of(one)
        state, sizes = observer.init(0.0, lower=np.full(3, -2.0), upper=np.full(3, 2.0)), []
        for k, t in enumerate(run.t):
            events = tuple(np.flatnonzero(run.happened[k]).tolist())
            y, w = run.block("y")[k], run.block("w")[k]
            row = Sample(t, y, w=w, jump=bool(events), events=events)
            state, estimate = observer.step(state, row)
            x = run.block("x")[k]
            assert ((estimate.lower <= x) & (x <= estimate.upper)).all()
            sizes.append(estimate.upper - estimate.lower)
        widths.append(np.mean(sizes, axis=0))
    assert (widths[0] < 0.95 * widths[1]).any()
    assert (widths[0] <= widths[1] * 1.001).all()


def test_events_and_sensors_on_their_own_clocks_bound_an_input_too() -> None:
    body = copy.deepcopy(DOSES)
    body["flow"] |= {
        "D": [[0], [1], [0]], "d_bounds": {"lower": [-1], "upper": [2], "rate": [0.05]},
    }  # fmt: skip
    body["sensor"][0]["every"] = [0.5, 1]
    body["observer"] |= {"window": 8, "steps": 5, "directions": [[1, 1, 1]], "fixed_lag": 3}
    observer = observer_of(body)
    run = simulate(Problem.from_dict(body).plant, until=30.0, rng=np.random.default_rng(3))
    assert run.happened is not None
    batch = observer.run_batch(
        run.t, run.block("y"), w=run.block("w"), jump=run.happened,
        lower=np.full(3, -2.0), upper=np.full(3, 2.0),
    )  # fmt: skip
    x, d = run.block("x"), run.block("d")
    assert set(batch.status) == {"ok"}
    assert ((batch.lower <= x) & (x <= batch.upper)).all()
    assert ((batch.d_bounds[:, 0] <= d) & (d <= batch.d_bounds[:, 1])).all()
    assert np.diff(batch.d_bounds[-1], axis=0) < 1.5
    assert tuple(to_columns(batch)) == ("t", *observer.names, "status")


# --- interval, other kinds ------------------------------------------------------------------------


def two_tanks(**flow: Any) -> dict[str, Any]:
    return {
        "name": "two tanks", "flow": {"A": [[-0.6, 0.1], [0.5, -0.4]], **flow},
        "output": {"C": [[0, 1]], "noise_bound": 0.02}, "observer": {"kind": "interval"},
    }  # fmt: skip


def test_an_interval_observer_takes_d_along_its_columns() -> None:
    bounded = two_tanks(
        D=[[1], [-2]], d_bounds={"lower": [-0.5], "upper": [0.25], "rate": [1.0]},
        disturbance={"lower": [0, -1], "upper": [0.5, 1]},
    )  # fmt: skip
    boxed = two_tanks(disturbance={"lower": [-0.5, -1.5], "upper": [0.75, 2]})
    own, other = (designed(body) for body in (bounded, boxed))
    assert all(claim.verdict == "proved" for claim in own.claims)
    assert own.gains["disturbance_matrix"].tolist() == [[1, 0, 1], [0, 1, -2]]
    always, of_box = (
        np.array(claim.evidence["always"])
        for design in (own, other) for claim in design.claims if claim.id == "width"
    )  # fmt: skip
    assert (always <= of_box * (1 + 1e-9)).all()
    # bounds of a row are of b alone, and say nothing of b + D d
    free = copy.deepcopy(bounded)
    del free["flow"]["d_bounds"]
    with pytest.raises(InputError, match=r"Give bounds as flow\.d_bounds"):
        designed(free)


def test_columns_of_b_do_not_narrow_what_d_adds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    body = two_tanks(D=[[1], [0]], d_bounds={"lower": [-0.5], "upper": [0.5]})
    designed(body).save("d.json")
    for name, ends in (("a", ""), ("b", ",0,0")):
        titles = "t,y1" + (",b1_lo,b1_hi" if ends else "")
        rows = "\n".join(f"{0.1 * k:.1f},0{ends}" for k in range(9))
        Path(f"{name}.csv").write_text(f"{titles}\n{rows}\n")
        arguments = ["run", "d.json", f"{name}.csv", "--initial=-1,1,-1,1", "-o", f"{name}e.csv"]
        done = CliRunner().invoke(cli, arguments, standalone_mode=False)
        assert done.exception is None
    assert "b1_lo, b1_hi are not used" in done.stderr
    assert Path("ae.csv").read_text() == Path("be.csv").read_text()


def test_an_observer_of_d_needs_no_bounds_and_keeps_its_gains() -> None:
    body = obsdesign.load_problem(
        Path(__file__).parents[3] / "examples" / "ahn_1.toml"
    ).to_dict()  # fmt: skip
    plain = designed(body)
    body["flow"]["d_bounds"] = {"lower": [1.0, -1.0], "upper": [3.0, 1.0]}
    own = designed(body)
    assert jsonable(own.gains) == jsonable(plain.gains)


# --- files, refusals ------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["random", "sine", "extreme", "zero"])
@pytest.mark.parametrize("rate", [None, 0.3])
def test_simulations_keep_the_bounds(kind: str, rate: float | None) -> None:
    body = filtered(lower=[-1.0], upper=[3.0], rate=[rate])
    if rate is None:
        del body["flow"]["d_bounds"]["rate"]
    run = simulate(Problem.from_dict(body).plant, until=20.0, step=0.05, disturbance=kind,
                   rng=np.random.default_rng(2))  # fmt: skip
    d = run.block("d")[:, 0]
    assert (d.min() >= -1.0) & (d.max() <= 3.0)
    if rate is not None:
        assert (np.abs(np.diff(d)) <= rate * np.diff(run.t) * (1 + 1e-9)).all()
    assert (d.max() > d.min()) == (kind in ("random", "sine"))


def test_every_command_knows_bounds_of_d(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    body = filtered()
    body["jump"] = {"E": [[1.0]], "dwell_time": [0.5, 2.0]}
    Path("p.json").write_text(json.dumps(body), encoding="utf-8")
    start = "--initial=-2,2"
    for arguments in (
        ["check", "p.json", "--time", "5"], ["design", "p.json", "-o", "d.json"],
        ["verify", "d.json"], ["simulate", "d.json", "--until", "3", "--step", "0.04",
                               "-o", "a.csv"],
        ["run", "d.json", "a.csv", start, "-o", "e.csv", "--strict"],
        ["plot", "e.csv", "a.csv", "--design", "d.json", "-o", "e.svg"],
        ["report", "d.json", "--data", "a.csv", start, "-o", "r.html"],
        ["compare", "p.json", "--data", "a.csv", "--kinds", "set_membership", "--time", "5"],
        ["export", "d.json", "-o", "r.mat"],
        ["sweep", "p.json", "--over", "flow.d_bounds.rate[0]=0.1:0.3:2", "-o", "s.jsonl"],
    ):  # fmt: skip
        done = CliRunner().invoke(cli, arguments)
        assert done.exit_code == 0, (arguments, done.output)
    lines = Path("e.csv").read_text().splitlines()
    assert lines[0] == "t,x1_lo,x1_hi,d1_lo,d1_hi,status"
    data = Path("a.csv").read_text().splitlines()
    k = data[0].split(",").index("d1")
    for line, row in zip(lines[1:], data[1:], strict=True):
        low, high = map(float, line.split(",")[3:5])
        assert low <= float(row.split(",")[k]) <= high
    for part, rows in (("one", data[1:30]), ("two", data[30:])):
        Path(f"{part}.csv").write_text("\n".join([data[0], *rows]) + "\n")
        own = [start] if part == "one" else []
        CliRunner().invoke(cli, ["run", "d.json", f"{part}.csv", *own, "--state", "s.json",
                                 "-o", f"{part}e.csv"], standalone_mode=False)  # fmt: skip
    parts = [Path(f"{part}e.csv").read_text().splitlines()[1:] for part in ("one", "two")]
    assert [*parts[0], *parts[1]] == lines[1:]


def test_changed_bounds_of_d_are_refuted() -> None:
    design = designed(filtered())
    for name in ("d_lower", "d_upper", "d_rate", "D"):
        value = np.asarray(design.gains[name]) * 0.9
        changed = obsdesign.workflow.verify(_with(design, name, value.tolist()))
        assert changed.verdict == "refuted"
        with pytest.raises(InputError, match=f"gains.{name} differs from problem"):
            from_design(_with(design, name, value.tolist()))


def _with(design: Any, name: str, value: Any) -> Any:
    from dataclasses import replace

    return replace(design, gains={**design.gains, name: value})


@pytest.mark.parametrize(
    ("own", "words"),
    [
        ({"upper": [-9.0]}, r"flow.d_bounds: lower must not exceed upper"),
        ({"lower": [1.0, 2.0]}, r"flow.d_bounds.lower must have"),
        ({"rate": [-1.0]}, r"flow.d_bounds.rate must have 1 numbers >= 0"),
        ({"rate": [1.0, 1.0]}, r"flow.d_bounds.rate must have 1 numbers >= 0"),
        ({"speed": [1.0]}, "unknown key 'speed'"),
        ({"lower": "low"}, "flow.d_bounds.lower must be"),
    ],
)
def test_bounds_that_are_none_are_refused(own: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        Problem.from_dict(filtered(**own))


def test_bounds_without_an_input_are_refused() -> None:
    body = filtered()
    del body["flow"]["D"]
    with pytest.raises(InputError, match=r"flow.d_bounds requires flow.D"):
        Problem.from_dict(body)
    del body["flow"]["d_bounds"]
    Problem.from_dict(body)


def test_bounds_of_a_row_are_of_b_and_v() -> None:
    body = filtered()
    body["flow"]["disturbance"] = {"lower": [-1.0], "upper": [1.0]}
    wide = last(body, y=[0.0])
    narrow = last(body, y=[0.0], bounds=Bounds(b=([0.0], [0.0])))
    assert np.diff(narrow.d_bounds, axis=0) < 0.5 * np.diff(wide.d_bounds, axis=0)
    with pytest.raises(ValueError, match="b1_hi must be within"):
        last(body, y=[0.0], bounds=Bounds(b=([0.0], [2.0])))


@pytest.mark.parametrize("when", ["none", "before"])
def test_clocks_are_those_of_the_plant_with_and_without_a_rate(when: str) -> None:
    """A jump hides the sample that is due there, changes no faster than stated, and so on."""
    statuses = []
    for rate in ({}, {"rate": [0.5]}):
        body = filtered()
        body["flow"]["d_bounds"] = {"lower": [-4.0], "upper": [6.0], **rate}
        body["output"] |= {"period": 0.5, "measured": "periodic", "jump_measurement": when}
        body["jump"] = {"G": [[1.0]], "dwell_time": [0.5, 2.0], "dwell_jitter": 0.25}
        observer = observer_of(body)
        state = observer.init(0.0, lower=[-40.0], upper=[40.0])
        listed = []
        # (time, is it sampled, does it jump)
        for t, has_y, jump in (
            (0.0, True, False), (0.5, when == "before", True), (1.0, True, False),
            (1.25, False, True), (1.5, True, True), (2.0, False, False), (3.0, True, True),
        ):  # fmt: skip
            y = np.array([0.0]) if has_y else None
            state, estimate = observer.step(state, Sample(t, y, jump=jump))
            listed.append(estimate.status)
        statuses.append(listed)
    assert statuses[0] == statuses[1]
    assert statuses[0][:3] == ["ok"] * 3
    assert "dwell time 0.25 below 0.5" in statuses[0][4]
    assert "missing sample" in statuses[0][5]
    assert "of the dwell time above" in statuses[0][6]
