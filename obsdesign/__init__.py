"""Observers for impulsive, sampled and unknown-input systems: designed, proved, executed.

    problem = obsdesign.load_problem("problem.toml")
    design = obsdesign.design(problem)
    obsdesign.verify(design)

Names load lazily, so that `import obsdesign.runtime` needs numpy alone.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from obsdesign.version import __version__ as __version__

if TYPE_CHECKING:
    from obsdesign.design_file import load_design
    from obsdesign.document import Claim, Design
    from obsdesign.errors import InputError
    from obsdesign.notebook import check, compare, plot, report, run, search, simulate, sweep
    from obsdesign.problem.flow import Flow
    from obsdesign.problem.output import Output
    from obsdesign.problem.plant import Jump, Plant
    from obsdesign.problem.problem import Problem, load_problem
    from obsdesign.workflow import NotProved, Outcome, design, investigate, verify

_HOME = {
    "Claim": "document",
    "Design": "document",
    "Flow": "problem.flow",
    "InputError": "errors",
    "Jump": "problem.plant",
    "NotProved": "workflow",
    "Outcome": "workflow",
    "Output": "problem.output",
    "Plant": "problem.plant",
    "Problem": "problem.problem",
    "check": "notebook",
    "compare": "notebook",
    "design": "workflow",
    "investigate": "workflow",
    "load_design": "design_file",
    "load_problem": "problem.problem",
    "plot": "notebook",
    "report": "notebook",
    "run": "notebook",
    "search": "notebook",
    "simulate": "notebook",
    "sweep": "notebook",
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
    "check",
    "compare",
    "design",
    "investigate",
    "load_design",
    "load_problem",
    "plot",
    "report",
    "run",
    "search",
    "simulate",
    "sweep",
    "verify",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'obsdesign' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"obsdesign.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return __all__
