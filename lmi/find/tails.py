"""Matrices that fall along a flow: hints for proofs for all late times."""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balancing import Scaling
from lmi.arithmetic.balls import Exact, exact, to_float
from lmi.prove.tails import certify_falling, proposed_forms


def propose_tails(F: Exact, bound: Exact) -> list[Matrix]:
    """Symmetric X > 0 with F'X + XF < 0, certified, shaped like a bound >= 0, (n, n) exact.

    None where F does not look Hurwitz. Any scale of them does; they are of that of the bound.
    """
    scaling = Scaling.from_pair(F, 0 * F, np.inf)
    forms = proposed_forms(to_float(scaling.map(F)), to_float(scaling.form(bound)))
    symmetric = [scaling.undone.form((X + X.T) / 2) for X in forms]
    return [X for X in symmetric if np.isfinite(X).all() and certify_falling(F, exact(X))]
