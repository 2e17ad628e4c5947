"""Names of the columns of data and estimates; docs/problem_file.md says what they hold.

A signal of several entries has a column for each, numbered from 1: y1, y2. A pair of bounds has
two: x1_lo, x1_hi.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

TIME, JUMP, STATUS = "t", "jump", "status"
# names of the events of a row, where events have names
EVENT = "event"
# when a row arrived
RECEIVED = "received"
# the mode from a row on
MODE = "mode"
# measurements, known inputs of the flow, known inputs of jumps; empty where there is none
SIGNALS = ("y", "u", "w")
# bounds of a row: of the flow's disturbance, of the jump's, of the noise; empty: as declared
BOUNDED = ("b", "c", "v")
# of simulations: states and unknown inputs, which observers do not read
TRUTH = ("x", "d")
ENDS = ("lo", "hi")
# smallest part of the largest coefficient that a linear combination shows
_NEGLIGIBLE = 1e-3


def numbered(letter: str, count: int) -> tuple[str, ...]:
    """x1, x2, ..., as many as there are entries."""
    return tuple(f"{letter}{i + 1}" for i in range(count))


def signal_columns(name: str, count: int) -> tuple[str, ...]:
    """Columns of an event or a sensor: its name, with a number where it has several entries."""
    return (name,) if count == 1 else numbered(name, count)


def pairs(names: Iterable[str]) -> tuple[str, ...]:
    """x1_lo, x1_hi, x2_lo, ...: the columns of the bounds of what has these names."""
    return tuple(f"{name}_{end}" for name in names for end in ENDS)


def data_columns(counts: Mapping[str, int], has_jump: bool) -> tuple[str, ...]:
    """Columns that the data of a plant have, in their usual order; counts: entries by signal."""
    signals = [name for letter in SIGNALS for name in numbered(letter, counts[letter])]
    return (TIME, *signals, *([JUMP] if has_jump else []))


def combination(coefficients: Sequence[float], names: Sequence[str]) -> str:
    """A linear combination of states for people, its first term without a factor: "x1 - 2 x2".

    Terms below 1e-3 of the largest are left out.
    """
    largest = max(map(abs, coefficients))
    pairs = zip(coefficients, names, strict=True)
    terms = [(value, name) for value, name in pairs if abs(value) >= _NEGLIGIBLE * largest]
    first, text = terms[0]
    for value, name in terms[1:]:
        factor = f"{abs(value / first):.3g}"
        sign = "-" if value / first < 0 else "+"
        text += f" {sign} {name}" if factor == "1" else f" {sign} {factor} {name}"
    return text
