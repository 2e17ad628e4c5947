"""The flow of a plant between its jumps, or its step in discrete time, and bounds of d."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Entries, Matrix, Value
from obsdesign.entries import bounds, matrix, positive, real, shown, size_text, vector
from obsdesign.equations.boxes import image_box
from obsdesign.errors import InputError
from obsdesign.problem.blocks import DISTURBANCE, Block, DisturbedBlock, set_fields
from obsdesign.problem.schema import POSITIVE, file_entry, ref

# what is left out: __post_init__ fills it in
_DEFAULT: Value = None
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


@dataclass(frozen=True, eq=False)
class Flow(DisturbedBlock):
    """The flow x' = A x + B u(t) + D d(t) + b(t), lower <= b(t) <= upper.

    A (n, n); B (n, m): known input; D (n, q): unknown input; lower, upper (n,): zero by default.
    With a disturbance_matrix Bw (n, k), b = Bw w(t) and lower, upper (k,) are bounds of w.
    d_bounds: of d, None where there are none. dt: the step of a plant in discrete time,
    x(t + dt) = A x + B u + D d + b, None for a flow. input_bound (m,): largest |u|, None where
    it is not stated. A_radius (n, n): a parameter for each entry of A, None where A is known.
    InputError where sizes do not agree, numbers are not finite or bounds are crossed.
    """

    A: Matrix = file_entry(ref("matrix"), "n x n.")
    B: Matrix | None = file_entry(ref("matrix"), "n x m, known input u.", default=None)
    D: Matrix | None = file_entry(ref("matrix"), "n x q, unknown input d.", default=None)
    lower: Matrix = file_entry(
        ref("bounds"), DISTURBANCE.format("b(t)"), default=_DEFAULT, name="disturbance"
    )
    upper: Matrix = _DEFAULT
    disturbance_matrix: Matrix | None = file_entry(
        ref("matrix"), "n x k: b = Bw w, and disturbance bounds w.", default=None
    )
    d_bounds: InputBounds | None = file_entry(
        ref("input_bounds"), "Bounds of d and, optional, of its rate of change.", default=None
    )
    dt: float | None = file_entry(
        POSITIVE, "Step of a plant in discrete time, x(t + dt) = A x + B u + D d + b.", default=None
    )
    input_bound: Matrix | None = file_entry(
        ref("vector"), "m: largest |u| of each known input, for claims about widths.", default=None
    )
    A_radius: Matrix | None = file_entry(
        ref("matrix"), "n x n: each entry of A is known up to so much.", default=None
    )

    def __post_init__(self) -> None:
        A = matrix(self.A, "flow.A")
        n = A.shape[0]
        if A.shape != (n, n):
            raise InputError(f"flow.A must be square; got {size_text(A)}.")
        names = ("B", "D", "disturbance_matrix")
        set_fields(self, A=A, **self.matrices("flow", names, n, f"flow.A ({size_text(A)})"))
        lower, upper = self.checked_bounds("flow", n)
        set_fields(self, lower=lower, upper=upper)
        set_fields(self, **self.known_sizes("flow", "A", "B", n))
        if self.dt is not None:
            set_fields(self, dt=positive(real(self.dt, "flow.dt"), "flow.dt"))
        if self.d_bounds is not None:
            set_fields(self, d_bounds=InputBounds.from_entry(self.d_bounds, self.D))

    @property
    def shaped_disturbance(self) -> tuple[Matrix, Matrix, Matrix]:
        """(columns (n, k), lower, upper (k,)) of b, D d included where d is bounded."""
        columns, lower, upper = super().shaped_disturbance
        if self.D is None or self.d_bounds is None:
            return columns, lower, upper
        ends = ((lower, self.d_bounds.lower), (upper, self.d_bounds.upper))
        low, high = (np.concatenate(pair) for pair in ends)
        return np.hstack([columns, self.D]), low, high

    @property
    def b_bounds(self) -> tuple[Matrix, Matrix]:
        """(lower, upper) of b, (n,), D d included where d is bounded; rounded outward."""
        if self.D is None or self.d_bounds is None:
            return self.disturbance_box()
        return image_box(*self.shaped_disturbance)
