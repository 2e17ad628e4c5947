"""Provenance names the solvers that were called for the design, and no others."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module, metadata
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.design_file import from_dict
from obsdesign.document import digest
from obsdesign.synthesis.finite_time import minimax

# where each solver is entered: (module, attribute)
ENTRIES = {
    "Clarabel": ("clarabel", "DefaultSolver"),
    "HiGHS": ("lmi.find.linear_program", "SilentSolver"),
    "CVXPY/Clarabel": ("cvxpy", "Problem"),
    "IPOPT": ("casadi", "nlpsol"),
    "SciPy": ("scipy.optimize", "minimize"),
}
OSCILLATOR = {"A": [[0, 0.15], [-0.15, 0]]}
SAMPLES = {"C": [[0.3, 0.0]], "measured": "periodic", "period": 0.5}
JUMPS = {"G": [[0.5, 0.1], [-0.2, 0.6]], "dwell_time": [0.5, 2.0]}


def finite_time(**options: Any) -> dict[str, Any]:
    observer = {"kind": "finite_time", "window": 6.0} | options
    return {"flow": OSCILLATOR, "output": SAMPLES, "observer": observer}


def with_minimax() -> dict[str, Any]:
    body = finite_time(method="minimax")
    return body | {"output": {**SAMPLES, "noise_bound": [0.01]}}


def luenberger(A: Any, G: Any) -> dict[str, Any]:
    n = len(A)
    zero = [[0.0]] * n
    return {
        "flow": {"A": A},
        "jump": {"G": G, "dwell_time": [0.5, 2.0]},
        "output": {"C": [[1.0] + [0.0] * (n - 1)]},
        "observer": {"kind": "luenberger", "gains": {"L": zero, "M": zero}},
    }


def turning() -> dict[str, Any]:
    return luenberger([[-1.0, 2.0], [-2.0, -1.0]], JUMPS["G"])


def with_open_jump_gain() -> dict[str, Any]:
    body = turning()
    return body | {"observer": {"kind": "luenberger", "gains": {"L": [[0.0], [0.0]]}}}


def positive(n: int) -> dict[str, Any]:
    """A positive system, so large that a vector is looked for before a matrix."""
    A = np.full((n, n), 0.01) - np.eye(n)
    return luenberger(A.tolist(), (0.5 * np.eye(n)).tolist())


def sampled() -> dict[str, Any]:
    return {
        "flow": {
            "A": [[-1.0, 1.0], [0.0, -0.5]],
            "disturbance": {"lower": [0, 0], "upper": [1, 1]},
        },
        "output": {**SAMPLES, "C": [[1.0, 0.0]], "noise_bound": [0.1]},
        "observer": {"kind": "interval", "form": "cooperative"},
    }


def impulses(**options: Any) -> dict[str, Any]:
    return {
        "flow": {"A": [[-0.1, 0], [1, -0.2]]},
        "jump": {"H": [[1], [0]], "dwell_time": [10, "inf"]},
        "output": {"C": [[0, 1]], "measured": "periodic", "period": 0.05, "noise_std": [0.1]},
        "observer": {"kind": "impulsive_input", "operator": "integral"} | options,
    }


CASES: list[tuple[Callable[[], dict[str, Any]], tuple[str, ...], str]] = [
    (lambda: finite_time(method="least_squares"), (), "none"),
    (turning, ("Clarabel",), "Clarabel"),
    (with_open_jump_gain, ("Clarabel",), "Clarabel"),
    (lambda: positive(16), ("HiGHS",), "HiGHS"),
    (sampled, ("HiGHS",), "HiGHS"),
    (with_minimax, ("CVXPY/Clarabel",), "CVXPY/Clarabel"),
    (lambda: finite_time(method="exact"), ("IPOPT", "SciPy"), "IPOPT, SciPy"),
    (
        lambda: finite_time(method="exact", objective="least_noise"),
        ("IPOPT", "SciPy"),
        "IPOPT, SciPy",
    ),
    (impulses, ("IPOPT",), "IPOPT"),
    # twins: what is given is not searched for
    (lambda: impulses(exponents=[-1.0, -1.2, -1.4, -1.6]), (), "none"),
    (lambda: finite_time(method="exact", gains={"L": [[0.0], [0.1]]}), (), "none"),
]


def called(monkeypatch: pytest.MonkeyPatch) -> set[str]:
    """The names of the solvers that are entered from now on."""
    names: set[str] = set()

    def watch(name: str, module: str, attribute: str) -> None:
        home = import_module(module)
        original = getattr(home, attribute)

        def entered(*args: Any, **keys: Any) -> Any:
            names.add(name)
            return original(*args, **keys)

        monkeypatch.setattr(home, attribute, entered)

    for name, (module, attribute) in ENTRIES.items():
        watch(name, module, attribute)
    return names


@pytest.mark.parametrize(("body", "solvers", "text"), CASES)
def test_the_solvers_that_were_called(
    body: Callable[[], dict[str, Any]],
    solvers: tuple[str, ...],
    text: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    names = called(monkeypatch)
    design = obsdesign.design(obsdesign.Problem.from_dict(body()))
    # CVXPY enters Clarabel itself
    assert names - ({"Clarabel"} if "CVXPY/Clarabel" in solvers else set()) == set(solvers)
    assert design.provenance["solver"]["name"] == text
    assert ("version" in design.provenance["solver"]) == bool(solvers)


def test_versions_are_those_of_the_packages() -> None:
    solver = obsdesign.design(obsdesign.Problem.from_dict(with_minimax())).provenance["solver"]
    assert solver["version"] == "/".join(metadata.version(name) for name in ("cvxpy", "clarabel"))


def test_the_second_solver_of_a_program(monkeypatch: pytest.MonkeyPatch) -> None:
    second = {"CVXPY/HiGHS": minimax._SOLVERS["CVXPY/HiGHS"]}
    monkeypatch.setattr(minimax, "_SOLVERS", second)
    design = obsdesign.design(obsdesign.Problem.from_dict(with_minimax()))
    assert design.provenance["solver"]["name"] == "CVXPY/HiGHS"


@pytest.mark.parametrize("body", [turning(), finite_time(method="least_squares")])
def test_a_file_that_names_clarabel_always_still_verifies(body: dict[str, Any]) -> None:
    """As files of earlier versions do."""
    stored = obsdesign.design(obsdesign.Problem.from_dict(body)).to_dict()
    solver = {"name": "clarabel", "version": "0.11.1"}
    older = stored | {"provenance": stored["provenance"] | {"solver": solver}}
    outcome = obsdesign.verify(from_dict(older | {"digest": digest(older)}))
    assert outcome.verdict == "proved"
    assert outcome.design is not None
    assert outcome.design.provenance["solver"] == solver
