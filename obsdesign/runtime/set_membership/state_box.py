"""The box of the state of an uncertain design; where it was proved, its comparison system."""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Array, Matrix
from lmi.arithmetic.enclosure import raised
from obsdesign.equations.set_membership.gains import SetMembershipGains
from obsdesign.runtime.state_box import Growth, StatedBox, StateTube


def known_box(gains: SetMembershipGains) -> StatedBox | StateTube | None:
    """The box of the state of a design; None without any."""
    lower, upper, tube = gains.state_lower, gains.state_upper, gains.state_tube
    if lower is None or upper is None:
        return None
    if tube is None:
        return StatedBox(lower, upper)
    on_diagonal = np.eye(gains.n, dtype=bool)
    comparison = np.where(on_diagonal, gains.A, np.abs(gains.A))
    b = _largest(*gains.declared_disturbance)
    if gains.D is not None:
        assert gains.d_lower is not None
        assert gains.d_upper is not None
        b = raised(b + _largest(gains.D, gains.d_lower, gains.d_upper), 1)
    jump = None
    if gains.G is not None:
        c = _largest(*gains.jump_disturbance)
        jump = _growth(gains, ("G", "E"), np.abs(gains.G), c)
    return StateTube(_growth(gains, ("A", "B"), comparison, b), jump, tube, upper)


def _growth(
    gains: SetMembershipGains, names: tuple[str, str], whole: Matrix, disturbance: Matrix
) -> Growth:
    """Of the flow or of the jump; whole (n, n): without effects of parameters, and of rounding."""
    n = gains.n
    effects = gains.effects_on(*names)
    added = sum((np.abs(X) for X in effects), np.zeros((n, n + gains.inputs_of(names[1]))))
    known = getattr(gains, names[1])
    inputs = np.zeros((n, 0)) if known is None else np.abs(known)
    # a sum is rounded up where there is anything to add
    total = np.hstack([whole, inputs])
    total = np.where(added > 0, raised_sum(total, raised(added, len(effects))), total)
    return Growth(total[:, :n], disturbance, total[:, n:])


def raised_sum(first: Matrix, second: Matrix) -> Matrix:
    """An upper bound of a sum, whatever the signs of its terms."""
    return np.nextafter(first + second, np.inf)


def _largest(columns: Array, lower: Array, upper: Array) -> Matrix:
    """Bound of |columns w|, (n,)."""
    sizes = np.maximum(np.abs(lower), np.abs(upper))
    return np.asarray(raised(np.abs(columns) @ sizes, 2 * len(sizes)))
