"""Synthesis of a kind: its module `<kind>/candidates.py`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from importlib import import_module
from typing import Protocol, cast, runtime_checkable

from lmi.time_budget import TimeBudget
from obsdesign.analysis.served import require_served
from obsdesign.errors import InputError
from obsdesign.kinds import kind_named
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate

# of a user: from the variables of its kind to constraints of CVXPY, which is not typed
Constraints = Callable[..., Iterable[object]]


class Synthesis(Protocol):
    """A module that makes candidates."""

    def synthesize(self, problem: Problem, budget: TimeBudget, /) -> Iterator[Candidate]:
        """Candidates in order of preference; InputError where the kind cannot serve the problem."""


@runtime_checkable
class SelectiveSynthesis(Protocol):
    """A module that passes some of its forms over."""

    def untried(self, problem: Problem, /) -> dict[str, str]:
        """Forms that are passed over, and why."""


@runtime_checkable
class ConstrainedSynthesis(Protocol):
    """A module that chooses gains under a user's CVXPY constraints."""

    def synthesize_constrained(
        self, problem: Problem, constraints: Constraints, budget: TimeBudget, /
    ) -> Iterator[Candidate]:
        """Candidates in order of preference; InputError for what cannot be built."""


def candidates_of(
    problem: Problem, budget: TimeBudget, constraints: Constraints | None = None
) -> Iterator[Candidate]:
    """Candidates for a problem; InputError for constraints that its kind has no gains for."""
    kind = problem.require_kind()
    has_modes = bool(problem.plant.modes)
    require_served(problem.plant, kind)
    synthesis = synthesis_of(kind, has_modes=has_modes)
    if has_modes and constraints is not None:
        raise InputError("constraints on gains are not available with [[mode]].")
    if constraints is None:
        return synthesis.synthesize(problem, budget)
    if not isinstance(synthesis, ConstrainedSynthesis):
        raise InputError(
            f"constraints are available for kinds 'interval' and 'luenberger'; got {kind!r}."
        )
    return synthesis.synthesize_constrained(problem, constraints, budget)


def synthesis_of(kind: str, *, has_modes: bool = False) -> Synthesis:
    """The module of a kind, or its one for modes; InputError for what is no kind."""
    module = kind_named(kind).module("candidates", has_modes=has_modes)
    return cast(Synthesis, import_module(module))


def untried_forms(problem: Problem) -> dict[str, str]:
    """Forms of its kind that synthesis passes over for a problem, and why."""
    synthesis = synthesis_of(problem.require_kind(), has_modes=bool(problem.plant.modes))
    return synthesis.untried(problem) if isinstance(synthesis, SelectiveSynthesis) else {}
