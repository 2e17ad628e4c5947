"""Largest error of an event's time stamps: a bracket, proved on one side.

`time_error` of the event is replaced, all that the file gives besides is kept. What is proved is
`late_width`, and that its widths are at most the stated ones. What refutes is a run of the bounds
that come out wider. Two windows of an event must not overlap: half its shortest time is no answer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Entries, Matrix, NewEntries
from lmi.arithmetic.exponential import expm
from lmi.time_budget import TimeBudget
from obsdesign import workflow
from obsdesign.analysis.interval.uncertain_widths import reason_against_events
from obsdesign.document import Claim, jsonable
from obsdesign.equations.clocks import events_of, sensors_of
from obsdesign.errors import InputError
from obsdesign.problem.clocks import Event
from obsdesign.problem.plant import Plant
from obsdesign.problem.problem import Problem
from obsdesign.runtime.base import Sample
from obsdesign.runtime.bounds_observer import BoundsObserver
from obsdesign.runtime.interval.uncertain_state import UncertainState
from obsdesign.runtime.load import observer_class
from obsdesign.studies.search.result import SearchResult
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.kind import candidates_of
from obsdesign.verification.kind import verification_of

_SMALLEST = 2.0**-20  # of the shortest time, the first error that is tried
_EVENTS = 30  # of a run that may refute


@dataclass(frozen=True)
class _Attempt:
    """An error with its candidate, claims and verdict; witness: of a run that is wider."""

    error: float
    candidate: Candidate
    claims: tuple[Claim, ...]
    verdict: str
    reason: str | None
    witness: Entries | None


def search_time_error(
    problem: Problem,
    of: str | None,
    width: Sequence[float] | None,
    accuracy: float,
    budget: TimeBudget,
) -> workflow.Outcome:
    """One attempt at the bracket with this budget.

    of: the event, None for the one that there is; width: at most that of the bounds of each state,
    farther than the error from every stamp; None for any that is proved. InputError for what has no
    such limit.
    """
    event = _event_of(problem, of, width)
    assert event.dwell_time is not None
    limit = event.dwell_time[0] / 2
    low, high = _attempt(problem, event.name, limit * _SMALLEST, width, budget), None
    if low.verdict == "proved":
        a, b = low.error, limit
        while b / a > 1 + accuracy and budget.remaining() >= 0:
            # by ratios while the answer may be smaller by orders of magnitude
            middle = (a * b) ** 0.5 if b > 4 * a else (a + b) / 2
            tried = _attempt(problem, event.name, middle, width, budget)
            if tried.verdict == "proved":
                low, a = tried, middle
            else:
                high, b = tried, middle
    else:
        high = low
    return _outcome(low, high, limit, accuracy, budget)


def _event_of(problem: Problem, of: str | None, width: Sequence[float] | None) -> Event:
    """The event whose error is searched; InputError where there is none."""
    events, n = problem.plant.events, problem.plant.n
    names = [event.name for event in events]
    if not problem.plant.has_tables or not names:
        raise InputError("--for largest_time_error: [[event]] is required; the plant has none.")
    if of is not None and of not in names:
        raise InputError(f"--of must be an event, one of {', '.join(names)}; got {of!r}.")
    uncertain = problem.plant.uncertain_events
    if of is None and len(names) > 1 and len(uncertain) != 1:
        raise InputError(
            "--for largest_time_error: --of must name the event at uncertain times, one of "
            f"{', '.join(names)}."
        )
    name = of or (uncertain or names)[0]
    event = events[names.index(name)]
    if width is not None and (len(width) != n or not all(x > 0 for x in width)):
        raise InputError(f"--width must be {n} positive numbers, one per state; got {width}.")
    if event.dwell_time is None:
        raise InputError(f"event.{name}.every is required for --for largest_time_error.")
    assert isinstance(event, Event)
    return event


def _with_error(problem: Problem, name: str, error: float) -> Problem:
    body = problem.to_dict()
    for event in body["event"]:
        if event["name"] == name:
            event["time_error"] = error
    return Problem.from_dict(body)


def _attempt(
    problem: Problem, name: str, error: float, width: Sequence[float] | None, budget: TimeBudget
) -> _Attempt:
    """The verdict on one error."""
    own = _with_error(problem, name, error)
    candidate = next(candidates_of(own, budget))
    gains, verification = candidate.document(), verification_of("interval")
    claims = verification.claims(own, gains, candidate.certificates, budget=budget)
    claim, reason = claims[-1], reason_against_events(events_of(own.plant), sensors_of(own.plant))
    if reason is not None or claim.verdict != "proved":
        reason = reason or claim.evidence.get("reason")
        return _Attempt(error, candidate, claims, "undecided", reason, None)
    if width is None or (np.array(claim.evidence["always"]) <= width).all():
        return _Attempt(error, candidate, claims, "proved", None, None)
    # of other events the run would have to keep the clocks too
    reached = _reached(own, gains) if len(own.plant.events) == 1 else np.zeros(own.plant.n)
    if (reached > width).any():
        witness = {"events": _EVENTS, "width": reached.tolist()}
        reason = "a run with an event every shortest time has bounds that are wider"
        return _Attempt(error, candidate, claims, "refuted", reason, witness)
    return _Attempt(error, candidate, claims, "undecided", "the proved width is larger", None)


def _reached(problem: Problem, gains: Entries) -> Matrix:
    """Widths (n,) that the bounds reach, farther than the error from every stamp.

    In a run that the clocks allow: events that add the most, a shortest time apart, at their
    stamps, without disturbance and noise; each sensor as seldom as may be.
    """
    observer = observer_class("interval", gains).from_gains(gains)
    assert isinstance(observer, BoundsObserver)
    rows, n = _rows(problem.plant), problem.plant.n
    state: UncertainState = observer.init(0.0, lower=np.zeros(n), upper=np.zeros(n))
    stamps = np.array([row.t for row in rows if row.jump])
    error, widest = problem.plant.events[0].stamp_error * (1 + 1e-9), np.zeros(n)
    for each in observer.run(state, rows):
        assert each.lower is not None
        assert each.upper is not None
        if each.t > stamps[-4] and np.abs(stamps - each.t).min() > error:
            widest = np.maximum(widest, each.upper - each.lower)
    return widest


def _rows(plant: Plant) -> list[Sample]:
    """The rows of such a run, and some between them."""
    event = plant.events[0]
    assert event.dwell_time is not None
    apart, error = event.dwell_time[0], event.stamp_error * (1 + 1e-6)
    stamps = apart * np.arange(1, _EVENTS + 1)
    gaps = [sensor.gap or apart for sensor in plant.sensors]
    samples = [
        np.zeros(0) if np.isinf(gap) else gap * np.arange(int(stamps[-1] // gap) + 1)
        for gap in gaps
    ]
    largest = np.ones(event.inputs) if event.input_bound is None else event.input_bound
    added = sum(event.c_bounds) / 2 + (0.0 if event.E is None else event.E @ largest)
    times = np.unique(np.concatenate([[0.0], stamps - error, stamps, stamps + error, *samples]))
    u = np.zeros(0 if plant.flow.B is None else plant.flow.B.shape[1])
    n, x, now, rows = plant.n, np.zeros(plant.n), 0.0, []
    Z = np.zeros((n + 1, n + 1))
    Z[:n, :n], Z[:n, n] = plant.flow.A, sum(plant.flow.b_bounds) / 2
    for t in times.tolist():
        x = (expm(Z * (t - now)) @ np.append(x, 1.0))[:n]
        is_read = [
            sensor.gap == 0 or t in own for sensor, own in zip(plant.sensors, samples, strict=True)
        ]
        middle = plant.outputs.noise_centre
        y = plant.outputs.C @ x + (0.0 if middle is None else middle)
        y = np.where(np.repeat(is_read, [len(own.C) for own in plant.sensors]), y, np.nan)
        is_stamp = t in stamps
        rows.append(Sample(t, y, u, largest, is_stamp, None, (0,) if is_stamp else ()))
        x, now = x + added if is_stamp else x, t
    return rows


def _outcome(
    low: _Attempt, high: _Attempt | None, limit: float, accuracy: float, budget: TimeBudget
) -> workflow.Outcome:
    """The bracket, with the claims of its proved end."""
    is_proved = low.verdict == "proved"
    other = limit if high is None else high.error
    gap = abs(low.error / other - 1) if is_proved else None
    at_limit = "windows of two stamps must not overlap"
    gains: NewEntries = jsonable(low.candidate.document())
    result = SearchResult(
        proved=low.error if is_proved else None,
        not_proved=other,
        not_proved_verdict="undecided" if high is None else high.verdict,
        accuracy=accuracy, open=gap, reason=at_limit if high is None else high.reason,
        witness=None if high is None else high.witness, form=low.candidate.label,
        gains={name: gains[name] for name in ("L", "M") if name in gains},
        ended=budget.ended() if budget.remaining() < 0 else {},
    )  # fmt: skip
    verdict = "proved" if gap is not None and gap <= accuracy else "undecided"
    if not is_proved:
        verdict = low.verdict
    return workflow.Outcome(verdict, "interval", low.claims, result.to_dict(), None)
