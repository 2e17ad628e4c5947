"""Gains of the observer of unknown impulses: entries of designs of `impulsive_input`."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar, Self, TypeGuard

import numpy as np

from lmi.arithmetic.arrays import Entries, Matrix, NewEntries, Value
from obsdesign.equations.gains import PlantGains
from obsdesign.equations.plant import Plant
from obsdesign.equations.stored import flag, matrix, number, word

WEIGHTINGS = ("plain", "gls")
RULES = ("peak", "position", "threshold")
# what is measured and its noise are squared, and multiplied by gains
LARGEST, SMALLEST = 1e100, 1e-100

# of e^x in binary64, with room for products of a few such numbers
MAX_GROWTH_EXPONENT = 300.0


@dataclass(frozen=True, kw_only=True, eq=False)
class ImpulsiveInputGains(PlantGains):
    """Entries of both operators.

    H (n, q): directions of the impulses; window, margin: length of a window and the youngest age
    that is evaluated; period: of the samples, None where y is measured continuously; noise_std,
    noise_cv (p,): constant and proportional deviations; initial_std (n,): of the initial state.
    Designs without nonnegative or state_correction mean false.
    """

    H: Matrix = matrix("n", "q")
    window: float = number()
    margin: float = number()
    period: float | None = number(optional=True)
    noise_std: Matrix = matrix("p")
    noise_cv: Matrix = matrix("p")
    initial_std: Matrix | None = matrix("n", optional=True)
    weighting: str = word(*WEIGHTINGS)
    nonnegative: bool | None = flag(optional=True)
    state_correction: bool | None = flag(optional=True)

    # entries behind those of the plant, as design files list them
    _FILE_ORDER: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.dwell_time is None:
            raise ValueError("gains.dwell_time must have shape 2; got nothing.")
        if self.initial_std is not None and not (self.initial_std >= 0).all():
            raise ValueError("gains.initial_std must be >= 0.")
        noisy = (self.noise_std > 0) | (self.noise_cv > 0)
        if noisy.any() and not noisy.all():
            raise ValueError("gains.noise_std must be > 0 for every output or for none.")
        for name in ("window", "margin"):
            if not is_positive(getattr(self, name)):
                raise ValueError(f"gains.{name} must be a positive number.")

    def to_document(self) -> NewEntries:
        """Entries of a design file, without those that the design does not have."""
        entries = super().to_document()
        places = {name: place for place, name in enumerate(self._FILE_ORDER)}
        return dict(sorted(entries.items(), key=lambda entry: places.get(entry[0], -1)))

    @classmethod
    def from_plant(cls, plant: Plant, **gains: Value) -> Self:
        """Gains with the numbers of a plant, its impulses and its noise."""
        output, H = plant.output, None if plant.jump is None else plant.jump.H
        return super().from_plant(
            plant, H=H, noise_std=output.noise_std, noise_cv=output.noise_cv, **gains
        )

    @property
    def directions(self) -> int:
        """Number of columns of H."""
        return int(self.H.shape[1])

    @property
    def inputs(self) -> int:
        """Number of columns of B."""
        return int(self.input_matrix.shape[1])

    @property
    def noisy(self) -> bool:
        """Whether outputs have noise."""
        return bool(((self.noise_std > 0) | (self.noise_cv > 0)).any())

    @property
    def shortest_dwell(self) -> float:
        """Shortest time between two impulses."""
        return self.dwell_range[0]

    @property
    def input_matrix(self) -> Matrix:
        """B (n, m), without columns where the plant has no known input."""
        return np.zeros((self.n, 0)) if self.B is None else self.B


@dataclass(frozen=True, kw_only=True, eq=False)
class IntegralGains(ImpulsiveInputGains):
    """Operator `integral`: K (n, p), exponents (m,) of the kernels, and when to evaluate.

    threshold: |R| above which rule `threshold` evaluates. output_units (p,): in which outputs stand
    beside each other in R, `output_units`; None for one output, and in designs of old, whose R is
    that of y as it is.
    """

    operator: str = word("integral")
    K: Matrix = matrix("n", "p")
    exponents: Matrix = matrix("kernels")
    rule: str = word(*RULES)
    threshold: float | None = number(optional=True)
    output_units: Matrix | None = matrix("p", optional=True)

    _FILE_ORDER: ClassVar[tuple[str, ...]] = (
        "H", "window", "margin", "noise_std", "noise_cv", "nonnegative", "initial_std", "period",
        "threshold", "K", "weighting", "operator", "state_correction", "exponents", "rule",
        "output_units",
    )  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        if not are_exponents(self.exponents):
            raise ValueError("gains.exponents must be distinct, finite numbers, one or more.")
        if not self.exponents.max() * self.window < MAX_GROWTH_EXPONENT:
            raise ValueError(
                f"gains.exponents times gains.window must be below {MAX_GROWTH_EXPONENT:g}: floats "
                f"cannot hold what grows further; got {self.exponents.max() * self.window:g}."
            )
        if self.output_units is not None and not (self.output_units > 0).all():
            raise ValueError("gains.output_units must be positive.")

    def in_output_units(self) -> Self:
        """The gains for outputs in their units, the same observer of y / output_units."""
        units = self.output_units
        if units is None:
            return self
        return replace(
            self, C=self.C / units[:, None], K=self.K * units, noise_std=self.noise_std / units,
            noise_bound=None if self.noise_bound is None else self.noise_bound / units,
            noise_centre=None if self.noise_centre is None else self.noise_centre / units,
            output_units=None,
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class SamplesGains(ImpulsiveInputGains):
    """Operator `samples`: the window is a multiple of the period of the samples."""

    operator: str = word("samples")

    _FILE_ORDER: ClassVar[tuple[str, ...]] = (
        "H", "noise_std", "noise_cv", "period", "margin", "weighting", "operator",
        "state_correction", "nonnegative", "initial_std", "window",
    )  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        if not is_positive(self.period):
            raise ValueError("gains.period must be a positive number for operator 'samples'.")
        if not is_whole_multiple(self.window, self.sample_period):
            raise ValueError("gains.window must be a multiple of gains.period.")

    @property
    def sample_period(self) -> float:
        """Period of the samples, which this operator always has."""
        assert self.period is not None
        return self.period

    @property
    def window_samples(self) -> int:
        """Samples of a window after its first one."""
        return round(self.window / self.sample_period)


OPERATORS: dict[str, type[IntegralGains] | type[SamplesGains]] = {
    "integral": IntegralGains,
    "samples": SamplesGains,
}


def gains_from_document(entries: Entries) -> IntegralGains | SamplesGains:
    """The gains that a design file states, of the class of their operator; ValueError if unfit."""
    operator = entries.get("operator")
    if operator not in OPERATORS:
        raise ValueError(f"gains.operator must be one of {', '.join(OPERATORS)}.")
    return OPERATORS[operator].from_document(entries)


def is_positive(value: object) -> TypeGuard[float]:
    """A positive, finite number."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return value > 0 and math.isfinite(value)


def are_exponents(value: object) -> bool:
    """A list of one or more distinct, finite numbers."""
    try:
        exponents = np.asarray(value)
    except ValueError:
        return False
    if exponents.ndim != 1 or exponents.dtype.kind not in "fi" or len(exponents) == 0:
        return False
    return bool(np.isfinite(exponents).all()) and len(set(exponents.tolist())) == len(exponents)


def is_whole_multiple(window: float, period: float) -> bool:
    """Whether a window is a multiple of the period, at least one, up to rounding."""
    count = float(window) / float(period)
    return abs(count - round(count)) <= 1e-6 and round(count) >= 1
