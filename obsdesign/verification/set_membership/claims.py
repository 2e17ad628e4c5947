"""The multiplier observer: its gains, what its samples determine, its widths.

The bounds themselves need no hypothesis: they are certified at run time, for any multipliers.
"""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Entries, EntriesByClaim, NewEntries
from lmi.time_budget import UNLIMITED, TimeBudget
from lmi.verdict import undecided
from obsdesign.analysis.set_membership.parameters import in_box, with_all_noise
from obsdesign.analysis.set_membership.requirements import pattern_of, reason_against
from obsdesign.analysis.widened import StateBounds
from obsdesign.document import Claim
from obsdesign.equations.set_membership.gains import SetMembershipGains, plant_entries
from obsdesign.errors import DoesNotApply
from obsdesign.problem.options import SetMembershipOptions
from obsdesign.problem.problem import Problem
from obsdesign.verification.assumptions import STATE_BOX
from obsdesign.verification.consistency import consistent_gains, inconsistent
from obsdesign.verification.set_membership.observability import observability_claims
from obsdesign.verification.set_membership.optimal import optimal_claims
from obsdesign.verification.set_membership.width import width_claims
from obsdesign.verification.state_box import state_box


def claims(
    problem: Problem,
    stored: Entries,
    certificates: EntriesByClaim,
    *,
    paranoid: bool = False,
    budget: TimeBudget = UNLIMITED,
) -> tuple[Claim, ...]:
    """All claims of the design, each with its verdict; stored: gains as a file states them.

    certificates: {"state_box": tube, "width": {"tube"}, "optimal": {"trajectories"},
    "attainable": {"P"}} where they were found; they are checked.
    """
    del budget  # proofs end by their size
    try:
        box_claims, bounds = _box(problem, certificates)
        nominal = in_box(problem, bounds)
    except DoesNotApply as error:
        return (inconsistent(str(error)),)
    problem = nominal.problem
    expected = {**_expected(problem, stored), **nominal.entries}
    agreement, gains = consistent_gains(
        reason_against(problem), stored, expected, SetMembershipGains.from_document
    )
    if gains is None or not nominal.is_bounded:
        return (agreement,)
    gains = with_all_noise(gains)
    observable = observability_claims(problem, gains, certificates.get("attainable", {}), paranoid)
    pattern = pattern_of(problem.plant)
    if isinstance(pattern, str):
        return (agreement, *box_claims, *observable)
    width = width_claims(gains, pattern, certificates.get("width", {}))
    proposed = {} if nominal.entries else certificates.get("optimal", {})
    least = optimal_claims(gains, pattern, proposed, width[0] if width else None)
    return (agreement, *box_claims, *observable, *without_contradiction(width, least))


def _box(
    problem: Problem, certificates: EntriesByClaim
) -> tuple[tuple[Claim, ...], StateBounds | None]:
    """The claim on a box of the state that effects of parameters are bounded in, and the box."""
    if not problem.plant.parameters:
        return (), None
    return state_box(problem.plant, certificates.get(STATE_BOX, {}))


def without_contradiction(
    width: tuple[Claim, ...], least: tuple[Claim, ...]
) -> tuple[Claim, ...]:  # fmt: skip
    """Both claims; undecided where a least possible width is above the certified one.

    Both are proved from the file alone: one of the proofs is then wrong.
    """
    claims = (*width, *least)
    if any(claim.verdict != "proved" for claim in claims):
        return claims
    pairs = zip(
        (x for claim in width for x in claim.evidence["always"]),
        (x for claim in least for x in claim.evidence["least"]),
        strict=False,
    )
    crossed = [(i, above, below) for i, (above, below) in enumerate(pairs) if not below <= above]
    if not crossed:
        return claims
    i, above, below = crossed[0]
    verdict = undecided(
        f"two proofs contradict each other: the least possible width of x{i + 1} is {below!r}, the "
        f"certified one {above!r}. This is an error of the program; please report it"
    )
    return tuple(Claim.from_verdict(x.id, x.statement, x.source, verdict) for x in claims)


def _expected(problem: Problem, stored: Entries) -> NewEntries:
    options = problem.options_as(SetMembershipOptions)
    expected = plant_entries(problem.plant)
    # a window that the problem leaves open is a choice: every one gives sound bounds
    window = stored.get("window") if options.window is None else options.window
    expected |= {"window": window, "steps": options.steps}
    if options.fixed_lag is not None:
        expected["fixed_lag"] = options.fixed_lag
    if options.directions is not None:
        expected["directions"] = np.array(options.directions)
    if "multipliers" in stored and np.ndim(stored["multipliers"]) == 4:
        expected["multipliers"] = np.shape(stored["multipliers"])
    return expected
