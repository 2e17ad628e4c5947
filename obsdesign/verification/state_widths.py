"""What a design says of each state in numbers: `states` in the results of design and verify."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.column_names import numbered
from obsdesign.document import Claim
from obsdesign.problem.output import Output
from obsdesign.problem.problem import Problem


@dataclass(frozen=True)
class StateWidths:
    """Widths of the bounds of a state, or errors of its estimate; None where there is none.

    strip: what one sample alone leaves open, where an output is this state alone; width: certified;
    typical: mean width, or |error|, over the default simulation; best: no observer can guarantee
    less; ratio: of width and best; error: certified bound of |error|; pattern: the only times of
    samples and jumps that width and best are about, None where they are about all that the plant
    allows.
    """

    name: str
    unit: str | None
    strip: float | None = None
    width: float | None = None
    typical: float | None = None
    best: float | None = None
    ratio: float | None = None
    error: float | None = None
    pattern: str | None = None


def sensor_strips(output: Output) -> list[float | None]:
    """Width of each state that one sample of an output leaves open; None where none is it alone."""
    C, radius = output.C, output.noise_radius
    strips: list[float | None] = [None] * C.shape[1]
    if radius is None:
        return strips
    for row, bound in zip(C, radius, strict=True):
        used = np.flatnonzero(row)
        if len(used) == 1:
            i, width = int(used[0]), float(2 * bound / abs(row[used[0]]))
            before = strips[i]
            strips[i] = width if before is None else min(before, width)
    return strips


def state_labels(problem: Problem) -> list[tuple[str, str | None]]:
    """(name, unit) of each state; the unit is None where none is stated."""
    n, names = problem.plant.n, problem.names
    columns = numbered("x", n)
    return [
        (name, names.unit(column)) for name, column in zip(names.states_of(n), columns, strict=True)
    ]


def widths_of_claim(
    problem: Problem, claims: tuple[Claim, ...], *names: str
) -> tuple[StateWidths, ...]:
    """Sensor strip and width of each state: that of the first claim that is proved.

    Of modes the largest of all.
    """
    proved_of = {claim.id: claim.evidence for claim in claims if claim.verdict == "proved"}
    labels = state_labels(problem)
    stated = [proved_of[name]["always"] for name in names if name in proved_of]
    width = [None] * problem.plant.n
    if stated:
        width = np.atleast_2d(stated[0]).max(axis=0).tolist()
    return tuple(
        StateWidths(*labels[i], strip, width[i])
        for i, strip in enumerate(sensor_strips(problem.plant.outputs))
    )


def errors_of_claim(
    problem: Problem, claims: tuple[Claim, ...], name: str, entry: str
) -> tuple[StateWidths, ...]:
    """The bounds of |error| of each state in an entry of a claim; none unless it is proved."""
    stated = [c.evidence[entry] for c in claims if c.id == name and c.verdict == "proved"]
    if not stated:
        return ()
    pairs = zip(state_labels(problem), stated[0], strict=True)
    return tuple(StateWidths(name, unit, error=error) for (name, unit), error in pairs)
