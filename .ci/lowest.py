"""Print the lowest versions that pyproject.toml allows, one `name==version` per dependency.

`.ci/run` installs and tests them: a lower bound that nobody runs is a guess.
"""

import re
import tomllib
from pathlib import Path

# of the extra `test`, what the tests that are run need; the rest is for pages, types and exports
NEEDED = ("hypothesis", "pytest", "pytest-xdist")


def main() -> None:
    """Print the pins; SystemExit if a dependency is not written name>=version."""
    project = tomllib.loads((Path(__file__).parent.parent / "pyproject.toml").read_text())[
        "project"
    ]
    wanted = list(project["dependencies"])
    for entry in project["optional-dependencies"]["test"]:
        if entry.split(">=")[0] in NEEDED:
            wanted.append(entry)
    for entry in wanted:
        if not re.fullmatch(r"[\w.-]+>=[\w.]+", entry):
            raise SystemExit(f"pyproject.toml: {entry!r} must be written name>=version")
        print(entry.replace(">=", "=="))


main()
