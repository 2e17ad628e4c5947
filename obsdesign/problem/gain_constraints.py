"""Convex constraints on the gains L and M: norm, structure, region of eigenvalues.

Their fragments of the schema, their checks, and one `GainConstraints` per gain for readers.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from lmi.window_memory import AUTO, Memory
from obsdesign.errors import InputError
from obsdesign.problem.options_base import Options, option
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
class GainConstraints:
    """Constraints on one gain and the eigenvalues it moves, None where there is none.

    norm: largest spectral norm; pattern: rows of 0 and 1, (n, p), which entries may differ from
    zero; decay: real parts below -decay; sector: half angle around the negative real axis; disc.
    """

    norm: float | None = None
    pattern: Pattern | None = None
    decay: float | None = None
    sector: float | None = None
    disc: Disc | None = None

    def has_region(self) -> bool:
        """Is there a constraint on eigenvalues?"""
        return not (self.decay is None and self.sector is None and self.disc is None)

    def options(self) -> list[str]:
        """Names of the options that state them."""
        stated = {
            "gain_norm": self.norm is not None,
            "structure": self.pattern is not None,
            "region": self.has_region(),
        }
        return [f"observer.{name}" for name, is_stated in stated.items() if is_stated]

    def parts(self, gain: str) -> dict[str, GainConstraints]:
        """Each constraint on the gain "L" or "M" alone, by its entry of the problem file."""
        names = {
            "norm": f"gain_norm.{gain}",
            "pattern": f"structure.{gain}",
            "decay": "region.decay",
            "sector": "region.sector",
            "disc": "region.disc" if gain == "L" else "region.jump_disc",
        }
        return {
            f"observer.{name}": GainConstraints(**{field: getattr(self, field)})
            for field, name in names.items()
            if getattr(self, field) is not None
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class ConstrainedGains(Options):
    """Options of kinds with gains L and M: constraints on them, and the reach of certificates."""

    gain_norm: Mapping[str, float] | None = option(GAIN_NORM, "Largest spectral norm of a gain.")
    structure: Mapping[str, Pattern] | None = option(
        STRUCTURE, "Which entries of a gain may differ from zero: 1 where one may, else 0."
    )
    region: Mapping[str, Region] | None = option(
        REGION, "Where the eigenvalues of the error's flow, and of its matrix at jumps, must lie."
    )
    memory: Memory = option(
        ref("memory"),
        "Dwell times a certificate may look at: auto (default), 0 for one common matrix, or a "
        "depth.",
        whole=True,
        default=AUTO,
    )

    def gain_constraints(self, gain: str) -> GainConstraints:
        """What gain_norm, structure and region state about the gain "L" or "M"."""
        return _of_gain(gain, self.gain_norm, self.structure, self.region)

    def check(self, plant: Plant) -> None:
        """InputError unless patterns have the gains' sizes and what is constrained exists."""
        _check(self.gain_norm, self.structure, self.region, plant)


def _of_gain(
    gain: str,
    norms: Mapping[str, float] | None,
    patterns: Mapping[str, Pattern] | None,
    regions: Mapping[str, Region] | None,
) -> GainConstraints:
    """Constraints on the gain "L" or "M", from the three options."""
    norm, pattern = (norms or {}).get(gain), (patterns or {}).get(gain)
    numbers = {name: value for name, value in (regions or {}).items() if isinstance(value, float)}
    discs = {
        name: Disc(value["centre"], value["radius"])
        for name, value in (regions or {}).items()
        if not isinstance(value, float)
    }
    if gain == "M":
        return GainConstraints(norm, pattern, disc=discs.get("jump_disc"))
    return GainConstraints(
        norm, pattern, numbers.get("decay"), numbers.get("sector"), discs.get("disc")
    )


def _check(
    norms: Mapping[str, float] | None,
    patterns: Mapping[str, Pattern] | None,
    regions: Mapping[str, Region] | None,
    plant: Plant,
) -> None:
    """InputError unless patterns are n x p matrices of 0 and 1 and what is constrained exists."""
    for name, rows in (patterns or {}).items():
        _check_pattern(f"observer.structure.{name}", rows, plant)
    stated: dict[str, Mapping[str, object]] = {
        "gain_norm": norms or {}, "structure": patterns or {}, "region": regions or {}
    }  # fmt: skip
    for name, table in stated.items():
        for part in {"M", "jump_disc"} & set(table):
            if reason := plant.reason_without("jump", needed_by=f"observer.{name}.{part}"):
                raise InputError(reason)
    if regions and not plant.needs_clock_gains and plant.output.measured == "periodic":
        raise InputError(
            "observer.region is about A - L C and the error's matrix at jumps, on which no gain "
            "acts with output.measured = 'periodic': L acts at samples. Drop region."
        )


def _check_pattern(entry: str, rows: Pattern, plant: Plant) -> None:
    """InputError unless a pattern is an n x p matrix of 0 and 1."""
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
