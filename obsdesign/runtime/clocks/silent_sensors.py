"""Bounds of a reading between two samples of a sensor that sends on change.

From one sample to the next its reading y = C x + v stays within `sends_on_change` of the value sent
last, at every instant: a strip for C x, wider by this change than that of the sample. It ends where
the sensor is silent for longer than stated, since a sample may then be lost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Matrix
from obsdesign.equations.clocks import SensorGains
from obsdesign.runtime.clocks.time_stamps import time_tolerances


@dataclass(frozen=True)
class SilentSensors:
    """Those sensors of a design that send on change."""

    sensors: Sequence[SensorGains]

    def sent(self, before: Matrix, y: Matrix | None) -> Matrix:
        """Values sent last (p,) after a row, NaN before the first; a sample is of a whole sensor.

        before: the same before the row; y (p,): its measurements, NaN where there is none.
        """
        if y is None or not self.has_senders:
            return before
        return np.where(self._has_sample(y), y, before)

    def readings(
        self, sent: Matrix, sampled: Sequence[float], t: float, y: Matrix | None
    ) -> Matrix:
        """Values (p,) from which readings of silent sensors differ by `change` at most at time t.

        NaN where nothing is known. sent, sampled: values and times of the last samples, before the
        row of y (p,) at time t.
        """
        apart = t - np.asarray(sampled)
        is_in_time = apart <= self._gaps + time_tolerances(apart, np.full(len(apart), t))
        is_known = is_in_time[self._sensor] & (self.change > 0.0)
        if y is not None:
            is_known &= ~self._has_sample(y)
        return np.where(is_known, sent, np.nan)

    def _has_sample(self, y: Matrix) -> NDArray[np.bool_]:
        """Which outputs are of a sensor that has a sample (p,)."""
        sampled = np.zeros(len(self.sensors), np.bool_)
        sampled[self._sensor[np.isfinite(y)]] = True
        return np.asarray(sampled[self._sensor])

    @cached_property
    def has_senders(self) -> bool:
        """Does any of them send on change?"""
        return bool(self.change.any())

    @cached_property
    def change(self) -> Matrix:
        """Largest change since the value sent last (p,); 0 for outputs that do not send so."""
        own = [np.zeros(x.outputs) if x.sends_on_change is None else x.sends_on_change
               for x in self.sensors]  # fmt: skip
        return np.concatenate([np.zeros(0), *own])

    @cached_property
    def _gaps(self) -> Matrix:
        return np.array([sensor.gap for sensor in self.sensors])

    @cached_property
    def _sensor(self) -> NDArray[np.intp]:
        """The place of the sensor of each output (p,)."""
        return np.repeat(np.arange(len(self.sensors)), [sensor.outputs for sensor in self.sensors])
