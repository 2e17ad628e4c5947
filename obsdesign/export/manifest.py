"""The manifest of exported code: its origin, operation counts, what rounding costs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from lmi.arithmetic.arrays import Entries, NewEntries, Value
from obsdesign.document import Claim, Design
from obsdesign.errors import InputError
from obsdesign.export.execution import width_cost
from obsdesign.export.precision import PRECISIONS, gamma
from obsdesign.export.program import FLOWS, Product, Program
from obsdesign.export.programs import program_of
from obsdesign.export.record import Record
from obsdesign.export.source import Export
from obsdesign.export.timing import Steps
from obsdesign.version import __version__

FORMAT, VERSION = "obsdesign/code", 1


@dataclass(frozen=True)
class Options:
    """What an export may choose. prefix: of the names in C."""

    precision: str = "double"
    steps: Steps = field(default_factory=Steps)
    prefix: str = "obs"

    def program(self, design: Design) -> Program:
        """The program of a design."""
        return program_of(design, self.precision, self.steps)

    def export(self, design: Design) -> Export:
        """The program of a design with its names."""
        names = design.problem.get("names") or {}
        return Export(self.program(design), design.name, design.digest, self.prefix, names)


def manifest_of(export: Export, record: Record, options: Options, design: Design) -> NewEntries:
    """The entries of the manifest; numbers of operations are those of one row without jump."""
    program, target = export.program, export.program.target
    terms = max(product.terms for product in program.products)
    cost = 0.0
    if program.has_bounds and target.name != "double":
        double = program_of(design, "double", options.steps)
        cost = width_cost(program, double, record.rows, record.initial)
    margin = None
    if program.has_bounds:
        margin = min(product.margin(target) for product in program.products)
    timing = program.timing
    return {
        "format": FORMAT, "version": VERSION, "obsdesign": __version__, "design": export.digest,
        "kind": program.kind, "precision": target.name, "prefix": export.prefix,
        "steps": list(timing.lengths), "step_error": timing.error, "tick": str(timing.tick),
        "products": len(program.products), "products_of_a_row": terms,
        "multiplications_of_a_step": _multiplications(program),
        "unit_roundoff": target.unit, "rounding_of_a_step": _rounding(terms, target.unit),
        "smallest_margin": margin, "width_cost": cost,
        "rows_of_self_test": len(record.rows),
    }  # fmt: skip


def claim_of(program: Program, manifest: Entries) -> Claim:
    """The claim `code` of files that are what the design gives, from the counts of a manifest."""
    margin, rounding = manifest["smallest_margin"], manifest["rounding_of_a_step"]
    what = "tables, source and manifest are those of the design"
    source = "N. J. Higham, Accuracy and Stability of Numerical Algorithms (2002), section 3.1"
    if not program.has_bounds:
        statement = f"{what}; a step rounds by at most {rounding:.2g} of the sum of its magnitudes"
        return Claim("code", statement, source, "proved", {"rounding_of_a_step": rounding})
    statement = f"{what}, and their margins cover the rounding of every operation"
    verdict = "proved" if margin >= 1.0 else "refuted"
    return Claim("code", statement, source, verdict, {"smallest_margin": margin})


def options_of(manifest: Value, design: Design) -> Options:
    """The options that a manifest states; InputError where it is none, or of another design."""
    if not isinstance(manifest, Mapping) or manifest.get("format") != FORMAT:
        raise InputError(f"not a manifest: format must be {FORMAT!r}.")
    if manifest.get("version") != VERSION:
        raise InputError(f"version must be {VERSION}; got {manifest.get('version')!r}.")
    if manifest.get("design") != design.digest:
        raise InputError("the digest of the design is another one than that of design.json.")
    keys = ("precision", "prefix", "steps", "step_error")
    precision, prefix, steps, error = (manifest.get(key) for key in keys)
    if not isinstance(precision, str) or precision not in PRECISIONS:
        raise InputError(f"precision must be one of {', '.join(PRECISIONS)}; got {precision!r}.")
    if not isinstance(prefix, str):
        raise InputError(f"prefix must be a text; got {prefix!r}.")
    lengths = [_number(each) for each in steps] if isinstance(steps, list) else [None]
    known = [each for each in lengths if each is not None]
    if len(known) < len(lengths):
        raise InputError(f"steps must be a list of numbers; got {steps!r}.")
    relative = _number(error)
    if relative is None:
        raise InputError(f"step_error must be a number; got {error!r}.")
    return Options(precision, Steps(tuple(known), relative), prefix)


def _number(value: Value) -> float | None:
    """A number of a file; None for what is none."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        return float(value)
    except OverflowError:
        return math.inf


def _multiplications(program: Program) -> int:
    """Of the longest step without a jump, unless its bounds cross."""
    places = {flow[name] for flow in program.flows if flow is not None for name in FLOWS}
    return program.width * max(
        _rows(program.products[place], program.sizes.ends) for place in places
    )


def _rows(product: Product, ends: int) -> int:
    if not product.rooms:
        return len(product.rows)
    _, *lists = product.candidates(ends)
    return product.rooms + 1 + sum(len(each) for of_ends in lists for each in of_ends)


def _rounding(terms: int, unit: float) -> float:
    return float(gamma(np.array([terms]), unit)[0])
