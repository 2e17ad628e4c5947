"""Widths on the nominal pattern: a tube of the stored multipliers, in balls.

The observer evaluates the stored multipliers in every row whose window has their samples, beside
those that it proposes: its bounds are never wider.
"""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Entries, Matrix
from lmi.arithmetic.balls import exact, precision
from lmi.verdict import Verdict, proved, undecided
from obsdesign.analysis.set_membership.enclosed import WIDTH_BITS, enclosed_rows
from obsdesign.document import Claim
from obsdesign.equations.set_membership.gains import SetMembershipGains
from obsdesign.equations.set_membership.pattern import Pattern

SOURCE = "weak duality over a window (docs/set_membership.md)"


def width_claims(
    gains: SetMembershipGains, pattern: Pattern, proposed: Entries
) -> tuple[Claim, ...]:  # fmt: skip
    """Claim of the proposed tube; none where there is no proposal.

    proposed: "tube", half widths (rows, n) after each row of a cycle.
    """
    tube = matrix_of(proposed.get("tube"), (len(pattern.ends), gains.n))
    if tube is None or gains.multipliers is None:
        return ()
    verdict = _proof(gains, gains.multipliers, pattern, tube)
    if verdict.outcome == "proved":
        always = (2 * tube.max(axis=0)).tolist()
        verdict = proved(tube=tube.tolist(), always=always, method="tube in balls")
    statement = (
        f"on the nominal pattern, {pattern}, `always` is an ultimate bound of the width after a "
        "row: a tube that the bounds by the stored multipliers do not leave and are drawn to"
    )
    return (Claim.from_verdict("width", statement, SOURCE, verdict),)


def _proof(
    gains: SetMembershipGains, multipliers: Matrix, pattern: Pattern, tube: Matrix
) -> Verdict:
    windows = pattern.windows(gains.window)
    if len(multipliers) != len(windows):
        return undecided(
            f"gains.multipliers must have one entry for each of the {len(windows)} windows of the "
            f"pattern; got {len(multipliers)}"
        )
    for window, mu in zip(windows, multipliers, strict=True):
        sampled = np.array([step.sampled for step in window])
        if mu[:, ~sampled].any():
            return undecided("gains.multipliers has entries where the pattern has no sample")
    if not (tube > 0).all():  # below 0 an expanding map would lead further down
        return undecided("the tube is not positive")
    with precision(WIDTH_BITS):
        rows = enclosed_rows(gains, pattern, multipliers)
        radii = exact(tube)
        for j, row in enumerate(rows):
            after = row.M @ radii[row.start] + row.k
            failing = [i for i in range(gains.n) if not after[i] < radii[j, i]]
            if failing:
                return undecided(
                    f"the tube is left, or nearly left, by x{failing[0] + 1} after row {j + 1} "
                    "of the pattern"
                )
    return proved()


def matrix_of(value: object, shape: tuple[int, ...]) -> Matrix | None:
    """A stored table as a matrix of finite floats of that shape; None if it is none."""
    try:
        table = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return None
    return table if table.shape == shape and np.isfinite(table).all() else None
