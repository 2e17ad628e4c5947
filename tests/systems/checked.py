"""Designs for the programs that check them, and those programs as whoever signs runs them."""

from __future__ import annotations

import copy
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from obsdesign.document import digest
from tests.systems.designs import designed

FOLDER = Path(__file__).parents[2] / "obsdesign" / "checker"
CHECK_DESIGN, CHECK_GAINS = FOLDER / "check_design.py", FOLDER / "check_gains.py"
CHECK_WIDTHS, CHECK_EVENTS = FOLDER / "check_widths.py", FOLDER / "check_events.py"
CHECK_SETS = FOLDER / "check_sets.py"

_JUMP = {"G": [[2, 1], [1, 3]], "dwell_time": [0.7, "inf"]}
_OUTPUT = {"C": [[0, 1]], "noise_bound": [0]}
_GAINS = {"L": [[0], [1]], "M": [[1], [2.8]]}
_COORDINATES = {"S": [[0.1, 0.9], [0.9, 0.1]], "L": [[0], [0]], "M": [[0], [0]]}
_STRAYING = {
    "A": [[-0.5, 1.28, 0.26], [0.23, -0.03, 1.71], [0.4, 0.0, -2.93]],
    "G": [[0.0, 0.0, 0.0], [0.0, 0.011, 0.715], [0.219, 0.54, 0.0]],
}
_SLOW = {
    "A": [[0.42, 0.0, 0.0], [0.0, -1.23, 0.35], [1.58, 0.0, -1.27]],
    "G": [[0.0, 0.511, 0.0], [0.535, 0.0, 0.441], [0.751, 0.199, 0.685]],
}


def _interval(A: Any, jump: Any, **observer: Any) -> dict[str, Any]:
    output = {"C": [[0.0] * (len(A) - 1) + [1.0]], "noise_bound": [0.0]}
    gains = {"L": [[0.0]] * len(A), "M": [[0.0]] * len(A)}
    return {
        "flow": {"A": A}, "jump": jump, "output": output,
        "observer": {"kind": "interval", "gains": gains, **observer},
    }  # fmt: skip


def _luenberger(A: Any, jump: Any, **observer: Any) -> dict[str, Any]:
    output = {"C": [[0.0] * (len(A) - 1) + [1.0]]}
    plant = {"flow": {"A": A}, "output": output} | ({"jump": jump} if jump else {})
    return plant | {"observer": {"kind": "luenberger", **observer}}


PROBLEMS: dict[str, dict[str, Any]] = {
    "cooperative": {
        "flow": {"A": [[-1, 0], [1, -2]]}, "jump": _JUMP, "output": _OUTPUT,
        "observer": {"kind": "interval", "gains": _GAINS},
    },
    "split": _interval([[-3, -1], [1, -2]], {"G": [[1, -0.5], [0.3, 1]], "dwell_time": [0.5, 3]}),
    "coordinates": _interval(
        [[-3, 1], [1, -2]], {"G": [[1, 0.2], [0.3, 1]], "dwell_time": [0.8, 3]}, form="coordinates",
        gains=_COORDINATES,
    ),
    "windows, reduced": _interval(
        _STRAYING["A"], {"G": _STRAYING["G"], "dwell_time": [0.1, 2.0]}
    ),
    "windows, jitter": _interval(
        _SLOW["A"], {"G": _SLOW["G"], "dwell_time": [0.1, 2.0], "dwell_jitter": 0.2}, form="split",
    ),
    "no jumps, bounds": {
        "flow": {"A": [[-1, 0], [1, -2]]}, "output": _OUTPUT,
        "observer": {"kind": "interval", "gains": {"L": [[0], [1]]}},
    },
    "no jumps, widths": {
        "flow": {
            "A": [[-1, 0.5], [1, -2]], "disturbance": {"lower": [-0.1, 0.0], "upper": [0.1, 0.2]},
        },
        "output": {"C": [[0, 1]], "noise_bound": [0.03]},
        "observer": {"kind": "interval", "gains": {"L": [[0.2], [1]]}},
    },
    "point": _luenberger([[0, 1], [-2, 0.1]], {"G": [[1, 0], [0, -0.7]], "dwell_time": [0.3, 2]}),
    "point, decay": _luenberger(
        [[0, 1], [-2, 0.1]], {"G": [[1, 0], [0, -0.7]], "dwell_time": [0.3, "inf"]}, decay_rate=0.2
    ),
    "point, no jumps": _luenberger([[0, 1], [-2, 0.1]], None, decay_rate=0.5),
    "one dwell time": _luenberger(
        [[0, 1], [-2, 0.1]], {"G": [[1, 0], [0, -0.7]], "dwell_time": [0.3, 0.3]}
    ),
    "schedule": {
        "flow": {"A": [[-0.6, 0, -2.3], [-0.2, -1.2, -0.7], [-0.5, -0.3, 0.4]]},
        "jump": {
            "G": [[1, -0.1, 1.4], [-0.7, 0.4, 0.9], [0.1, -0.7, -0.9]], "dwell_time": [0.2, 1.6],
        },
        "output": {"C": [[-0.5, 0.2, -1]], "measured": "at_jumps"},
        "observer": {"kind": "luenberger", "schedule": 4},
    },
    "shaped inputs": {
        "flow": {
            "A": [[-1, 0], [1, -2]], "D": [[1], [0.1]],
            "d_bounds": {"lower": [-0.1], "upper": [0.3]},
            "disturbance_matrix": [[0.1], [0.7]], "disturbance": {"lower": [-0.1], "upper": [0.2]},
        },
        "jump": _JUMP, "output": {"C": [[0, 1]], "noise_bound": [[-0.1, 0.3]]},
        "observer": {"kind": "interval", "gains": _GAINS},
    },
}  # fmt: skip


def body(name: str) -> dict[str, Any]:
    """The document of the design of a problem, by its name."""
    return copy.deepcopy(designed(PROBLEMS[name]).to_dict())


def changed(document: dict[str, Any], change: Callable[[dict[str, Any]], object]) -> dict[str, Any]:
    """The document with a change, signed again."""
    result = copy.deepcopy(document)
    change(result)
    return result | {"digest": digest(result)}


def answer(document: Any, program: Path = CHECK_DESIGN) -> tuple[int, str]:
    """Exit code and output of a program, run with the standard library alone."""
    text = document if isinstance(document, str) else json.dumps(document)
    done = subprocess.run(
        [sys.executable, "-I", "-S", str(program), "-"], input=text, capture_output=True, text=True,
        check=False, timeout=60,
    )  # fmt: skip
    assert "Traceback" not in done.stderr
    return done.returncode, done.stdout


def exit_code(document: Any, program: Any) -> int:
    """The same exit code, from the module of the program, in this process."""
    text = document if isinstance(document, str) else json.dumps(document)
    code = 2
    try:
        design = program.Design(text)
        code = 1
        (program.prove_design if hasattr(program, "prove_design") else program.check_gains)(design)
    except Exception:  # as in `main` of the program
        return code
    return 0


def evidence(document: dict[str, Any], name: str = "dwell_stability") -> dict[str, Any]:
    """The evidence of a claim of a document."""
    return {claim["id"]: claim["evidence"] for claim in document["claims"]}[name]


def point_design(F: Any, H: Any, ends: Any, proof: dict[str, Any]) -> dict[str, Any]:
    """The design of a plant whose error is (F, H), with evidence that may prove nothing."""
    document = copy.deepcopy(body("point"))
    document["claims"] = [claim for claim in document["claims"] if claim["id"] != "rates"]
    n = len(F)
    zeros = [[0.0]] * n
    for block in (document["problem"]["flow"], document["gains"]):
        block["A"] = F
    for block in (document["problem"]["jump"], document["gains"]):
        block["G"], block["dwell_time"] = H, ends
    for block in (document["problem"]["output"], document["gains"]):
        block["C"] = [[0.0] * n]
    document["gains"].update(L=zeros, M=zeros)
    evidence(document).clear()
    evidence(document).update(proof)
    return changed(document, lambda d: None)
