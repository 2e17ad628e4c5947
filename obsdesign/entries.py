"""Checks of the entries of a problem: numbers, vectors and matrices.

Every InputError names the entry as it stands in a problem file, what was required and what arrived.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Matrix, Value
from obsdesign.errors import InputError

# magnitudes of what a problem, a design or a record holds, zero apart: products of two stay inside
# binary64. Who multiplies three, divides or takes an exponential looks at the result.
SMALLEST, LARGEST = 1e-150, 1e150


def matrix(values: ArrayLike, entry: str, *, empty: bool = False) -> Matrix:
    """A finite read-only float matrix, or InputError; without rows or columns only if `empty`."""
    wanted = "a matrix: a list of rows of numbers, all equally long"
    return _array(values, entry, 2, wanted, empty)


def vector(values: ArrayLike, entry: str) -> Matrix:
    """A finite read-only float vector, or InputError."""
    return _array(values, entry, 1, "a list of numbers")


def _array(values: object, entry: str, dimensions: int, wanted: str, empty: bool = False) -> Matrix:
    try:
        raw = np.asarray(values)
        # as objects: beside numbers numpy takes True for 1, and integers may exceed 64 bits
        loose: Value = () if isinstance(values, np.ndarray) else np.asarray(values, object).flat
        if raw.dtype.kind not in "iufO" or not all(is_number(item) for item in loose):
            raise ValueError
        result = np.array(raw, dtype=np.float64)
    except (ValueError, TypeError):
        raise InputError(f"{entry} must be {wanted}; got {shown(values)}.") from None
    except OverflowError:
        raise InputError(f"{entry} must hold binary64 numbers; one is too large.") from None
    if result.ndim != dimensions or (result.size == 0 and not empty):
        raise InputError(f"{entry} must be {wanted}; got {shown(values)}.")
    for index in np.argwhere(~np.isfinite(result)):
        raise InputError(
            f"{entry} must hold finite numbers; got {result[tuple(index)]} at {_place(index)}."
        )
    size = np.abs(result)
    for index in np.argwhere((size > LARGEST) | ((size < SMALLEST) & (size > 0))):
        in_range(float(result[tuple(index)]), f"{entry}, {_place(index)}")
    result += 0.0  # -0.0 is 0.0
    result.setflags(write=False)
    return result


def _place(index: Iterable[int]) -> str:
    places = list(index)
    words = ("row", "column") if len(places) == 2 else ("entry",)
    return ", ".join(f"{word} {i + 1}" for word, i in zip(words, places, strict=True))


def in_range(value: float, entry: str) -> float:
    """A number that is 0, infinite, not a number, or of magnitude 1e-150 to 1e150; InputError."""
    if math.isfinite(value) and value and not SMALLEST <= abs(value) <= LARGEST:
        raise InputError(
            f"{entry} must be 0 or of magnitude {SMALLEST:g} to {LARGEST:g}; got {value!r}. "
            "Choose other units."
        )
    return value


def is_number(value: object) -> bool:
    """A number, and not a truth value, which Python counts as one."""
    return isinstance(value, int | float | np.number) and not isinstance(value, bool)


def shown(value: object) -> str:
    """A value as a message repeats it: on one line, and short."""
    try:
        text = repr(value.tolist() if isinstance(value, np.ndarray) else value)
    except ValueError:  # Python does not write out integers beyond some 4300 digits
        return "an integer of thousands of digits"
    return text if len(text) <= 60 else text[:57] + "..."


def size_text(array: Matrix) -> str:
    """Shape as people write it: 2x3."""
    return "x".join(map(str, array.shape))


def require_shape(array: Matrix, entry: str, shape: tuple[int | None, ...], why: str) -> None:
    """Refuse another shape; None leaves a dimension free."""
    for axis, (have, want) in enumerate(zip(array.shape, shape, strict=True)):
        if want is not None and have != want:
            word = "entries" if array.ndim == 1 else ("rows", "columns")[axis]
            word = word if want != 1 else {"entries": "entry"}.get(word, word[:-1])
            hint = ""
            if array.ndim == 2 and array.shape[::-1] == shape:
                hint = " Is it transposed?"
            got = f"{have}" if array.ndim == 1 else size_text(array)
            raise InputError(f"{entry} must have {want} {word}, {why}; got {got}.{hint}")


def bounds(
    lower: ArrayLike | None, upper: ArrayLike | None, n: int, entry: str, item: str = "state"
) -> tuple[Matrix, Matrix]:
    """Lower and upper bounds (n,), lower <= upper; both left out: zeros."""
    if (lower is None) != (upper is None):
        raise InputError(
            f"{entry}.{'lower' if lower is None else 'upper'} is required; it is missing."
        )
    ends = []
    for values, name in ((lower, "lower"), (upper, "upper")):
        end = vector(np.zeros(n) if values is None else values, f"{entry}.{name}")
        require_shape(end, f"{entry}.{name}", (n,), f"one per {item}")
        ends.append(end)
    for i in np.flatnonzero(ends[0] > ends[1]):
        raise InputError(
            f"{entry}: lower must not exceed upper; got lower {ends[0][i]:g} > upper "
            f"{ends[1][i]:g} for {item} {i + 1}. Are they swapped?"
        )
    return ends[0], ends[1]


def positive(value: float, entry: str) -> float:
    """A positive finite number, or InputError."""
    if not (math.isfinite(value) and value > 0):
        raise InputError(f"{entry} must be a positive finite number; got {value!r}.")
    return in_range(float(value), entry)


def number_from_text(text: str) -> float:
    """The number that a text is: of data, options and tables alike; ValueError for any other.

    Decimal, ASCII, without blanks; Python would take 1_0 and digits of other scripts too.
    """
    if not text.isascii() or "_" in text or text != text.strip():
        raise ValueError(f"{shown(text)} is not a number")
    return float(text)


def numbers_from_cells(cells: Iterable[str]) -> list[float]:
    """The numbers in a column of a table, NaN where a cell is empty; ValueError for any other."""
    return [number_from_text(cell) if cell else math.nan for cell in map(str.strip, cells)]


def real(value: Value, entry: str) -> float:
    """A number that is one, as a float: no text, no truth value."""
    if not is_number(value):
        raise InputError(f"{entry} must be a number; got {shown(value)}.")
    try:
        return in_range(float(value), entry)
    except OverflowError:
        raise InputError(f"{entry} must fit a binary64 number; got {shown(value)}.") from None


def missing_entry(entry: str, needed_by: str, absent: str = "it") -> str:
    """The sentence about an entry that is missing, where `absent`, it or the block it is of, is."""
    return f"{entry} is required by {needed_by}; {absent} is missing."
