"""Observers for impulsive, sampled and unknown-input linear systems: designed, proved, executed.

    problem = obsdesign.load_problem("problem.toml")
    design = obsdesign.design(problem)
    obsdesign.verify(design)

Names load lazily, so that `import obsdesign.runtime` needs numpy alone.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from obsdesign.document import Claim, Design, load_design
    from obsdesign.errors import InputError
    from obsdesign.plant import Flow, Jump, Output, Plant
    from obsdesign.problem import Problem, load_problem
    from obsdesign.simulation import simulate
    from obsdesign.workflow import NotProved, Outcome, design, investigate, verify

_HOME = {
    "Claim": "document",
    "Design": "document",
    "Flow": "plant",
    "InputError": "errors",
    "Jump": "plant",
    "NotProved": "workflow",
    "Outcome": "workflow",
    "Output": "plant",
    "Plant": "plant",
    "Problem": "problem",
    "design": "workflow",
    "investigate": "workflow",
    "load_design": "document",
    "load_problem": "problem",
    "simulate": "simulation",
    "verify": "workflow",
}

__all__ = [
    "Claim",
    "Design",
    "Flow",
    "InputError",
    "Jump",
    "NotProved",
    "Outcome",
    "Output",
    "Plant",
    "Problem",
    "design",
    "investigate",
    "load_design",
    "load_problem",
    "simulate",
    "verify",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'obsdesign' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"obsdesign.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return __all__
