"""The version of the package and of what it runs with, for everything that states them."""

from __future__ import annotations

import sys

__version__ = "0.1.0"

# distribution -> the module that states its version; asking the module is faster than the installer
_MODULES = {"numpy": "numpy", "python-flint": "flint", "clarabel": "clarabel"}


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
