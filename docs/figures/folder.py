"""Where a script of figures draws: the folder of the command line, or docs/."""

from __future__ import annotations

import sys
from pathlib import Path

DOCS = Path(__file__).parents[1]


def chosen() -> Path:
    """The first argument, or docs/."""
    return Path(sys.argv[1]) if len(sys.argv) > 1 else DOCS
