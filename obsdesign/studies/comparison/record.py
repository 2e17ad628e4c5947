"""The samples of a comparison, and the true states where they are known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import islice

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.column_names import TIME, numbered
from obsdesign.data.clock_columns import ClockColumns
from obsdesign.data.csv_lines import OWN_TITLES, all_titles, read_columns
from obsdesign.data.layout import Layout
from obsdesign.data.records import read_samples
from obsdesign.data.simulation import simulate
from obsdesign.data.simulation.parameter_courses import nominal_plant
from obsdesign.data.simulation.rows import default_until
from obsdesign.document import Design
from obsdesign.entries import numbers_from_cells
from obsdesign.errors import InputError
from obsdesign.problem.plant import Plant
from obsdesign.problem.problem import Problem
from obsdesign.runtime import Sample
from obsdesign.runtime.base import Observer, rows_of


@dataclass(frozen=True)
class ComparisonRecord:
    """Samples of a plant, and the true x (rows, n), d (rows, q) if known.

    path: the data file that they are of, None for a simulation; titles: column by another title.
    """

    samples: tuple[Sample, ...]
    x: Matrix | None = None
    d: Matrix | None = None
    path: str | None = None
    titles: Mapping[str, str] = field(default_factory=dict)

    def head(self, rows: int) -> ComparisonRecord:
        """The first rows."""
        x, d = (None if truth is None else truth[:rows] for truth in (self.x, self.d))
        return replace(self, samples=self.samples[:rows], x=x, d=d)

    def samples_for(self, design: Design, observer: Observer) -> tuple[Sample, ...]:
        """Samples as an observer reads them; of a file those that `run` gives it, with bounds."""
        if self.path is None:
            if observer.reads["jump"]:
                return self.samples
            return tuple(sample._replace(jump=False) for sample in self.samples)
        layout = Layout.from_design(design, observer).with_titles(self.titles)
        with open(self.path, encoding="utf-8", newline="") as stream:
            return tuple(islice(read_samples(stream, layout, self.path), len(self.samples)))

    @staticmethod
    def from_simulation(
        plant: Plant,
        *,
        until: float | None = None,
        step: float | None = None,
        rng: np.random.Generator | None = None,
        parameters: str = "random",
    ) -> ComparisonRecord:
        """A simulation of the plant, with the options of `simulation.simulate`."""
        until = end_of_record(plant) if until is None else until
        run = simulate(
            plant, until=until, step=step, rng=rng, announced=True, parameters=parameters
        )
        inputs = {letter: run.block(letter) for letter in "uw" if run.block(letter).size}
        jump = run.happened
        if jump is not None and len(plant.events) == 1:
            jump = jump[:, 0]
        samples = rows_of(run.t, run.block("y"), **inputs, jump=jump, mode=run.mode)
        d = run.block("d")
        return ComparisonRecord(tuple(samples), run.block("x"), d if d.size else None)

    @staticmethod
    def from_file(
        path: str, problem: Problem, titles: Mapping[str, str] = OWN_TITLES
    ) -> ComparisonRecord:
        """A data file, with its truth where it has all of x1, ..., xn (and d1, ...).

        titles: column by another title of it, beside the names in the problem.
        """
        plant, flow = problem.plant, problem.plant.flow
        known = all_titles(problem.names.columns, titles)
        columns = read_columns(path, known)
        u = 0 if flow.B is None else flow.B.shape[1]
        w = sum(event.inputs for event in plant.events)
        # impulses of unknown weight may come unannounced
        names = {"jump", "event", *(event.name for event in plant.events)}
        announced = bool(plant.events) and (
            all(event.H is None for event in plant.events) or not names.isdisjoint(columns)
        )
        clocks = ClockColumns.from_problem(problem.to_dict(), has_events=announced)
        modes = tuple(mode.name for mode in plant.modes)
        layout = Layout(
            plant.p, u, w, announced, clocks=clocks, modes=modes, dt=flow.dt,
            may_repeat=not plant.has_one_clock and flow.dt is None, titles=known,
        )  # fmt: skip
        with open(path, encoding="utf-8", newline="") as stream:
            samples = tuple(read_samples(stream, layout, path))
        q = 0 if flow.D is None else flow.D.shape[1]
        # samples are in the order of time, whenever they arrived
        order = np.argsort(numbers_from_cells(columns[TIME]), kind="stable")
        x, d = (_truth(columns, *size, path) for size in (("x", plant.n), ("d", q)))
        x, d = (None if truth is None else truth[order] for truth in (x, d))
        return ComparisonRecord(samples, x, d, path, titles)


def end_of_record(plant: Plant) -> float | None:
    """End of a simulation, None for its default; five times that where every row is a jump."""
    at_jumps = plant.has_one_clock and plant.output.measured == "at_jumps"
    return 5 * default_until(nominal_plant(plant), "random") if at_jumps else None


def _truth(columns: dict[str, list[str]], letter: str, count: int, path: str) -> Matrix | None:
    names = numbered(letter, count)
    if not names or any(name not in columns for name in names):
        return None
    try:
        cells = [numbers_from_cells(columns[name]) for name in names]
    except ValueError as error:
        raise InputError(f"{path}: columns {names[0]}, ... must hold numbers: {error}.") from None
    return np.array(cells).T
