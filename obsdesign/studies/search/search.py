"""Search for a limit of a problem: an end of its dwell times, its period or its window.

Both sides of the bracket are decided: one is proved, the other refuted or undecided.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from lmi.decide.dwell_problem import Direction
from lmi.decide.dwell_search import ACCURACY
from lmi.time_budget import TimeBudget
from obsdesign import workflow
from obsdesign.analysis.served import require_served
from obsdesign.errors import InputError
from obsdesign.kinds import (
    DWELL_SEARCHES,
    LARGEST_TIME_ERROR,
    LARGEST_UNCERTAINTY,
    PERIOD_SEARCHES,
    SEARCHES,
    TAKING_TIME_ERRORS,
)
from obsdesign.problem.problem import Problem
from obsdesign.studies.search.dwell_time import search_dwell_time
from obsdesign.studies.search.period import search_period
from obsdesign.studies.search.result import SearchResult
from obsdesign.studies.search.stays import search_stays
from obsdesign.studies.search.time_error import search_time_error
from obsdesign.studies.search.uncertainty import require_parameters, search_uncertainty


def search(
    problem: Problem,
    what: str,
    accuracy: float = ACCURACY,
    *,
    of: str | None = None,
    width: Sequence[float] | None = None,
    seconds: float | None = None,
) -> workflow.Outcome:
    """The bracket for `what`; accuracy is its relative width.

    The outcome's result is that of `SearchResult`, or of `period.search_period`.
    Verdict: proved when the bracket is as tight as `accuracy`, undecided when it is wider, refuted
    when no range is admissible. InputError when the kind has no such search.

    seconds: of processor time that searches may take in all; None for their own budgets, which a
    larger total stretches until the bracket is as tight as `accuracy`. of: the mode whose stays are
    searched, None for all; or the event. width: of largest_time_error, (n,): the largest widths.
    """
    if width is not None and what != LARGEST_TIME_ERROR:
        raise InputError(f"--width is available for {LARGEST_TIME_ERROR} alone; got {what}.")
    require_search(problem, what, accuracy, of)
    best: workflow.Outcome | None = None
    for budget in TimeBudget.from_seconds(seconds).attempts():
        if what == LARGEST_TIME_ERROR:
            outcome = search_time_error(problem, of, width, accuracy, budget)
        else:
            outcome = _searched(problem, what, of, accuracy, budget)
        best = outcome if best is None else max(best, outcome, key=lambda o: _quality(o, what))
        if not SearchResult.from_dict(outcome.result).ended:
            break
    assert best is not None
    return best


def _quality(outcome: workflow.Outcome, what: str) -> tuple[int, float, float]:
    """Rank of an answer to a search: decided, far on the proved side, tight."""
    rank = ("undecided", "refuted", "proved").index(outcome.verdict)
    result = SearchResult.from_dict(outcome.result)
    proved, other = result.proved, result.not_proved
    if proved is None:
        return rank, -math.inf, -math.inf
    reach = -proved if what.startswith("shortest") else proved
    gap = 0.0 if other is None or other == proved else abs(other - proved)
    return rank, reach, -gap


def _searched(
    problem: Problem, what: str, of: str | None, accuracy: float, budget: TimeBudget
) -> workflow.Outcome:
    """One attempt with this budget."""
    if what == LARGEST_UNCERTAINTY:
        return search_uncertainty(problem, accuracy, budget)
    if what in PERIOD_SEARCHES:
        return search_period(problem, what, budget)
    direction: Direction = "shortest" if what == "shortest_dwell" else "longest"
    if problem.plant.modes:
        return search_stays(problem, direction, of, accuracy, budget)
    return search_dwell_time(problem, direction, accuracy, budget)


def require_accuracy(accuracy: float) -> None:
    """InputError unless it is the relative width of a bracket that can be found."""
    if not (math.isfinite(accuracy) and 1e-12 <= accuracy < 1):
        raise InputError(f"--accuracy must be a number from 1e-12 to 1; got {accuracy!r}.")


def require_search(
    problem: Problem, what: str, accuracy: float = ACCURACY, of: str | None = None
) -> None:
    """InputError unless `search` knows this limit for a problem of this kind."""
    kind, modes = problem.require_kind(), problem.plant.modes
    if what == LARGEST_TIME_ERROR and kind in TAKING_TIME_ERRORS:
        require_accuracy(accuracy)
        return
    if of is not None and not modes:
        raise InputError(f"--of names a mode; the plant has none; got {of!r}.")
    require_served(problem.plant, kind)
    if what not in SEARCHES:
        raise InputError(f"--for must be one of {', '.join(SEARCHES)}; got {what!r}.")
    if what == LARGEST_UNCERTAINTY:
        require_parameters(problem)
        require_accuracy(accuracy)
        return
    _require_known_plant(problem, what)
    if kind == "finite_time" and what in PERIOD_SEARCHES:
        return
    if what not in DWELL_SEARCHES or kind not in ("interval", "luenberger"):
        raise InputError(f"--for {what} is not available for kind {kind!r} in this version.")
    require_accuracy(accuracy)
    (_require_stays if modes else _require_dwell_times)(problem, what)


def _require_known_plant(problem: Problem, what: str) -> None:
    """InputError for parameters and discrete time where no search takes them."""
    plant = problem.plant
    if plant.parameters and problem.kind == "luenberger":
        raise InputError(
            f"--for {what} is not available for kind 'luenberger' with parameters in this version."
        )
    if plant.parameters and plant.state is None:
        raise InputError(
            f"--for {what} requires [state] with parameters, since a box that is proved from the "
            "plant holds for its own dwell times; it is missing."
        )
    if plant.flow.dt is not None:
        raise InputError(f"--for {what} is not available with flow.dt in this version.")


def _require_stays(problem: Problem, what: str) -> None:
    """InputError for events that change the state beside stays in modes."""
    for event in problem.plant.events:
        if not np.array_equal(event.G, np.eye(problem.plant.n)):
            raise InputError(
                f"--for {what} is not available with {event.entry}.G other than the identity."
            )


def _require_dwell_times(problem: Problem, what: str) -> None:
    """InputError for a plant whose dwell times cannot be searched."""
    if not problem.plant.has_one_clock:
        raise InputError(f"--for {what} is not available with several clocks.")
    if problem.plant.output.measured == "periodic":
        raise InputError(
            f"--for {what} is not available with output.measured = 'periodic'; it must be "
            "continuous or at_jumps."
        )
    problem.require_dwell_time()
    if problem.options.is_stated("schedule"):
        raise InputError(
            "--for dwell times: observer.schedule divides a range that is fixed; search without it."
        )
