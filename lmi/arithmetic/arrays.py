"""Names of array types; no dependency but numpy."""

from __future__ import annotations

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
