"""What a kind consists of: a place in every layer, and modules that fit the layer's protocol."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import pytest

import obsdesign
from obsdesign.errors import InputError
from obsdesign.kinds import KINDS, LAYERS, kind_named
from obsdesign.problem.option_table import OPTIONS
from obsdesign.runtime.finite_time.observer import FiniteTimeObserver
from obsdesign.runtime.impulsive.observer import ImpulsiveObserver
from obsdesign.runtime.impulsive_input.observer import ImpulsiveInputObserver
from obsdesign.runtime.interval.observer import IntervalObserver
from obsdesign.runtime.load import RunnableKind, observer_class
from obsdesign.runtime.luenberger.observer import LuenbergerObserver
from obsdesign.runtime.set_membership.observer import SetMembershipObserver
from obsdesign.runtime.unknown_input.fixed_lag import FixedLagObserver
from obsdesign.runtime.unknown_input.observer import UnknownInputObserver
from obsdesign.synthesis.finite_time import candidates as finite_time
from obsdesign.synthesis.impulsive import candidates as impulsive
from obsdesign.synthesis.impulsive_input import candidates as impulsive_input
from obsdesign.synthesis.interval import candidates as interval
from obsdesign.synthesis.kind import Synthesis, synthesis_of, untried_forms
from obsdesign.synthesis.luenberger import candidates as luenberger
from obsdesign.synthesis.set_membership import candidates as set_membership
from obsdesign.synthesis.unknown_input import candidates as unknown_input
from obsdesign.verification.finite_time import claims as finite_time_claims
from obsdesign.verification.finite_time import guarantees as finite_time_guarantees
from obsdesign.verification.impulsive import claims as impulsive_claims
from obsdesign.verification.impulsive import guarantees as impulsive_guarantees
from obsdesign.verification.impulsive_input import claims as impulsive_input_claims
from obsdesign.verification.impulsive_input import guarantees as impulsive_input_guarantees
from obsdesign.verification.interval import claims as interval_claims
from obsdesign.verification.interval import guarantees as interval_guarantees
from obsdesign.verification.kind import (
    Conclusions,
    DwellVerification,
    Verification,
    Warns,
    conclusions_of,
    verification_of,
)
from obsdesign.verification.luenberger import claims as luenberger_claims
from obsdesign.verification.luenberger import guarantees as luenberger_guarantees
from obsdesign.verification.set_membership import claims as set_membership_claims
from obsdesign.verification.set_membership import guarantees as set_membership_guarantees
from obsdesign.verification.unknown_input import claims as unknown_input_claims
from obsdesign.verification.unknown_input import guarantees as unknown_input_guarantees

ROOT = Path(__file__).parent.parent

# the type checker compares the signatures of every module with the protocol of its role
CANDIDATES: dict[str, Synthesis] = {
    "interval": interval,
    "set_membership": set_membership,
    "luenberger": luenberger,
    "impulsive": impulsive,
    "finite_time": finite_time,
    "impulsive_input": impulsive_input,
    "unknown_input": unknown_input,
}
CLAIMS: dict[str, Verification] = {
    "interval": interval_claims,
    "set_membership": set_membership_claims,
    "luenberger": luenberger_claims,
    "impulsive": impulsive_claims,
    "finite_time": finite_time_claims,
    "impulsive_input": impulsive_input_claims,
    "unknown_input": unknown_input_claims,
}
DWELL_CLAIMS: tuple[DwellVerification, ...] = (interval_claims, luenberger_claims)
GUARANTEES: dict[str, Conclusions] = {
    "interval": interval_guarantees,
    "set_membership": set_membership_guarantees,
    "luenberger": luenberger_guarantees,
    "impulsive": impulsive_guarantees,
    "finite_time": finite_time_guarantees,
    "impulsive_input": impulsive_input_guarantees,
    "unknown_input": unknown_input_guarantees,
}
WARNS: dict[str, Warns] = {
    "interval": interval_guarantees,
    "set_membership": set_membership_guarantees,
    "luenberger": luenberger_guarantees,
    "finite_time": finite_time_guarantees,
    "impulsive_input": impulsive_input_guarantees,
    "unknown_input": unknown_input_guarantees,
}
OBSERVERS: dict[str, RunnableKind] = {
    "interval": IntervalObserver,
    "set_membership": SetMembershipObserver,
    "luenberger": LuenbergerObserver,
    "impulsive": ImpulsiveObserver,
    "finite_time": FiniteTimeObserver,
    "impulsive_input": ImpulsiveInputObserver,
    "unknown_input": UnknownInputObserver,
}


@pytest.mark.parametrize("kind", KINDS)
def test_the_table_leads_to_the_modules_of_a_kind(kind: str) -> None:
    assert synthesis_of(kind) is CANDIDATES[kind]
    assert verification_of(kind) is CLAIMS[kind]
    assert conclusions_of(kind) is GUARANTEES[kind]
    assert observer_class(kind, {}) is OBSERVERS[kind]
    assert isinstance(GUARANTEES[kind], Warns) == (kind in WARNS)
    for role in LAYERS:
        assert import_module(kind_named(kind).module(role))


@pytest.mark.parametrize("kind", KINDS)
def test_a_kind_has_a_page_options_gains_and_tests(kind: str) -> None:
    assert kind in OPTIONS
    assert (ROOT / "docs" / f"{kind}.md").exists()
    assert import_module(f"obsdesign.equations.{kind}.gains")
    assert [path for path in (ROOT / "tests").rglob(kind) if list(path.glob("test_*.py"))]


@pytest.mark.parametrize("layer", ["equations", *sorted(set(LAYERS.values()))])
def test_a_layer_has_no_folder_of_another_kind(layer: str) -> None:
    """Beside those of kinds, run time has one of clocks, which all kinds share."""
    shared = {"clocks"} if layer == "runtime" else set()
    folders = {path.parent.name for path in (ROOT / "obsdesign" / layer).glob("*/__init__.py")}
    assert folders - shared == set(KINDS)


def test_every_table_has_every_kind() -> None:
    for table in (CANDIDATES, CLAIMS, GUARANTEES, OBSERVERS, OPTIONS):
        assert tuple(table) == KINDS


def test_rows_that_come_later_have_a_class_of_their_own() -> None:
    runnable = observer_class("unknown_input", {"differentiator": "fixed_lag"})
    assert runnable is FixedLagObserver  # type: ignore[comparison-overlap]


def test_what_is_no_kind_is_refused() -> None:
    with pytest.raises(InputError, match="kind must be one of interval, set_membership, "):
        kind_named("kalman")


def test_forms_that_are_passed_over_are_named() -> None:
    problem = obsdesign.load_problem(ROOT / "examples" / "degue_4_1.toml")
    open_problem = problem.for_kind("interval")[0]
    assert set(untried_forms(open_problem)) <= {"two_coordinates"}
    assert untried_forms(problem.for_kind("luenberger")[0]) == {}
