"""The JSON Schema of problem files, made from the dataclasses of plant and options.

python -m docs.problem_schema > obsdesign/problem/problem.schema.json
"""

from __future__ import annotations

import json
from dataclasses import MISSING, fields
from typing import Any

from obsdesign.kinds import GAINS, KINDS, WITH_NAMED_GAINS
from obsdesign.problem.clocks import Event, Sensor
from obsdesign.problem.flow import Flow
from obsdesign.problem.modes import Mode
from obsdesign.problem.option_table import OPTIONS, OPTIONS_OF
from obsdesign.problem.output import Output
from obsdesign.problem.parameters import Parameter, StateBox
from obsdesign.problem.plant import Jump
from obsdesign.problem.schema import DEFINITIONS, entry_name, ref
from obsdesign.problem.signal_names import SignalNames
from obsdesign.problem.timing import Timing

HEAD = {
    "$schema": "https://json-schema.org/draft/2020-12/schema",
    "$id": "obsdesign/problem/1",
    "title": "obsdesign problem",
    "description": "A linear plant with jumps and what is asked of it; TOML, or JSON with the same "
    'keys. Infinity is inf in TOML and the string "inf" in JSON, allowed only as the upper dwell '
    "time and as dwell_jitter. Shapes, bounds and finiteness are checked beyond this schema.",
    "type": "object",
    "required": ["flow"],
    "if": {"anyOf": [{"required": ["event"]}, {"required": ["sensor"]}]},
    "then": {"required": ["sensor"], "properties": {"jump": {"not": {}}, "output": {"not": {}}}},
    "else": {"required": ["output"]},
    # modes may all have their own A
    "allOf": [
        {"if": {"required": ["mode"]}, "else": {"properties": {"flow": {"required": ["A"]}}}}
    ],
    "additionalProperties": False,
}
NAME = {"type": "string", "title": "a text", "description": "What the plant is called."}
BLOCKS = {
    "flow": (Flow, "x'(t) = A x + B u(t) + D d(t) + b(t) between jumps."),
    "jump": (Jump, "x(t) = G x(t-) + E w[k] + H g[k] + c[k] at jump times."),
    "output": (Output, "y = C x + v."),
    "state": (StateBox, "lower <= x(t) <= upper at every instant, as the user vouches."),
    "timing": (Timing, "What the clocks of events have in common."),
    "names": (SignalNames, "What signals are called, and their units."),
}
CLOCKS = {
    "event": (Event, "A jump by a name of its own, as [jump], on a clock of its own."),
    "sensor": (Sensor, "An output by a name of its own, as [output], on a clock of its own."),
    "parameter": (
        Parameter,
        "A number p known up to a range: A(p) = flow.A + p A, likewise B, G, E, C.",
    ),
    "mode": (Mode, "What differs in a mode from [flow] and the sensor, and how long it lasts."),
}
KIND = {
    "enum": list(KINDS),
    "title": "an observer kind",
    "description": "Which observer; without one, only commands that ask for all kinds can be used.",
}
# an event or a sensor by its name, with gains of its own
NAMED = "^[a-z][a-z0-9_]*$"
GAINS_OF_NAMED = {
    "type": "object",
    "title": "a table { L = [...] } of a sensor or { M = [...] } of an event",
    "properties": {"L": ref("gain_matrix"), "M": ref("gain_matrix")},
    "additionalProperties": False,
    "description": "Gains of a sensor (L, n x its outputs: at its samples, x+ = x + L(y - C x)) or "
    "of an event (M, n x p: x+ = G x + M(y - C x)), by its name.",
}
GAIN_DESCRIPTIONS = {
    "D0": "n x n: own split of A - L C = D0 - D1.",
    "D1": "n x n: own split of A - L C = D0 - D1.",
    "Gn": "n x n: own split of the jump matrix, Gp - Gn.",
    "Gp": "n x n: own split of the jump matrix, Gp - Gn.",
    "K": "n x p: output injection, A - K C.",
    "L": "Gain of the flow. interval, luenberger: n x p, A - L C (interval with periodic "
    "measurement: at samples, x+ = x + L(y - C x)). finite_time: n x p, A + L C. unknown_input: "
    "(n-q) x (p-q), in the coordinates of T1.",
    "M": "n x p: gain at jumps.",
    "R": "n x n: A - L C in coordinates S that are built for it, given with T, L and M.",
    "S": "n x n: coordinates, invertible.",
    "S2": "n x n: coordinates at jumps, invertible.",
    "T": "n x n: jump matrix in the coordinates S2.",
    "T1": "n x n: coordinates [Ta, D], invertible; given with L.",
}


def schema() -> dict[str, Any]:
    """The schema of a problem file."""
    blocks = {name: _block(name, *about) for name, about in BLOCKS.items()}
    blocks |= {
        name: {
            "type": "array", "title": f"tables [[{name}]]", "minItems": 1,
            "items": _block(name, *about),
        }
        for name, about in CLOCKS.items()
    }  # fmt: skip
    del blocks["flow"]["required"]  # A, unless modes have their own
    kinds = {kind: _kind(kind) for kind in KINDS}
    return {
        **HEAD,
        "properties": {"name": NAME, **blocks, "observer": _observer()},
        "$defs": {**DEFINITIONS, "kind": KIND, **kinds},
    }


def _block(name: str, block: Any, description: str) -> dict[str, Any]:
    declared = [entry for entry in fields(block) if entry_name(entry)]
    required = [entry_name(e) for e in declared if e.default is MISSING]
    return {
        "type": "object",
        "title": f"a table [{name}]",
        "description": description,
        **({"required": required} if required else {}),
        "additionalProperties": False,
        "properties": {entry_name(entry): entry.metadata["schema"] for entry in declared},
    }


def _observer() -> dict[str, Any]:
    """The [observer] block: all gains and options; `allOf` selects those of its kind."""
    gains = {
        name: {**ref("gain_matrix"), "description": text}
        for name, text in GAIN_DESCRIPTIONS.items()
    }
    options = sorted({name for names in OPTIONS.values() for name in names})
    return {
        "type": "object",
        "title": "a table [observer]",
        "description": "Kind, gains that are kept, options.",
        "properties": {
            "kind": ref("kind"),
            "gains": {
                "type": "object",
                "title": "a table of gain matrices",
                "properties": gains,
                "patternProperties": {NAMED: GAINS_OF_NAMED},
                "additionalProperties": False,
                "description": "Gains that are kept; what is missing is synthesised.",
            },
        },
        "propertyNames": {"enum": ["kind", "gains", *options]},
        "allOf": [
            {
                "if": {"properties": {"kind": {"const": kind}}, "required": ["kind"]},
                "then": ref(kind),
            }
            for kind in KINDS
        ],
    }


def _kind(kind: str) -> dict[str, Any]:
    gains: dict[str, Any] = {"properties": dict.fromkeys(GAINS[kind], True)}
    if kind in WITH_NAMED_GAINS:
        gains["patternProperties"] = {NAMED: True}
    options: Any = OPTIONS_OF[kind]
    return {
        "title": f"[observer] of kind {kind}",
        "properties": {
            "kind": True,
            "gains": {**gains, "additionalProperties": False},
            **{option.name: option.metadata["schema"] for option in fields(options)},
        },
        "additionalProperties": False,
    }


def text() -> str:
    """The schema as the package stores it."""
    return json.dumps(schema(), indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    print(text(), end="")
