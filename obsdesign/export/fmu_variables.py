"""Variables of an FMU: inputs and outputs by their columns, start values as parameters.

Their order is that of their value references, which `templates/fmu.c.j2` counts by: time, numbers
(start values, inputs, outputs), flags, status.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lmi.arithmetic.arrays import Entries
from obsdesign.column_names import numbered
from obsdesign.export.program import Program

# what each version calls numbers, flags and whole numbers
_ELEMENTS = {
    ("2.0", "double"): ("Real", "Boolean", "Integer"),
    ("3.0", "double"): ("Float64", "Boolean", "Int32"),
    ("3.0", "float"): ("Float32", "Boolean", "Int32"),
}


@dataclass(frozen=True)
class Variable:
    """A variable of the model description; start, unit: None where there is none."""

    element: str
    name: str
    causality: str
    variability: str = "discrete"
    start: str | None = None
    unit: str | None = None
    description: str = ""


def plain(text: str) -> str:
    """A text on a line of its own, without signs that XML cannot hold."""
    return "".join(sign for sign in " ".join(text.split()) if sign.isprintable())


class Variables:
    """All variables of a program, in the order of their value references."""

    def __init__(self, program: Program, names: Entries, version: str) -> None:
        self._program, self._names = program, names
        self._number, self._flag, self._whole = _ELEMENTS[version, program.target.name]
        self._time = "Real" if version == "2.0" else "Float64"

    def all(self) -> list[Variable]:
        """Time, start values, inputs, outputs, flags and status."""
        unit = self._names.get("time_unit")
        time = Variable(
            self._time,
            "time",
            "independent",
            "continuous",
            unit=None if unit is None else plain(unit),
        )
        return [time, *self.starts(), *self.inputs(), *self.outputs(), *self.flags(), self._status]

    def starts(self) -> list[Variable]:
        """Bounds of x, or a guess, that the first row begins with."""
        program = self._program
        columns = numbered("x", program.sizes.n)
        if not program.has_bounds:
            return self._numbers([f"{name}_start" for name in columns], "states", "parameter", "0")
        largest = repr(float(program.target.largest))
        return [
            *self._numbers([f"{name}_lo_start" for name in columns], "states", "parameter",
                           f"-{largest}"),
            *self._numbers([f"{name}_hi_start" for name in columns], "states", "parameter",
                           largest),
        ]  # fmt: skip

    def inputs(self) -> list[Variable]:
        """Measurements and known inputs."""
        sizes = self._program.sizes
        signals: list[tuple[str, str | None, int]] = [
            ("y", "outputs", sizes.p), ("u", "inputs", sizes.m)
        ]  # fmt: skip
        if self._program.jumps:
            signals.append(("w", None, sizes.l))
        return [
            variable
            for letter, key, count in signals
            for variable in self._numbers(numbered(letter, count), key, "input", "0")
        ]

    def outputs(self) -> list[Variable]:
        """The estimate, or bounds of x, lower ones first."""
        program = self._program
        columns = numbered("x", program.sizes.n)
        if program.has_bounds:
            return [
                variable
                for end in ("lo", "hi")
                for variable in self._numbers(
                    [f"{name}_{end}" for name in columns], "states", "output", None
                )
            ]
        estimates = self._numbers(columns, "states", "output", None)
        return estimates + self._numbers(numbered("d", program.q), None, "output", None)

    def settable_flags(self) -> list[Variable]:
        """Whether the row has a measurement, and a jump."""
        flags = [Variable(self._flag, "has_y", "input", start="true",
                          description="is there a measurement at this row?")]  # fmt: skip
        if self._program.jumps:
            flags.append(Variable(self._flag, "jump", "input", start="false",
                                  description="does a jump happen at this row?"))  # fmt: skip
        return flags

    def flags(self) -> list[Variable]:
        """Flags of a row, and whether an unknown input is estimated."""
        has_d = Variable(self._flag, "has_d", "output",
                         description="is the unknown input estimated?")  # fmt: skip
        return self.settable_flags() + ([has_d] if self._program.q else [])

    @property
    def _status(self) -> Variable:
        return Variable(
            self._whole, "status", "output",
            description="0: everything that the design guarantees; else a sum of reasons",
        )  # fmt: skip

    def _numbers(
        self, columns: Sequence[str], key: str | None, causality: str, start: str | None
    ) -> list[Variable]:
        """Variables of a signal, described by its names in the problem's block `key`."""
        stated = [] if key is None else self._names.get(key) or []
        units = self._names.get("units") or {}
        variability = "fixed" if causality == "parameter" else "discrete"
        return [
            Variable(
                self._number, column, causality, variability, start,
                plain(units[name]) if name in units else None, plain(name or ""),
            )
            for column, name in (
                (column, stated[i] if i < len(stated) else None) for i, column in enumerate(columns)
            )
        ]  # fmt: skip
