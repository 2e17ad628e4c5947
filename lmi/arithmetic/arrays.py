"""Names of types that every layer shares: arrays, and entries of files; nothing but numpy."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]
# floats or exact rationals where formulas run on both, and precisions that numpy's stubs leave open
Array = NDArray[Any]
# one number of such an array: a float, a rational or a ball
Number = Any
# positions in an array
Indices = NDArray[np.intp]
# one value of a table of JSON or TOML, of any type until a reader has checked it
Value = Any
# such a table: of a problem, a design, evidence, a certificate
Entries = Mapping[str, Value]
# the same while it is put together for a file, for evidence or for an answer
NewEntries = dict[str, Value]
# by the id of a claim, what a search proposes as its proof
EntriesByClaim = Mapping[str, Entries]


def floats(values: object) -> Matrix:
    """Nested lists of numbers as an array; TypeError or ValueError where something else stands."""
    array = np.asarray(values)
    if array.dtype.kind not in "iuf":
        raise TypeError("numbers are due")
    return array.astype(np.float64)
