"""An FMU that fmpy loads: rows in, outputs of the row out."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from obsdesign.export.execution import Row
from obsdesign.export.program import Program


def load(path: Path, folder: Path) -> tuple[Any, dict[str, int]]:
    """An instance of an FMU, and its value references by name."""
    fmpy = pytest.importorskip("fmpy", reason="the extra `fmu` is not installed")
    fmpy.extract(str(path), str(folder))
    description = fmpy.read_model_description(str(folder))
    instance = fmpy.instantiate_fmu(str(folder), description, "CoSimulation")
    return instance, {each.name: each.valueReference for each in description.modelVariables}


class Simulated:
    """A co-simulation of a program: a step after each row."""

    def __init__(self, program: Program, path: Path, folder: Path) -> None:
        self.program = program
        self.fmu, self.references = load(path, folder)
        self._is_2 = hasattr(self.fmu, "setReal")
        self._number = "Float32" if program.target.name == "float" else "Float64"
        self.time = 0.0

    def set(self, kind: str, values: Mapping[str, Any]) -> None:
        """Set variables of a kind: Number or Boolean."""
        names = [self.references[name] for name in values]
        getattr(self.fmu, f"set{self._word(kind)}")(names, list(values.values()))

    def get(self, kind: str, *names: str) -> list[Any]:
        """Values of variables of a kind: Number, Boolean or Whole."""
        references = [self.references[name] for name in names]
        return list(getattr(self.fmu, f"get{self._word(kind)}")(references))

    def _word(self, kind: str) -> str:
        if kind == "Number":
            return "Real" if self._is_2 else self._number
        return {"Whole": "Integer" if self._is_2 else "Int32"}.get(kind, kind)

    def begin(self, *initial: Any) -> None:
        """Initialise with bounds, or with an estimate."""
        if self._is_2:
            self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        ends = ("_lo", "_hi") if self.program.has_bounds else ("",)
        for end, values in zip(ends, initial, strict=True):
            self.set("Number", {f"x{i + 1}{end}_start": v for i, v in enumerate(values.tolist())})
        self.fmu.exitInitializationMode()
        self.time = 0.0

    def put(self, row: Row) -> None:
        """Set the inputs of a row."""
        sizes = self.program.sizes
        signals = [("y", row.y, sizes.p), ("u", row.u, sizes.m)]
        if self.program.jumps:
            signals.append(("w", row.w, sizes.l))
        numbers = {
            f"{letter}{i + 1}": 0.0 if values is None else float(values[i])
            for letter, values, count in signals
            for i in range(count)
        }
        self.set("Number", numbers)
        flags = {"has_y": row.y is not None} | ({"jump": row.jump} if self.program.jumps else {})
        self.set("Boolean", flags)

    def step(self, length: float) -> None:
        """A communication step from the present row to the next."""
        end = self.time + length
        # as most masters do: the difference of two times
        self.fmu.doStep(currentCommunicationPoint=self.time, communicationStepSize=end - self.time)
        self.time = end

    def answer(self) -> tuple[Any, int]:
        """[lower; -upper], or x and d, and the status."""
        n, q = self.program.sizes.n, self.program.q
        columns = [f"x{i + 1}" for i in range(n)]
        status = self.get("Whole", "status")[0]
        if not self.program.has_bounds:
            names = columns + [f"d{i + 1}" for i in range(q)]
            return np.array(self.get("Number", *names)), status
        low, high = (
            np.array(self.get("Number", *(name + end for name in columns)))
            for end in ("_lo", "_hi")
        )
        return np.concatenate([low, -high]), status
