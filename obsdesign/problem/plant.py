"""A linear plant that may jump: frozen values, validated once, arrays read-only.

    x'(t) = A x + B u(t) + D d(t) + b(t)      between jumps,  lower <= b <= upper
    x(t)  = G x(t-) + E w[k] + H g[k] + c[k]  at jump times,  lower <= c <= upper
                      with a disturbance_matrix Bw: b = Bw w,  lower <= w <= upper, likewise c
                      in discrete time, with a step dt: x(t + dt) = A x(t) + B u(t) + D d(t) + b(t)
    y     = C x + v,  |v_i| <= noise_bound_i, or lower_i <= v_i <= upper_i where that is a pair;
                      standard deviation noise_std_i + noise_cv_i |y_i|

Every InputError names the entry as it stands in a problem file. Fields take anything numpy can read
as an array and hold float64 arrays; None leaves an optional one out, or takes its default.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Matrix, Value
from obsdesign.column_names import JUMP
from obsdesign.entries import matrix, missing_entry, real, require_shape, size_text
from obsdesign.errors import InputError, naming
from obsdesign.problem.blocks import DISTURBANCE, DisturbedBlock, set_fields
from obsdesign.problem.flow import Flow
from obsdesign.problem.modes import Mode, check_events_of_modes, check_modes
from obsdesign.problem.output import IRREGULAR, Output, check_sends_on_change, every_step, stacked
from obsdesign.problem.parameters import Parameter, StateBox, check_parameters, radius_parameters
from obsdesign.problem.schema import DWELL_RANGE, file_entry, ref
from obsdesign.problem.several_clocks import require_fixed, require_one
from obsdesign.problem.time_ranges import require_on_grid, time_range
from obsdesign.problem.timing import Timing

# what is left out: __post_init__ fills it in, and for a jump the plant, which knows the sizes
_DEFAULT: Value = None
# how messages write an entry
_WRITTEN = {"jump": "[jump]", "jump.dwell_time": "jump.dwell_time = [shortest, longest]"}


@dataclass(frozen=True, eq=False)
class Jump(DisturbedBlock):
    """The jump x(t) = G x(t-) + E w[k] + H g[k] + c[k], lower <= c[k] <= upper.

    G (n, n): None for the identity; E (n, l): known jump input; H (n, r): directions of impulses of
    unknown weights g; lower, upper (n,): zero by default. With a disturbance_matrix W (n, k),
    c = W w and lower, upper (k,) are bounds of w. dwell_time: (shortest, longest) time between
    jumps, the longest may be infinite; dwell_jitter: largest change from one dwell time to the
    next. Times in the unit of flow.A. G_radius (n, n): a parameter for each entry of G, None where
    G is known; input_bound (l,): largest |w|, None where not stated. InputError as for `Flow`.
    """

    name = "jump"
    G: Matrix = file_entry(ref("matrix"), "n x n; default identity.", default=_DEFAULT)
    E: Matrix | None = file_entry(ref("matrix"), "Known jump input w.", default=None)
    H: Matrix | None = file_entry(
        ref("matrix"), "Directions of impulses with unknown weights g.", default=None
    )
    lower: Matrix = file_entry(
        ref("bounds"), DISTURBANCE.format("c[k]"), default=_DEFAULT, name="disturbance"
    )
    upper: Matrix = _DEFAULT
    dwell_time: tuple[float, float] | None = file_entry(
        DWELL_RANGE, "Shortest and longest time between jumps.", default=None
    )
    dwell_jitter: float = file_entry(
        ref("upper_end"), "Largest change from one dwell time to the next.", default=math.inf
    )
    disturbance_matrix: Matrix | None = file_entry(
        ref("matrix"), "n x k: c = W w, and disturbance bounds w.", default=None
    )
    G_radius: Matrix | None = file_entry(
        ref("matrix"), "n x n: each entry of G is known up to so much.", default=None
    )
    input_bound: Matrix | None = file_entry(
        ref("vector"), "l: largest |w| of each known input, for claims about widths.", default=None
    )
    stamp_error: float = field(default=0.0, init=False)  # of events, as modes
    modes: tuple[str, ...] | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        self.check_map()
        jitter = real(self.dwell_jitter, "jump.dwell_jitter")
        if not jitter >= 0:
            raise InputError(f"jump.dwell_jitter must be a number >= 0 or inf; got {jitter!r}.")
        dwell_time = time_range(self.dwell_time, f"{self.entry}.dwell_time", "dwell time")
        set_fields(self, dwell_time=dwell_time, dwell_jitter=jitter)

    @property
    def entry(self) -> str:
        """What messages call it."""
        return self.name

    @property
    def stated_times(self) -> tuple[tuple[str, tuple[float, ...]], ...]:
        """Entries that hold times of its clock, each with these."""
        return (("dwell_time" if self.entry == "jump" else "every", self.dwell_time or ()),)

    @property
    def inputs(self) -> int:
        """Number of known inputs w."""
        return 0 if self.E is None else int(self.E.shape[1])

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns of a data file that say when it happens."""
        return (JUMP,)

    def check_map(self) -> None:
        """InputError unless G is square where it is given; a matrix from now on."""
        if self.G is not None:
            G = matrix(self.G, f"{self.entry}.G")
            if G.shape[0] != G.shape[1]:
                raise InputError(f"{self.entry}.G must be square; got {size_text(G)}.")
            set_fields(self, G=G)

    def completed(self, n: int, why: str) -> Self:
        """The jump of a plant with n states: identity and zero bounds filled in, sizes checked."""
        G = np.eye(n) if self.G is None else self.G
        G = matrix(G, f"{self.entry}.G")
        require_shape(G, f"{self.entry}.G", (n, n), why)
        names = ("E", "H", "disturbance_matrix")
        inputs = self.matrices(self.entry, names, n, why.removeprefix("one per state of "))
        lower, upper = self.checked_bounds(self.entry, n)
        inputs |= self.known_sizes(self.entry, "G", "E", n)
        result = copy(self)
        set_fields(result, G=G, lower=lower, upper=upper, **inputs)
        return result

    @property
    def c_bounds(self) -> tuple[Matrix, Matrix]:
        """(lower, upper) of c, (n,): the box around all W w, rounded outward."""
        return self.disturbance_box()


@dataclass(frozen=True, init=False)
class Plant:
    """Flow, events and sensors of n states and p measurements, those of all sensors together.

    jump: one jump, its several events, or None: the plant never jumps; output: one, or several
    sensors; modes: flows that take turns, none by default; timing: what clocks have in common;
    parameters: numbers known up to a range; state: box of x that the user vouches for. InputError
    where their sizes differ, or y is measured at jumps and there are none.
    """

    flow: Flow
    events: tuple[Jump, ...]
    sensors: tuple[Output, ...]
    modes: tuple[Mode, ...]
    timing: Timing
    stated_parameters: tuple[Parameter, ...]
    state: StateBox | None
    n: int
    p: int

    def __init__(
        self,
        flow: Flow,
        jump: Jump | Sequence[Jump] | None,
        output: Output | Sequence[Output],
        modes: Sequence[Mode] = (),
        timing: Timing | None = None,
        parameters: Sequence[Parameter] = (),
        state: StateBox | None = None,
    ) -> None:
        n, why = len(flow.A), f"one per state of flow.A ({size_text(flow.A)})"
        listed = (jump,) if isinstance(jump, Jump) else tuple(jump or ())
        sensors = (output,) if isinstance(output, Output) else tuple(output)
        for sensor in sensors:
            require_shape(sensor.C, f"{sensor.entry}.C", (None, n), why)
        events = tuple(event.completed(n, why) for event in listed)
        if sensors[0].measured == "at_jumps" and not events:
            raise InputError(missing_entry("[jump]", "output.measured = 'at_jumps'"))
        if flow.dt is not None:
            sensors = tuple(every_step(sensor, flow.dt) for sensor in sensors)
            require_on_grid((*events, *sensors), flow.dt)
        p = sum(len(sensor.C) for sensor in sensors)
        set_fields(self, flow=flow, events=events, sensors=sensors, modes=tuple(modes), n=n, p=p)
        set_fields(self, timing=timing or Timing())
        check_sends_on_change(sensors, flow.dt, self.uncertain_events)
        if modes:
            self._check_modes()
        check_events_of_modes(self.modes, events)
        ends = [event.dwell_time[1] for event in events if event.dwell_time and not modes]
        longest = [end for end in ends if math.isfinite(end)]
        self.timing.check(len(events), flow.dt, self.uncertain_events, longest)
        set_fields(self, stated_parameters=tuple(parameters), state=state)
        check_parameters(self)

    def _check_modes(self) -> None:
        flow, sensors = self.flow, self.sensors
        has_jump = bool(self.events) and not self.has_tables
        check_modes(self.modes, has_jump=has_jump, has_steps=flow.dt is not None)
        m = 0 if flow.B is None else flow.B.shape[1]
        for mode in self.modes:
            if mode.C is not None and len(sensors) > 1:
                raise InputError(f"{mode.entry}.C requires one sensor; got {len(sensors)}.")
            mode.check_sizes(self.n, self.p, m, len(flow.lower))
            self.in_mode(self.modes.index(mode))

    def in_mode(self, place: int, *, entered: bool = False) -> Plant:
        """The plant as it is in one mode, without any change of it, and any time between events.

        entered: with the map on entry, where there is one, in place of all events.
        """
        mode, flow, sensors = self.modes[place], self.flow, self.sensors
        own = {key: getattr(mode, key) for key in ("A", "B", "lower", "upper")}
        stated = {key: value for key, value in own.items() if value is not None}
        with naming(mode.entry):
            flow = replace(flow, **stated)
            if mode.C is not None:
                sensors = (replace(sensors[0], C=mode.C),)
        if not entered:
            events = [replace(event, modes=None) for event in self.events]
            return Plant(flow, events, sensors)
        return Plant(flow, None if mode.entry_map is None else Jump(G=mode.entry_map), sensors)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """All that is known up to a range: those stated, and one for each entry of a radius."""
        return (*self.stated_parameters, *radius_parameters(self.flow, self.events, self.sensors))

    @property
    def jump(self) -> Jump | None:
        """The one event, None without any; DoesNotApply where there are several."""
        require_one("event", [event.name for event in self.events])
        return self.events[0] if self.events else None

    @property
    def output(self) -> Output:
        """The one sensor; DoesNotApply where there are several, or it keeps no fixed time."""
        require_one("sensor", [sensor.name for sensor in self.sensors])
        require_fixed(self.sensors[0].name, self.sensors[0].measured != IRREGULAR)
        return self.sensors[0]

    @cached_property
    def outputs(self) -> Output:
        """Outputs of all sensors, one above the other; when they are measured each one says."""
        return stacked(self.sensors)

    @cached_property
    def has_one_clock(self) -> bool:
        """Are `jump` and `output` all that there is?"""
        fixed = self.sensors[0].measured != IRREGULAR and not self.uncertain_events
        return len(self.events) <= 1 and len(self.sensors) == 1 and fixed

    @cached_property
    def needs_clock_gains(self) -> bool:
        """Does kind `interval` have a gain for each clock: several of them, or discrete time?"""
        return not self.has_one_clock or self.flow.dt is not None

    @property
    def uncertain_events(self) -> tuple[str, ...]:
        """Names of the events whose time stamps have an error."""
        return tuple(event.name for event in self.events if event.stamp_error)

    @property
    def has_tables(self) -> bool:
        """Is it of [[event]] and [[sensor]] in a file, and not of [jump] and [output]?"""
        return self.sensors[0].is_named

    @cached_property
    def sees_after(self) -> NDArray[np.bool_]:
        """(p,): does an output see the state after an event?"""
        sees = [sensor.jump_measurement == "after" for sensor in self.sensors]
        return np.repeat(sees, [len(sensor.C) for sensor in self.sensors])

    def reason_without(self, *entries: str, needed_by: str) -> str | None:
        """Reason against a plant that lacks one of these entries, or None; one sentence.

        entries: optional ones, as "flow.D", "jump", "jump.H"; needed_by: what requires them.
        """
        for entry in entries:
            value: Value = self
            for name in entry.split("."):
                value = getattr(value, name)
                if value is None:
                    absent = self.stated(name) if name == "jump" and name != entry else "it"
                    return missing_entry(self.stated(entry), needed_by, absent)
        return None

    def stated(self, entry: str) -> str:
        """The name of an entry, of [jump] or [output] too, in the plant's own file."""
        block, _, key = entry.partition(".")
        if not self.has_tables or block not in ("jump", "output"):
            return _WRITTEN.get(entry, entry)
        if block == "jump" and not self.events:
            return "[[event]]"
        owner = self.events[0] if block == "jump" else self.sensors[0]
        return f"{owner.entry}.{'every' if key in ('dwell_time', 'period') else key}"
