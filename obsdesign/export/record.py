"""A record for the self-test of exported code: samples, and the answers of the runtime."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.document import Design
from obsdesign.equations.gains import Gains, PlantGains
from obsdesign.export.execution import Row
from obsdesign.export.program import Program
from obsdesign.runtime.base import Sample
from obsdesign.runtime.flow_cells import free_cells
from obsdesign.runtime.load import from_design

# rows of a self-test, and how many of its samples are missing
ROWS = 40
_MISSING = 0.1
# part of the bounds of the noise that is used: numbers of the target are rounded
_NOISE = 0.9


class Record(NamedTuple):
    """Rows with the runtime's answers. initial: bounds of x, or a guess.

    ends (rows, 2n): [lower; -upper], or (rows, n + q): x and d, 0 where there is none; is_ok: is a
    row's status ok?
    """

    initial: list[Matrix]
    rows: list[Row]
    ends: Matrix
    is_ok: list[bool]


def record_of(design: Design, program: Program, gains: Gains) -> Record:
    """The record of a design: its plant without disturbances, from a fixed seed."""
    random = np.random.default_rng(0)
    rows = (
        rows_of(program, gains, random, ROWS)
        if isinstance(gains, PlantGains)
        else wandering_rows(program, random, ROWS)
    )
    n = program.sizes.n
    bounds = [-np.ones(n), np.ones(n)]
    initial = bounds if program.has_bounds else [np.zeros(n)]
    observer = from_design(design)
    order = np.stack(initial, axis=1).reshape(-1).tolist()
    state, ends, is_ok, ticks = observer.start(0.0, order), [], [], 0
    for row in rows:
        ticks += program.timing.ticks[row.step - 1] if row.step else 0
        sample = Sample(float(ticks * program.timing.tick), row.y, row.u, row.w, row.jump)
        state, estimate = observer.step(state, sample)
        low, high = estimate.lower, estimate.upper
        parts = [estimate.x, estimate.d]
        if program.has_bounds and low is not None and high is not None:
            parts = [low, -high]
        ends.append(np.concatenate([part for part in parts if part is not None]))
        is_ok.append(estimate.status == "ok")
    return Record(initial, rows, np.nan_to_num(np.array(ends)), is_ok)


def rows_of(
    program: Program, gains: PlantGains, random: np.random.Generator, count: int
) -> list[Row]:
    """Samples of the plant with noise, jumps at admissible times, and a few missing samples."""
    target, sizes, timing = program.target, program.sizes, program.timing
    flows = free_cells(gains)
    x, u = 0.3 * random.uniform(-1.0, 1.0, sizes.n), np.zeros(sizes.m)
    rows: list[Row] = []
    elapsed: int | None = None
    for k in range(count):
        step = 0 if k == 0 else 1 + (k - 1) % len(timing.lengths)
        if step:
            x = flows.at(timing.lengths[step - 1]) @ np.concatenate([x, u, [1.0]])
            elapsed = None if elapsed is None else elapsed + timing.ticks[step - 1]
        jump = bool(program.jumps) and step > 0 and _is_due(program, elapsed, step, random)
        before = x
        w = None
        if jump:
            w = target.nearest(random.uniform(-1.0, 1.0, sizes.l))
            E = np.zeros((sizes.n, 0)) if gains.E is None else gains.E
            x, elapsed = gains.jump_matrix @ x + E @ w + gains.jump_drift, 0
        measured = before if program.rules.when == "before" else x
        y = _measurement(program, gains, measured, random)
        is_missing = random.random() < _MISSING or (jump and program.rules.when == "none")
        if not program.rules.bridges_gaps:  # later rows differ from the runtime's
            is_missing = bool(program.rules.window) and not jump
        u = target.nearest(random.uniform(-1.0, 1.0, sizes.m))
        rows.append(Row(step, None if is_missing else y, u, w, jump))
    return rows


def wandering_rows(program: Program, random: np.random.Generator, count: int) -> list[Row]:
    """Samples that wander, of a plant whose inputs are unknown."""
    target, sizes, lengths = program.target, program.sizes, program.timing.lengths
    y, rows = np.zeros(sizes.p), list[Row]()
    for k in range(count):
        step = 0 if k == 0 else 1 + (k - 1) % len(lengths)
        y = y + 0.1 * random.uniform(-1.0, 1.0, sizes.p)
        u = target.nearest(random.uniform(-1.0, 1.0, sizes.m))
        rows.append(Row(step, target.nearest(y), u))
    return rows


def _measurement(
    program: Program, gains: PlantGains, x: Matrix, random: np.random.Generator
) -> Matrix:
    p = program.sizes.p
    radius = np.zeros(p) if gains.noise_bound is None else gains.noise_bound
    centre = np.zeros(p) if gains.noise_centre is None else gains.noise_centre
    noise = centre + _NOISE * radius * random.uniform(-1.0, 1.0, p)
    return program.target.nearest(gains.C @ x + noise)


def _is_due(program: Program, elapsed: int | None, step: int, random: np.random.Generator) -> bool:
    """Does the plant jump at this row? As soon as it may, but not at every one."""
    timing = program.timing
    if elapsed is None:
        return True
    waits = random.random() < 0.5 if program.rules.window else elapsed < 3 * timing.ticks[step - 1]
    return (elapsed >= timing.shortest and not waits) or (
        timing.longest is not None and elapsed + max(timing.ticks) > timing.longest
    )
