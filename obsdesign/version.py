"""The version of the package and of what it runs with, for everything that states them."""

from __future__ import annotations

import platform
import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lmi.solvers import Solver, Solvers

__version__ = "0.1.0"

# distribution -> the module that states its version; asking the module is faster than the installer
_MODULES = {"numpy": "numpy", "python-flint": "flint", "clarabel": "clarabel"}

# distributions whose versions identify a solver; IPOPT comes with CasADi
_DISTRIBUTIONS: Mapping[Solver, tuple[str, ...]] = {
    "Clarabel": ("clarabel",),
    "HiGHS": ("highspy",),
    "CVXPY/Clarabel": ("cvxpy", "clarabel"),
    "CVXPY/HiGHS": ("cvxpy", "highspy"),
    "IPOPT": ("casadi",),
    "SciPy": ("scipy",),
}


def version_of(distribution: str) -> str:
    """Version of a distribution as it runs here, or "not installed"."""
    module = sys.modules.get(_MODULES.get(distribution, ""))
    stated = getattr(module, "__version__", None)
    if isinstance(stated, str):
        return stated
    from importlib import metadata  # slow to import

    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return "not installed"


def provenance(solvers: Solvers, label: str) -> dict[str, dict[str, str]]:
    """What a design was made with: versions, the solvers it comes from, the form's label."""
    versions = {name: version_of(name) for name in ("numpy", "python-flint")}
    return {
        "versions": {"obsdesign": __version__, **versions, "python": platform.python_version()},
        "solver": solver_record(solvers),
        "options": {"label": label},
    }


def solver_record(solvers: Solvers) -> dict[str, str]:
    """Names and versions of the solvers that gains and certificates of a candidate come from."""
    if not solvers:
        return {"name": "none"}
    versions = ["/".join(map(version_of, _DISTRIBUTIONS[solver])) for solver in solvers]
    return {"name": ", ".join(solvers), "version": ", ".join(versions)}
