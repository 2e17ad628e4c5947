"""Commands from process start to answer, in times of `import numpy`, a process of its own too.

`run`, `verify`, `check` and `design` of two small examples. Ceilings: 3.5, 4.5, 11 and 10 times. A
`check` looks for observers of every kind, and a `design` solves a semidefinite program, for which
Clarabel imports scipy.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path

from benchmarks.cases import report, seconds

CEILINGS = {"run": 3.5, "verify": 4.5, "check": 11.0, "design": 10.0}
ROUNDS = 7
EXAMPLE = Path(__file__).parents[1] / "examples" / "degue_4_1.toml"
OURS, NUMPY = "from obsdesign.cli.main import main; main()", "import numpy"


def main() -> bool:
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    run = partial(subprocess.run, capture_output=True, check=True, env=environment)
    with tempfile.TemporaryDirectory() as folder:
        design, data, out = (str(Path(folder, name)) for name in ("d.json", "d.csv", "e.csv"))
        lines = [f"{k / 10},0.0,0\n" for k in range(100)]
        Path(data).write_text("t,y1,jump\n" + "".join(lines))
        commands = {
            "design": ["design", str(EXAMPLE), "-o", design],
            "verify": ["verify", design],
            "check": ["check", str(EXAMPLE)],
            "run": ["run", design, data, "--initial=-1,1,-1,1", "-o", out],
        }
        good = True
        for name, words in commands.items():
            ours, theirs = list[float](), list[float]()
            for _ in range(ROUNDS):
                ours.append(seconds(partial(run, [sys.executable, "-c", OURS, *words]))[0])
                theirs.append(seconds(partial(run, [sys.executable, "-c", NUMPY]))[0])
            good &= report(f"cold {name}, import numpy", ours, theirs, 1 / CEILINGS[name])
    return good


if __name__ == "__main__":
    sys.exit(not main())
