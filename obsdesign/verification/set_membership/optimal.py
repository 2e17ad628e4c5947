"""The least width that any observer can guarantee: two states with equal samples.

From any state, disturbances at the middle of their box +- the stored ones lead to two states with
the same measurements, inside all declared bounds. Whoever guarantees bounds must include both.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Array, Entries, Matrix, NewEntries
from lmi.arithmetic.balls import Ball, ball_column, exact, number, precision, scalar, upper_ends
from lmi.verdict import Verdict, proved, undecided
from obsdesign.analysis.set_membership.enclosed import BALLS
from obsdesign.document import Claim
from obsdesign.equations.set_membership.gains import SetMembershipGains
from obsdesign.equations.set_membership.nominal import NominalMaps, StepMap
from obsdesign.equations.set_membership.pattern import Pattern, Step
from obsdesign.verification.set_membership.width import matrix_of

SOURCE = "radius of information: M. Milanese, R. Tempo, IEEE TAC 30 (1985)"
_BITS = 320
_MOST_STEPS, _MOST_PIECES = 10_000, 64


@dataclass(frozen=True)
class Hidden:
    """Disturbances of a state's trajectory; row: after which it is far from the other one."""

    row: int
    disturbances: Matrix


@dataclass(frozen=True)
class Pair:
    """The stored trajectories of all states."""

    steps: int
    pieces: int
    of_state: tuple[Hidden, ...]

    @classmethod
    def from_evidence(
        cls, gains: SetMembershipGains, pattern: Pattern, entries: Entries
    ) -> Pair | None:
        """None where the entries are not those of a pattern."""
        rows, steps, pieces = (entries.get(name) for name in ("rows", "steps", "pieces"))
        listed = entries.get("disturbances")
        counts = (_count(steps, _MOST_STEPS), _count(pieces, _MOST_PIECES))
        if counts[0] is None or counts[1] is None or counts[1] & (counts[1] - 1):
            return None
        if not isinstance(rows, list) or not isinstance(listed, list):
            return None
        if len(rows) != gains.n or len(listed) != gains.n:
            return None
        hidden = []
        for row, values in zip(rows, listed, strict=True):
            own = _disturbances(values)
            if not isinstance(row, int) or not 0 <= row < len(pattern.ends) or own is None:
                return None
            hidden.append(Hidden(row, own))
        return cls(counts[0], counts[1], tuple(hidden))

    def to_document(self) -> NewEntries:
        """The entries that `from_evidence` reads."""
        rows = [hidden.row for hidden in self.of_state]
        listed = [hidden.disturbances.tolist() for hidden in self.of_state]
        return {"rows": rows, "steps": self.steps, "pieces": self.pieces, "disturbances": listed}


def optimal_claims(
    gains: SetMembershipGains, pattern: Pattern, proposed: Entries, width: Claim | None
) -> tuple[Claim, ...]:
    """Claim of the least widths that trajectories show; none where none are proposed."""
    stated = proposed.get("trajectories")
    pair = Pair.from_evidence(gains, pattern, stated) if isinstance(stated, dict) else None
    if pair is None:
        return ()
    verdict = _proof(gains, pattern, pair)
    if verdict.outcome == "proved":
        least = verdict.evidence["least"]
        ratio = None if width is None or width.verdict != "proved" else [
            above / below if below > 0 else None
            for above, below in zip(width.evidence["always"], least, strict=True)
        ]  # fmt: skip
        verdict = proved(least=least, ratio=ratio, trajectories=pair.to_document())
    statement = (
        f"on the nominal pattern, {pattern}, no observer can guarantee a width below `least` "
        "after every row: two trajectories with the same measurements end so far apart"
    )
    return (Claim.from_verdict("optimal", statement, SOURCE, verdict),)


def _proof(gains: SetMembershipGains, pattern: Pattern, pair: Pair) -> Verdict:
    least = []
    with precision(_BITS):
        maps = NominalMaps(gains, BALLS)
        steps = maps.steps(pattern.cycle, lambda h: (pair.pieces,))
        for i, hidden in enumerate(pair.of_state):
            window = pattern.window(pattern.ends[hidden.row], pair.steps)
            value = _distance(maps, steps, window, hidden.disturbances, i)
            if isinstance(value, str):
                return undecided(f"trajectory of x{i + 1}: {value}")
            least.append(value)
    return proved(least=least)


def _distance(
    maps: NominalMaps, steps: dict[Step, StepMap], window: tuple[Step, ...], xi: Matrix, i: int
) -> float | str:
    """Certified distance of two states, in x_i, at the end of a window; or what is wrong."""
    if len(xi) != sum(steps[step].F0.shape[1] for step in window):
        return "its disturbances are not those of the pattern"
    if (np.abs(xi) > 1).any():
        return "a disturbance leaves its bounds"
    inputs, e, used, loudest = exact(xi), maps.C[0] * 0, 0, number(1.0)
    for step in window:
        generators = steps[step].generators
        end = used + generators.shape[1]
        e = steps[step].Phi @ e + generators @ inputs[used:end]
        used = end
        if step.sampled:
            loudest = _loudest(loudest, maps.C @ e, maps.V)
            if not loudest.is_finite():
                return 0.0
    bottom = -upper_ends(ball_column([-abs(e[i]) * 2 / loudest]))[0, 0]
    return float(bottom) if math.isfinite(bottom) and bottom > 0 else 0.0


def _loudest(before: Ball, y: Array, V: Array) -> Ball:
    """Upper end of the largest |y| in parts of the noise: by so much all is made smaller.

    Not finite where an output without noise shows the trajectory.
    """
    result = before
    for value, bound in zip(y, V, strict=True):
        if not abs(value) <= bound * result:
            if not bound > 0:
                return scalar(1) / 0
            result = scalar(abs(value) / bound).abs_upper()
    return result


def _disturbances(values: object) -> Matrix | None:
    return matrix_of(values, (len(values),)) if isinstance(values, list) else None


def _count(value: object, most: int) -> int | None:
    """A whole number from 1 to `most`, or None."""
    is_count = isinstance(value, int) and not isinstance(value, bool) and 1 <= value <= most
    return value if is_count and isinstance(value, int) else None
