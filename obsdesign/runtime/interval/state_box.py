"""The box of the state of an uncertain design; where it was proved, its comparison system."""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import UNIT, Enclosure, raised
from obsdesign.equations.interval.certain_bounds import without_effects
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.runtime.interval.model import metzler_bound, rounded, shapes, size
from obsdesign.runtime.known_inputs import KnownInputs
from obsdesign.runtime.state_box import Growth, StatedBox, StateTube


def known_box(gains: IntervalGains) -> StatedBox | StateTube | None:
    """The box of the state of an uncertain design; None without any."""
    lower, upper, tube = gains.state_lower, gains.state_upper, gains.state_tube
    if lower is None or upper is None or not gains.is_uncertain:
        return None
    if tube is None:
        return StatedBox(lower, upper)
    own = without_effects(gains)
    b, c = shapes(own)
    flow, jump = _growth(gains, "A", "B", b, own.declared_disturbance[1:]), None
    if gains.G is not None:
        jump = _growth(gains, "G", "E", c, own.jump_disturbance[1:])
    return StateTube(flow, jump, tube, upper)


def known_inputs(gains: IntervalGains) -> KnownInputs:
    """Bounds of known inputs that the box of a design counts on; none without such a box."""
    if not gains.is_uncertain:
        return KnownInputs(None, None)
    return KnownInputs(gains.input_bound, gains.jump_input_bound)


def _growth(
    gains: IntervalGains,
    state: str,
    known: str,
    columns: Enclosure | None,
    ends: tuple[Matrix, Matrix],
) -> Growth:
    """Of the flow or of the jump, by the names of its matrices; columns, ends: of b or c."""
    X = rounded(getattr(gains, state), UNIT)
    whole = metzler_bound(X) if state == "A" else size(X)
    disturbance = np.maximum(np.abs(ends[0]), np.abs(ends[1]))
    if columns is not None:
        disturbance = raised(size(columns) @ disturbance, 2 * len(disturbance))
    values = getattr(gains, known)
    inputs = np.zeros((gains.n, 0)) if values is None else np.asarray(values)
    return Growth(
        _with_effects(gains, whole, state), disturbance,
        _with_effects(gains, size(rounded(inputs, UNIT)), known),
    )  # fmt: skip


def _with_effects(gains: IntervalGains, nominal: Matrix, name: str) -> Matrix:
    listed = [getattr(each, name) for each in gains.effects]
    effects = [size(rounded(X, UNIT)) for X in listed if X is not None]
    added = sum(effects, np.zeros_like(nominal))
    total = nominal + raised(added + UNIT * np.abs(nominal), len(listed) + 1)
    return np.where(added > 0, total, nominal)
