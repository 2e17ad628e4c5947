"""Plants in discrete time in a problem file: what they mean, and what is refused."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

from lmi.time_budget import UNLIMITED
from obsdesign.data.simulation import simulate
from obsdesign.errors import DoesNotApply, InputError
from obsdesign.kinds import KINDS, TAKING_DISCRETE_TIME
from obsdesign.problem.problem import Problem
from obsdesign.studies.search.search import search
from obsdesign.synthesis.kind import candidates_of
from obsdesign.verification.kind import verification_of
from tests.systems.discrete_time import pulsed, turning, two_rates


def changed(body: dict[str, Any], path: tuple[Any, ...], value: Any) -> dict[str, Any]:
    body = copy.deepcopy(body)
    place: Any = body
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    return body


@pytest.mark.parametrize("body", [two_rates(2, 5), pulsed(), turning("interval")])
def test_a_problem_survives_its_own_text(body: dict[str, Any]) -> None:
    problem = Problem.from_dict(body)
    assert Problem.from_dict(problem.to_dict()) == problem
    assert problem.plant.flow.dt == body["flow"]["dt"]


def test_what_is_read_always_is_read_at_every_step() -> None:
    problem = Problem.from_dict(turning("interval"))
    assert (problem.plant.output.measured, problem.plant.output.period) == ("periodic", 0.1)
    named = changed(two_rates(2, 5), ("sensor", 0, "every"), "continuous")
    assert Problem.from_dict(named).plant.sensors[0].gap == 0.1


REFUSALS: list[tuple[dict[str, Any], tuple[Any, ...], Any, str]] = [
    (turning("interval"), ("flow", "dt"), 0, "flow.dt must be a positive"),
    (turning("interval"), ("flow", "dt"), "inf", "flow.dt must be a positive"),
    (turning("interval", measured="periodic"), ("output", "period"), 0.25, "output.period must be a multiple of flow.dt"),
    (two_rates(2, 5), ("sensor", 1, "every"), [0.1, 0.33],
     "sensor.position.every must be a multiple of flow.dt = 0.1: nothing happens between two"),
    (pulsed(), ("sensor", 0, "jitter"), 0.1, "sensor.first.jitter must be a multiple"),
    (pulsed(), ("event", 0, "every"), [1.5, 2.75], "event.swap.every must be a multiple"),
]  # fmt: skip


@pytest.mark.parametrize(("body", "path", "value", "message"), REFUSALS)
def test_refusals(body: dict[str, Any], path: tuple[Any, ...], value: Any, message: str) -> None:
    with pytest.raises(InputError, match=message) as refusal:
        Problem.from_dict(changed(body, path, value))
    assert "\n" not in str(refusal.value)


def test_modes_and_searches_are_refused() -> None:
    modes = [{"name": name, "A": [[0.5, 0], [0, 0.5]], "every": 1} for name in ("on", "off")]
    with pytest.raises(InputError, match=r"\[\[mode\]\] is not available with flow.dt"):
        Problem.from_dict({**turning("interval"), "mode": modes})
    with pytest.raises(InputError, match=r"--for shortest_dwell is not available with flow.dt"):
        search(Problem.from_dict(pulsed()), "shortest_dwell")


@pytest.mark.parametrize("kind", ["interval", "set_membership"])
@pytest.mark.parametrize("dwell_time", [[0.1, 0.1], [0.3, 0.5]])
def test_bounds_need_to_know_what_a_sample_at_a_jump_saw(
    kind: str, dwell_time: list[float]
) -> None:
    """With a jump in every step no sample sees anything: nothing is claimed of samples."""
    hidden = {**turning(kind, jump_measurement="none"), "jump": {"dwell_time": dwell_time}}
    with pytest.raises(DoesNotApply, match="jump_measurement must be before or after"):
        next(candidates_of(Problem.from_dict(hidden), UNLIMITED))
    seen = changed(hidden, ("output", "jump_measurement"), "before")
    gains = dict(next(candidates_of(Problem.from_dict(seen), UNLIMITED)).gains.to_document())
    # the twin: gains of samples that are seen, for the problem in which they are hidden
    problem = Problem.from_dict(hidden)
    claims = verification_of(kind).claims(problem, gains, {}, paranoid=False)
    assert [claim.verdict for claim in claims] == ["refuted"]
    free = {key: value for key, value in hidden.items() if key != "jump"}
    next(candidates_of(Problem.from_dict(free), UNLIMITED))


@pytest.mark.parametrize("kind", sorted(set(KINDS) - set(TAKING_DISCRETE_TIME)))
def test_other_kinds_name_those_that_can(kind: str) -> None:
    problem = Problem.from_dict({**turning("interval"), "observer": {"kind": kind}})
    with pytest.raises(DoesNotApply, match="Observers for discrete time: interval, set_membership"):
        next(candidates_of(problem, UNLIMITED))


def test_a_simulation_repeats_the_step() -> None:
    """Rows on the grid, in whichever units; x is that of a loop over the steps."""
    plant = Problem.from_dict(pulsed()).plant
    run = simulate(plant, until=40.0, disturbance="zero", rng=np.random.default_rng(8))
    assert run.t.tolist() == [0.5 * k for k in range(81)]
    assert run.happened is not None
    x, b = np.ones(2), (plant.flow.lower + plant.flow.upper) / 2
    jumps = np.flatnonzero(run.happened[:, 0])
    assert set(np.diff(jumps)) == {3, 4, 5}
    for k in range(1, 81):
        x = plant.flow.A @ x + b
        if k in jumps:
            x = plant.events[0].G @ x + plant.events[0].E @ run.block("w")[k]
        np.testing.assert_allclose(run.block("x")[k], x, rtol=1e-12, atol=1e-12)
    for step in (0.25, 0.7):
        with pytest.raises(InputError, match=r"step must be a multiple of flow.dt = 0.5"):
            simulate(plant, step=step)
    with pytest.raises(InputError, match=r"dwell must be a multiple of flow.dt = 0.5"):
        simulate(plant, dwell=1.7)


def test_more_steps_than_rows_may_be_are_not_simulated() -> None:
    plant = Problem.from_dict(turning("interval")).plant
    with pytest.raises(InputError, match="is the limit"):
        simulate(plant, until=1e9, step=1e7)
