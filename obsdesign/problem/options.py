"""Options of the [observer] block: one frozen dataclass per kind.

A field declares the JSON Schema of its entry and its default, None where the kind chooses. Values
are those of `observer_options.options`: finite numbers, lists as tuples, read-only tables.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.errors import InputError
from obsdesign.problem.gain_constraints import ConstrainedGains
from obsdesign.problem.options_base import (
    POLES,
    WEIGHTS,
    Options,
    check_count,
    check_longest_dwell_time,
    check_weights,
    option,
)
from obsdesign.problem.schema import (
    FLAG,
    NONNEGATIVE,
    POSITIVE,
    POSITIVE_LIST,
    list_of,
    one_of,
    ref,
    whole_number,
)

if TYPE_CHECKING:
    from obsdesign.problem.plant import Plant

Pole = float | tuple[float, float]


@dataclass(frozen=True, kw_only=True, eq=False)
class IntervalOptions(ConstrainedGains):
    """Options of kind interval."""

    form: str = option(
        one_of("cooperative", "split", "coordinates", "two_coordinates", "auto"),
        "How positivity is reached; default auto: all in this order.",
        default="auto",
    )
    objective: str | None = option(
        one_of("feasible", "shortest_dwell", "narrowest"),
        "What missing gains are chosen for; default narrowest.",
    )
    gain_limit: float | None = option(POSITIVE, "Largest absolute entry of L and M.")
    width: str = option(
        one_of("mean", "pre_jump"),
        "Which width objective narrowest makes small: its time average (default), or the one just "
        "before jumps.",
        default="mean",
    )
    width_weights: tuple[float, ...] | None = option(
        list_of(NONNEGATIVE, "a list of nonnegative numbers, one per state"),
        "Weight of each state's width in objective narrowest; default all alike. Only their ratios "
        "matter.",
    )

    def check(self, plant: Plant) -> None:
        """InputError unless there is a width weight per state, and one of them is not zero."""
        super().check(plant)
        check_count("width_weights", self.width_weights, plant.n, "state")
        if self.width_weights is not None and not any(self.width_weights):
            raise InputError("observer.width_weights must not all be zero.")


_WINDOW_STAGES = whole_number(1, 200, "a whole number of stages")


@dataclass(frozen=True, kw_only=True, eq=False)
class SetMembershipOptions(Options):
    """Options of kind set_membership."""

    window: int | None = option(
        _WINDOW_STAGES,
        "Stages (steps of time, and jumps) that a bound looks back at; default by the plant.",
        whole=True,
    )
    steps: int = option(
        whole_number(1, 50),
        "Interior point steps of the search for multipliers in a row, at most: it ends where the "
        "duality gap is below a thousandth of the width; default 20.",
        whole=True,
        default=20,
    )
    fixed_lag: int | None = option(
        _WINDOW_STAGES,
        "Bounds of the state that many rows ago are given as well; below window.",
        whole=True,
    )
    directions: tuple[tuple[float, ...], ...] | None = option(
        ref("matrix"), "Rows l: bounds of l'x are given besides those of the states."
    )

    def check(self, plant: Plant) -> None:
        """InputError unless rows have the plant's size and the lag is inside the window."""
        for i, row in enumerate(self.directions or ()):
            check_count(f"directions, row {i + 1},", row, plant.n, "state")
            if not any(row):
                raise InputError(f"observer.directions, row {i + 1} must not be zero.")
        if self.window is not None and (self.fixed_lag or 0) >= self.window:
            raise InputError(
                f"observer.fixed_lag must be less than observer.window = {self.window}; got "
                f"{self.fixed_lag}."
            )


@dataclass(frozen=True, kw_only=True, eq=False)
class LuenbergerOptions(ConstrainedGains):
    """Options of kind luenberger."""

    poles: tuple[Pole, ...] | None = option(ref("poles"), POLES)
    decay_rate: float = option(
        NONNEGATIVE, "Exponential decay that is required, per unit of time.", default=0.0
    )
    weights: Mapping[str, tuple[float, ...]] | None = option(ref("weights"), WEIGHTS)
    schedule: int | tuple[float, ...] | None = option(
        {
            "anyOf": [{"type": "integer", "minimum": 2}, POSITIVE_LIST],
            "title": "a number of cells >= 2, or a list of cell borders",
        },
        "Jump gains that depend on the past dwell time: number of cells of the dwell range, or "
        "their borders.",
        whole=True,
    )

    def check(self, plant: Plant) -> None:
        """InputError unless weights and patterns have the plant's sizes and borders increase."""
        super().check(plant)
        check_weights(self.weights, plant)
        cells = self.schedule
        if isinstance(cells, tuple) and any(a >= b for a, b in itertools.pairwise(cells)):
            from obsdesign.entries import shown  # the command line loads this file without numpy

            raise InputError(f"observer.schedule must be increasing; got {shown(list(cells))}.")


@dataclass(frozen=True, kw_only=True, eq=False)
class ImpulsiveOptions(Options):
    """Options of kind impulsive."""

    window: int | None = option(
        whole_number(1),
        "Number of impulses that a gain looks back at.",
        whole=True,
    )
    alpha: float | None = option(
        {"type": "number", "exclusiveMinimum": 1, "title": "a number > 1"},
        "Weight of the past; the error is guaranteed to shrink by 1/alpha per impulse.",
    )
    strategy: str = option(
        one_of("full", "compressed", "subspace", "quadratic", "auto"),
        "Which condition the gain rests on; default auto: all in this order.",
        default="auto",
    )
    decay_rate: float = option(
        NONNEGATIVE,
        "Exponential decay that is required, per unit of time; chooses alpha.",
        default=0.0,
    )
    noise_target: tuple[float, ...] | None = option(
        POSITIVE_LIST,
        "Largest standard deviation wanted of each state's error just after an impulse, for "
        "measurement noise noise_std (1 where none is given); chooses window and alpha.",
    )

    def check(self, plant: Plant) -> None:
        """InputError unless there is a noise target per state and a strategy for the range."""
        check_count("noise_target", self.noise_target, plant.n, "state")
        if self.strategy in ("subspace", "quadratic"):
            check_longest_dwell_time(f"observer.strategy = {self.strategy!r}", plant)


@dataclass(frozen=True, kw_only=True, eq=False)
class FiniteTimeOptions(Options):
    """Options of kind finite_time."""

    window: float | None = option(
        POSITIVE, "T: time after which the state is known; a multiple of output.period."
    )
    method: str = option(
        one_of("approximate", "exact", "least_squares", "minimax"),
        "How the state is computed from the window; default least_squares.",
        default="least_squares",
    )
    objective: str | None = option(
        one_of("longest_period", "shortest_window", "least_noise"),
        "What is searched for among period, window and gains.",
    )
    half_sample_correction: bool = option(
        FLAG, "Method approximate: take off the half-sample delay of (14).", default=False
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class ImpulsiveInputOptions(Options):
    """Options of kind impulsive_input."""

    window: float | None = option(
        POSITIVE, "tau: length of the sliding window, below the shortest dwell time."
    )
    exponents: tuple[float, ...] | None = option(
        list_of(ref("number"), "a list of numbers"),
        "Lambda: distinct exponents of the modulating kernels.",
    )
    margin: float | None = option(
        POSITIVE,
        "epsilon: onsets in the last part of the window are not decided; less than window.",
    )
    ratio: float | None = option(
        POSITIVE,
        "r: largest ratio of what the features neglect to what they keep; chooses the exponents.",
    )
    weighting: str | None = option(
        one_of("plain", "gls"), "Norm of the fit: plain, or gls for measurement noise."
    )
    operator: str | None = option(
        one_of("integral", "samples"), "Kernels as integrals, or as exact sums over few samples."
    )
    state_correction: bool | None = option(
        FLAG, "gls: correct the state with each impulse; default true."
    )
    initial_std: tuple[float, ...] | None = option(
        list_of(NONNEGATIVE, "a list of numbers >= 0"),
        "gls: standard deviation of the initial state, one per state; default from the data.",
    )
    nonnegative: bool = option(FLAG, "Weights of impulses are not negative.", default=False)
    threshold: float | None = option(
        POSITIVE,
        "eta: an impulse is evaluated when the norm of the features exceeds it, instead of at a "
        "maximum.",
    )
    smallest_weight: float | None = option(
        POSITIVE, "Smallest absolute weight of an impulse that is evaluated; chooses threshold."
    )
    uncertainty: tuple[tuple[float, ...], ...] | None = option(
        list_of(
            list_of(NONNEGATIVE, "a row: a list of numbers >= 0"),
            "a matrix: a list of rows of numbers >= 0",
        ),
        "Largest absolute changes of the entries of flow.A, n x n, for the claim robustness.",
    )
    poles: tuple[Pole, ...] | None = option(
        ref("poles"), "Poles of A - K C, one per state; one of a conjugate pair stands for both."
    )
    weights: Mapping[str, tuple[float, ...]] | None = option(
        ref("weights"),
        "Diagonal weights of the Riccati equation for K, in the plant's coordinates.",
    )

    @property
    def has_threshold(self) -> bool:
        """Whether an impulse is evaluated by a threshold, given or from the smallest weight."""
        return self.threshold is not None or self.smallest_weight is not None

    def check(self, plant: Plant) -> None:
        """InputError unless exponents differ and the other lists and the margin fit the plant."""
        exponents = self.exponents or ()
        for i, exponent in enumerate(exponents):
            if exponent in exponents[:i]:
                raise InputError(f"observer.exponents must differ; {exponent!r} stands twice.")
        window = math.inf if self.window is None else self.window
        if self.margin is not None and self.margin >= window:
            raise InputError(
                f"observer.margin must be less than observer.window = {window!r}; got "
                f"{self.margin!r}."
            )
        check_count("initial_std", self.initial_std, plant.n, "state")
        check_weights(self.weights, plant)
        check_count("uncertainty", self.uncertainty, plant.n, "state")
        for i, row in enumerate(self.uncertainty or ()):
            check_count(f"uncertainty, row {i + 1},", row, plant.n, "state")


@dataclass(frozen=True, kw_only=True, eq=False)
class UnknownInputOptions(Options):
    """Options of kind unknown_input."""

    poles: tuple[Pole, ...] | None = option(ref("poles"), POLES)
    weights: Mapping[str, tuple[float, ...]] | None = option(ref("weights"), WEIGHTS)
    differentiator: str | None = option(
        one_of("cell", "damped", "batch", "fixed_lag"),
        "How the output is differentiated. Default: fixed_lag where every output has a noise_std, "
        "else cell.",
    )
    lag: int = option(
        whole_number(1, 1000, "a whole number of samples"),
        "Delay of fixed_lag, in samples; default 10.",
        whole=True,
        default=10,
    )

    def check(self, plant: Plant) -> None:
        """InputError unless the weights have the plant's sizes."""
        check_weights(self.weights, plant)
