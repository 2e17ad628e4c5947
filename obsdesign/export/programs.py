"""Which designs can be exported, and the program of each kind."""

from __future__ import annotations

from obsdesign.document import Design
from obsdesign.equations.finite_time.gains import FiniteTimeGains
from obsdesign.equations.gains import Gains
from obsdesign.equations.impulsive.gains import ImpulsiveGains
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.equations.luenberger.gains import LuenbergerGains
from obsdesign.equations.unknown_input.gains import UnknownInputGains
from obsdesign.errors import InputError
from obsdesign.export.finite_time import finite_time_program
from obsdesign.export.impulsive import impulsive_program
from obsdesign.export.interval import interval_program
from obsdesign.export.luenberger import luenberger_program
from obsdesign.export.precision import PRECISIONS
from obsdesign.export.program import Program
from obsdesign.export.timing import Steps
from obsdesign.export.unknown_input import unknown_input_program

_PROGRAMS = {
    "interval": interval_program, "luenberger": luenberger_program,
    "impulsive": impulsive_program, "unknown_input": unknown_input_program,
    "finite_time": finite_time_program,
}  # fmt: skip
_GAINS: dict[str, type[Gains]] = {
    "interval": IntervalGains, "luenberger": LuenbergerGains, "impulsive": ImpulsiveGains,
    "unknown_input": UnknownInputGains, "finite_time": FiniteTimeGains,
}  # fmt: skip
# entries of gains that the code has no operations for
_BLOCKS = {
    "modes": "a plant with modes", "sensors": "a plant with several clocks or in discrete time",
    "dt": "a plant in discrete time",
}  # fmt: skip


def program_of(design: Design, precision: str, steps: Steps) -> Program:
    """The program of a design for a precision.

    InputError for a design that cannot be exported, with the reason.
    """
    _refuse(design)
    return _PROGRAMS[design.kind](design.gains, PRECISIONS[precision], steps)


def typed_gains(design: Design) -> Gains:
    """The gains of a design that can be exported."""
    _refuse(design)
    return _GAINS[design.kind].from_document(design.gains)


def _refuse(design: Design) -> None:
    if design.kind not in _PROGRAMS:
        raise InputError(
            f"a design of kind {design.kind!r} cannot be exported to C yet; "
            f"{', '.join(map(repr, _PROGRAMS))} can. Run it with obsdesign.runtime."
        )
    for entry, what in _BLOCKS.items():
        if entry in design.gains:
            raise InputError(
                f"{what} cannot be exported to C yet. Run the design with obsdesign.runtime."
            )
