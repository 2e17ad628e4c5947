"""What the first row of a record must state, since no row before it does: u and the mode."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from obsdesign.errors import InputError
from obsdesign.runtime.base import Sample


@dataclass(frozen=True)
class FirstRow:
    """Number of known inputs u, and names of modes; nothing for a row that others precede."""

    u: int = 0
    modes: Sequence[str] = ()

    def has_all(self, sample: Sample) -> bool:
        """Does a row state what it must as the first?"""
        return not self._missing(sample)

    def require(self, sample: Sample, where: str, row: str = "the first row") -> None:
        """InputError unless `sample` may be the first row, which is `row` of `where`."""
        if missing := self._missing(sample):
            raise InputError(f"{where}: {missing[0]} is required in {row}{missing[1]}.")

    def _missing(self, sample: Sample) -> tuple[str, str] | None:
        """The column that is empty, and what may stand there."""
        if self.modes and sample.mode is None:
            return "mode", f" ({', '.join(self.modes)})"
        if self.u and sample.u is None:
            columns = "u1" if self.u == 1 else f"u1…u{self.u}"
            return columns, ", since it holds until a row changes it"
        return None
