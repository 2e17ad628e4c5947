"""Numbers of pieces that the observer cuts a step into."""

from __future__ import annotations

from collections.abc import Callable

from obsdesign.equations.set_membership.gains import SetMembershipGains
from obsdesign.runtime.set_membership.model import observer_model
from obsdesign.runtime.set_membership.tables import Tables

# relative error of a step length, at most, that time stamps leave
_ROUNDING = 1e-6


def pieces_of(gains: SetMembershipGains) -> Callable[[float], tuple[int, ...]]:
    """h -> the numbers of pieces that a step of about that length may be cut into, one or two."""
    tables = Tables(observer_model(gains))

    def pieces(h: float) -> tuple[int, ...]:
        lengths = (h * (1 - _ROUNDING), h * (1 + _ROUNDING))
        return tuple(sorted({tables.for_step(length, h).pieces for length in lengths}))

    return pieces
