"""L of finite-time estimation where it is left open."""

from __future__ import annotations
from typing import Any
from obsdesign.problem import Problem


def chosen_injection(problem: Problem, k: int) -> Any:
    raise NotImplementedError
