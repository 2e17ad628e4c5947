"""Norms in which the error contracts from jump to jump: proposals for bounds of the error.

A certificate of stability has the norm of the fastest contraction. In the units in which bounds of
the error are alike it may be far from round, and then says little of each state, or nothing can be
proved in it. The other norms are those that estimates of the bounds count with.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lmi.arithmetic.arrays import EntriesByClaim, Matrix
from lmi.arithmetic.balls import to_float
from obsdesign.analysis.luenberger.driven_error import DrivenError
from obsdesign.analysis.luenberger.error_bounds import Contraction
from obsdesign.synthesis.estimated_bounds import SampledJumps

# of what a contraction leaves, this share is kept, in turn, until it is proved
_SHARES = (0.99, 0.9, 0.7)


def contractions(
    error: DrivenError, ends: tuple[float, float], known: EntriesByClaim
) -> Iterator[list[Contraction]]:
    """Norms to be proved, each with rates in turn until one is proved; floats.

    known: certificates of the nominal error; ends: of dwell times.
    """
    rates = known.get("rates", {})
    per_jump = rates.get("per_jump")
    P = rates.get("P_per_jump", known.get("dwell_stability", {}).get("P"))
    if P is not None and per_jump is not None and (T := _root(P)) is not None:
        yield _with_rates(T, per_jump, (1.0, *_SHARES))
    assert error.H is not None
    assert error.K is not None
    F, E, H, K = (to_float(X) for X in (error.F, error.E, error.H, error.K))
    with np.errstate(all="ignore"):
        system = SampledJumps.from_matrices((F, E), (H, K), ends)
        if system is None:
            return
        rated = [(T, system.contraction(T)) for T in system.norms()]
    for T, gamma in rated:
        if gamma < 1:
            yield _with_rates(T, gamma, _SHARES)


def _with_rates(T: Matrix, gamma: float, shares: tuple[float, ...]) -> list[Contraction]:
    return [Contraction(T, 1.0 - share * (1.0 - gamma)) for share in shares]


def _root(P: Matrix) -> Matrix | None:
    """T with T'T = P; None where P is not positive definite."""
    try:
        return np.asarray(np.linalg.cholesky(np.asarray(P, dtype=np.float64)).T)
    except np.linalg.LinAlgError:
        return None
