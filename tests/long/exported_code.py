"""Exported C over a million random rows of each kind: states are inside, float encloses double.

    python -m tests.long.exported_code [rows]

Disturbances and noise are at their ends or inside, at random; jumps, missing samples and lengths of
steps too. A point observer is compared with the Python runtime's numbers.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from lmi.arithmetic.exponential import expm
from obsdesign.export.execution import Row
from obsdesign.export.manifest import Options
from obsdesign.export.programs import typed_gains
from obsdesign.export.timing import Steps
from obsdesign.runtime import Sample, from_design
from tests.export.plants import PROBLEMS, design_named
from tests.systems.compiled import Library

BLOCK = 10_000


def at_ends(rng: np.random.Generator, lower: Any, upper: Any) -> Any:
    """An end of a box, or a point in it."""
    share = rng.random(len(lower)) if rng.random() < 0.5 else rng.integers(0, 2, len(lower))
    return lower + share * (upper - lower)


class TruePlant:
    """The true plant; b is constant over a step."""

    def __init__(self, gains: Any, program: Any, rng: np.random.Generator) -> None:
        self.gains, self.program, self.rng = gains, program, rng
        n = gains.n
        self.x, self.u, self.elapsed = 0.5 * rng.uniform(-1, 1, n), np.zeros(gains.m), 10**6
        flow = np.zeros((2 * n, 2 * n))
        flow[:n] = np.hstack([gains.A, np.eye(n)])
        self.maps = [expm(flow * h)[:n] for h in program.timing.lengths]

    def row(self, is_first: bool) -> Row:
        """The next row; x is then the state after it."""
        gains, rng, timing, program = self.gains, self.rng, self.program.timing, self.program
        step = 0 if is_first else int(rng.integers(1, len(timing.lengths) + 1))
        if step:
            driven = at_ends(rng, gains.flow_lower, gains.flow_upper)
            driven = driven + (0 if gains.B is None else gains.B @ self.u)
            self.x = self.maps[step - 1] @ np.concatenate([self.x, driven])
            self.elapsed += timing.ticks[step - 1]
        due = self.elapsed >= timing.shortest
        jump = bool(
            program.jumps
            and due
            and (
                rng.random() < 0.3
                or (
                    timing.longest is not None and self.elapsed + max(timing.ticks) > timing.longest
                )
            )
        )
        before, w = self.x, None
        if jump:
            w = program.target.nearest(rng.uniform(-1, 1, program.sizes.l))
            c = at_ends(rng, gains.jump_lower, gains.jump_upper)
            driven = 0 if gains.E is None else gains.E @ w
            self.x, self.elapsed = gains.G @ self.x + driven + c, 0
        measured = before if program.rules.when == "before" else self.x
        centre = np.zeros(gains.p) if gains.noise_centre is None else gains.noise_centre
        noise = np.zeros(gains.p) if gains.noise_bound is None else 0.999 * gains.noise_bound
        y = program.target.nearest(gains.C @ measured + centre + at_ends(rng, -noise, noise))
        self.u = program.target.nearest(rng.uniform(-1, 1, program.sizes.m))
        is_missing = program.rules.bridges_gaps and rng.random() < 0.1
        return Row(step, None if is_missing else y, self.u, w, jump)


def run(name: str, precision: str, rows: int, folder: Path) -> str:
    """A line of what was counted."""
    design, steps = design_named(name)
    library = Library(folder, design, Options(precision, Steps(steps)), "-O2", "-ffp-contract=fast")
    double = Library(folder / "d", design, Options("double", Steps(steps)))
    observer, program = from_design(design), library.program
    path = TruePlant(typed_gains(design), program, np.random.default_rng(0))
    outside = narrower = void = 0
    off = 0.0
    for k in range(rows):
        if k % BLOCK == 0:  # a new beginning, as of a new box
            initial = [path.x - 0.1, path.x + 0.1] if program.has_bounds else [path.x]
            initial = [program.target.nearest(each) for each in initial]
            library.start(*initial)
            double.start(*initial)
            state = observer.init(0.0, x=initial[0]) if not program.has_bounds else None
            path.elapsed, ticks = 10**6, 0
        row = path.row(k % BLOCK == 0)
        ends, status = library.step(row)
        if program.has_bounds:
            others, _ = double.step(row)
            n = program.sizes.n
            outside += bool((ends[:n] > path.x + 1e-12).any() or (-ends[n:] < path.x - 1e-12).any())
            narrower += bool((ends > others).any())
            void += bool(status & (8 | 16 | 32 | 64 | 128))
        elif k % BLOCK < 1000:
            ticks += program.timing.ticks[row.step - 1] if row.step else 0
            t = float(ticks * program.timing.tick)
            state, estimate = observer.step(state, Sample(t, row.y, row.u, row.w, row.jump))
            off = max(off, float(np.abs(estimate.x - ends).max()))
    words = f"outside {outside}, narrower than double {narrower}, void {void}"
    return words if program.has_bounds else f"largest difference from Python {off:.2g}"


def main() -> None:
    """All kinds and precisions."""
    rows = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
    for name in (name for name in PROBLEMS if name != "unknown"):  # no plant without inputs
        for precision in ("double", "float"):
            with tempfile.TemporaryDirectory() as folder:
                (Path(folder) / "d").mkdir()
                line = run(name, precision, rows, Path(folder))
            print(f"{name:18}{precision:8}{rows} rows: {line}", flush=True)


if __name__ == "__main__":
    main()
