"""The output of a plant: what one sensor measures, its noise, and when."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from lmi.arithmetic.arrays import Matrix, Value
from obsdesign.column_names import numbered
from obsdesign.entries import matrix, missing_entry, positive, real
from obsdesign.equations.noise_bounds import noise_box
from obsdesign.errors import InputError
from obsdesign.problem.blocks import Block, radius_matrix, set_fields
from obsdesign.problem.noise import noise_numbers, noise_pairs
from obsdesign.problem.schema import POSITIVE, file_entry, one_of, ref

MEASURED = ("continuous", "periodic", "at_jumps")
# of a sensor with a clock that is none of these
IRREGULAR = "irregular"
JUMP_MEASUREMENTS = ("before", "after", "none")
# what is left out: __post_init__ fills it in
_DEFAULT: Value = None
# entries of several sensors that stand one above the other
_STACKED = ("C", "noise_std", "noise_cv")


@dataclass(frozen=True, eq=False)
class Output(Block):
    """The output y = C x + v, |v_i| <= noise_bound_i: the noise v, and when y is measured.

    C (p, n); noise_bound (p,), or (p, 2) of pairs [lower, upper], or None: not known, which is not
    zero; noise_std, noise_cv (p,): standard deviation noise_std_i + noise_cv_i |y_i|, zero by
    default. One number serves all outputs; a number among pairs is a pair.

    measured: continuous, periodic (with period, in the unit of time of flow.A) or at_jumps;
    jump_measurement: at a jump y is that of the state before or after it, or there is none.
    C_radius (p, n): a parameter for each entry of C, None where C is known.
    InputError as for `Flow`.
    """

    name = "output"
    is_named: ClassVar[bool] = False
    C: Matrix = file_entry(ref("matrix"), "p x n.")
    noise_bound: Matrix | None = file_entry(
        ref("noise_bound"),
        "|v_i| <= noise_bound_i, or lower <= v_i <= upper where that is a pair, at every instant; "
        "required by kinds that guarantee bounds. Absent: not known.",
        default=None,
    )
    noise_std: Matrix = file_entry(
        ref("per_output"), "Standard deviation of v_i.", default=_DEFAULT
    )
    noise_cv: Matrix = file_entry(
        ref("per_output"), "Part of the deviation proportional to |y_i|.", default=_DEFAULT
    )
    measured: str = file_entry(
        one_of(*MEASURED),
        "When y is available: always, every period, or at jump times only; default continuous.",
        default="continuous",
    )
    period: float | None = file_entry(
        POSITIVE, "Time between samples; required when measured is periodic.", default=None
    )
    jump_measurement: str = file_entry(
        one_of(*JUMP_MEASUREMENTS),
        "Whether a measurement at a jump time is taken before or after the jump, or is missing "
        "(none); default before.",
        default="before",
    )
    C_radius: Matrix | None = file_entry(
        ref("matrix"), "p x n: each entry of C is known up to so much.", default=None
    )

    @property
    def entry(self) -> str:
        """What messages call it."""
        return self.name

    def check_measurement(self) -> None:
        """InputError unless C is a matrix and the noise fits it; arrays from now on."""
        C = matrix(self.C, f"{self.entry}.C")
        set_fields(self, C=C)
        if self.C_radius is not None:
            radius = radius_matrix(self.C_radius, f"{self.entry}.C_radius", C.shape, "as output.C")
            set_fields(self, C_radius=radius)
        if self.noise_bound is not None:
            pairs = noise_pairs(self.noise_bound, C, self.entry)
            if pairs is None:
                pairs = noise_numbers(self.noise_bound, C, f"{self.entry}.noise_bound")
            set_fields(self, noise_bound=pairs)
        for name in ("noise_std", "noise_cv"):
            values, entry = getattr(self, name), f"{self.entry}.{name}"
            set_fields(self, **{name: noise_numbers(0.0 if values is None else values, C, entry)})

    def __post_init__(self) -> None:
        self.check_measurement()
        for name, words in (("measured", MEASURED), ("jump_measurement", JUMP_MEASUREMENTS)):
            if getattr(self, name) not in words:
                raise InputError(
                    f"output.{name} must be one of {', '.join(words)}; got {getattr(self, name)!r}."
                )
        if self.measured == "at_jumps" and self.jump_measurement == "none":
            raise InputError(
                "output.jump_measurement must be before or after when measured = 'at_jumps'; "
                "got 'none', which leaves no measurement at all."
            )
        if self.period is not None:
            set_fields(self, period=positive(real(self.period, "output.period"), "output.period"))
        elif self.measured == "periodic":
            raise InputError(missing_entry("output.period", "output.measured = 'periodic'"))

    @property
    def noise_centre(self) -> Matrix | None:
        """Middle of the bounds of v, (p,); None where they are symmetric or not known."""
        return None if self.noise_bound is None else noise_box(self.noise_bound)[0]

    @property
    def noise_radius(self) -> Matrix | None:
        """Half the width of the bounds of v, (p,), rounded up; None where they are not known."""
        return None if self.noise_bound is None else noise_box(self.noise_bound)[1]

    @property
    def columns(self) -> tuple[str, ...]:
        """Its columns in a data file."""
        return numbered("y", len(self.C))

    @property
    def gap(self) -> float:
        """Longest time between two samples; 0 where every row has one, infinite if not bounded."""
        if self.measured == "continuous":
            return 0.0
        return math.inf if self.period is None else self.period

    @property
    def sends_on_change(self) -> Matrix | None:
        """Changes (p,) at which it sends a sample; None where it does not send on change."""
        return None

    @property
    def event(self) -> str | None:
        """Name of the event at which alone it is read; None where it has a clock of its own."""
        return "jump" if self.measured == "at_jumps" else None

    def required_clock(self, fitting: Sequence[str]) -> str:
        """Sentence without its end: how its file says that it is measured in one of these ways."""
        return f"output.measured must be {' or '.join(fitting)}"

    @property
    def own_clock(self) -> str:
        """When it is measured, as its file has it."""
        return repr(self.measured)

    @property
    def stated_times(self) -> tuple[tuple[str, tuple[float, ...]], ...]:
        """Entries that hold times of its clock, each with these."""
        return () if self.period is None else (("period", (self.period,)),)

    def at_every_step(self, dt: float) -> Self:
        """The same sensor, read at every step of discrete time."""
        return replace(self, measured="periodic", period=dt)

    @property
    def sample_period(self) -> float:
        """Time between samples; 1 where none is stated."""
        return 1.0 if self.period is None else self.period

    @property
    def sample_spacing(self) -> float:
        """Time between samples; 0 where none is stated."""
        return 0.0 if self.period is None else self.period


def every_step(sensor: Output, dt: float) -> Output:
    """A sensor of a plant in discrete time: what is read always is read at every step."""
    return sensor.at_every_step(dt) if sensor.measured == "continuous" else sensor


def check_sends_on_change(
    sensors: Sequence[Output], dt: float | None, uncertain: Sequence[str]
) -> None:
    """InputError where discrete time, uncertain events or sensors that send on change meet.

    dt: step of discrete time; uncertain: names of the events whose time stamps have an error.
    """
    senders = [sensor.entry for sensor in sensors if sensor.sends_on_change is not None]
    for entry in senders if dt is not None else ():  # a reading changes from step to step
        raise InputError(f"{entry}.sends_on_change is not available with flow.dt.")
    for name in uncertain:
        beside = ["flow.dt"] if dt is not None else [f"{s}.sends_on_change" for s in senders]
        for entry in beside:
            raise InputError(f"event.{name}.time_error is not available with {entry}.")


def stacked(sensors: Sequence[Output]) -> Output:
    """Outputs of several sensors, one above the other; of one that sensor itself.

    When each is measured the sensors themselves say. All noise bounds are known, or none is.
    """
    if len(sensors) == 1:
        return sensors[0]
    bounds = [sensor.noise_bound for sensor in sensors]
    has_pairs = any(bound is not None and bound.ndim == 2 for bound in bounds)
    known = [
        np.column_stack([-bound, bound]) if has_pairs and bound.ndim == 1 else bound
        for bound in bounds
        if bound is not None
    ]
    for sensor, bound in zip(sensors, bounds, strict=True):
        if bound is None and known:
            raise InputError(
                f"{sensor.entry}.noise_bound is required where another sensor has one; it is "
                "missing."
            )
    C, std, cv = (np.concatenate([getattr(x, name) for x in sensors]) for name in _STACKED)
    return Output(C, np.concatenate(known) if known else None, std, cv)
