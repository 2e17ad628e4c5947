"""Names of solvers, as results carry them: who made a certificate or a gain."""

from __future__ import annotations

from typing import Literal

# a modelling package stands before the solver that it called
Solver = Literal["Clarabel", "HiGHS", "CVXPY/Clarabel", "CVXPY/HiGHS", "IPOPT", "SciPy"]
Solvers = tuple[Solver, ...]


def merged(*groups: Solvers) -> Solvers:
    """The solvers of several results, each once, in their order."""
    return tuple(dict.fromkeys(solver for group in groups for solver in group))
