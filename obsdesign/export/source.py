"""C99 text of a program: header and source, from one description of the step."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import jinja2
import numpy as np

from lmi.arithmetic.arrays import Entries, Matrix, NewEntries, Value
from obsdesign.errors import InputError
from obsdesign.export.program import Product, Program, flat_flows
from obsdesign.version import __version__

_JUMP_WORDS = {"before": "before it", "after": "after it", "none": "never there"}
# what may begin the names of C
_PREFIX = re.compile(r"[a-z][a-z0-9_]{0,30}")


@dataclass(frozen=True)
class Export:
    """A program with what its files say of it. names: the problem's block of that name."""

    program: Program
    name: str
    digest: str
    prefix: str
    names: Entries

    def __post_init__(self) -> None:
        if not _PREFIX.fullmatch(self.prefix):
            raise InputError(
                f"--prefix must be a lower-case letter and at most 30 letters, digits or _; "
                f"got {self.prefix!r}."
            )


def environment() -> jinja2.Environment:
    """Templates of this folder; a name that they do not know is an error."""
    return jinja2.Environment(
        loader=jinja2.PackageLoader("obsdesign.export"), undefined=jinja2.StrictUndefined,
        trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True, autoescape=False,
    )  # fmt: skip


def rendered(template: str, export: Export, **more: Value) -> str:
    """The text of a template for an export."""
    return environment().get_template(template).render(**_context(export), **more)


def literals(export: Export, values: Sequence[float]) -> list[str]:
    """Numbers as constants of the target."""
    target = export.program.target
    return [target.literal(value) for value in values]


def _context(export: Export) -> NewEntries:
    program = export.program
    sizes, rules = program.sizes, program.rules
    has_jumps = bool(program.jumps)
    return {
        "p": export.prefix, "P": export.prefix.upper(), "title": _comment(export.name),
        "kind": program.kind, "digest": export.digest, "version": __version__,
        "c_type": program.target.name, "limits": program.target.limits,
        "digits": program.target.digits, "zero": program.target.literal(0.0),
        "one": program.target.literal(1.0), "n": sizes.n, "outputs": sizes.p, "m": sizes.m,
        "l": sizes.l, "ends": sizes.ends, "known": sizes.known, "middle": sizes.middle,
        "width": program.width, "first": program.first, "q": program.q, "rooms": 2 * sizes.p,
        "answers": program.answer.stop - program.answer.start, "has_bounds": program.has_bounds,
        "has_jumps": has_jumps, "when": rules.when, "corrects": rules.corrects,
        "is_periodic": rules.is_periodic, "jump_words": _JUMP_WORDS[rules.when],
        "still": program.still, "initial": program.initial,
        "through": [-1 if each is None else each for each in program.through],
        "samples": rules.samples, "full": flat_flows([program.full])[0],
        "has_gap": program.refines_gaps, "before_w": sizes.before_jump_inputs,
        "flows": flat_flows(program.flows), "jumps": program.jumps,
        "input_bounds": _input_bounds(export),
    } | _tables(export) | _names(export) | _timing(export, has_jumps)  # fmt: skip


def _timing(export: Export, has_jumps: bool) -> NewEntries:
    program = export.program
    timing, rules = program.timing, program.rules
    has_guard = has_jumps and timing.has_guard
    counts_jumps = has_jumps and (
        has_guard or bool(timing.borders or rules.window) or rules.is_periodic
    )
    unit = program.target.unit
    within = [each for each in timing.ticks if timing.limit is None or each <= timing.limit]
    off = [_tolerance(length, unit, timing.error) for length in timing.lengths]
    between = rules.corrects or timing.limit is not None
    due = f"jump ? {_word(rules.when != 'none')} : {_word(between)}"
    return {
        "step_error": f"{timing.error:.3g}" if timing.error else "",
        "lengths": ", ".join(f"{length:.9g}" for length in timing.lengths),
        "lengths_text": ", ".join(literals(export, [0.0, *timing.lengths])),
        "tolerances_text": ", ".join(literals(export, [0.0, *off])),
        "ticks": [0, *timing.ticks], "tick": f"{float(timing.tick):.9g}",
        "counts_time": counts_jumps or rules.is_periodic, "counts_jumps": counts_jumps,
        "has_guard": has_guard, "has_jitter": has_guard and timing.jitter is not None,
        "shortest": timing.shortest, "longest": timing.longest, "jitter": timing.jitter,
        "period": timing.period, "borders": timing.borders, "due": due,
        "longest_place": None if timing.limit is None else len(within),
        "window": rules.window, "bridges_gaps": rules.bridges_gaps,
        "base": (timing.spacings or 0) + 1, "sequences": len(program.jumps),
        "has_second_jump": has_jumps and rules.allows_no_second_jump,
    }  # fmt: skip


def _word(value: bool) -> str:
    return "true" if value else "false"


def _tolerance(length: float, unit: float, error: float) -> float:
    """How far a sample's h may be from a length: its error, and an ulp of the target."""
    return float(2.0 * unit * 2.0 ** np.floor(np.log2(length)) + error * length)


def _tables(export: Export) -> NewEntries:
    """Rows, each once, and products as their places."""
    program = export.program
    pool: dict[bytes, int] = {}
    texts: list[str] = []

    def place(row: Matrix) -> int:
        key = (row + 0.0).tobytes()  # a zero has one sign
        if key not in pool:
            pool[key] = len(texts)
            texts.append(", ".join(literals(export, row.tolist())))
        return pool[key]

    products = [
        ", ".join(map(str, _product_words(product, [place(row) for row in product.rows], program)))
        for product in program.products
    ]
    has_inner = any(product.inner for product in program.products)
    return {"pool": texts, "products": products, "has_inner": has_inner}


def _product_words(product: Product, places: list[int], program: Program) -> list[int]:
    """What `products` of the source holds for a product: places of rows and counts."""
    if not program.has_bounds:
        return places
    whole, *lists = product.candidates(program.sizes.ends)
    words = [*places[: product.rooms + 1], *(places[k] for k in whole)]
    for candidates in (each for of_ends in lists for each in of_ends):
        words += [len(candidates), *(places[k] for k in candidates)]
    return words


def _input_bounds(export: Export) -> list[tuple[str, list[str]]]:
    rules = export.program.rules
    bounds = {"input_bound": rules.input_bound, "jump_input_bound": rules.jump_input_bound}
    return [
        (name, literals(export, export.program.target.nearest(values).tolist()))
        for name, values in bounds.items()
        if values is not None and len(values) and np.isfinite(values).all()
    ]


def _names(export: Export) -> dict[str, str]:
    """What the problem calls its signals, for comments."""
    sizes, units = export.program.sizes, export.names.get("units") or {}
    time = export.names.get("time_unit")
    return {
        f"{word}_names": ", ".join(
            _comment(_named(name, units))
            for name in _signal_names(export.names, key, letter, count)
        )
        for word, key, letter, count in (
            ("state", "states", "x", sizes.n), ("output", "outputs", "y", sizes.p),
            ("input", "inputs", "u", sizes.m),
        )
    } | {"time_unit": f" in {_comment(str(time))}" if time else ""}  # fmt: skip


def _signal_names(names: Entries, key: str, letter: str, count: int) -> list[str]:
    stated = names.get(key) or []
    return [str(stated[i]) if i < len(stated) else f"{letter}{i + 1}" for i in range(count)]


def _named(name: str, units: Mapping[str, str]) -> str:
    return f"{name} [{units[name]}]" if name in units else name


def _comment(text: str) -> str:
    """A text that cannot end a comment of C, nor its line."""
    return " ".join(text.split()).replace("*/", "* /").replace("/*", "/ *").rstrip("\\")
