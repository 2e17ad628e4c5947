"""Parameters with their ranges, and their values in witnesses, in words."""

from __future__ import annotations

from collections.abc import Sequence

from lmi.arithmetic.arrays import Entries, NewEntries
from obsdesign.problem.plant import Plant

# parameters that a sentence names
_MOST_NAMES = 3
# pieces of a course that it lists
_MOST_PIECES = 6


def parameter_ranges(plant: Plant) -> str:
    """The parameters with their ranges, or how many they are, in words."""
    parameters = plant.parameters
    if len(parameters) > _MOST_NAMES:
        return f"{len(parameters)} parameters in their ranges"
    return ", ".join(
        f"{each.name} {'constant ' if each.constant else ''}in "
        f"[{each.range[0]:g}, {each.range[1]:g}]"
        for each in parameters
    )


def in_units(plant: Plant, witness: Entries, factor: float) -> NewEntries:
    """Return a witness with "values", those of the parameters by their names.

    witness: of `lmi.refute.parameter_words`. factor: by which ranges are wider
    than stated. The reason begins with the values.
    """
    if "stays" not in witness:
        values = _values(plant, witness["p"], factor)
        reason = f"with {_text(values)} for ever, {witness['reason']}"
        return {**witness, "values": values, "reason": reason}
    stays = [
        {
            "jump": None if stay["jump"] is None else _values(plant, stay["jump"], factor),
            "flow": [
                {"values": _values(plant, piece["p"], factor), "duration": piece["duration"]}
                for piece in stay["flow"]
            ],
        }
        for stay in witness["stays"]
    ]
    reason = f"with {_course(stays)}, and so on, {witness['reason']}"
    return {**witness, "values": stays, "reason": reason}


def _values(plant: Plant, p: Sequence[float], factor: float) -> dict[str, float]:
    """The values at p, in [-1, 1] each."""
    ends = {each.name: each.range for each in plant.parameters}
    return {
        name: (low + high) / 2 + factor * (high - low) / 2 * share
        for (name, (low, high)), share in zip(ends.items(), p, strict=True)
    }


def _text(values: Entries) -> str:
    return ", ".join(f"{name} = {value:.6g}" for name, value in values.items())


def _course(stays: Sequence[Entries]) -> str:
    """The first pieces of a course, after each other."""
    pieces = [
        f"{_text(piece['values'])} for {piece['duration']:.6g}"
        for stay in stays
        for piece in stay["flow"]
    ]
    more = len(pieces) - _MOST_PIECES
    listed = pieces[:_MOST_PIECES] + ([f"{more} more"] if more > 0 else [])
    return ", ".join(listed)
