"""Entry point of the command line: an interrupted import is no traceback."""

from __future__ import annotations

import gc
import sys

# most of a short command is importing: what is imported stays, and collecting finds nothing in it
_NEW_OBJECTS_BEFORE_COLLECTING = 50_000


def main() -> None:
    """Run the command line."""
    gc.set_threshold(_NEW_OBJECTS_BEFORE_COLLECTING)
    try:
        from obsdesign.cli.commands import main as run
    except KeyboardInterrupt:
        sys.exit(130)
    run()
