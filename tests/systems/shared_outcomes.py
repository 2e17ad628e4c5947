"""Equal problems are designed once in a process: half of the suite's time is searches for gains.

A problem that a test designs twice is designed twice, so that a test of repeats tests them.
"""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from typing import Any

import numpy as np

from lmi.time_budget import TimeBudget
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem

Attempt = Callable[[Problem, bool, TimeBudget, Any], Any]


class SharedOutcomes:
    """In place of an attempt at a design: what an earlier test came to with the same problem."""

    def __init__(self) -> None:
        self._known: dict[str, Any] = {}
        self._in_this_test: set[str] = set()

    def begin_test(self) -> None:
        self._in_this_test.clear()

    def around(self, attempt: Attempt) -> Attempt:
        """The attempt, or a copy of its result in an earlier test."""

        def shared(problem: Problem, first: bool, budget: TimeBudget, constraints: Any) -> Any:
            if budget.remaining() < float("inf") or constraints is not None:
                return attempt(problem, first, budget, constraints)
            body = json.dumps(problem.to_dict(), default=np.ndarray.tolist)
            key = f"{first} {budget.factor} {body}"
            if key in self._in_this_test or key not in self._known:
                result = attempt(problem, first, budget, constraints)
                if isinstance(result, InputError):
                    return result
                self._known[key] = copy.deepcopy(result)
                self._in_this_test.add(key)
                return result
            self._in_this_test.add(key)
            return copy.deepcopy(self._known[key])

        return shared
