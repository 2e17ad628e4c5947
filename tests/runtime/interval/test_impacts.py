"""Jumps that the output causes: the recipe of docs/interval.md, as it stands there."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

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
