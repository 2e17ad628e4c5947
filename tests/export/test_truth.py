"""Bounds of the code hold for the exact state: rational numbers, no disturbance, hardly any noise."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from obsdesign.export.execution import Execution, Row
from obsdesign.export.manifest import Options
from obsdesign.export.precision import PRECISIONS
from obsdesign.export.program import Program
from obsdesign.export.timing import Steps
from tests.systems.designs import designed

H, NOISE = 0.125, 2.0**-21
G = [[0.75, 0.125], [0.0, 0.5]]


def body(**output: Any) -> dict[str, Any]:
    """x1' = x2: e^{A h} is exact, and so are the jumps."""
    return {
        "flow": {"A": [[0, 1], [0, 0]]}, "jump": {"G": G, "dwell_time": [0.5, 0.5]},
        "output": {"C": [[1, 0]], "noise_bound": [NOISE], **output},
        "observer": {"kind": "interval", "form": "split"},
    }  # fmt: skip


def exact_path(
    count: int, rng: np.random.Generator, error: float
) -> Iterator[tuple[list[Fraction], Row]]:
    """States and rows; y is C x as a float, nearer than the noise; error: of the steps, relative."""
    x = [Fraction(float(np.float32(value))) for value in rng.uniform(-0.5, 0.5, 2)]
    yield x, Row(0, None)
    for k in range(1, count):
        h = Fraction(H) * (1 + Fraction(error) * int(rng.choice([-1, 1])))
        x = [x[0] + h * x[1], x[1]]
        y = np.array([float(np.float32(float(x[0])))])
        jump = k % 4 == 0
        if jump:
            x = [
                sum((Fraction(g) * each for g, each in zip(row, x, strict=True)), Fraction(0))
                for row in G
            ]
        yield x, Row(1, y if rng.random() < 0.3 else None, jump=jump)


def violations(program: Program, count: int, error: float = 0.0) -> int:
    """Bounds on the wrong side of the state, over a path that begins at a point."""
    execution, state, wrong = Execution(program), None, 0
    for x, row in exact_path(count, np.random.default_rng(3), error):
        if state is None:
            point = np.array([float(each) for each in x])
            state = execution.start(point, point)
        state, ends = execution.step(state, row)
        stated = [Fraction(float(each)) for each in ends]
        wrong += sum(low > each for low, each in zip(stated[:2], x, strict=True))
        wrong += sum(-high < each for high, each in zip(stated[2:], x, strict=True))
    return wrong


def program(precision: str, **output: Any) -> Program:
    design = designed(body(**output), allow_undecided=True)
    return Options(precision, Steps(() if output else (H,))).program(design)


@pytest.mark.parametrize("output", [{}, {"measured": "periodic", "period": H}])
@pytest.mark.parametrize("precision", PRECISIONS)
def test_exact_states_are_inside(precision: str, output: dict[str, Any]) -> None:
    assert violations(program(precision, **output), 400) == 0


def test_tables_without_margins_lose_the_state() -> None:
    """The twin: the numbers of double as they are, on a float."""
    outward, double = program("float"), program("double")
    nearest = [
        replace(each, rows=PRECISIONS["float"].nearest(each.rows)) for each in double.products
    ]
    assert violations(replace(outward, products=tuple(nearest)), 400) > 10


@pytest.mark.parametrize("precision", PRECISIONS)
def test_steps_off_their_length(precision: str) -> None:
    """Lengths within the error that is stated; the twin states a tenth of it."""
    design, error = designed(body(), allow_undecided=True), 2.0**-10
    for stated, is_inside in ((error, True), (error / 10, False)):
        each = Options(precision, Steps((H,), stated)).program(design)
        assert (violations(each, 400, error) == 0) is is_inside
