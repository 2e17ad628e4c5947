"""Problem files (TOML or JSON) to and from `Problem`: a plant and what is asked of it.

Structure is checked by the published JSON Schema, meaning by the plant's own checks; both speak in
one line (`obsdesign.errors.InputError`).
"""

from __future__ import annotations

import json
import math
import os
import tomllib
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from obsdesign.document import jsonable
from obsdesign.errors import InputError
from obsdesign.kinds import GAINS, KINDS, OPTIONS
from obsdesign.plant import Flow, Jump, Output, Plant, matrix
from obsdesign.structure_check import check_structure

Blocks = Mapping[str, Any]


class Problem:
    """A plant, an observer kind (None: not chosen), gains that are kept, options. Read-only.

    Blocks are dataclasses of `obsdesign.plant` or dicts with the keys of a problem file; arrays
    may be numpy arrays. InputError for anything a problem file may not hold.
    """

    __slots__ = ("gains", "kind", "name", "options", "plant")
    name: str
    plant: Plant
    kind: str | None
    gains: Mapping[str, Any]
    options: Mapping[str, Any]

    def __init__(
        self,
        flow: Flow | Blocks,
        output: Output | Blocks,
        jump: Jump | Blocks | None = None,
        observer: Blocks | None = None,
        name: str = "plant",
    ) -> None:
        plain: dict[str, Any] = {"name": name, "flow": flow, "output": output}
        plain |= {} if jump is None else {"jump": jump}
        plain |= {} if observer is None else {"observer": observer}
        body: dict[str, Any] = {key: _as_block(value) for key, value in plain.items()}
        check_structure(body)
        plant = Plant(_flow(body["flow"]), _jump(body.get("jump")), Output(**body["output"]))
        asked = dict(body.get("observer", {}))
        kind = asked.pop("kind", None)
        gains = _gains(asked.pop("gains", {}), kind, plant)
        values = (name, plant, kind, MappingProxyType(gains), MappingProxyType(asked))
        for slot, value in zip(("name", "plant", "kind", "gains", "options"), values, strict=True):
            object.__setattr__(self, slot, value)

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError("a Problem is read-only; build a new one")

    def __repr__(self) -> str:
        return f"Problem({self.name!r}, kind={self.kind!r}, n={self.plant.n}, p={self.plant.p})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Problem) and self.to_dict() == other.to_dict()

    __hash__ = None  # type: ignore[assignment]

    @staticmethod
    def from_dict(body: Any) -> Problem:
        """A problem from parsed TOML or JSON."""
        check_structure(body)
        return Problem(**body)

    def to_dict(self) -> dict[str, Any]:
        """The normalised problem: defaults filled in, JSON-ready, infinity as "inf"."""
        flow, jump, output = self.plant.flow, self.plant.jump, self.plant.output
        body: dict[str, Any] = {"name": self.name, "flow": _present(flow, ("A", "B", "D"))}
        body["flow"]["disturbance"] = {"lower": flow.lower, "upper": flow.upper}
        if jump is not None:
            body["jump"] = _present(jump, ("G", "E", "H", "dwell_time", "dwell_jitter"))
            body["jump"]["disturbance"] = {"lower": jump.lower, "upper": jump.upper}
        names = ("C", "noise_bound", "noise_std", "noise_cv", "measured", "period")
        body["output"] = _present(output, (*names, "jump_measurement"))
        asked = {} if self.kind is None else {"kind": self.kind}
        if asked or self.gains or self.options:
            body["observer"] = asked | {"gains": dict(self.gains)} | dict(self.options)
        result: dict[str, Any] = jsonable(body)
        return result

    def require_kind(self) -> str:
        """The observer kind, or InputError that tells how to choose one."""
        if self.kind is None:
            raise InputError(
                f"observer.kind is required; it is missing. It is one of {', '.join(KINDS)}; "
                "`obsdesign check` tells which of them fit this plant."
            )
        return self.kind

    def require_dwell_time(self) -> tuple[float, float]:
        """(shortest, longest) dwell time, or InputError; for kinds that cannot do without."""
        jump = self.plant.jump
        if jump is None or jump.dwell_time is None:
            raise InputError(
                f"jump.dwell_time = [shortest, longest] is required by kind {self.kind!r}; "
                f"{'[jump]' if jump is None else 'it'} is missing."
            )
        low, high = jump.dwell_time
        return low, high

    def for_kind(self, kind: str) -> tuple[Problem, list[str]]:
        """The same plant for another kind, and the gains and options that were dropped."""
        if kind not in KINDS:
            raise InputError(f"kind must be one of {', '.join(KINDS)}; got {kind!r}.")
        body = self.to_dict()
        asked = body.get("observer", {})
        if asked.get("kind") == kind:
            return self, []
        foreign = self.kind is not None  # gains of one kind mean nothing to another
        gains = {
            k: v for k, v in asked.get("gains", {}).items() if not foreign and k in GAINS[kind]
        }
        options = {k: v for k, v in self.options.items() if not foreign and k in OPTIONS[kind]}
        dropped = [f"gains.{name}" for name in self.gains if name not in gains]
        dropped += [name for name in self.options if name not in options]
        body["observer"] = {"kind": kind, "gains": gains} | options
        return Problem.from_dict(body), dropped


def load_problem(path: str | os.PathLike[str]) -> Problem:
    """Read a problem file: JSON by its suffix .json, else TOML. InputError names file and line."""
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(
            f"{path}: UTF-8 text is required; it is not. Is it a binary file?"
        ) from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}.") from None
    if not text.strip():
        raise InputError(f"{path}: a problem is required; the file is empty.")
    is_json = Path(path).suffix.lower() == ".json"
    try:
        body = _parse_json(text) if is_json else tomllib.loads(text)
    except RecursionError:
        raise InputError(f"{path}: nested too deeply to be a problem file.") from None
    except ValueError as error:
        raise InputError(f"{path}: not valid {'JSON' if is_json else 'TOML'}: {error}.") from None
    try:
        return Problem.from_dict(body)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _parse_json(text: str) -> Any:
    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        names = [name for name, _ in pairs]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"key {name!r} stands {names.count(name)} times")
        return dict(pairs)

    def constant(name: str) -> float:
        raise ValueError(f'{name} is not allowed; infinity is written "inf"')

    return json.loads(text, object_pairs_hook=once, parse_constant=constant)


def _as_block(value: Any) -> Any:
    """Dataclasses and arrays as the plain dicts and lists of a file."""
    if isinstance(value, Flow | Jump | Output):
        names = [name for name in value.__dataclass_fields__ if getattr(value, name) is not None]
        block = {name: _as_block(getattr(value, name)) for name in names}
        ends = {name: block.pop(name) for name in ("lower", "upper") if name in block}
        return block | ({"disturbance": ends} if ends else {})
    if isinstance(value, Mapping):
        return {key: _as_block(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [_as_block(item) for item in value]
    return value


def _flow(block: Blocks) -> Flow:
    rest = dict(block)
    bounds = rest.pop("disturbance", {})
    return Flow(**rest, **bounds)


def _jump(block: Blocks | None) -> Jump | None:
    if block is None:
        return None
    rest = dict(block)
    bounds = rest.pop("disturbance", {})
    for name in ("dwell_time", "dwell_jitter"):
        if name in rest:
            rest[name] = _infinite(rest[name])
    return Jump(**rest, **bounds)


def _infinite(value: Any) -> Any:
    if isinstance(value, list):
        return [_infinite(item) for item in value]
    return math.inf if value == "inf" else value


def _gains(given: Blocks, kind: str | None, plant: Plant) -> dict[str, Any]:
    """Gain matrices, finite and of the shape their kind gives them."""
    D = plant.flow.D
    q = 0 if D is None else np.shape(D)[1]
    sizes = {"n": plant.n, "p": plant.p, "n-q": plant.n - q, "p-q": plant.p - q}
    found = {}
    for name, values in given.items():
        entry = f"observer.gains.{name}"
        found[name] = matrix(values, entry)
        if kind is None:
            continue
        letters = GAINS[kind][name]
        rows, columns = (sizes[letter] for letter in letters)
        if found[name].shape != (rows, columns):
            got = "x".join(map(str, found[name].shape))
            hint = " Is it transposed?" if found[name].shape == (columns, rows) else ""
            raise InputError(
                f"{entry} must be {rows}x{columns} ({letters[0]} x {letters[1]}, n states, "
                f"p outputs{', q unknown inputs' if 'q' in letters[1] else ''}); got {got}.{hint}"
            )
    if kind == "unknown_input" and ("L" in found) != ("T1" in found):
        absent = "T1" if "L" in found else "L"
        raise InputError(
            f"observer.gains.{absent} is required: L and T1 are given together; it is missing."
        )
    return found


def _present(block: Any, names: tuple[str, ...]) -> dict[str, Any]:
    return {name: getattr(block, name) for name in names if getattr(block, name) is not None}
