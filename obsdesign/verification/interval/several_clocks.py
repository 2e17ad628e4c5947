"""The interval observer for several clocks: its gains, and what follows from its clocks.

The bounds themselves need no hypothesis: no stated time enters them.
"""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Entries, EntriesByClaim, NewEntries
from obsdesign.analysis.interval.several_clocks import reason_against_clocks, with_given
from obsdesign.document import Claim, Guarantee
from obsdesign.equations.clocks import clock_data
from obsdesign.equations.interval.clock_gains import ClockedIntervalGains
from obsdesign.problem.problem import Problem
from obsdesign.verification.consistency import consistent_gains

_ENCLOSURE = (
    "The bounds contain the state at every row, if they contain it at the start, b, c and v stay "
    "inside their bounds and events are reported at their times; this holds for samples of each "
    "sensor at any spacing, missing ones included, for any times between events and whatever the "
    "rounding."
)
_MONOTONE = (
    "A further sample, of whichever sensor, never makes the bounds wider, but for rounding: the "
    "box that it leaves is kept only where it is narrower."
)
_NO_WIDTH = (
    "No width of the bounds is guaranteed: nothing is proved here of clocks that are independent."
)


def clocked_claims(
    problem: Problem, stored: Entries, certificates: EntriesByClaim
) -> tuple[Claim, ...]:
    """All claims of the design, each with its verdict; stored: gains as a file states them."""
    del certificates
    reason = reason_against_clocks(problem)
    expected = {} if reason is not None else _expected(problem, stored)
    agreement, _ = consistent_gains(reason, stored, expected, ClockedIntervalGains.from_document)
    return (agreement,)


def clocked_guarantees(claims: tuple[Claim, ...]) -> tuple[Guarantee, ...]:
    """The sentences a user may rely on."""
    verdicts = {claim.id: claim.verdict for claim in claims}
    given = [Guarantee.from_verdicts(x, ["consistent"], verdicts) for x in (_ENCLOSURE, _MONOTONE)]
    return (*given, Guarantee.not_proved(_NO_WIDTH))


def _expected(problem: Problem, stored: Entries) -> NewEntries:
    """Entries of the gains: the plant's numbers, given gains, and the shapes of the others."""
    plant, n, p = problem.plant, problem.plant.n, problem.plant.p
    shapes = {"L": (n, p), "M": (len(plant.events), n, p)}
    L, M = (np.asarray(stored.get(name, 0.0)) for name in shapes)
    expected: NewEntries = clock_data(plant) | shapes
    if L.shape == shapes["L"]:
        expected["L"] = with_given(plant, problem.gains, L, np.zeros(shapes["M"]))[0]
    if M.shape == shapes["M"]:
        expected["M"] = with_given(plant, problem.gains, np.zeros(shapes["L"]), M)[1]
    if not plant.events:
        del expected["M"]
    return expected
