"""Interval observers for several clocks: what problems may state, and gains that are kept."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from lmi.arithmetic.arrays import Array
from obsdesign.analysis.hidden_samples import reason_against_hidden_samples
from obsdesign.analysis.interval.requirements import large_gain, reason_against_plant
from obsdesign.problem.named_gains import clock_condition
from obsdesign.problem.options import IntervalOptions
from obsdesign.problem.plant import Plant
from obsdesign.problem.problem import Problem

# options of the interval observer that mean the same for several clocks
_KEPT = ("form", "gain_limit", "objective")


def reason_against_clocks(problem: Problem) -> str | None:
    """Reason against an interval observer for a problem with several clocks, or None."""
    options, plant = problem.options_as(IntervalOptions), problem.plant
    reason = reason_against_plant(plant) or problem.reason_without_noise_bound()
    if reason is not None:
        return reason
    if hidden := reason_against_hidden_samples(plant):
        return hidden
    when = clock_condition(plant)
    for name in options.to_document():
        if name not in _KEPT:
            return f"observer.{name} is not available for kind 'interval' {when}."
    if options.form not in ("auto", "split"):
        return (
            f"observer.form must be split {when}: bounds are in the plant's own "
            f"coordinates; got {options.form!r}."
        )
    if options.objective == "shortest_dwell":
        return (
            f"observer.objective = 'shortest_dwell' is not available {when}; it must be feasible "
            "or narrowest."
        )
    for name in plant.uncertain_events:
        if f"{name}.M" in problem.gains:
            return (
                f"observer.gains.{name}.M is not available with event.{name}.time_error: no sample "
                "is known to be taken at the event. Samples correct by the gains of sensors."
            )
    for entry, gain in problem.gains.items():
        if large := large_gain(gain, None, options.gain_limit):
            return replace(large, name=entry).reason("observer.gains")
    return None


def sensor_columns(plant: Plant) -> Iterator[tuple[str, slice]]:
    """Each sensor's gain by its entry, and the columns of its outputs among all."""
    first = 0
    for sensor in plant.sensors:
        yield f"{sensor.name}.L", slice(first, first + len(sensor.C))
        first += len(sensor.C)


def with_given(
    plant: Plant, given: Mapping[str, Array], L: Array, M: Array
) -> tuple[Array, Array]:  # fmt: skip
    """L (n, p) and M (e, n, p) with the gains that a problem gives in their places."""
    L, M = np.array(L, dtype=np.float64), np.array(M, dtype=np.float64)
    for entry, columns in sensor_columns(plant):
        if entry in given:
            L[:, columns] = given[entry]
    for place, event in enumerate(plant.events):
        if f"{event.name}.M" in given:
            M[place] = given[f"{event.name}.M"]
    return L, M
