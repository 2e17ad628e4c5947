"""Bounds of an unknown input d: how large it is and, if it is stated, how fast it changes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from lmi.arithmetic.arrays import Entries, Matrix, Value
from obsdesign.entries import bounds, shown, vector
from obsdesign.errors import InputError
from obsdesign.problem.blocks import Block

_ENTRY = "flow.d_bounds"


@dataclass(frozen=True, eq=False)
class InputBounds(Block):
    """lower <= d(t) <= upper, (q,); rate (q,): |d(t) - d(s)| <= rate |t - s|, None for any."""

    lower: Matrix
    upper: Matrix
    rate: Matrix | None = None

    @classmethod
    def from_entry(cls, value: Value, D: Matrix | None) -> InputBounds:
        """The entry d_bounds of a flow with the matrix D; InputError where it does not fit."""
        if isinstance(value, InputBounds):
            value = value.to_entry()
        if D is None:
            raise InputError(f"{_ENTRY} requires flow.D, through which d acts; it is missing.")
        if not isinstance(value, Mapping) or not {"lower", "upper"} <= set(value):
            raise InputError(
                f"{_ENTRY} must be a table {{ lower = [...], upper = [...], rate = [...] }}, the "
                f"rate optional; got {shown(value)}."
            )
        q = D.shape[1]
        lower, upper = bounds(value["lower"], value["upper"], q, _ENTRY, "column of flow.D")
        rate = value.get("rate")
        if rate is not None:
            rate = vector(rate, f"{_ENTRY}.rate")
            if rate.shape != (q,) or not (rate >= 0).all():
                raise InputError(
                    f"{_ENTRY}.rate must have {q} numbers >= 0, one per column of flow.D; got "
                    f"{rate.tolist()}."
                )
        return cls(lower, upper, rate)

    def to_entry(self) -> Entries:
        """The entry of a problem file."""
        listed = {name: getattr(self, name) for name in ("lower", "upper", "rate")}
        return {name: own.tolist() for name, own in listed.items() if own is not None}
