"""Point observers of plants with modes: the error tends to zero however modes take turns."""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Entries, EntriesByClaim
from lmi.arithmetic.balls import exact
from lmi.modes import Modes
from lmi.time_budget import UNLIMITED, TimeBudget
from obsdesign.analysis.modes import graph_of_spans, stays_text
from obsdesign.document import Claim, Guarantee
from obsdesign.equations.estimation_error import flow_error_matrix
from obsdesign.equations.gains import plant_data
from obsdesign.equations.luenberger.gains import LuenbergerGains
from obsdesign.equations.modes import SwitchedGains
from obsdesign.problem.options import LuenbergerOptions
from obsdesign.problem.problem import Problem
from obsdesign.verification.absent_signals import absent_signals
from obsdesign.verification.modes import (
    STABILITY,
    consistent_modes,
    mode_stability,
    stability_claim,
)


def claims(
    problem: Problem,
    stored: Entries,
    certificates: EntriesByClaim,
    *,
    paranoid: bool = False,
    budget: TimeBudget = UNLIMITED,
) -> tuple[Claim, ...]:
    """All hypotheses of the design, each with its verdict.

    certificates: {"mode_stability": ..., "decay_rate": ...}, cells with their P; all are checked.
    """
    del budget  # proofs end by their number of boxes
    agreement, gains = consistent_modes(problem, stored, expected_gains, LuenbergerGains)
    if gains is None:
        return (agreement,)
    rate = problem.options_as(LuenbergerOptions).decay_rate
    listed = [agreement, _stability(gains, 0.0, certificates, paranoid)]
    if rate > 0:
        listed.append(_stability(gains, rate, certificates, paranoid))
    return tuple(listed)


def error_modes(problem: Problem, stored: Entries) -> Modes:
    """The graph of modes whose paths are claimed to tend to zero: the error's, with its rate."""
    gains = SwitchedGains.from_document(stored, LuenbergerGains)
    return _modes(gains, problem.options_as(LuenbergerOptions).decay_rate)


def _modes(gains: SwitchedGains[LuenbergerGains], rate: float) -> Modes:
    flows = [
        flow_error_matrix(exact(own.A), exact(own.L), exact(own.C))
        + exact(rate * np.eye(own.n))
        for own in gains.gains
    ]  # fmt: skip
    entry = [None if own.G is None else exact(own.G) for own in gains.gains]
    return graph_of_spans(gains.spans, flows, entry)


def _stability(
    gains: SwitchedGains[LuenbergerGains], rate: float, certificates: EntriesByClaim, paranoid: bool
) -> Claim:
    modes = _modes(gains, rate)
    what = "the error e, e' = (A - L C) e in each mode,"
    name = "decay_rate" if rate else STABILITY
    if rate:
        what = f"the error times e^({rate!r} t)"
    verdict = mode_stability(modes, certificates.get(name, {}), paranoid)
    return stability_claim(verdict, what, name=name)


def expected_gains(problem: Problem, place: int, stored: Entries) -> Entries:
    """Entries of the stored gains of a mode: the value that the problem fixes, or its shape."""
    del stored
    plant = problem.plant.in_mode(place, entered=True)
    shape = (plant.n, plant.p)
    given = problem.in_modes[place].gains
    return plant_data(plant) | {"L": shape, "M": np.zeros(shape)} | dict(given)


def guarantees(problem: Problem, claims: tuple[Claim, ...]) -> tuple[Guarantee, ...]:
    """The sentences a user may rely on, and those of the problem that are not proved."""
    verdicts = {claim.id: claim.verdict for claim in claims}
    measured, stays = "With y measured continuously", stays_text(problem)
    when = f"for all sequences of modes with stays {stays}"
    free = absent_signals(problem.plant)
    sentences = [
        (f"{measured} and without {free}, the estimation error tends to zero {when}.", [STABILITY]),
        (f"{measured}, bounded {free} leave the estimation error bounded {when}.", [STABILITY]),
    ]
    if "decay_rate" in verdicts:
        rate = problem.options_as(LuenbergerOptions).decay_rate
        ids = [STABILITY, "decay_rate"]
        sentences.append((f"The error decays like e^(-{rate!r} t) {when}.", ids))
    given = [Guarantee.from_verdicts(text, ids, verdicts) for text, ids in sentences]
    sampled = "Convergence for samples at a given spacing is not claimed."
    return (*given, Guarantee.not_proved(sampled))
