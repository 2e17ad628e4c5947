"""An impulse that was decided: its time, its weights, their deviations and doubts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.runtime.base import Estimate
from obsdesign.runtime.clocks.time_stamps import time_tolerance
from obsdesign.runtime.state_marks import Axes
from obsdesign.runtime.status import MISSING_SAMPLE, status_of

OPEN = "unresolved"  # of a row
CONFUSED = "an error of the state at first explains an impulse as well"
MISFIT = "does not fit one impulse in the window"
FAINT = "hardly above the noise in the norm of the fit"


def onset_statistics(
    onsets: Matrix, probability: Matrix, steps: Matrix | float
) -> tuple[float, float]:
    """(mean, deviation) of an onset on a grid (G,); a point stands for its step.

    Of ages before the last one: a mean of stamps themselves would round once for each of them.
    """
    latest = float(onsets[-1])
    ages = latest - onsets
    age = float(probability @ ages)
    variance = (ages - age) ** 2 + np.square(steps) / 12
    return latest - age, math.sqrt(float(probability @ variance))


@dataclass(frozen=True, slots=True)
class Event:
    """An impulse that was decided: time, weights (q,), standard deviations, doubts.

    The deviations are None where the problem states no noise; doubts: sentences, none where nothing
    is doubtful.
    """

    t: float
    weights: Annotated[Matrix, Axes("q")]
    t_std: float | None = None
    weights_std: Annotated[Matrix, Axes("q")] | None = None
    doubts: tuple[str, ...] = ()

    @property
    def status(self) -> str:
        """`ok`, or what is doubtful."""
        return status_of(self.doubts)

    def row(self) -> tuple[float | str, ...]:
        """The cells of an event file: t, weights, t_std, deviations of the weights, status."""
        unknown = np.full(len(self.weights), np.nan)
        spread = unknown if self.weights_std is None else self.weights_std
        t_std = np.nan if self.t_std is None else self.t_std
        return (
            float(self.t),
            *map(float, self.weights),
            float(t_std),
            *map(float, spread),
            self.status,
        )


def missing_sample(period: float | None, first: float, t: float) -> tuple[str, ...]:
    """Sentence of a row at t without measurement that lacks a sample; none between samples.

    period: of the samples, None where y is measured continuously; first: time of the record's first
    row, by which samples are due.
    """
    if period is not None:
        apart = abs(t - first - round((t - first) / period) * period)
        if apart > time_tolerance(t - first, t):
            return ()
    return (MISSING_SAMPLE,)


def with_event(rows: list[Estimate], event: Event) -> list[Estimate]:
    """The rows; the first one after the event holds it, the last one where there is none after."""
    k = next((k for k, row in enumerate(rows) if row.t >= event.t), len(rows) - 1)
    return [*rows[:k], rows[k]._replace(events=(event,)), *rows[k + 1 :]]
