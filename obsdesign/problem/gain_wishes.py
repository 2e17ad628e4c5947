"""Convex wishes about the gains L and M: norm, structure, region of eigenvalues.

Their fragments of the schema, their checks, and one `GainWishes` per gain for those who read them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.errors import InputError
from obsdesign.problem.schema import NONNEGATIVE, POSITIVE, Fragment, ref

if TYPE_CHECKING:
    from obsdesign.problem.plant import Plant

Pattern = tuple[tuple[float, ...], ...]
# a rate or a half angle in radians; a disc as {"centre", "radius"}
Region = float | Mapping[str, float]

_DISC: Fragment = {
    "type": "object",
    "title": "a table { centre = q, radius = r }",
    "properties": {"centre": ref("number"), "radius": POSITIVE},
    "required": ["centre", "radius"],
    "additionalProperties": False,
}
_SECTOR: Fragment = {
    "type": "number",
    "exclusiveMinimum": 0,
    "exclusiveMaximum": math.pi / 2,
    "title": "a half angle in radians, between 0 and pi/2",
}


def _table(title: str, properties: Mapping[str, Fragment]) -> Fragment:
    return {
        "type": "object",
        "title": title,
        "properties": properties,
        "minProperties": 1,
        "additionalProperties": False,
    }


GAIN_NORM = _table(
    "a table { L = ..., M = ... } of positive numbers", {"L": POSITIVE, "M": POSITIVE}
)
STRUCTURE = _table(
    "a table { L = [[...]], M = [[...]] } of matrices of 0 and 1",
    {"L": ref("matrix"), "M": ref("matrix")},
)
REGION = _table(
    "a table of decay, disc, sector (of A - L C) and jump_disc (of the error's matrix at jumps)",
    {
        "decay": NONNEGATIVE,
        "disc": _DISC,
        "sector": _SECTOR,
        "jump_disc": _DISC,
    },
)


@dataclass(frozen=True)
class Disc:
    """The open disc around a real centre."""

    centre: float
    radius: float


@dataclass(frozen=True)
class GainWishes:
    """Wishes about one gain and the eigenvalues it moves, None where there is none.

    norm: largest spectral norm; pattern: rows of 0 and 1, (n, p), which entries may differ from
    zero; decay: real parts below -decay; sector: half angle around the negative real axis; disc.
    """

    norm: float | None = None
    pattern: Pattern | None = None
    decay: float | None = None
    sector: float | None = None
    disc: Disc | None = None

    def has_region(self) -> bool:
        """Is there a wish about eigenvalues?"""
        return not (self.decay is None and self.sector is None and self.disc is None)

    def options(self) -> list[str]:
        """Names of the options that state them."""
        stated = {
            "gain_norm": self.norm is not None,
            "structure": self.pattern is not None,
            "region": self.has_region(),
        }
        return [f"observer.{name}" for name, is_stated in stated.items() if is_stated]


def gain_wishes(
    gain: str,
    norms: Mapping[str, float] | None,
    patterns: Mapping[str, Pattern] | None,
    regions: Mapping[str, Region] | None,
) -> GainWishes:
    """Wishes about the gain "L" or "M", from the three options."""
    norm, pattern = (norms or {}).get(gain), (patterns or {}).get(gain)
    numbers = {name: value for name, value in (regions or {}).items() if isinstance(value, float)}
    discs = {
        name: Disc(value["centre"], value["radius"])
        for name, value in (regions or {}).items()
        if not isinstance(value, float)
    }
    if gain == "M":
        return GainWishes(norm, pattern, disc=discs.get("jump_disc"))
    return GainWishes(norm, pattern, numbers.get("decay"), numbers.get("sector"), discs.get("disc"))


def check_wishes(
    patterns: Mapping[str, Pattern] | None, regions: Mapping[str, Region] | None, plant: Plant
) -> None:
    """InputError unless patterns are n x p matrices of 0 and 1 and regions have their map."""
    for name, rows in (patterns or {}).items():
        entry = f"observer.structure.{name}"
        if len(rows) != plant.n or any(len(row) != plant.p for row in rows):
            widths = sorted({len(row) for row in rows})
            raise InputError(
                f"{entry} must be {plant.n}x{plant.p} (n states, p outputs), as the gain is; got "
                f"{len(rows)}x{' or '.join(map(str, widths))}."
            )
        others = [value for row in rows for value in row if value not in (0, 1)]
        if others:
            raise InputError(
                f"{entry} must hold 0 (the entry is zero) and 1 (it is free); got {others[0]!r}."
            )
    if plant.jump is None and "jump_disc" in (regions or {}):
        raise InputError("observer.region.jump_disc needs jumps; [jump] is missing.")
