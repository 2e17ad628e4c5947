"""Synthesis of a kind: its module `<kind>/candidates.py`."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from typing import Protocol, cast, runtime_checkable

from lmi.time_budget import TimeBudget
from obsdesign.kinds import kind_named
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate


class Synthesis(Protocol):
    """A module that makes candidates."""

    def synthesize(self, problem: Problem, budget: TimeBudget, /) -> Iterator[Candidate]:
        """Candidates in order of preference; InputError where the kind cannot serve the problem."""


@runtime_checkable
class SelectiveSynthesis(Protocol):
    """A module that passes some of its forms over."""

    def untried(self, problem: Problem, /) -> dict[str, str]:
        """Forms that are passed over, and why."""


def synthesis_of(kind: str) -> Synthesis:
    """The module of a kind; InputError for what is no kind."""
    return cast(Synthesis, import_module(kind_named(kind).module("candidates")))


def untried_forms(problem: Problem) -> dict[str, str]:
    """Forms of its kind that synthesis passes over for a problem, and why."""
    synthesis = synthesis_of(problem.require_kind())
    return synthesis.untried(problem) if isinstance(synthesis, SelectiveSynthesis) else {}
