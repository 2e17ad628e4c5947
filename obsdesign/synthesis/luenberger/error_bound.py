"""Proposals for the claims `error_bound`, `state_box` of a point observer."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import cast

from lmi.arithmetic.arrays import Entries, EntriesByClaim, Matrix, NewEntries
from lmi.arithmetic.balls import Exact, exact, to_float
from lmi.bounds.driven_jumps import Radius
from lmi.bounds.tube import Tube
from lmi.solvers import Solvers, merged
from lmi.time_budget import TimeBudget
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
from obsdesign.synthesis.luenberger.contractions import contractions
from obsdesign.synthesis.state_box import KnownBox, known_state_box
from obsdesign.synthesis.tube import proved_tube, solvers_of_tube

# stated bounds exceed those that are proved by this share: other libraries steer proofs otherwise
_ROOM = 1e-6


def known_box(problem: Problem) -> KnownBox | None:
    """The box that effects of parameters are bounded in, stated or proved; None where none is."""
    if reason_against_error_bound(problem):
        return None
    return known_state_box(problem.plant)


def bound_certificates(
    problem: Problem, gains: LuenbergerGains, known: EntriesByClaim, box: KnownBox,
    budget: TimeBudget,
) -> Certificates:  # fmt: skip
    """Certificates of the claims on the box and on the error; none where no bound is proved.

    known: certificates of the nominal error; budget: ends the proofs of contractions.
    """
    error = driven_error(problem.plant, gains, box.bounds)
    entries: Entries
    if problem.plant.jump is None:
        entries, solvers = _stated(bounds_without_jumps(error)), cast(Solvers, ())
    else:
        entries, solvers = _with_jumps(error, stability_dwell(problem), known, box.units, budget)
    if not entries:
        return Certificates()
    return Certificates({**box.certificates, "error_bound": entries}, merged(box.solvers, solvers))


def _with_jumps(
    error: DrivenError, ends: tuple[float, float], known: EntriesByClaim, units: Matrix,
    budget: TimeBudget,
) -> tuple[Entries, Solvers]:  # fmt: skip
    """The certificate of an error with jumps, empty where nothing is proved, and its solvers.

    Of the norms that contract, that of the least bounds in sum, in these units (n,).
    """
    tube = proved_tube(*comparison_system(error), ends=ends, vanishing=True)
    names = ("tube", "after_jump", "before_jump", "always")
    proposed = None if tube is None else Tube(*(exact(tube[name]) for name in names))
    if proposed is not None and not is_tube(error, ends, proposed):
        tube = proposed = None
    least, chosen = bounds_with_jumps(error, ends, proposed, None), None
    for contraction, radius in _proved_norms(error, ends, known, budget):
        bounds = bounds_with_jumps(error, ends, proposed, radius)
        if bounds is not None and _total(bounds, units) < _total(least, units):
            least, chosen = bounds, contraction
    entries = _stated(least)
    if not entries:
        return {}, ()
    if tube is not None:
        entries["tube"] = tube
    if chosen is not None:
        entries |= {"T": chosen.T.tolist(), "per_jump": chosen.per_jump}
    return entries, solvers_of_tube(tube is not None)


def _proved_norms(
    error: DrivenError, ends: tuple[float, float], known: EntriesByClaim, budget: TimeBudget
) -> Iterator[tuple[Contraction, Radius]]:
    """Norms in which the error is proved in time to contract, and its ultimate bound in them."""
    for norm in contractions(error, ends, known):
        if budget.remaining() < 0:
            return
        proofs = ((each, contraction_radius(error, ends, each, budget)) for each in norm)
        proved = next(((each, radius) for each, radius in proofs if radius is not None), None)
        if proved is not None:
            yield proved


def _total(bounds: ErrorBounds | None, units: Matrix) -> float:
    return math.inf if bounds is None else float((to_float(bounds.always) / units).sum())


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
