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
# entries of a table as JSON and TOML have them: of a problem, a design, evidence or a certificate.
# Their values are of any type until whoever reads one has checked it
Entries = Mapping[str, Any]
# the same while they are put together for a file, for evidence or for an answer
NewEntries = dict[str, Any]
# by the id of a claim, what a search proposes as its proof
EntriesByClaim = Mapping[str, Entries]
