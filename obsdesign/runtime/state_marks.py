"""What entries of a state may hold beside finite numbers, as marks of their annotations.

Read by `stored_state` alone: an array without a mark is finite, a number no NaN.
"""

from __future__ import annotations

from typing import Annotated

from lmi.arithmetic.arrays import Matrix

MISSING, UNBOUNDED, PAST, STEP = "missing", "unbounded", "past", "step"

# NaN where a measurement is missing
Measured = Annotated[Matrix, MISSING]
# ends of bounds, infinite where there are none
Bounded = Annotated[Matrix, UNBOUNDED]
# a time, or times in order, up to that of the state; -inf where there was none
Past = Annotated[float, PAST]
PastTimes = Annotated[Matrix, PAST]
# of an entry of a list with a `Past`: the time since that of the entry before
Step = Annotated[float, STEP]
