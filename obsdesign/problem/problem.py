"""`Problem`, a plant and its [observer] block, to and from what a problem file holds.

Structure is checked by the published JSON Schema, meaning by the plant's own checks; both speak in
one line (`obsdesign.errors.InputError`).
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter
from types import MappingProxyType
from typing import TypeVar

from lmi.arithmetic.arrays import Entries, Matrix, NewEntries, Value
from obsdesign.document import jsonable
from obsdesign.entries import missing_entry
from obsdesign.errors import DoesNotApply, InputError, naming
from obsdesign.html_table import html_table
from obsdesign.kinds import KINDS
from obsdesign.problem import observer_options
from obsdesign.problem.clock_checks import check_clocks
from obsdesign.problem.clocks import Event, Sensor
from obsdesign.problem.file import read_problem_file
from obsdesign.problem.flow import Flow
from obsdesign.problem.modes import Mode
from obsdesign.problem.named_gains import nested, refuse_triggers
from obsdesign.problem.options_base import Options
from obsdesign.problem.output import Output
from obsdesign.problem.parameters import Parameter, StateBox
from obsdesign.problem.plain import as_block, entries_of
from obsdesign.problem.plant import Jump, Plant
from obsdesign.problem.schema_errors import check_structure
from obsdesign.problem.signal_names import SignalNames
from obsdesign.problem.timing import Timing

Blocks = Entries
_Options = TypeVar("_Options", bound=Options)

_KEYS = (
    "name", "flow", "jump", "output", "event", "sensor", "mode", "timing", "parameter", "state",
    "names", "observer",
)  # fmt: skip


@dataclass(frozen=True, init=False, repr=False, eq=False)
class Problem:
    """A plant, an observer kind (None: not chosen), gains that are kept, options. Read-only.

    Blocks are dataclasses of `obsdesign.problem.plant` or dicts with the keys of a problem file
    (docs/problem_file.md); arrays may be numpy arrays. event, sensor: lists of blocks, in place of
    jump and output where there are several, or they have clocks of their own; mode: list of blocks
    of flows that take turns; timing: block of what clocks have in common; parameter: list of blocks
    of numbers known up to a range; state: block of bounds of x; names: block of what signals are
    called, and their units. gains: by name, in the shapes of
    the kind (L (n, p), M (n, p), ...). InputError for anything a problem file may not hold; one
    line, which entry, what was required, what arrived.
    """

    name: str
    plant: Plant
    names: SignalNames
    kind: str | None
    gains: Mapping[str, Matrix]
    options: Options

    def __init__(
        self,
        flow: Flow | Blocks,
        output: Output | Blocks | None = None,
        jump: Jump | Blocks | None = None,
        observer: Blocks | None = None,
        name: str = "plant",
        *,
        event: Sequence[Event | Blocks] | None = None,
        sensor: Sequence[Sensor | Blocks] | None = None,
        mode: Sequence[Mode | Blocks] | None = None,
        timing: Timing | Blocks | None = None,
        parameter: Sequence[Parameter | Blocks] | None = None,
        state: StateBox | Blocks | None = None,
        names: SignalNames | Blocks | None = None,
    ) -> None:
        plain: NewEntries = {"name": name, "flow": flow, "output": output, "jump": jump}
        plain |= {"event": event, "sensor": sensor, "mode": mode, "timing": timing}
        plain |= {"parameter": parameter, "state": state, "names": names, "observer": observer}
        body: NewEntries = {
            key: as_block(value)
            for key, value in plain.items()
            if value is not None or key in ("name", "flow")
        }
        check_structure(body)
        _check_name(body["name"])
        plant = _plant(body)
        block = dict(body.get("observer", {}))
        kind = block.pop("kind", None)
        gains = observer_options.gains(block.pop("gains", {}), kind, plant)
        refuse_triggers(plant, gains)
        options = observer_options.options(block, kind, plant)
        signals = SignalNames(**body.get("names", {}))
        signals.check(plant)
        self.__dict__.update(
            name=name, plant=plant, names=signals, kind=kind, gains=MappingProxyType(gains),
            options=options,
        )  # fmt: skip

    def __reduce__(self) -> tuple[object, ...]:
        return Problem.from_dict, (self.to_dict(),)  # a copy is read-only too

    def __repr__(self) -> str:
        return f"Problem({self.name!r}, kind={self.kind!r}, n={self.plant.n}, p={self.plant.p})"

    def _repr_html_(self) -> str:
        body = self.to_dict()
        rows = [(key, entry) for key, entry in body.items() if key != "name"]
        return html_table((self.name, "entries"), rows)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Problem) and self.to_dict() == other.to_dict()

    @staticmethod
    def from_dict(body: Value) -> Problem:
        """A problem from parsed TOML or JSON."""
        body = as_block(body)
        if not isinstance(body, dict) or not {"flow"} <= set(body) <= set(_KEYS):
            check_structure(body)  # says what is wrong with the top level
        return Problem(**body)

    def to_dict(self) -> NewEntries:
        """The normalised problem, JSON-ready: defaults filled in, infinity as "inf".

        A noise bound that is absent stays absent: no kind may take it for zero.
        """
        plant = self.plant
        blocks: NewEntries = {"flow": plant.flow}
        if self.plant.has_tables:
            blocks |= {"event": plant.events or None, "sensor": plant.sensors}
        else:
            blocks |= {"jump": plant.jump, "output": plant.output}
        blocks |= {"mode": plant.modes or None}
        blocks |= {"timing": plant.timing if plant.timing.spacing else None}
        blocks |= {"parameter": plant.stated_parameters or None, "state": plant.state}
        body: NewEntries = {"name": self.name}
        body |= {name: as_block(block) for name, block in blocks.items() if block is not None}
        if stated_names := as_block(self.names):
            body["names"] = stated_names
        observer = {} if self.kind is None else {"kind": self.kind}
        stated = self.options.to_document()
        if observer or self.gains or stated:
            body["observer"] = observer | {"gains": nested(self.gains)} | stated
        result: NewEntries = jsonable(body)
        return result

    def options_as(self, kind_options: type[_Options]) -> _Options:
        """The options as those of one kind; TypeError where the problem is of another."""
        if not isinstance(self.options, kind_options):
            raise TypeError(f"a problem of kind {self.kind!r} has no {kind_options.__name__}")
        return self.options

    def require_kind(self) -> str:
        """The observer kind, or InputError that names the kinds."""
        if self.kind is None:
            raise InputError(
                f"observer.kind is required; it is missing. It is one of {', '.join(KINDS)}; "
                "`obsdesign check` lists which of them fit this plant."
            )
        return self.kind

    def reason_without(self, *entries: str, needed_by: str = "") -> str | None:
        """Reason against a problem that lacks one of these entries, or None; one sentence.

        entries: optional ones, as "flow.D", "jump", "jump.H"; needed_by: what requires them, the
        kind unless it is given.
        """
        needed_by = needed_by or f"kind {self.kind!r}"
        return self.plant.reason_without(*entries, needed_by=needed_by)

    def reason_unless_measured(self, *fitting: str) -> str | None:
        """Reason against a problem that is not measured in one of these ways, or None."""
        sensor = self.plant.output
        if sensor.measured in fitting:
            return None
        return f"{sensor.required_clock(fitting)} for kind {self.kind!r}; got {sensor.own_clock}."

    def require(self, entry: str, needed_by: str = "") -> Value:
        """Value of an optional entry, or DoesNotApply with what `reason_without` says."""
        if reason := self.reason_without(entry, needed_by=needed_by):
            raise DoesNotApply(reason, entry)
        return attrgetter(entry)(self.plant)

    def require_dwell_time(self) -> tuple[float, float]:
        """(shortest, longest) dwell time, or DoesNotApply where the problem has none."""
        low, high = self.require("jump.dwell_time")
        return low, high

    def require_noise_bound(self, needed_by: str = "") -> Matrix:
        """Half-widths of the bounds of the noise, (p,), or DoesNotApply where it has none."""
        if reason := self.reason_without_noise_bound(needed_by):
            raise DoesNotApply(reason, "output.noise_bound")
        radius = self.plant.outputs.noise_radius
        assert radius is not None
        return radius

    def reason_without_noise_bound(self, needed_by: str = "") -> str | None:
        """Reason against a problem without bounds of the noise of every sensor, or None."""
        needed_by = needed_by or f"kind {self.kind!r}"
        for sensor in self.plant.sensors:
            if sensor.noise_bound is None:
                zeros = ", ".join(["0.0"] * len(sensor.C))
                hint = f" If y is free of noise, write noise_bound = [{zeros}]."
                needed_by += ", which guarantees bounds"
                return missing_entry(f"{sensor.entry}.noise_bound", needed_by) + hint
        return None

    def require_measured(self, *fitting: str) -> None:
        """DoesNotApply unless the output is measured in one of these ways."""
        if reason := self.reason_unless_measured(*fitting):
            raise DoesNotApply(reason, "output.measured")

    def with_dwell_time(self, low: float, high: float) -> Problem:
        """The same problem for another range of dwell times."""
        body = self.to_dict()
        if self.plant.has_tables:
            body["event"][0]["every"] = jsonable([low, high])
        else:
            body["jump"]["dwell_time"] = jsonable([low, high])
        return Problem.from_dict(body)

    @cached_property
    def in_modes(self) -> tuple[Problem, ...]:
        """A problem for each mode: its plant without changes of mode, and its gains."""
        observer = self.to_dict().get("observer", {})
        problems = []
        for place, mode in enumerate(self.plant.modes):
            plant = self.plant.in_mode(place)
            blocks: NewEntries = {"flow": plant.flow}
            names = ("sensor", plant.sensors) if plant.has_tables else ("output", plant.output)
            blocks |= {names[0]: names[1]}
            gains = {**observer.get("gains", {}), **mode.gains}
            body = {key: as_block(block) for key, block in blocks.items()}
            problems.append(Problem(**body, observer={**observer, "gains": gains}, name=self.name))
        return tuple(problems)

    def for_kind(self, kind: str) -> tuple[Problem, list[str]]:
        """The same plant for another kind, and the gains and options that were dropped."""
        observer, dropped = observer_options.for_kind(self.to_dict().get("observer", {}), kind)
        return Problem.from_dict(self.to_dict() | {"observer": observer}), dropped


def load_problem(path: str | os.PathLike[str]) -> Problem:
    """Read a problem file: JSON by its suffix .json, else TOML.

    InputError, with file and entry or line, where it cannot be read or states no problem.
    """
    return load_for_kind(path, None)[0]


def load_for_kind(path: str | os.PathLike[str], kind: str | None) -> tuple[Problem, list[str]]:
    """Read a problem file for a kind, whatever kind it names; also the entries dropped.

    Unlike `load_problem` then `for_kind`, this reads files that hold entries of several kinds.
    """
    body = read_problem_file(path)
    dropped: list[str] = []
    if kind is not None and isinstance(body, dict) and isinstance(body.get("observer", {}), dict):
        observer, dropped = observer_options.for_kind(body.get("observer", {}), kind)
        body |= {"observer": observer}
    with naming(path):
        return Problem.from_dict(body), dropped


def _plant(body: Entries) -> Plant:
    """The plant of a problem as plain dicts and lists."""
    listed = [Mode(**entries_of(block)) for block in body.get("mode", ())]
    given = entries_of(body["flow"])
    if "A" not in given:
        given["A"] = _first_of_all(body["mode"])
    flow = Flow(**given)
    timing = Timing(**body.get("timing", {}))
    parameters = [Parameter(**block) for block in body.get("parameter", ())]
    state = StateBox(**body["state"]) if "state" in body else None
    if "sensor" not in body:
        jump = Jump(**entries_of(body["jump"])) if "jump" in body else None
        return Plant(flow, jump, Output(**body["output"]), listed, timing, parameters, state)
    events = [Event(**entries_of(block)) for block in body.get("event", ())]
    sensors = [Sensor(**entries_of(block)) for block in body["sensor"]]
    check_clocks(events, sensors)
    return Plant(flow, events, sensors, listed, timing, parameters, state)


def _first_of_all(modes: Sequence[Blocks]) -> Value:
    """A of the first mode, in place of flow.A, where every mode has its own; else InputError."""
    for block in modes:
        if "A" not in block:
            raise InputError(
                f"flow.A is required, since mode.{block['name']} has no A; it is missing."
            )
    return modes[0]["A"]


def _check_name(name: str) -> None:
    try:
        name.encode("utf-8")
    except UnicodeEncodeError:
        raise InputError(f"name must be text that UTF-8 can hold; got {name!r}.") from None
