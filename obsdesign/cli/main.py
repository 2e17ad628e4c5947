"""Entry point of the command line: an interrupted import is no traceback."""

from __future__ import annotations

import sys


def main() -> None:
    """Run the command line."""
    try:
        from obsdesign.cli.commands import main as run
    except KeyboardInterrupt:
        sys.exit(130)
    run()
