"""Set-membership bounds for plants with parameters: they hold, and shrink with the box."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

import obsdesign
from lmi.arithmetic.arrays import Matrix
from obsdesign.data.simulation import Simulation, simulate
from obsdesign.data.simulation.parameter_courses import COURSES
from obsdesign.equations.set_membership.effects import factored
from obsdesign.errors import DoesNotApply, InputError
from obsdesign.problem.problem import Problem
from obsdesign.runtime import from_design
from obsdesign.runtime.columns import Batch
from obsdesign.runtime.set_membership.stages import Stage
from obsdesign.runtime.set_membership.uncertain_observer import UncertainSetMembershipObserver
from tests.systems.designs import designed
from tests.systems.parameters import Body, compartments, degue, rooms, spring


def _of_kind(body: Body, window: int = 6) -> Body:
    return {**copy.deepcopy(body), "observer": {"kind": "set_membership", "window": window}}


def random_plant(seed: int) -> Body:
    """Two or three states, parameters on every matrix, measured in any way."""
    rng = np.random.default_rng([seed, 7])
    n = int(rng.integers(2, 4))
    drawn: Any = lambda *shape: rng.uniform(-1, 1, shape).round(3).tolist()  # noqa: E731
    body: Body = {
        "flow": {
            "A": (rng.uniform(-1, 1, (n, n)) - 0.7 * np.eye(n)).round(3).tolist(),
            "B": drawn(n, 1),
            "disturbance": {"lower": [-0.05] * n, "upper": [0.1] * n},
        },
        "jump": {
            "G": (0.8 * rng.uniform(-1, 1, (n, n))).round(3).tolist(), "E": drawn(n, 1),
            "disturbance": {"lower": [-0.1] * n, "upper": [0.1] * n}, "dwell_time": [0.3, 1.5],
        },
        "output": {
            "C": drawn(1, n), "noise_bound": [0.02],
            "jump_measurement": str(rng.choice(["before", "after", "none"])),
        },
        "parameter": [
            {"name": "both", "range": [-0.1, 0.3], "A": drawn(n, n), "B": drawn(n, 1)},
            {"name": "kick", "range": [0.0, 0.2], "G": drawn(n, n), "E": drawn(n, 1)},
            {"name": "rank", "range": [-0.2, 0.1], "A": np.outer([1, -2, 1][:n], [1, 0.5, 2][:n])
             .tolist(), "constant": True},
            {"name": "gain", "range": [-0.05, 0.05], "C": drawn(1, n)},
        ],
    }  # fmt: skip
    if seed % 3 == 0:
        body["output"] |= {"measured": "periodic", "period": 0.2}
    return _of_kind(body, 9)


def bounded(body: Body, run: Simulation, initial: Matrix, radius: float) -> Batch:
    """Bounds of a record by a design of a problem."""
    observer = from_design(designed(body))
    blocks: dict[str, Any] = {
        letter: run.block(letter) for letter in ("u", "w") if run.block(letter).shape[1]
    }
    return observer.run_batch(
        run.t, run.block("y"), jump=run.columns["jump"].astype(bool), **blocks,
        lower=initial - radius, upper=initial + radius,
    )  # fmt: skip


def beyond(body: Body, truth: Body, course: str, seed: int, until: float = 3.0) -> float:
    """By how much the state of a true plant leaves the bounds of a problem, relative to it."""
    n = len(body["flow"]["A"])
    middle = np.mean(list(body["state"].values()), axis=0) if "state" in body else np.full(n, 0.3)
    run = simulate(
        Problem.from_dict(truth).plant, parameters=course, until=until, step=0.05,
        disturbance=("random", "extreme", "zero")[seed % 3], initial=middle,
        rng=np.random.default_rng(seed),
    )  # fmt: skip
    bounds, x = bounded(body, run, middle, 0.05), run.block("x")
    gap = np.maximum(bounds.lower - x, x - bounds.upper).max()
    return float(gap) / (1 + float(np.abs(x).max()))


@pytest.mark.parametrize("seed", range(6))
def test_bounds_contain_the_state_of_random_plants(seed: int) -> None:
    body = random_plant(seed)
    course = COURSES[1 + seed % 3]
    assert beyond(body, body, course, seed) <= 1e-12


@pytest.mark.parametrize("body", [spring(), rooms(), compartments(), degue(0.05)])
def test_a_parameter_beyond_its_range_leaves_the_bounds(body: Body) -> None:
    body, wide = _of_kind(body), _of_kind(body)
    assert max(beyond(body, wide, "bang-bang", seed) for seed in (0, 1)) <= 1e-12
    for parameter in wide.get("parameter", ()):
        low, high = parameter["range"]
        parameter["range"] = [low - 3 * (high - low), high + 3 * (high - low)]
    for block, key in (("flow", "A_radius"), ("jump", "G_radius")):
        if key in wide[block]:
            wide[block][key] = (10 * np.array(wide[block][key])).tolist()
    body.pop("state", None)
    assert max(beyond(body, wide, "bang-bang", seed) for seed in range(3)) > 0


def _run(body: Body) -> Simulation:
    return simulate(
        Problem.from_dict(body).plant, until=3.0, step=0.05, initial=[0.3, 0.3],
        disturbance="zero", parameters="nominal",
    )  # fmt: skip


def test_a_range_of_one_number_changes_no_bound() -> None:
    zero = _of_kind(spring(parameter=[{"name": "p", "range": [0, 0], "A": [[1, 2], [3, 4]]}]))
    plain = {key: value for key, value in zero.items() if key not in ("parameter", "state")}
    run = _run(plain)
    one, other = (bounded(each, run, np.full(2, 0.3), 0.1) for each in (zero, plain))
    assert np.array_equal(one.lower, other.lower)
    assert np.array_equal(one.upper, other.upper)


def test_bounds_grow_with_the_range_and_shrink_with_the_box() -> None:
    run, widths = _run(_of_kind(spring())), []
    for half in (0.0, 0.1, 0.2, 0.4):
        body = _of_kind(spring())
        body["parameter"][0]["range"] = [1 - half, 1 + half]
        bounds = bounded(body, run, np.full(2, 0.3), 0.1)
        widths.append((bounds.upper - bounds.lower).mean(axis=0))
    assert (np.diff(widths, axis=0) >= -1e-12).all()
    assert widths[3][1] > 1.2 * widths[0][1]
    free, small = _of_kind(rooms()), _of_kind(rooms())
    del free["state"]
    run = simulate(Problem.from_dict(free).plant, until=3.0, step=0.5, initial=[21, 21])
    sizes = [
        (bounds.upper - bounds.lower).mean(axis=0)
        for bounds in (bounded(each, run, np.full(2, 21.0), 2.9) for each in (small, free))
    ]
    assert (sizes[0] <= sizes[1]).all()
    assert sizes[0][1] < sizes[1][1]


@pytest.mark.parametrize("seed", range(4))
def test_effects_of_a_step_are_bounded_by_what_they_are(seed: int) -> None:
    """An oracle that integrates: the largest row along many courses is within the bound."""
    rng = np.random.default_rng(seed)
    body = random_plant(seed)
    observer = from_design(designed(body))
    assert isinstance(observer, UncertainSetMembershipObserver)
    effects, model, plant = observer._effects, observer._model, Problem.from_dict(body).plant
    h, u, n = 0.1, np.array([0.7]), plant.n
    box = np.array([0.5 * np.ones(n), np.ones(n)]) * model.scales
    flow, zero = model.flow, np.zeros(n)
    stage = Stage(h, h, h, False, np.concatenate([u, (flow.lower + flow.upper) / 2]), zero, zero,
                  np.append((flow.upper - flow.lower) / 2, 0)[: model.width], None, box, False)  # fmt: skip
    stage = effects.driven(stage, box)
    rows, factors = observer.gains.flow_factors.rows, observer.gains.flow_factors
    largest = np.zeros(len(rows))
    for _ in range(60):
        x, steps = rng.choice(box, 1)[0] / model.scales, 100
        x = np.where(rng.random(n) < 0.5, 0.5, 1.0)
        for _ in range(steps):
            A, B = np.array(plant.flow.A), np.array(plant.flow.B)
            for parameter in plant.parameters:
                p = rng.choice(parameter.range)
                A = A + p * parameter.effects.get("A", 0 * A)
                B = B + p * parameter.effects.get("B", 0 * B)
            b = np.where(rng.random(n) < 0.5, plant.flow.lower, plant.flow.upper)
            largest = np.maximum(largest, np.abs(rows @ np.append(x, u)))
            x = x + h / steps * (A @ x + B @ u + b)
    first = len(flow.lower) - factors.columns.shape[1]
    places = [flow.active.tolist().index(first + k) for k in range(factors.columns.shape[1])]
    stated, least = stage.radius[places], factors.of_column @ largest
    assert (least <= stated * (1 + 1e-9)).all()
    assert (stated <= 2.0 * least + 0.1).all()


def test_effects_share_columns_where_they_can() -> None:
    exchange = np.array([[-0.5, 0.5], [0.5, -0.5]])
    factors = factored([exchange, 3 * exchange, np.array([[0, 0], [1, 0.0]])], (2, 2))
    assert factors.columns.T.tolist() == [[1, -1], [0, 1]]
    assert factors.of_column.tolist() == [[1, 1, 0], [0, 0, 1]]
    plain = factored([np.array([[1.0, 2], [3, 4]])], (2, 2))
    assert plain.columns.tolist() == [[1, 0], [0, 1]]


@pytest.mark.parametrize("matrix", ["C", "G", "A"])
def test_a_parameter_on_one_matrix_alone_leaves_known_inputs_as_they_are(matrix: str) -> None:
    """Neither of a flow nor of a jump without effects."""
    body = random_plant(1)
    entry = [[0.05, -0.1]] if matrix == "C" else [[0.05, -0.1], [0.1, 0]]
    for block, key in (("flow", "A"), ("jump", "G"), ("flow", "B"), ("jump", "E")):
        body[block][key] = np.array(body[block][key])[:2, :2].tolist()
    for block in ("flow", "jump"):
        body[block]["disturbance"] = {"lower": [-0.05] * 2, "upper": [0.1] * 2}
    body["output"]["C"] = [[1, 0.5]]
    body["parameter"] = [{"name": "p", "range": [-1, 1], matrix: entry}]
    assert beyond(body, body, "bang-bang", 1) <= 1e-12


def test_claims_need_a_box_stated_or_proved() -> None:
    body = _of_kind(compartments())
    outcome = obsdesign.investigate(Problem.from_dict(body))
    assert outcome.verdict == "proved"
    assert [claim.id for claim in outcome.claims][:2] == ["consistent", "observable_window"]
    assert outcome.guarantees[0].statement.startswith("Assumed: clearance in [-0.06, 0.06]; x from")
    del body["state"]
    own = obsdesign.investigate(Problem.from_dict(body))
    assert [claim.id for claim in own.claims][:3] == [
        "consistent", "state_box", "observable_window",
    ]  # fmt: skip
    body = _of_kind(spring())  # it oscillates: no box is proved
    del body["state"]
    free = obsdesign.investigate(Problem.from_dict(body))
    assert [claim.id for claim in free.claims] == ["consistent"]
    assert "No width of the bounds is proved: [state] is not stated" in free.warnings[0]
    assert "x from" not in free.guarantees[0].statement
    assert free.design is not None
    assert obsdesign.verify(free.design).verdict == "proved"


def test_a_width_counts_the_effects_in_the_box() -> None:
    """Doses at one spacing: proved with the box, and wider than that of the nominal plant."""
    body = _of_kind(compartments())
    body["jump"]["dwell_time"] = [6, 6]
    body["output"] |= {"measured": "periodic", "period": 1.0, "C_radius": [[0.0005, 0]]}
    widths = []
    for keys in ((), ("parameter", "state")):
        own = {key: value for key, value in body.items() if key not in keys}
        if keys:
            own["output"] = {**body["output"]}
            del own["output"]["C_radius"]
        outcome = obsdesign.investigate(Problem.from_dict(own))
        (width,) = (claim for claim in outcome.claims if claim.id == "width")
        assert width.verdict == "proved"
        widths.append(width.evidence["always"])
        assert ("optimal" in [claim.id for claim in outcome.claims]) == bool(keys)
    assert np.all(np.array(widths[0]) > 1.2 * np.array(widths[1]))
    design = designed(body)
    forged = dict(design.gains) | {"flow_effect": 0.5 * design.gains["flow_effect"]}
    outcome = obsdesign.verify(obsdesign.Design(**{**vars(design), "gains": forged}))
    assert outcome.verdict == "refuted"


def test_rates_of_inputs_are_refused_and_gains_of_another_plant() -> None:
    body = _of_kind(spring())
    body["flow"] |= {"D": [[0], [1]], "d_bounds": {"lower": [-1], "upper": [1], "rate": [1]}}
    with pytest.raises(DoesNotApply, match=r"flow\.d_bounds\.rate is not available with param"):
        obsdesign.investigate(Problem.from_dict(body))
    design = designed(_of_kind(spring()))
    forged = {**design.gains, "effects": []}
    with pytest.raises(InputError, match="gains: effects differ from problem"):
        from_design(obsdesign.Design(**{**vars(design), "gains": forged}))
