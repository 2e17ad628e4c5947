"""Verification of a kind: its modules `<kind>/claims.py` and `<kind>/guarantees.py`."""

from __future__ import annotations

from importlib import import_module
from typing import Protocol, cast, runtime_checkable

from lmi.arithmetic.arrays import Array, Entries, EntriesByClaim
from lmi.modes import Modes
from lmi.time_budget import UNLIMITED, TimeBudget
from obsdesign.analysis.served import require_served
from obsdesign.document import Claim, Guarantee
from obsdesign.kinds import kind_named
from obsdesign.problem.problem import Problem
from obsdesign.verification.state_widths import StateWidths


class Verification(Protocol):
    """A module that proves claims."""

    def claims(
        self,
        problem: Problem,
        stored: Entries,
        certificates: EntriesByClaim,
        /,
        *,
        paranoid: bool = False,
        budget: TimeBudget = UNLIMITED,
    ) -> tuple[Claim, ...]:
        """Every hypothesis of the theorem, for gains as a file states them."""


class DwellVerification(Verification, Protocol):
    """A module whose claim of stability is one about a pair of matrices."""

    def dwell_pair(self, stored: Entries, /) -> tuple[Array, Array]:
        """Exact (F, H) of x -> e^(F theta) H x."""


class ModeVerification(Verification, Protocol):
    """A module for modes, whose claim of stability is one about a graph of them."""

    def error_modes(self, problem: Problem, stored: Entries, /) -> Modes:
        """The graph of modes whose paths are claimed to tend to zero."""


class Conclusions(Protocol):
    """A module that says what follows from claims."""

    def guarantees(self, problem: Problem, claims: tuple[Claim, ...], /) -> tuple[Guarantee, ...]:
        """The sentences a user may rely on, and those that are not proved."""


@runtime_checkable
class StatesWidths(Protocol):
    """A module that has numbers for each state."""

    def states(self, problem: Problem, claims: tuple[Claim, ...], /) -> tuple[StateWidths, ...]:
        """Sensor strip, certified width and least possible width of each state."""


@runtime_checkable
class Warns(Protocol):
    """A module that knows warnings."""

    def warnings(self, problem: Problem, claims: tuple[Claim, ...], /) -> tuple[str, ...]:
        """What is wrong, or nearly so, in one sentence each."""


def verification_of(kind: str, *, has_modes: bool = False) -> Verification:
    """The module of a kind that proves its claims, or its one for modes; InputError for no kind."""
    return cast(Verification, import_module(kind_named(kind).module("claims", has_modes=has_modes)))


def dwell_verification_of(kind: str) -> DwellVerification:
    """The same of a kind whose dwell times can be searched."""
    return cast(DwellVerification, verification_of(kind))


def verification_for(problem: Problem) -> Verification:
    """The module that proves the claims of a problem; DoesNotApply for modes of other kinds."""
    kind = problem.require_kind()
    require_served(problem.plant, kind)
    return verification_of(kind, has_modes=bool(problem.plant.modes))


def mode_verification_of(kind: str) -> ModeVerification:
    """The module for modes of a kind that takes them."""
    return cast(ModeVerification, verification_of(kind, has_modes=True))


def conclusions_of(kind: str, *, has_modes: bool = False) -> Conclusions:
    """The module of a kind with its guarantees, or its one for modes."""
    module = kind_named(kind).module("guarantees", has_modes=has_modes)
    return cast(Conclusions, import_module(module))
