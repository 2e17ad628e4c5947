"""A record before its first row that counts."""

from __future__ import annotations

from dataclasses import dataclass

from obsdesign.runtime.state_marks import Inputs, Past, Square, States


@dataclass(frozen=True, slots=True)
class Initial:
    """The estimate x at t, and the input u from then on; first: time of the first row, if any.

    covariance: of the estimate at time `since`, None where the design has none.
    """

    t: float
    x: States
    u: Inputs
    covariance: Square | None
    since: Past
    first: Past | None = None
