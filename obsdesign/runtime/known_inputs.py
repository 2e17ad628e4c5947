"""Known inputs beyond the bounds that effects of parameters count on."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lmi.arithmetic.arrays import Matrix
from obsdesign.runtime.status import Reason

LARGE_U = Reason("u above flow.input_bound")
LARGE_W = Reason("w above jump.input_bound")


class KnownInputs(NamedTuple):
    """Largest |u| (m,) and |w| (l,) that a box of the state counts on; None for any."""

    u: Matrix | None
    w: Matrix | None

    def reasons(self, u: Matrix, w: ArrayLike | None) -> list[str]:
        """Reasons of a row: u of the step to it, w of its jump, None without either."""
        reasons: list[str] = []
        if self.u is not None and not (np.abs(u) <= self.u).all():
            reasons.append(LARGE_U)
        if self.w is not None and w is not None and not (np.abs(w) <= self.w).all():
            reasons.append(LARGE_W)
        return reasons

    def kept(self, u: Matrix) -> NDArray[np.bool_]:
        """Which u, (rows, m), are within their bounds."""
        if self.u is None:
            return np.ones(len(u), dtype=bool)
        return np.asarray((np.abs(u) <= self.u).all(axis=1))
