"""Parameters that are known up to a range, and the box in which the state is stated to stay."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Entries, Matrix, Value
from obsdesign.entries import bounds, matrix, real, require_shape, shown
from obsdesign.equations.parameters import nominal_matrices
from obsdesign.equations.plant import Flow, Jump, Output, Plant
from obsdesign.errors import InputError
from obsdesign.problem.blocks import Block, set_fields
from obsdesign.problem.names import NAME_SCHEMA, check_name
from obsdesign.problem.schema import FLAG, Fragment, file_entry, ref

RANGE: Fragment = {
    "type": "array",
    "title": "a pair [lowest, highest]",
    "items": ref("number"),
    "minItems": 2,
    "maxItems": 2,
}
# what one unit of a parameter adds, and the entry that it adds to
TARGETS = {"A": "flow.A", "B": "flow.B", "G": "jump.G", "E": "jump.E", "C": "output.C"}
_MATRIX = ref("matrix")


@dataclass(frozen=True, eq=False, kw_only=True)
class Parameter(Block):
    """A number p that is not measured: A(p) = flow.A + p A, likewise B, G, E and C.

    range: (lowest, highest) at every instant; constant: one unknown number for ever, else p may
    change at any time. A (n, n), B (n, m), G (n, n), E (n, l), C (p, n): None where it adds
    nothing. InputError for a range that is reversed or not finite, and without any effect.
    """

    name: str = file_entry(NAME_SCHEMA, "Name of the parameter.")
    range: tuple[float, float] = file_entry(RANGE, "Lowest and highest value, at every instant.")
    constant: bool = file_entry(
        FLAG, "One unknown number for ever; default false: it may change at any time.",
        default=False,
    )  # fmt: skip
    A: Matrix | None = file_entry(_MATRIX, "n x n: what one unit adds to flow.A.", default=None)
    B: Matrix | None = file_entry(_MATRIX, "n x m: what one unit adds to flow.B.", default=None)
    G: Matrix | None = file_entry(_MATRIX, "n x n: what one unit adds to jump.G.", default=None)
    E: Matrix | None = file_entry(_MATRIX, "n x l: what one unit adds to jump.E.", default=None)
    C: Matrix | None = file_entry(_MATRIX, "p x n: what one unit adds to output.C.", default=None)

    def __post_init__(self) -> None:
        check_name(self.name, "parameter")
        set_fields(self, range=_range(self.range, f"{self.entry}.range"))
        if not isinstance(self.constant, bool):
            raise InputError(
                f"{self.entry}.constant must be true or false; got {shown(self.constant)}."
            )
        for key in TARGETS:
            if (values := getattr(self, key)) is not None:
                set_fields(self, **{key: matrix(values, f"{self.entry}.{key}")})
        if not any(np.any(values) for values in self.effects.values()):
            got = "zeros" if self.effects else "none of them"
            raise InputError(
                f"{self.entry} must have an entry other than 0 in {', '.join(TARGETS)}; got {got}."
            )

    @property
    def entry(self) -> str:
        """What messages call it."""
        return f"parameter.{self.name}"

    @property
    def effects(self) -> dict[str, Matrix]:
        """What one unit adds, by the name of the matrix that it adds to."""
        stated = {key: getattr(self, key) for key in TARGETS}
        return {key: values for key, values in stated.items() if values is not None}

    def check_sizes(self, nominal: Entries) -> None:
        """InputError unless each effect has the shape of what it adds to, None if absent."""
        for key, values in self.effects.items():
            if nominal[key] is None:
                raise InputError(f"{self.entry}.{key} requires {TARGETS[key]}; it is missing.")
            why = f"as {TARGETS[key]}"
            require_shape(values, f"{self.entry}.{key}", nominal[key].shape, why)


@dataclass(frozen=True, eq=False)
class StateBox(Block):
    """lower <= x(t) <= upper (n,) at every instant: what the user vouches for."""

    lower: Matrix = file_entry(ref("vector"), "n: least value of each state.")
    upper: Matrix = file_entry(ref("vector"), "n: largest value of each state.")

    def check_sizes(self, n: int) -> None:
        """InputError unless it bounds n states; arrays from now on."""
        lower, upper = bounds(self.lower, self.upper, n, "state")
        set_fields(self, lower=lower, upper=upper)


def _range(values: Value, entry: str) -> tuple[float, float]:
    """(lowest, highest) from a pair of finite numbers."""
    if isinstance(values, str) or not hasattr(values, "__len__") or len(values) != 2:
        raise InputError(f"{entry} must be a pair [lowest, highest]; got {shown(values)}.")
    low, high = (real(value, entry) for value in values)
    if not np.isfinite([low, high]).all():
        raise InputError(f"{entry} must be finite; got [{low!r}, {high!r}].")
    if low > high:
        raise InputError(
            f"{entry} must be [lowest, highest]; got [{low:g}, {high:g}]. Is it reversed?"
        )
    return low + 0.0, high + 0.0


def radius_parameters(
    flow: Flow, events: Sequence[Jump], sensors: Sequence[Output]
) -> tuple[Parameter, ...]:
    """One parameter for each nonzero entry of flow.A_radius, jump.G_radius, output.C_radius."""
    radii = [("A", flow.A_radius)]
    radii += [("G", event.G_radius) for event in events]
    radii += [("C", sensor.C_radius) for sensor in sensors]
    return tuple(
        parameter
        for key, radius in radii
        if radius is not None
        for parameter in _parameters_of_entries(key, radius)
    )


def _parameters_of_entries(key: str, radius: Matrix) -> Iterator[Parameter]:
    for i, j in np.argwhere(radius).tolist():
        unit: dict[str, Value] = {key: np.zeros(radius.shape)}
        unit[key][i, j] = 1.0
        name, half = f"{key.lower()}_radius_{i + 1}_{j + 1}", float(radius[i, j])
        yield Parameter(name=name, range=(-half, half), **unit)


def check_parameters(plant: Plant) -> None:
    """InputError where names meet, sizes differ, also of the box, or others take no parameters."""
    if plant.state is not None:
        plant.state.check_sizes(len(plant.flow.A))
    parameters = plant.parameters
    if not parameters:
        return
    beside = {
        "[[event]] and [[sensor]]": plant.has_tables,
        "[[mode]]": bool(plant.modes),
        "flow.dt": plant.flow.dt is not None,
    }
    for entry, is_stated in beside.items():
        if is_stated:
            raise InputError(
                f"{parameters[0].entry}: parameters are not available with {entry} in this version."
            )
    names = [parameter.name for parameter in parameters]
    nominal = nominal_matrices(plant)
    for parameter in parameters:
        if names.count(parameter.name) > 1:
            raise InputError(
                f"parameter.name must differ from parameter to parameter; got {parameter.name!r} "
                "twice."
            )
        parameter.check_sizes(nominal)
