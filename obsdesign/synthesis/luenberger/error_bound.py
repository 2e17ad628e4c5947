"""Proposals for the claims `error_bound`, `state_box` of a point observer."""

from __future__ import annotations

from collections.abc import Iterator
from typing import cast

import numpy as np

from lmi.arithmetic.arrays import Entries, EntriesByClaim, NewEntries
from lmi.arithmetic.balls import Exact, exact, to_float
from lmi.bounds.tube import Tube
from lmi.solvers import Solvers, merged
from obsdesign.analysis.luenberger.driven_error import (
    DrivenError,
    driven_error,
    reason_against_error_bound,
)
from obsdesign.analysis.luenberger.error_bounds import (
    Contraction,
    ErrorBounds,
    bounds_with_jumps,
    bounds_without_jumps,
    comparison_system,
    contraction_radius,
    is_tube,
)
from obsdesign.analysis.nominal import stability_dwell
from obsdesign.equations.luenberger.gains import LuenbergerGains
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Certificates
from obsdesign.synthesis.state_box import KnownBox, known_state_box
from obsdesign.synthesis.tube import proved_tube, solvers_of_tube

# stated bounds exceed those that are proved by this share: other libraries steer proofs otherwise
_ROOM = 1e-6
# of what a contraction leaves, this share is kept, in turn, until it is proved
_SHARES = (1.0, 0.99, 0.9)


def known_box(problem: Problem) -> KnownBox | None:
    """The box that effects of parameters are bounded in, stated or proved; None where none is."""
    if reason_against_error_bound(problem):
        return None
    return known_state_box(problem.plant)


def bound_certificates(
    problem: Problem, gains: LuenbergerGains, known: EntriesByClaim, box: KnownBox
) -> Certificates:
    """Certificates of the claims on the box and on the error; none where no bound is proved.

    known: certificates of the nominal error.
    """
    error = driven_error(problem.plant, gains, box.bounds)
    entries: Entries
    if problem.plant.jump is None:
        entries, solvers = _stated(bounds_without_jumps(error)), cast(Solvers, ())
    else:
        entries, solvers = _with_jumps(error, stability_dwell(problem), known)
    if not entries:
        return Certificates()
    return Certificates({**box.certificates, "error_bound": entries}, merged(box.solvers, solvers))


def _with_jumps(
    error: DrivenError, ends: tuple[float, float], known: EntriesByClaim
) -> tuple[Entries, Solvers]:
    """The certificate of an error with jumps, empty where nothing is proved, and its solvers."""
    tube = proved_tube(*comparison_system(error), ends=ends, vanishing=True)
    names = ("tube", "after_jump", "before_jump", "always")
    proposed = None if tube is None else Tube(*(exact(tube[name]) for name in names))
    if proposed is not None and not is_tube(error, ends, proposed):
        tube = proposed = None
    proofs = ((each, contraction_radius(error, ends, each)) for each in _contractions(known))
    contraction, radius = next((pair for pair in proofs if pair[1] is not None), (None, None))
    entries = _stated(bounds_with_jumps(error, ends, proposed, radius))
    if not entries:
        return {}, ()
    if tube is not None:
        entries["tube"] = tube
    if contraction is not None:
        entries |= {"T": contraction.T.tolist(), "per_jump": contraction.per_jump}
    return entries, solvers_of_tube(tube is not None)


def _contractions(known: EntriesByClaim) -> Iterator[Contraction]:
    """Norms that contract from jump to jump, from the certificate of stability and its rates."""
    rates = known.get("rates", {})
    P = rates.get("P_per_jump", known.get("dwell_stability", {}).get("P"))
    if P is None or "per_jump" not in rates:
        return
    try:
        T = np.linalg.cholesky(np.asarray(P, dtype=np.float64)).T
    except np.linalg.LinAlgError:
        return
    for share in _SHARES:
        yield Contraction(T, 1.0 - share * (1.0 - rates["per_jump"]))


def _stated(bounds: ErrorBounds | None) -> NewEntries:
    """The entries of proved bounds, a little above them; none where there are none."""
    if bounds is None:
        return {}
    entries: NewEntries = {"always": _raised(bounds.always)}
    if bounds.before_jump is not None:
        entries["before_jump"] = _raised(bounds.before_jump)
    return entries


def _raised(values: Exact) -> list[float]:
    return [float(value) * (1.0 + _ROOM) for value in to_float(values)]
