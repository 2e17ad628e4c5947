"""What the blocks of a plant have in common."""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Matrix, NewEntries, Value
from obsdesign.entries import bounds, matrix, require_shape, shown, vector
from obsdesign.equations.boxes import image_box
from obsdesign.errors import InputError

DISTURBANCE = "Bounds of {}, or of w where there is a disturbance_matrix; default 0."


class Block:
    """A block of a plant; two are equal where all entries are."""

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return False
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return all((a is None) == (b is None) and np.array_equal(a, b) for a, b in pairs)


class DisturbedBlock(Block):
    """A block with a bounded disturbance of n states, or of w (k,) where it is a matrix times w."""

    lower: Matrix
    upper: Matrix
    disturbance_matrix: Matrix | None
    input_bound: Matrix | None

    @property
    def disturbance_columns(self) -> Matrix:
        """Factor (n, k) of what is bounded; the identity without a disturbance matrix."""
        given = self.disturbance_matrix
        return np.eye(len(self.lower)) if given is None else given

    @property
    def shaped_disturbance(self) -> tuple[Matrix, Matrix, Matrix]:
        """(columns (n, k), lower, upper (k,)): the disturbance is columns @ w, w in the box."""
        return self.disturbance_columns, self.lower, self.upper

    def disturbance_width(self, inward: Matrix) -> Matrix:
        """Width (n,) of inward @ disturbance, inward (n, n)."""
        columns, lower, upper = self.shaped_disturbance
        return np.asarray(np.abs(inward @ columns) @ (upper - lower))

    def disturbance_box(self) -> tuple[Matrix, Matrix]:
        """(lower, upper) of the disturbance of each state, (n,), rounded outward."""
        if self.disturbance_matrix is None:
            return self.lower, self.upper
        return image_box(self.disturbance_matrix, self.lower, self.upper)

    def checked_bounds(self, name: str, n: int) -> tuple[Matrix, Matrix]:
        """Bounds, one per state or per column of the disturbance matrix; InputError for others."""
        if self.disturbance_matrix is None:
            return bounds(self.lower, self.upper, n, f"{name}.disturbance")
        columns = matrix(self.disturbance_matrix, f"{name}.disturbance_matrix").shape[1]
        item = f"column of {name}.disturbance_matrix"
        return bounds(self.lower, self.upper, columns, f"{name}.disturbance", item)

    def matrices(self, name: str, keys: tuple[str, ...], n: int, states: str) -> NewEntries:
        """Optional matrices with one row per state; InputError for others."""
        result = {}
        for key in keys:
            values = getattr(self, key)
            if values is not None:
                result[key] = matrix(values, f"{name}.{key}")
                require_shape(result[key], f"{name}.{key}", (n, None), f"one per state of {states}")
        return result

    def known_sizes(self, name: str, square: str, inputs: str, n: int) -> NewEntries:
        """Radii of the square matrix and bounds of known inputs, as stated; InputError for others.

        square, inputs: names of the matrices, "A" and "B", or "G" and "E".
        """
        result, key = {}, f"{square}_radius"
        if (radius := getattr(self, key)) is not None:
            as_matrix = f"as {name}.{square}"
            result[key] = radius_matrix(radius, f"{name}.{key}", (n, n), as_matrix)
        if self.input_bound is not None:
            columns = getattr(self, inputs)
            wanted = 0 if columns is None else np.shape(columns)[1]
            result["input_bound"] = bound = vector(self.input_bound, f"{name}.input_bound")
            if bound.shape != (wanted,) or (bound < 0).any():
                raise InputError(
                    f"{name}.input_bound must be {wanted} numbers >= 0, one per column of "
                    f"{name}.{inputs}; got {bound.tolist()}."
                )
        return result


def radius_matrix(values: Value, entry: str, shape: tuple[int, ...], why: str) -> Matrix:
    """Half-widths of the entries of a matrix; InputError unless all are >= 0 in its shape."""
    radius = matrix(values, entry)
    require_shape(radius, entry, shape, why)
    if (radius < 0).any():
        raise InputError(f"{entry} must hold numbers >= 0; got {shown(radius)}.")
    return radius


def set_fields(target: object, **values: Value) -> None:
    """Fill fields of a frozen dataclass while it is being made."""
    for name, value in values.items():
        object.__setattr__(target, name, value)
