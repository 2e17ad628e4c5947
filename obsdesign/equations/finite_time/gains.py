"""Gains of the finite-time observer: what a design of kind `finite_time` stores."""

from __future__ import annotations

import math
from dataclasses import dataclass

from lmi.arithmetic.arrays import Matrix
from lmi.memory import OversizeError
from obsdesign.equations.finite_time.rows import END, START
from obsdesign.equations.gains import PlantGains
from obsdesign.equations.stored import matrix, number, word

METHODS = ("least_squares", "exact", "approximate", "minimax")
NEED_L = ("exact", "approximate")
FREE = ("least_squares", "minimax")
# more samples than this make a design file too large to handle
MOST_SAMPLES = 20_000
# samples times n^3: proving the rows of a window takes about half a microsecond for each
_MOST_WORK = 40_000_000
PRINTED, CORRECTED = "printed", "corrected"


def most_samples(n: int) -> int:
    """Most samples of a window of n states: of a design file, and of what is proved in 20 s."""
    return min(MOST_SAMPLES, _MOST_WORK // n**3)


def require_window(n: int, samples: int) -> None:
    """OversizeError where a window of n states takes more work than the budget allows."""
    if n**3 * samples > _MOST_WORK:
        raise OversizeError(
            f"a window of {samples} samples and {n} states takes about "
            f"{20 * n**3 * samples / _MOST_WORK:.0f} s, and the budget is 20 s, {most_samples(n)} "
            "samples: a shorter window or fewer states are required."
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class FiniteTimeGains(PlantGains):
    """Gains window_gain (n, k p) of one of `METHODS`, for k = `samples` samples, `period` apart.

    reference: the state that the rows of the samples are written in, x(t_i) unless it is START.
    L (n, p): injection of `exact` and `approximate`; half_sample: of `approximate`, is its delay of
    half a sample taken off? deviations (p,): of `least_squares`, relative sizes of the outputs'
    errors. Every method but `approximate` has state_error (n, n), a bound of its bias entry by
    entry, and with a noise bound radius (n,), the largest error.
    """

    period: float = number()
    method: str = word(*METHODS)
    samples: int = number()
    half_sample: str | None = word(PRINTED, CORRECTED, optional=True)
    deviations: Matrix | None = matrix("p", optional=True)
    L: Matrix | None = matrix("n", "p", optional=True)
    reference: str | None = word(START, optional=True)
    window_gain: Matrix = matrix("n", "window")
    state_error: Matrix | None = matrix("n", "n", optional=True)
    radius: Matrix | None = matrix("n", optional=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (self.samples >= 1 and float(self.samples).is_integer()):
            raise ValueError(f"gains.samples must be a whole number >= 1; got {self.samples!r}.")
        object.__setattr__(self, "samples", int(self.samples))
        if not 0 < self.period < math.inf:
            raise ValueError(f"gains.period must be a positive number; got {self.period!r}.")
        if self.window_gain.shape[1] != self.samples * self.p:
            raise ValueError(
                f"gains.window_gain must have shape {(self.n, self.samples * self.p)}; "
                f"got shape {self.window_gain.shape}."
            )
        for name in self._needed_entries():
            if getattr(self, name) is None:
                raise ValueError(f"gains.{name} is missing: method {self.method!r} needs it.")

    def _needed_entries(self) -> tuple[str, ...]:
        """Optional entries that this method cannot do without."""
        if not self.is_unbiased:
            return ("L", "half_sample")
        needed = (
            ("state_error", "deviations") if self.method == "least_squares" else ("state_error",)
        )
        return needed if self.radius is None else (*needed, "noise_bound")

    @property
    def is_unbiased(self) -> bool:
        """Does the window give the state itself? Only `approximate` has a bias by design."""
        return self.method != "approximate"

    @property
    def window_reference(self) -> str:
        """START or END: the rows of the samples speak of x(t_i - T) or of x(t_i)."""
        return END if self.reference is None else self.reference

    @property
    def is_relative_to_start(self) -> bool:
        """Do the rows of the samples speak of x(t_i - T)?"""
        return self.reference == START

    @property
    def window(self) -> float:
        """T = k nu."""
        return self.samples * self.period

    @property
    def injection(self) -> Matrix:
        """L (n, p); ValueError for a method that has none."""
        return _stored(self.L, "L")

    @property
    def bias_bound(self) -> Matrix:
        """state_error (n, n); ValueError for `approximate`, whose bias is not bounded by it."""
        return _stored(self.state_error, "state_error")

    @property
    def error_bound(self) -> Matrix:
        """radius (n,); ValueError where the design has no noise bound."""
        return _stored(self.radius, "radius")

    @property
    def noise(self) -> Matrix:
        """noise_bound (p,); ValueError where the plant has none."""
        return _stored(self.noise_bound, "noise_bound")


def _stored(value: Matrix | None, name: str) -> Matrix:
    if value is None:
        raise ValueError(f"gains.{name} is missing.")
    return value
