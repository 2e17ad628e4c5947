"""Bounds of the error of observer (14) along a record, by Theorem 1 and the error identity.

In floats, with the constants that were proved: an illustration of the claims.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.document import Claim, Design
from obsdesign.equations.finite_time.error_integrals import (
    ErrorBound,
    Integrals,
    WindowMaps,
    period_integrals,
)
from obsdesign.equations.finite_time.gains import PRINTED, FiniteTimeGains
from obsdesign.runtime import Sample
from obsdesign.runtime.base import centred_measurement
from obsdesign.runtime.clocks.time_stamps import time_tolerances
from obsdesign.runtime.finite_time.constants import WindowConstants
from obsdesign.studies.comparison.record import ComparisonRecord
from obsdesign.verification.finite_time.evidence import DesignEvidence, TheoremEvidence

_TIGHTER = "Theorem 1, tighter Lemma 2"
_THEOREM, _IDENTITY, _TRUE = "Theorem 1", "error identity", "true error"


@dataclass(frozen=True)
class ErrorBounds:
    """Bounds and errors (rows,) by name, at the sampling instants t (rows,) with a full window."""

    t: Matrix
    series: Mapping[str, Matrix]


def error_bounds(
    design: Design, record: ComparisonRecord, estimates: Matrix, statuses: Sequence[str]
) -> ErrorBounds | None:
    """Bounds of the error at the samples of a record that have a full window.

    estimates (rows, n) and statuses (rows,): of the design on this record. None for another
    observer than (14) as printed, without any such row, and where no bound was proved.
    """
    if design.kind != "finite_time" or "dt" in design.gains:
        return None
    gains = FiniteTimeGains.from_document(design.gains)
    if gains.is_unbiased or gains.half_sample != PRINTED:
        return None
    evidence = DesignEvidence.from_claims(design.claims)
    constants = _proved_constants(design.claims, evidence)
    windows = _Windows(gains, record.samples, statuses)
    full = {row: before for row in range(len(statuses)) if (before := windows.rows_before(row))}
    x = record.x if record.x is not None and np.isfinite(record.x).all() else None
    factor = evidence.error_factor if x is not None else None
    if not full or not (constants or factor is not None):
        return None
    integrals = [windows.integrals(*window) for window in full.items()] if constants else []
    series = {
        name: np.array([bound.value(window) for window in integrals])
        for name, bound in constants.items()
    }
    if x is not None:
        sizes = np.linalg.norm(x, axis=1)
        if factor is not None:
            largest = [sizes[before[0] : row + 1].max() for row, before in full.items()]
            series[_IDENTITY] = factor * np.array(largest)
        rows = list(full)
        series[_TRUE] = np.linalg.norm(estimates[rows] - x[rows], axis=1)
    return ErrorBounds(np.array([record.samples[row].t for row in full]), series)


def _proved_constants(claims: Sequence[Claim], evidence: DesignEvidence) -> dict[str, ErrorBound]:
    """Constants of Theorem 1, and of the one with a tighter Lemma 2, where they are proved."""
    verdicts = {claim.id: claim.verdict for claim in claims}
    named: list[tuple[str, str, TheoremEvidence | None]] = [
        (_THEOREM, "theorem_1_numbers", evidence.theorem),
        (_TIGHTER, "theorem_1_tighter", evidence.tighter),
    ]
    return {
        name: ErrorBound(*constants.factors)
        for name, claim, constants in named
        if constants is not None and constants.is_applicable and verdicts[claim] == "proved"
    }


@dataclass(frozen=True)
class _Windows:
    """Windows of a record: which rows they hold, and their integrals."""

    gains: FiniteTimeGains
    samples: Sequence[Sample]
    statuses: Sequence[str]

    @cached_property
    def times(self) -> Matrix:
        return np.array([sample.t for sample in self.samples])

    @cached_property
    def measured(self) -> list[Matrix | None]:
        """The measurement (p,) of each row less the middle of its noise, None where missing."""
        return [centred_measurement(sample.y, self.gains) for sample in self.samples]

    @cached_property
    def inputs(self) -> list[Matrix]:
        """The known input (n,) from each row on."""
        constants = WindowConstants(self.gains)
        held = np.zeros(0 if self.gains.B is None else self.gains.B.shape[1])
        inputs = []
        for sample in self.samples:
            held = held if sample.u is None else np.asarray(sample.u, dtype=np.float64)
            inputs.append(constants.forced(held))
        return inputs

    def rows_before(self, row: int) -> list[int]:
        """The k rows of the window's samples, oldest first; none without a full window."""
        if self.statuses[row] != "ok" or row == 0:
            return []
        ages = self.gains.period * np.arange(self.gains.samples, 0, -1, dtype=np.float64)
        wanted = self.times[row] - ages
        later = np.clip(np.searchsorted(self.times[: row + 1], wanted), 1, row)
        is_earlier_nearer = wanted - self.times[later - 1] < self.times[later] - wanted
        nearest = later - is_earlier_nearer
        is_met = np.abs(self.times[nearest] - wanted) <= time_tolerances(
            ages, np.full(len(ages), self.times[row])
        )
        if not is_met.all() or any(self.measured[k] is None for k in nearest):
            return []
        between = self.samples[int(nearest[0]) : row + 1]
        return [] if any(sample.jump for sample in between) else [int(k) for k in nearest]

    @cached_property
    def _periods(self) -> dict[int, Integrals]:
        return {}

    @cached_property
    def _maps(self) -> WindowMaps:
        return WindowMaps.from_gains(self.gains)

    def integrals(self, row: int, before: Sequence[int]) -> Integrals:
        """Integrals over the window of a row, with the rows of its samples."""
        ends = [*before[1:], row]
        periods = [self._period(a, b) for a, b in zip(before, ends, strict=True)]
        return self._maps.integrals(periods)

    def _period(self, row: int, end: int) -> Integrals:
        """Integrals of the period from the sample of a row to that of another one."""
        if row not in self._periods:
            y = self.measured[row]
            assert y is not None
            self._periods[row] = period_integrals(self.gains, y, [*self._inputs(row, end)])
        return self._periods[row]

    def _inputs(self, row: int, end: int) -> Iterator[tuple[float, Matrix]]:
        for k in range(row, end):
            yield float(self.times[k] - self.times[row]), self.inputs[k]
