"""Obstructions: proofs that no L, M exist (undetectable modes, entries with the wrong sign).

Decided in exact numbers. Each witness holds for every L and M that the problem leaves open, in the
form and the coordinates of the design (undetectable modes: for every observer).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from lmi.arithmetic.arrays import Array, NewEntries
from lmi.arithmetic.balls import exact, inverse, to_float
from lmi.prove.hurwitz import prove_hurwitz
from lmi.refute.spectral import refute_spectral
from lmi.verdict import Verdict, refuted, undecided
from obsdesign.analysis.hidden_modes import nearly_undetectable, nullspace, unseen_growth
from obsdesign.document import Claim
from obsdesign.equations.estimation_error import idle_gains, seen_before_jump
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.equations.interval.splits import absolute_metzler
from obsdesign.equations.interval.width import Coordinates, error_matrices
from obsdesign.problem.problem import Problem
from obsdesign.verification.gain_constraints import (
    stated_pattern,
    within_structure,
    witness_within_structure,
)

# supports of Farkas vectors that are tried for each row
_MOST_SUPPORTS = 2000
_STABILITY = ("dwell_stability", "sampled_stability")


@dataclass(frozen=True)
class _OpenGains:
    """Which gains the problem leaves open, where they act."""

    L: bool
    M: bool


def obstruction_claim(problem: Problem, gains: IntervalGains, source: str) -> tuple[Claim, ...]:
    """A refuted claim where gains are open and none suffices; nothing otherwise.

    An unseen mode refutes nothing where x stays in a known box: the claim is then undecided.
    """
    plant = problem.plant
    idle = idle_gains(plant)
    is_open = _OpenGains(*(name not in {*problem.gains, *idle} for name in ("L", "M")))
    is_periodic, witness = plant.output.measured == "periodic", None
    is_searched = is_open.L or (is_open.M and not is_periodic)
    unseen = _unseen(problem) if is_searched else None
    if unseen is not None and gains.state_lower is not None:
        reason = (
            f"{unseen['reason']}; the box of x bounds it, but no width of kind 'interval' is "
            "proved there: kind 'set_membership' takes such plants"
        )
        return (_attainable(gains, source, undecided(reason)),)
    if unseen is not None:
        witness = {**unseen, "reason": f"no observer exists: {unseen['reason']}"}
    elif is_searched:
        witness = witness_within_structure(problem)
        if witness is None and not is_periodic:
            witness = _in_these_coordinates(problem, gains, is_open)
    elif _has_open_coordinates(problem, gains):
        decide = _unstable_between_samples if is_periodic else _unstable_error
        witness = decide(problem, gains)
    if witness is None:
        return ()
    return (_attainable(gains, source, refuted({**witness, "of_all_gains": True})),)


def _attainable(gains: IntervalGains, source: str, verdict: Verdict) -> Claim:
    statement = f"some gains L, M make a design of form {gains.form}"
    return Claim.from_verdict("attainable", statement, source, verdict)


def _has_open_coordinates(problem: Problem, gains: IntervalGains) -> bool:
    return gains.S is not None and "S" not in problem.gains


def _unseen(problem: Problem) -> NewEntries | None:
    """Witness of a part of the state that no output shows and that does not decay, or None."""
    return unseen_growth(*_plant(problem), problem.names.states_of(problem.plant.n))


def _plant(problem: Problem) -> tuple[Array, Array | None, Array, tuple[float, float]]:
    """A, G (None without jumps), C, and the range of dwell times."""
    plant = problem.plant
    if plant.jump is None:
        return plant.flow.A, None, plant.output.C, (math.inf, math.inf)
    return plant.flow.A, plant.jump.G, plant.output.C, problem.require_dwell_time()


def with_hints(problem: Problem, claims: tuple[Claim, ...]) -> tuple[Claim, ...]:
    """The same claims; a failed one names a mode that is unobservable up to rounding, if any.

    Only where gains are open: a given one is judged by itself.
    """
    failed = [c for c in claims if c.id in _STABILITY and c.verdict != "proved"]
    is_open = {"L", "M"} - {*problem.gains, *idle_gains(problem.plant)}
    if not failed or not is_open or any(c.id == "attainable" for c in claims):
        return claims
    hint = nearly_undetectable(problem.plant.flow.A, problem.plant.output.C)
    if hint is None:
        return claims
    return tuple(_with_hint(c, hint) if c in failed else c for c in claims)


def _with_hint(claim: Claim, hint: str) -> Claim:
    witness = claim.evidence.get("witness")
    if witness is not None:
        witness = {**witness, "reason": f"{witness.get('reason', 'refuted')}; {hint}"}
        return replace(claim, evidence={**claim.evidence, "witness": witness})
    reason = f"{claim.evidence.get('reason', 'not proved')}; {hint}"
    return replace(claim, evidence={**claim.evidence, "reason": reason})


def _unstable_error(problem: Problem, gains: IntervalGains) -> NewEntries | None:
    """With gains that are given no coordinates help if the error itself does not shrink."""
    F, H = error_matrices(gains, exact)
    beginning = "with these gains no coordinates help, the estimation error does not shrink: "
    if H is None:
        return _witness(prove_hurwitz(F), beginning)
    low, high = problem.require_dwell_time()
    witness = _witness(prove_hurwitz(F), beginning) if math.isinf(high) else None
    return witness or _witness(refute_spectral(F, H, low, high), beginning)


def _unstable_between_samples(problem: Problem, gains: IntervalGains) -> NewEntries | None:
    """The same for samples as events, without jumps if they may stay away for ever."""
    if problem.plant.jump is not None and math.isfinite(problem.require_dwell_time()[1]):
        return None
    assert gains.period is not None
    A, C, L = (exact(matrix) for matrix in (gains.A, gains.C, gains.L))
    beginning = "with this L no coordinates help, the estimation error does not shrink: "
    K = exact(np.eye(gains.n)) - L @ C
    return _witness(refute_spectral(A, K, gains.period, gains.period), beginning)


def _witness(verdict: Verdict, beginning: str) -> NewEntries | None:
    """The witness of a refutation, its reason after a beginning; None without one."""
    if verdict.outcome != "refuted":
        return None
    return {**verdict.witness, "reason": beginning + verdict.reason}


def _in_these_coordinates(
    problem: Problem, gains: IntervalGains, is_open: _OpenGains
) -> NewEntries | None:
    plant = problem.plant
    if gains.form == "two_coordinates":
        return None
    frame = Coordinates.from_matrices(gains.S, None, inverse, exact)
    C = exact(plant.output.C)
    L, M = (0 * exact(X) if is_free else exact(X)
            for is_free, X in ((is_open.L, gains.L), (is_open.M, gains.M)))  # fmt: skip
    F = frame.similar(exact(plant.flow.A) - L @ C)
    H, C_jump = None, C
    if plant.jump is not None:
        G = exact(plant.jump.G)
        C_jump = seen_before_jump(G, C, plant.output.jump_measurement)
        H = frame.similar(G - M @ C_jump)
    if frame.S is not None:
        C, C_jump = C @ frame.S, C_jump @ frame.S
    flow = _Correction(C, _open_entries(problem, "L", frame, is_open.L))
    jump = _Correction(C_jump, _open_entries(problem, "M", frame, is_open.M))
    if gains.form == "cooperative":
        witness = _wrong_sign(F, flow, "A - L C", metzler=True)
        if witness is None and H is not None:
            witness = _wrong_sign(H, jump, "the jump matrix of the error", metzler=False)
        if witness is not None:
            return witness
    if _has_open_coordinates(problem, gains):
        return None
    return _unreached(problem, F, H, (flow, jump))


@dataclass(frozen=True)
class _Correction:
    """K C of a gain K in the design's coordinates; entries (n, p): which of K are open."""

    C: Array
    entries: Array

    def rows(self, i: int) -> Array:
        """C, zero at the outputs that row i of the gain does not use."""
        masked: Array = self.C * self.entries[i].astype(np.int64)[:, None]
        return masked

    def unseen(self) -> set[int]:
        """Columns of K C that are zero whatever the gain."""
        used = self.C[self.entries.any(axis=0)]
        return {j for j in range(used.shape[1]) if all(x == 0 for x in used[:, j])}

    def uncorrected(self) -> set[int]:
        """Rows of K C that are zero whatever the gain."""
        return {int(i) for i in np.flatnonzero(~self.entries.any(axis=1))}


def _open_entries(problem: Problem, gain: str, frame: Coordinates, is_open: bool) -> Array:
    """Entries (n, p) of a gain in the design's coordinates that may differ from zero."""
    pattern = stated_pattern(problem, gain) & is_open
    if frame.S is None:
        return pattern
    # other coordinates mix the rows of a pattern, not its columns
    return np.tile(pattern.any(axis=0), (len(pattern), 1))


def _unreached(
    problem: Problem, F: Array, H: Array | None, corrections: tuple[_Correction, _Correction]
) -> NewEntries | None:
    """Witness that columns or rows which no gain reaches do not contract, or None.

    Their part of W and N is the same for all gains.

    corrections: of the flow and at jumps.
    """
    flow, jump = corrections
    scope = within_structure(problem, "L", "M")
    unreached = {
        "column": flow.unseen() & jump.unseen(),
        "row": flow.uncorrected() & jump.uncorrected(),
    }
    for word, indices in unreached.items():
        names = ", ".join(str(j + 1) for j in sorted(indices))
        beginning = (
            f"in these coordinates no gain{scope} can touch {word}{'s' * (len(indices) > 1)} "
            f"{names} of A - L C and of the jump matrix: "
        )
        witness = _growth(problem, F, H, sorted(indices), beginning) if indices else None
        if witness is not None:
            return witness
    return None


def _growth(
    problem: Problem, F: Array, H: Array | None, indices: list[int], beginning: str
) -> NewEntries | None:
    """Witness that the widths of these states alone do not contract, or None."""
    part = np.ix_(indices, indices)
    W = absolute_metzler(F[part])
    if H is None:
        return _witness(prove_hurwitz(W), beginning)
    low, high = problem.require_dwell_time()
    witness = _witness(refute_spectral(W, np.abs(H[part]), low, high), beginning)
    if witness is None and math.isinf(high):
        witness = _witness(prove_hurwitz(W), beginning)
    return witness


def _wrong_sign(X: Array, correction: _Correction, name: str, metzler: bool) -> NewEntries | None:
    """A row that no gain makes nonnegative: y >= 0 with C y = 0 and (row) y < 0 (Farkas).

    C: of the outputs that the row of the gain uses.
    """
    n = len(X)
    for i in range(n):
        others = [j for j in range(n) if not (metzler and j == i)]
        for support, y in _kernel_vectors(correction.rows(i), others):
            total = sum(X[i, j] * value for j, value in zip(support, y, strict=True))
            if total < 0:
                return _entry(X, i, support, y, name)
    return None


def _entry(X: Array, i: int, support: tuple[int, ...], y: Array, name: str) -> NewEntries:
    values = [float(v) for v in to_float(np.array([X[i, j] for j in support], dtype=object))]
    if len(support) == 1:
        j = support[0]
        reason = f"entry ({i + 1}, {j + 1}) of {name} is {values[0]:.6g}, and no gain can touch it"
    else:
        places = ", ".join(f"({i + 1}, {j + 1})" for j in support)
        reason = (
            f"entries {places} of {name} cannot all be made nonnegative: a positive combination "
            "of them that no gain can touch is negative"
        )
    weights = [float(v) for v in to_float(np.array(list(y), dtype=object))]
    return {"row": i + 1, "columns": [j + 1 for j in support], "weights": weights, "reason": reason}


def _kernel_vectors(C: Array, columns: list[int]) -> Iterator[tuple[tuple[int, ...], Array]]:
    """Yield (support, y): y > 0 on a few columns with C y = 0, of least support."""
    supports = itertools.chain.from_iterable(
        itertools.combinations(columns, size) for size in range(1, len(C) + 2)
    )
    for support in itertools.islice(supports, _MOST_SUPPORTS):
        basis, free = nullspace(C[:, list(support)])
        if len(free) != 1:
            continue
        y = basis[:, 0]
        if all(v > 0 for v in y) or all(v < 0 for v in y):
            yield support, np.abs(y)
