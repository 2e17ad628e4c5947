"""Problems with modes: which are served, and their error systems as a graph of modes."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from lmi.arithmetic.balls import Exact
from lmi.modes import Modes
from obsdesign.analysis.served import require_served
from obsdesign.analysis.unbounded_inputs import reason_against_unbounded
from obsdesign.entries import missing_entry
from obsdesign.equations.modes import ModeSpan, following_places
from obsdesign.kinds import TAKING_CLOCKS, TAKING_MODES, kind_named
from obsdesign.problem.clocks import CONTINUOUS
from obsdesign.problem.modes import spans_of
from obsdesign.problem.plant import Plant
from obsdesign.problem.problem import Problem

FORMS = ("cooperative", "split")


def reason_against_modes(problem: Problem) -> str | None:
    """Reason against an observer of modes for a problem, one sentence, or None.

    DoesNotApply where the kind takes no modes.
    """
    kind, plant = problem.require_kind(), problem.plant
    require_served(plant, kind)
    if reason := _reason_against_sensors(plant):
        return reason
    if plant.output.period is not None:
        return "output.period is not available with [[mode]]; samples may have any spacing."
    taken = kind_named(kind).modes
    for name in problem.options.to_document():
        if taken is not None and name not in taken.options:
            allowed = ", ".join(taken.options)
            return f"observer.{name} is not available with [[mode]]; {allowed} is."
    for name in problem.gains:
        if name.rpartition(".")[2] != "L":
            return f"observer.gains.{name} is not available with [[mode]]; L is."
    if reason := _reason_against_events(plant, kind):
        return reason
    if kind != "interval":
        return None
    form = problem.options.to_document().get("form", "auto")
    if form not in (*FORMS, "auto"):
        return f"observer.form must be {' or '.join(FORMS)} with [[mode]]; got {form!r}."
    return reason_against_unbounded(plant, kind) or problem.reason_without_noise_bound()


def _reason_against_sensors(plant: Plant) -> str | None:
    """Reason against the sensors of a plant with modes, one sentence, or None."""
    names = [sensor.name for sensor in plant.sensors]
    if len(names) > 1:
        return (
            f"[[mode]] requires one sensor that is read at every row; the plant has {len(names)} "
            f"({', '.join(names)}). Several that are read at every row are one, with all rows in C."
        )
    sensor = plant.sensors[0]
    if sensor.measured != CONTINUOUS:
        return (
            f"{sensor.required_clock([CONTINUOUS])} with [[mode]], for kinds "
            f"{', '.join(TAKING_MODES)}; got {sensor.own_clock}. Observers for other times, "
            f"without modes: {', '.join(TAKING_CLOCKS)}."
        )
    return None


def _reason_against_events(plant: Plant, kind: str) -> str | None:
    """Reason against the events of a plant with modes, one sentence, or None."""
    for event in plant.events:
        if event.dwell_time is None:
            return missing_entry(f"{event.entry}.every", "[[mode]]")
        if not event.dwell_time[0] > 0:
            return (
                f"{event.entry}.every: the shortest time must be > 0 with [[mode]], or any number "
                f"may happen in one stay; got {event.dwell_time[0]:g}."
            )
        if kind != "interval" and not np.array_equal(event.G, np.eye(plant.n)):
            return (
                f"{event.entry}.G must be the identity for kind {kind!r} with [[mode]]. Kind "
                "interval takes others."
            )
    return None


def graph_of(
    problem: Problem, flows: Sequence[Exact], entry: Sequence[Exact | None]
) -> Modes:  # fmt: skip
    """The graph of modes with these flows of an error, and its maps on entry."""
    return graph_of_spans(spans_of(problem.plant.modes), flows, entry)


def graph_of_spans(
    spans: Sequence[ModeSpan], flows: Sequence[Exact], entry: Sequence[Exact | None]
) -> Modes:
    """The graph of modes of a design."""
    ends = [(float(span.every[0]), float(span.every[1])) for span in spans]
    names = [span.name for span in spans]
    return Modes.from_flows(flows, ends, following_places(spans), entry, names)


def stays_text(problem: Problem) -> str:
    """Stays and events in words: "open [2.0, 10.0], closed [1.0, inf) and stroke 5.0 apart"."""
    words = []
    for mode in problem.plant.modes:
        low, high = mode.every
        words.append(f"{mode.name} [{low!r}, {'inf)' if np.isinf(high) else f'{high!r}]'}")
    stays, events = ", ".join(words), []
    for event in problem.plant.events:
        shortest, _ = event.dwell_time or (0.0, math.inf)
        where = "" if event.modes is None else f" in {' and '.join(event.modes)}"
        events.append(f"event {event.name}{where} at least {shortest!r} apart")
    return ", ".join([stays, *events])
