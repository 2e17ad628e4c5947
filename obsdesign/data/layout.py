"""Which columns a record of a plant has, by signal or by the names of events and sensors."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from lmi.arithmetic.arrays import Entries
from obsdesign.column_names import MODE, TIME, data_columns, numbered
from obsdesign.data.clock_columns import ClockColumns
from obsdesign.data.csv_lines import all_titles
from obsdesign.data.first_row import FirstRow
from obsdesign.document import Design
from obsdesign.errors import InputError, naming
from obsdesign.problem.signal_names import names_of
from obsdesign.runtime.base import Observer
from obsdesign.runtime.bounds import DeclaredBounds
from obsdesign.runtime.clocks.time_grid import steps_to_row


@dataclass(frozen=True)
class Layout:
    """Columns of a plant's data: numbers of measurements, known inputs, jump inputs; jumps.

    bounds: declared ones that columns of a row may narrow, None where none are used; unused:
    letters of those that stay as declared. clocks: of named events and sensors, whose columns stand
    for y, w and jump; may_repeat: rows may share a time, and act in the order of the file; modes:
    names in the column `mode`, none where the plant has none; dt: step of discrete time, of which
    each has one row; titles: column by another title of it.
    """

    y: int
    u: int = 0
    w: int = 0
    jump: bool = False
    bounds: DeclaredBounds | None = None
    unused: str = ""
    clocks: ClockColumns | None = None
    may_repeat: bool = False
    modes: tuple[str, ...] = ()
    dt: float | None = None
    titles: Mapping[str, str] = field(default_factory=dict)

    @property
    def first_row(self) -> FirstRow:
        """What the first row of a record must state."""
        return FirstRow(self.u, self.modes)

    def check_time(self, t: float, previous: float, where: str) -> None:
        """InputError unless a row may follow that of time `previous`, -inf for the first."""
        may_repeat = self.may_repeat or self.dt is not None  # the latter says more of such a row
        if t < previous or (t == previous and not may_repeat):
            late = " A row that arrives late needs report_delay of its [[event]] or [[sensor]]."
            raise InputError(
                f"{where}: t must increase; got {t!r} after {previous!r}. "
                f"Are the rows sorted, without repeats?{late if t < previous else ''}"
            )
        if self.dt is not None:
            with naming(where):
                has_row = previous > -math.inf
                steps_to_row(previous if has_row else t, t, self.dt, started=has_row)

    @staticmethod
    def from_reads(reads: Mapping[str, int]) -> Layout:
        """The layout of the samples that an observer reads (`Observer.reads`)."""
        return Layout(reads["y"], reads["u"], reads["w"], bool(reads["jump"]))

    @staticmethod
    def from_design(design: Design, observer: Observer) -> Layout:
        """The layout of the samples that the observer of a design reads, and their bounds.

        Where b = Bw w or c = W w, columns are of w: an observer that has no use for the matrix
        knows the box around b or c alone, which they do not narrow; likewise around b + D d.
        """
        layout, bounds = Layout.from_reads(observer.reads), observer.declared_bounds
        clocks = ClockColumns.from_problem(design.problem, has_events=layout.jump)
        modes = tuple(mode["name"] for mode in design.problem.get("mode", ()))
        dt = _block(design.problem, "flow").get("dt")
        layout = replace(
            layout, clocks=clocks, modes=modes, dt=dt,
            may_repeat="sensors" in design.gains and dt is None,
            titles=names_of(design.problem).columns,
        )  # fmt: skip
        if bounds is None:
            return layout
        folded = [
            letter
            for letter, block, gain in (
                ("b", "flow", "disturbance_matrix"),
                ("c", "jump", "jump_disturbance_matrix"),
            )
            if "disturbance_matrix" in _block(design.problem, block) and gain not in design.gains
        ]
        if "d_bounds" in _block(design.problem, "flow") and "D" not in design.gains:
            folded.append("b")
        return replace(layout, bounds=bounds, unused="".join(folded))

    def with_titles(self, titles: Mapping[str, str]) -> Layout:
        """The same columns under further titles, of each the column or a name of it."""
        return replace(self, titles=all_titles(self.titles, titles))

    def columns(self, header: Sequence[str] = ()) -> tuple[str, ...]:
        """Columns that a file with this header must have, in their usual order."""
        modes = (MODE,) if self.modes else ()
        if self.clocks is not None:
            return (TIME, *numbered("u", self.u), *self.clocks.required(header), *modes)
        return (*data_columns({"y": self.y, "u": self.u, "w": self.w}, self.jump), *modes)

    @property
    def lag(self) -> float:
        """Longest time between a row and its arrival."""
        return 0.0 if self.clocks is None else self.clocks.lag

    @property
    def optional(self) -> tuple[str, ...]:
        """Columns which a file may have: of bounds, of events by their names, of arrivals."""
        bounds = () if self.bounds is None else self.bounds.columns
        return bounds if self.clocks is None else (*bounds, *self.clocks.optional)


def _block(problem: Entries, name: str) -> Entries:
    """The flow or the jump of a problem as a dict; the one event where events have names."""
    events = problem.get("event", ())
    if name == "jump" and len(events) == 1:
        return dict(events[0])
    return dict(problem.get(name, {}))
