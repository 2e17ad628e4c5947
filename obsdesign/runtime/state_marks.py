"""What entries of a state may hold beside finite numbers, as marks of their annotations.

Read by `state_checks` alone: an array without a mark is finite, a number no NaN.
"""

from __future__ import annotations

from typing import Annotated

from lmi.arithmetic.arrays import Matrix

MISSING, UNBOUNDED, PAST, STEP = "missing", "unbounded", "past", "step"
# bounds in order: [lower; -upper] of one axis, or (lower, upper) as the two rows
STACKED, ROWS = "bounds above each other", "bounds in two rows"
# no entry below zero
RADIUS = "not negative"


class Axes(str):
    """The axes of an array, as in "2 n": numbers, letters of `sizes`, and others.

    A letter that an observer does not have in its `sizes` is one size within a record.
    """


# NaN where a measurement is missing
Measured = Annotated[Matrix, MISSING]
# ends of bounds, infinite where there are none
Bounded = Annotated[Matrix, UNBOUNDED]


class Below(str):
    """A whole number from 0 to below an entry of `sizes`."""


# bounds of the states: [lower; -upper], or the rows lower and upper
StackedBox = Annotated[Matrix, UNBOUNDED, STACKED, Axes("2n")]
Box = Annotated[Matrix, UNBOUNDED, ROWS, Axes("2 n")]
# vectors and matrices in the sizes of the plant
MeasuredRow = Annotated[Matrix, MISSING, Axes("y")]
States = Annotated[Matrix, Axes("n")]
Outputs = Annotated[Matrix, Axes("p")]
Inputs = Annotated[Matrix, Axes("m")]
Square = Annotated[Matrix, Axes("n n")]
Radii = Annotated[Matrix, RADIUS, Axes("n")]
UnboundedRadii = Annotated[Matrix, UNBOUNDED, RADIUS, Axes("n")]
# a time, or times in order, up to that of the state; -inf where there was none
Past = Annotated[float, PAST]
PastTimes = Annotated[Matrix, PAST]
# of an entry of a list with a `Past`: the time since that of the entry before
Step = Annotated[float, STEP]
