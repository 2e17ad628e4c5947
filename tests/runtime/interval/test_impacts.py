"""Jumps that the output causes: the recipe of docs/interval.md, as it stands there."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.runtime import Bounds, Sample, from_design
from tests.systems.designs import designed

PAGE = Path(__file__).parents[3] / "docs" / "interval.md"


def recipe() -> dict[str, Any]:
    """Names that the program of the page's section leaves."""
    section = PAGE.read_text(encoding="utf-8").split("## Jumps that the output causes")[1]
    program = re.search(r"```python\n(.*?)```", section, re.DOTALL)
    assert program is not None
    names: dict[str, Any] = {}
    exec(program[1], names)
    return names


def outside(names: dict[str, Any]) -> float:
    x, estimates = names["truth"], names["estimates"]
    lower, upper = (np.array([getattr(e, end) for e in estimates]) for end in ("lower", "upper"))
    return float(np.maximum(lower - x, x - upper).max())


def test_the_recipe_keeps_the_ball_inside_its_bounds() -> None:
    names = recipe()
    impacts = [sample.t for sample in names["samples"] if sample.jump]
    assert len(impacts) >= 4
    assert {estimate.status for estimate in names["estimates"]} == {"ok"}
    assert outside(names) <= 1e-12


def test_the_twin_impacts_that_are_not_reported_lose_the_ball() -> None:
    names = recipe()
    observer, samples = names["observer"], names["samples"]
    silent = [sample._replace(jump=False) for sample in samples]
    state = observer.init(0.0, lower=[4.9, -0.1], upper=[5.1, 0.1])
    names["estimates"] = list(observer.run(state, silent))
    assert outside(names) > 1.0
    assert any(estimate.status != "ok" for estimate in names["estimates"])


G, KEPT, SPEED, FORCE = 9.81, 0.8, 10.0, 10.31


def late_record(
    delay: float, still: Bounds | None, waiting: float | None = None
) -> tuple[list[Sample], np.ndarray]:
    """Samples of a ball from 5 m whose impacts are reported after a delay, and its states.

    waiting: time from an impact to a row without measurement, before its report.
    """
    impacts, t, speed = [(0.0, 5.0, 0.0)], math.sqrt(10 / G), KEPT * math.sqrt(10 * G)
    while t < 4.5:
        impacts.append((t, 0.0, speed))
        t, speed = t + 2 * speed / G, KEPT * speed
    rows = [(round(0.02 * k, 6), False) for k in range(220)]
    rows += [(t + delay, True) for t, _, _ in impacts[1:]]
    unmeasured = [] if waiting is None else [t + waiting for t, _, _ in impacts[1:]]
    samples, states = [], []
    for now, is_jump in sorted(rows + [(t, False) for t in unmeasured]):
        start, height, speed = [impact for impact in impacts if impact[0] <= now][-1]
        if not is_jump and start > 0 and now < start + delay and now not in unmeasured:
            continue  # between an impact and its report nothing is measured
        s = now - start
        states.append((height + speed * s - G * s**2 / 2, speed - G * s))
        bounds = None if is_jump else still
        y = None if now in unmeasured else [states[-1][0]]
        samples.append(Sample(now, y, jump=is_jump, bounds=bounds if y else None))
    return samples, np.array(states)


def estimates_of(samples: list[Sample], room: float) -> list[Any]:
    """Of the observer whose jump disturbance has room for reports up to `room` late."""
    position, velocity = (1 + KEPT) * SPEED * room, (1 + KEPT) * FORCE * room
    body = obsdesign.load_problem(PAGE.parents[1] / "examples" / "degue_4_2.toml").to_dict()
    body["jump"]["disturbance"] = {
        "lower": [-position, -0.5 - velocity], "upper": [position, 0.5 + velocity]
    }  # fmt: skip
    body["output"]["noise_bound"] = [position]
    observer: Any = from_design(designed(body))
    start = observer.init(0.0, lower=[4.9, -0.1], upper=[5.1, 0.1])
    return list(observer.run(start, samples))


@pytest.mark.parametrize(("delay", "room"), [(0.002, 0.004), (0.004, 0.004), (0.004, 0.0)])
def test_late_impacts_are_inside_where_the_recipe_leaves_room(delay: float, room: float) -> None:
    """Step 2 of the recipe for reports up to `room` late; the twin without it refutes the bounds."""
    samples, x = late_record(delay, Bounds(v=([0.0], [0.0])) if room else None)
    estimates = estimates_of(samples, room)
    statuses = {estimate.status for estimate in estimates}
    if not room:
        assert statuses != {"ok"}
        return
    assert statuses == {"ok"}
    assert outside({"truth": x, "estimates": estimates}) <= 1e-12


def test_between_an_impact_and_its_report_the_bounds_are_void() -> None:
    """The speed has its sign before the impact; from the report on the bounds hold again."""
    samples, x = late_record(0.004, Bounds(v=([0.0], [0.0])), waiting=0.002)
    estimates = estimates_of(samples, 0.004)
    rows = list(zip(samples, x, estimates, strict=True))
    waiting = [row for row in rows if row[0].y is None]
    assert len(waiting) == 3
    for _, state, estimate in waiting:
        assert outside({"truth": [state], "estimates": [estimate]}) > 8
    others = [row for row in rows if row[0].y is not None]
    truth, bounds = [row[1] for row in others], [row[2] for row in others]
    assert outside({"truth": truth, "estimates": bounds}) <= 1e-12
