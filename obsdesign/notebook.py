"""What the commands do, from Python: answers, records and pictures as objects.

Functions and keywords are those of the command line; files may stand for records.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Array, Matrix, Value
from obsdesign.column_names import STATUS, TIME
from obsdesign.data.csv_lines import OWN_TITLES, all_titles
from obsdesign.data.csv_text import table_text
from obsdesign.data.execution import execute
from obsdesign.data.simulation import Simulation
from obsdesign.data.simulation import simulate as simulate_plant
from obsdesign.data.simulation.stated_rows import StatedRows
from obsdesign.data.tally import Tally
from obsdesign.design_file import load_design
from obsdesign.document import Design
from obsdesign.entries import shown
from obsdesign.errors import InputError
from obsdesign.html_table import html_table
from obsdesign.kinds import KINDS
from obsdesign.output_files import temporary_folder, write_text
from obsdesign.pages.estimates import DataSource
from obsdesign.pages.plotting.estimate_record import EstimateRecord, Table
from obsdesign.pages.report import write_report
from obsdesign.problem.plant import Plant
from obsdesign.problem.problem import Problem
from obsdesign.studies.check.which_kinds import KindAnswer, check_all
from obsdesign.studies.comparison.compare import compare as compare_all
from obsdesign.studies.comparison.record import ComparisonRecord
from obsdesign.studies.comparison.row import ComparisonRow, table
from obsdesign.workflow import Outcome

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from obsdesign.studies.sweep.point import SweepPoint

# a record: the path of a data file, a simulation, or columns by name (a pandas table too)
Record = str | Path | Simulation | Mapping[str, ArrayLike]


class Check(dict[str, KindAnswer]):
    """The answer of each kind, by its name; `verdict` is that on the plant."""

    def __init__(self, verdict: str, answers: Mapping[str, KindAnswer]) -> None:
        super().__init__(answers)
        self.verdict = verdict

    def __repr__(self) -> str:
        return f"Check({', '.join(f'{kind}: {each.verdict}' for kind, each in self.items())})"

    def _repr_html_(self) -> str:
        rows = [
            (kind, each.verdict.replace("_", " "), " ".join(each.reasons[:1]) or each.next_step)
            for kind, each in self.items()
        ]
        return html_table(("kind", "answer", "why, or what next"), rows)


@dataclass(frozen=True, repr=False)
class Comparison:
    """Observers on one record, a row each, the Kalman filter last."""

    rows: tuple[ComparisonRow, ...]

    def __repr__(self) -> str:
        titles, lines = table(self.rows)
        return "\n".join("  ".join(line) for line in (titles, *lines))

    def _repr_html_(self) -> str:
        return html_table(*table(self.rows))

    def to_pandas(self) -> Value:
        """A `pandas.DataFrame` with a row per observer; InputError without pandas."""
        return _frame([vars(row) for row in self.rows])


@dataclass(frozen=True, repr=False)
class Sweep:
    """A map over entries of a problem: keys of the entries, what is mapped, and the points."""

    over: tuple[str, ...]
    what: str
    points: tuple[SweepPoint, ...]

    @property
    def columns(self) -> dict[str, list[Value]]:
        """Values of the entries, verdict and value of each point."""
        own: dict[str, list[Value]] = {
            key: [point.at[k] for point in self.points] for k, key in enumerate(self.over)
        }
        own["verdict"] = [point.verdict for point in self.points]
        if self.what != "verdict":
            own[self.what] = [point.value for point in self.points]
        return own

    def __repr__(self) -> str:
        return f"Sweep({self.what} over {', '.join(self.over)}, {len(self.points)} points)"

    def _repr_html_(self) -> str:
        columns = self.columns
        return html_table(list(columns), zip(*columns.values(), strict=True))

    def to_pandas(self) -> Value:
        """A `pandas.DataFrame` with a row per point; InputError without pandas."""
        return _frame(self.columns)


@dataclass(frozen=True, repr=False)
class Estimates:
    """Estimates of a record by a design: columns as in an estimate file.

    columns: t, x1_lo, x1_hi, ... or x1, ..., d1, ..., arrays (rows,); status: of each row; tally:
    how many rows have which; impulses: columns of an event file, empty for other kinds.
    """

    design: Design
    tables: tuple[Table, Table, Table]
    tally: Tally

    @cached_property
    def columns(self) -> dict[str, Matrix]:
        """The numbers of each column."""
        own = self.tables[0]
        return {name: own.numbers(name) for name in own.columns if name != STATUS}

    @property
    def t(self) -> Matrix:
        """Times, (rows,)."""
        return self.columns[TIME]

    @property
    def status(self) -> list[str]:
        """Status of each row."""
        return self.tables[0].statuses

    @property
    def x(self) -> Matrix | None:
        """Point estimates (rows, n), None of kinds that give bounds alone."""
        return self._block("x{}")

    @property
    def lower(self) -> Matrix | None:
        """Lower bounds (rows, n), None of kinds without bounds."""
        return self._block("x{}_lo")

    @property
    def upper(self) -> Matrix | None:
        """Upper bounds (rows, n), None of kinds without bounds."""
        return self._block("x{}_hi")

    @property
    def d(self) -> Matrix | None:
        """Estimates of the unknown input (rows, q), None of kinds without."""
        return self._block("d{}")

    @property
    def impulses(self) -> dict[str, Array]:
        """Impulses that were found, by the columns of an event file."""
        own = self.tables[2]
        return {name: own.numbers(name) for name in own.columns if name != STATUS}

    def __repr__(self) -> str:
        return f"Estimates({self.design.kind}, {self.tally.rows} rows: {self.tally})"

    def _repr_html_(self) -> str:
        import io

        drawn = io.BytesIO()
        plot(self).savefig(drawn, format="svg")
        return drawn.getvalue().decode("utf-8")

    def to_pandas(self) -> Value:
        """A `pandas.DataFrame` of the columns; InputError without pandas."""
        return _frame({**self.columns, STATUS: self.status})

    def _block(self, pattern: str) -> Matrix | None:
        names = [pattern.format(i + 1) for i in range(len(self.columns))]
        present = [self.columns[name] for name in names if name in self.columns]
        return np.array(present).T if present else None


def check(problem: Problem, *, seconds: float | None = None) -> Check:
    """For each kind: can it be built for a plant, and if not, why; `seconds` as for `design`."""
    return Check(*check_all(problem, seconds=seconds))


def search(problem: Problem, what: str, *, kind: str | None = None, **options: Value) -> Outcome:
    """The bracket of a limit; what, options: those of `obsdesign.studies.search.search`.

    kind: another than that of the problem, whose gains and options are then left out.
    """
    from obsdesign.studies.search.search import search as bracket

    return bracket(problem if kind is None else problem.for_kind(kind)[0], what, **options)


def simulate(
    problem: Problem | Design | Plant, *, seed: int = 0, data: str | None = None,
    rng: np.random.Generator | None = None, rename: Mapping[str, str] = OWN_TITLES,
    **options: Value,
) -> Simulation:  # fmt: skip
    """An exact simulation of the plant of a problem or design.

    seed, or rng: of what is drawn; data: file of rows, with inputs, events and missing samples (not
    of a bare plant); rename: column by another title of it; options: until, step, initial, dwell,
    disturbance, parameters of `obsdesign.data.simulation.simulate`. InputError as there.
    """
    rng = np.random.default_rng(seed) if rng is None else rng
    if isinstance(problem, Plant):
        return simulate_plant(problem, rng=rng, **options)
    if isinstance(problem, Design):
        problem = Problem.from_dict(problem.problem)
    rows = None if data is None else StatedRows.from_file(data, problem, rename)
    # impulses of unknown weight are announced to the kinds that cannot find them
    announced = problem.kind not in (None, "impulsive_input")
    return simulate_plant(problem.plant, rng=rng, rows=rows, announced=announced, **options)


def run(
    design: Design | str, data: Record, *, initial: Sequence[float] | None = None,
    rename: Mapping[str, str] = OWN_TITLES, skip_bad: bool = False,
) -> Estimates:  # fmt: skip
    """Estimates of a design on a record, as the command `run` gives them.

    design: or the path of its file; initial: x1, ..., xn, or x1_lo, x1_hi, ... for bounds (there
    required). InputError for data that do not fit.
    """
    with temporary_folder() as folder:
        path, signed = _design_file(design, folder)
        source, out = _data_file(data, folder), str(Path(folder, "estimates.csv"))
        initial = _stated_start(initial)
        events = str(Path(folder, "events.csv")) if signed.kind == "impulsive_input" else None
        tally = execute(path, source, out, initial, events, titles=rename, skip_bad=skip_bad)
        titles = all_titles(Problem.from_dict(signed.problem).names.columns, rename)
        tables = (Table.from_file(out), Table.from_file(source, titles), Table.from_file(events))
    return Estimates(signed, tables, tally)


def compare(
    problem: Problem, data: str | None = None, *, kinds: Sequence[str] = KINDS,
    initial: Sequence[float] | None = None, seed: int = 0, seconds: float | None = None,
    rename: Mapping[str, str] = OWN_TITLES,
) -> Comparison:  # fmt: skip
    """All observers that a plant admits on a data file or a simulation, beside a Kalman filter."""
    initial = _stated_start(initial)
    if data is None:
        rng = np.random.default_rng(seed)
        record = ComparisonRecord.from_simulation(problem.plant, rng=rng)
    else:
        record = ComparisonRecord.from_file(data, problem, rename)
    return Comparison(tuple(compare_all(problem, record, initial, kinds=kinds, seconds=seconds)))


def sweep(
    problem: Problem, over: Sequence[str], what: str = "verdict", *, accuracy: float = 1e-6,
    seconds: float | None = None, jobs: int | None = None, output: str | None = None,
) -> Sweep:  # fmt: skip
    """A map of `what` over one or two entries of a problem, as the command `sweep` makes it.

    over: "key=first:last:count", once or twice; output: JSON lines, of which points are not done
    again; seconds: at each point; jobs: processes. InputError as there.
    """
    from obsdesign.studies.sweep.axes import parse_axis
    from obsdesign.studies.sweep.point import plan_sweep
    from obsdesign.studies.sweep.run import run_sweep

    axes = tuple(parse_axis(text) for text in over)
    plan = plan_sweep(problem, axes, what, accuracy, seconds)
    with temporary_folder() as folder:
        path = str(Path(folder, "sweep.jsonl")) if output is None else output
        points = run_sweep(plan, path, jobs=jobs)
    return Sweep(tuple(axis.key for axis in axes), what, tuple(points))


def plot(
    estimates: Estimates, *, beside: Estimates | None = None, state: str | None = None,
    ax: Axes | None = None,
) -> Figure:  # fmt: skip
    """The figure of estimates, against the true state where the data have it.

    beside: bounds of another design on the same record. state, ax: one panel, of x1, ... or a
    state's name, on axes of one's own; both or none. InputError for a state that there is not.
    """
    from obsdesign.pages.plotting.estimate import Comparison as Compared
    from obsdesign.pages.plotting.estimate import draw_panel, draw_record

    problem = Problem.from_dict(estimates.design.problem)
    compared = Compared(problem=problem)
    own, data, impulses = estimates.tables
    second = Table("", {}) if beside is None else beside.tables[0]
    if beside is not None:  # names in the legend
        own, second = (
            Table(each.design.kind, each.tables[0].columns) for each in (estimates, beside)
        )
    record = EstimateRecord.from_tables(own, data, impulses, second, clocks=compared.clocks)
    if (ax is None) != (state is None):
        raise InputError("plot: state and ax are given together, for one panel.")
    if ax is None or state is None:
        return draw_record(record, compared)
    draw_panel(ax, problem.names.columns.get(state, state), record, compared)
    return cast("Figure", ax.get_figure())


def report(
    design: Design | str, output: str, data: str | None = None, *,
    initial: Sequence[float] | None = None, beside: str | None = None,
    rename: Mapping[str, str] = OWN_TITLES,
) -> Outcome:  # fmt: skip
    """Prove a design again and write its page; nothing is written where a claim is refuted."""
    with temporary_folder() as folder:
        path, _ = _design_file(design, folder)
        source = DataSource(data, _stated_start(initial), rename)
        return write_report(path, output, source, beside)


def _stated_start(initial: Sequence[float] | None) -> Sequence[float] | None:
    """The numbers of `initial`; InputError unless they are a list of numbers."""
    if initial is None:
        return None
    try:
        numbers = np.asarray(initial, dtype=np.float64)
    except (TypeError, ValueError):
        numbers = np.zeros((0, 0))
    if numbers.ndim != 1:
        raise InputError(
            "initial must be a list of numbers: x1, ..., xn, or x1_lo, x1_hi, ... for bounds; "
            f"got {shown(initial)}."
        )
    stated: list[float] = numbers.tolist()
    return stated


def _design_file(design: Design | str, folder: str) -> tuple[str, Design]:
    if isinstance(design, str):
        return design, load_design(design)
    path = str(Path(folder, "design.json"))
    design.save(path)
    return path, design


def _data_file(data: Record, folder: str) -> str:
    if isinstance(data, str | Path):
        return str(data)
    columns = data.columns if isinstance(data, Simulation) else {x: data[x] for x in data}
    path = str(Path(folder, "data.csv"))
    write_text(path, table_text({name: np.asarray(values) for name, values in columns.items()}))
    return path


def _frame(content: Value) -> Value:
    """A table of pandas; InputError where it is not installed."""
    try:
        import pandas as pd
    except ImportError:
        raise InputError(
            "a table requires pandas; it is missing: pip install 'obsdesign[interop]'."
        ) from None
    return pd.DataFrame(content)
