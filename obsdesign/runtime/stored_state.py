"""The state of an observer between two parts of a record, as JSON, and back by its types.

A state is built of dataclasses, named tuples, tuples, arrays and scalars. What is read back is
checked against the annotations of these classes, entry by entry: no text names what is called. A
number is no NaN and an array finite, but for the marks of `state_marks`; times are in order, and
limits of dwell times are those of the design. Arrays stand in a list of their own, so that what was
one array is one array again; caches are left out.
Every number is read back bit by bit.
"""

from __future__ import annotations

import json
import math
import types
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

import numpy as np

from lmi.arithmetic.arrays import Entries, NewEntries, Value
from obsdesign.document import Design, digest
from obsdesign.errors import InputError
from obsdesign.input_files import parse_json, require_depth
from obsdesign.runtime.clocks.dwell_guard import DwellGuard
from obsdesign.runtime.finite_time.tape import Tape
from obsdesign.runtime.progress import Progress
from obsdesign.runtime.state_checks import StateEntries, check_times_of_list, wrong
from obsdesign.runtime.status import VOID_SINCE

FORMAT = "obsdesign/state"
VERSION = 9
_KEYS = {"format", "version", "kind", "design", "progress", "arrays", "digest"}
_WORDS = {"nan": math.nan, "inf": math.inf, "-inf": -math.inf}
_DTYPES: Entries = {"float": np.float64, "int": np.int64, "bool": np.bool_}


def state_text(design: Design, progress: Progress) -> str:
    """The state file of an observer of a design, signed like the design."""
    writer = _Writer()
    body = {
        "format": FORMAT,
        "version": VERSION,
        "kind": design.kind,
        "design": design.digest,
        "progress": [writer.entry(getattr(progress, one.name)) for one in fields(Progress)],
        "arrays": writer.arrays,
    }
    return json.dumps(body | {"digest": digest(body)}, ensure_ascii=False, allow_nan=False)


def progress_from_text(text: str, design: Design, observer: Value, path: str) -> Progress:
    """Read the progress that `state_text` wrote for an observer of this design.

    InputError when it is no state file, was changed, belongs to another design, or holds an entry
    of another type than the observer's state has there.
    """
    body = _checked_body(text, design, path)
    try:
        reader = _Reader([_array(entry) for entry in body["arrays"]], observer.sizes)
        progress = Progress(**_progress(body["progress"], reader, observer))
        _check_ranges(progress, observer)
        if progress.state is not None:
            reader.entries.check(progress.state.t, observer.guards)
        return progress
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{path}: not a state of kind {design.kind!r}: {error}") from None


def _progress(stored: Value, reader: _Reader, observer: Value) -> NewEntries:
    """Entries of a `Progress`; TypeError or ValueError where they are none."""
    hints = get_type_hints(Progress, include_extras=True)
    names = [one.name for one in fields(Progress)]
    if not isinstance(stored, list) or len(stored) != len(names):
        raise wrong("progress", f"a list of {len(names)}", stored)
    entries = dict(zip(names, stored, strict=True))
    hints["state"] = get_type_hints(type(observer).init, include_extras=True)["return"]
    if entries["state"] is None and entries["late"]:
        hints["state"] = type(None)
    return {name: reader.entry(hints[name], entry, name) for name, entry in entries.items()}


def _checked_body(text: str, design: Design, path: str) -> NewEntries:
    try:
        body = parse_json(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not a state file that can be resumed: {error}.") from None
    require_depth(body, path)
    try:
        if not isinstance(body, dict) or body.get("format") != FORMAT:
            raise ValueError(f"format must be {FORMAT!r}")
        if type(body.get("version")) is not int or body["version"] != VERSION:
            raise ValueError(f"version must be {VERSION}; got {body.get('version')!r}")
        if set(body) != _KEYS:
            raise ValueError(f"its keys must be {', '.join(sorted(_KEYS))}")
        if body["digest"] != digest(body):
            raise ValueError("digest does not match the content; it was changed")
    except ValueError as error:
        raise InputError(f"{path}: not a state file that can be resumed: {error}.") from None
    own = design.digest
    if body["design"] != own:
        raise InputError(
            f"{path}: design must be {own!r}, the one that runs; got {body['design']!r}. Was it "
            "saved by another design?"
        )
    if body["kind"] != design.kind:
        raise InputError(f"{path}: kind must be {design.kind!r}; got {body['kind']!r}.")
    return body


def _check_ranges(progress: Progress, observer: Value) -> None:
    """Raise TypeError unless the rows behind a state are in order, and its lists not too long."""
    for name, most in observer.capacities.items() if progress.state is not None else ():
        if len(getattr(progress.state, name)) > most:
            count = len(getattr(progress.state, name))
            raise wrong(f"state.{name}", f"a list of {most} at most", count)
    if progress.given < 0:
        raise wrong("given", "at least 0", progress.given)
    latest = -math.inf if progress.state is None else progress.state.t
    if progress.state is not None and not math.isfinite(latest):
        raise wrong("state.t", "finite", latest)
    if progress.first == -math.inf:
        raise wrong("first", "the time of a row, or inf", progress.first)
    for k, row in enumerate(progress.waiting):
        if not (latest < row[0] < math.inf or (k == 0 and row[0] == latest)):
            raise wrong(f"waiting[{k}][0]", f"finite and after {latest!r}", row[0])
        latest = row[0]
    if not progress.in_force.since <= progress.t:
        raise wrong(
            "in_force.since", f"at most {progress.t!r}, the last row", progress.in_force.since
        )
    for k, late in enumerate(progress.late):
        if not latest <= late.t < math.inf:
            raise wrong(f"late[{k}].t", f"finite and at least {latest!r}", late.t)
        latest = late.t
        _ = late.sample
    if progress.now == math.inf:
        raise wrong("now", "finite", progress.now)


class _Writer:
    """Entries of a state as JSON; each array once, in the order in which it was met."""

    def __init__(self) -> None:
        self.arrays: list[NewEntries] = []
        self._places: dict[int, int] = {}

    def entry(self, value: Value) -> Value:
        if isinstance(value, np.integer | np.bool_):
            return value.item()
        if value is None or isinstance(value, bool | str | int):
            return value
        if isinstance(value, float):
            return _number(float(value))
        if isinstance(value, np.ndarray):
            if id(value) not in self._places:
                self._places[id(value)] = len(self.arrays)
                self.arrays.append(_stored(value))
            return {"array": self._places[id(value)]}
        if isinstance(value, Tape):  # a cache: room behind an array
            return None
        if (names := _fields(type(value))) is not None:
            entries = {name: self.entry(getattr(value, name)) for name in names}
            return {"type": type(value).__name__, **entries}
        if isinstance(value, tuple):
            return [self.entry(item) for item in value]
        raise TypeError(f"a state cannot hold {type(value).__name__}")


class _Reader:
    """Entries of a state from JSON, each checked against its annotation."""

    def __init__(
        self, arrays: Sequence[np.ndarray[Value, Value]], sizes: Mapping[str, int]
    ) -> None:
        self._arrays = arrays
        self.entries = StateEntries(sizes)

    def entry(self, hint: Any, value: Value, name: str, marks: Sequence[str] = ()) -> Value:
        origin, args = get_origin(hint), get_args(hint)
        if origin is Annotated:
            return self.entry(args[0], value, name, args[1:])
        if origin in (Union, types.UnionType):
            return self._one_of(args, value, name)
        if origin is tuple:
            return self._tuple(args, value, name)
        if origin is np.ndarray:
            return self.entries.add(name, self._array(args, value, name), marks)
        names = _fields(hint)
        if names is not None:
            return self._record(hint, names, value, name)
        if hint is float and value in ("inf", "-inf"):
            return self.entries.add(name, _WORDS[value], marks)
        if hint in (float, int, bool, str, type(None)) and type(value) is hint:
            return self.entries.add(name, value, marks)
        raise wrong(name, getattr(hint, "__name__", str(hint)), value)

    def _one_of(self, hints: tuple[Any, ...], value: Value, name: str) -> Value:
        if isinstance(value, dict) and "type" in value:
            hints = tuple(h for h in hints if getattr(h, "__name__", "") == value["type"])
        # None first: a refusal is then about what else the entry may be
        hints = tuple(sorted(hints, key=lambda hint: hint is not type(None)))
        for hint in hints:
            try:
                return self.entry(hint, value, name)
            except TypeError:
                if hint is hints[-1]:
                    raise
        raise wrong(name, "another type", value)

    def _tuple(self, args: tuple[Any, ...], value: Value, name: str) -> tuple[Value, ...]:
        if isinstance(value, list) and args[-1] is Ellipsis:
            args = args[:1] * len(value)
        if not isinstance(value, list) or len(value) != len(args):
            raise wrong(name, f"a list of {len(args)}", value)
        pairs = enumerate(zip(args, value, strict=True))
        items = tuple(self.entry(hint, item, f"{name}[{i}]") for i, (hint, item) in pairs)
        if args and _fields(args[0]) is not None:
            check_times_of_list(name, args[0], items)
        return items

    def _array(self, args: tuple[Any, ...], value: Value, name: str) -> Value:
        place = value.get("array") if isinstance(value, dict) and len(value) == 1 else None
        if type(place) is not int or not 0 <= place < len(self._arrays):
            raise wrong(name, "an array", value)
        array, (dtype,) = self._arrays[place], get_args(args[1])
        if dtype is not Any and array.dtype != dtype:
            raise wrong(name, f"an array of {dtype.__name__}", str(array.dtype))
        return array

    def _record(self, kind: Any, names: Sequence[str], value: Value, name: str) -> Value:
        if not isinstance(value, dict) or set(value) != {"type", *names}:
            raise wrong(name, f"{kind.__name__} with {', '.join(names)}", value)
        if value["type"] != kind.__name__:
            raise wrong(f"{name}.type", kind.__name__, value["type"])
        hints, unset = get_type_hints(kind, include_extras=True), _nan_before_the_first(kind)
        around, self.entries.own = self.entries.own, {}
        record = kind(*(
            math.nan if value[one] == "nan" and one in unset
            else self.entry(hints[one], value[one], f"{name}.{one}")
            for one in names
        ))  # fmt: skip
        self.entries.own = around
        refutation = getattr(record, "refutation", "")
        if refutation and not refutation.startswith(VOID_SINCE):
            raise wrong(f"{name}.refutation", f"empty or begin with '{VOID_SINCE}'", refutation)
        self.entries.is_refuted |= bool(refutation)
        if isinstance(record, DwellGuard):
            self.entries.guards.append((name, record))
        return record


def _fields(kind: Any) -> tuple[str, ...] | None:
    """Names of a dataclass or a named tuple, in the order of its arguments; None for others."""
    if isinstance(kind, type) and is_dataclass(kind):
        return tuple(one.name for one in fields(kind))
    return getattr(kind, "_fields", None) if isinstance(kind, type) else None


def _nan_before_the_first(kind: Any) -> tuple[str, ...]:
    """Names of the entries that are NaN by default: of what has not happened yet."""
    defaults = getattr(kind, "_field_defaults", None)
    if defaults is None:
        defaults = {one.name: one.default for one in fields(kind)}
    return tuple(name for name, x in defaults.items() if isinstance(x, float) and math.isnan(x))


def _stored(array: np.ndarray[Value, Value]) -> NewEntries:
    """An array with the order of its axes in memory: products round by it."""
    dtype = next((name for name, one in _DTYPES.items() if array.dtype == one), None)
    if dtype is None:
        raise TypeError(f"a state cannot hold an array of {array.dtype}")
    axes = sorted(range(array.ndim), key=lambda axis: -abs(array.strides[axis]))
    values = array.transpose(axes).ravel().tolist()
    return {"dtype": dtype, "shape": list(array.shape), "axes": axes,
            "values": [_number(x) for x in values] if dtype == "float" else values}  # fmt: skip


def _array(entry: Value) -> np.ndarray[Value, Value]:
    if not isinstance(entry, dict) or set(entry) != {"dtype", "shape", "axes", "values"}:
        raise wrong("arrays", "dtype, shape, axes and values", entry)
    dtype, shape, axes, values = (entry[name] for name in ("dtype", "shape", "axes", "values"))
    if dtype not in tuple(_DTYPES):
        raise wrong("dtype", f"one of {', '.join(_DTYPES)}", dtype)
    for name, listed in (("shape", shape), ("axes", axes), ("values", values)):
        if not isinstance(listed, list):
            raise wrong(name, "a list", listed)
    if not all(type(size) is int and size >= 0 for size in [*shape, *axes]):
        raise wrong("shape", "counts, and axes theirs", [shape, axes])
    if sorted(axes) != list(range(len(shape))) or len(values) != math.prod(shape):
        raise wrong("shape", f"that of {len(values)} values", shape)
    plain = [_WORDS.get(x, x) if dtype == "float" and isinstance(x, str) else x for x in values]
    if any(type(x).__name__ != dtype for x in plain):
        raise wrong("values", f"of type {dtype}", values)
    flat = np.array(plain, dtype=_DTYPES[dtype])
    return flat.reshape([shape[axis] for axis in axes]).transpose(np.argsort(axes))


def _number(value: float) -> float | str:
    return value if math.isfinite(value) else repr(value)
