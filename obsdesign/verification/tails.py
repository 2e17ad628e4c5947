"""Tail matrices of a claim of decay: X > 0 with F'X + XF < 0, which settle all late times.

No proof here rests on them. They stand in a design for its checker (docs/proofs.md), which then
needs no search, and what stands in a design is proved.
"""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Matrix, NewEntries, Value
from lmi.arithmetic.balls import Exact, exact
from lmi.prove.tails import certify_falling
from obsdesign.verification.proposal import matrix_of


def proved_tails(F: Exact, proposed: Value) -> NewEntries:
    """Evidence {"tails": ...} where all of the proposed matrices fall along the flow F, exact."""
    if not isinstance(proposed, list) or not proposed:
        return {}
    matrices = [matrix_of(X, len(F)) for X in proposed]
    is_proved = all(X is not None and _falls(F, X) for X in matrices)
    return {"tails": proposed} if is_proved else {}


def _falls(F: Exact, X: Matrix) -> bool:
    is_symmetric = np.isfinite(X).all() and np.array_equal(X, X.T)
    return bool(is_symmetric) and certify_falling(F, exact(X))
