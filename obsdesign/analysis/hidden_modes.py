"""Unobservable and undetectable modes of a plant. Each answer carries its witness."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Array, Matrix
from lmi.arithmetic.balls import Exact, exact, row_echelon, surely_observable, to_float
from lmi.prove.hurwitz import prove_hurwitz
from lmi.rank.witness import MARGIN
from lmi.refute.spectral import refute_spectral
from lmi.verdict import Verdict, undecided
from obsdesign.column_names import combination, numbered

# A mode counts as unobservable when [A - s I; C] is this close to losing rank, relative to its size
RANK_TOLERANCE = 1e-10
_LATER = 2.0**-10  # of the range, or of the fastest time: spacings that count as positive


@dataclass(frozen=True)
class Mode:
    """Eigenvalue of A, and how far [A - s I; C] is from losing rank there, relative to its size."""

    eigenvalue: complex
    margin: float


def approx_unobservable_modes(A: Matrix, C: Matrix) -> list[Mode]:
    """Unobservable modes of A, (n, n), C, (p, n), in floats (Popov-Belevitch-Hautus).

    In the units of A and C; the least decaying mode comes first.
    """
    size = max(float(np.abs(A).max(initial=0.0)), 1e-300)
    rows = C / max(float(np.abs(C).max(initial=0.0)), 1e-300)
    modes = []
    for value in np.linalg.eigvals(A):
        pencil = np.vstack([(A - value * np.eye(len(A))) / size, rows])
        margin = float(np.linalg.svd(pencil, compute_uv=False)[-1])
        if margin < RANK_TOLERANCE:
            modes.append(Mode(complex(value), margin))
    return sorted(modes, key=lambda mode: -mode.eigenvalue.real)


def hidden_growth(A: Matrix, C: Matrix) -> bool:
    """Decide exactly whether an unobservable mode does not decay.

    In rational arithmetic: the unobservable subspace of (A, C), and Routh's test on A restricted
    to it. No gain L moves such a mode of A - L C.
    """
    hidden = hidden_part([A], C)
    return hidden is not None and prove_hurwitz(hidden.maps[0]).outcome == "refuted"


@dataclass(frozen=True)
class HiddenPart:
    """The unobservable subspace of some maps, and the maps restricted to it.

    basis (n, h); maps (h, h). No gain reaches the error there: its stability is the plant's own.
    """

    basis: Exact
    maps: tuple[Exact, ...]

    def directions(self, names: Sequence[str]) -> str:
        """Directions of the state that span it, for people; names (n): of the states."""
        first, *more = (combination(column, names) for column in to_float(self.basis).T.tolist())
        return f"the direction {first}" if not more else f"the span of {'; '.join([first, *more])}"


def hidden_part(maps: Sequence[Array], C: Array) -> HiddenPart | None:
    """The largest subspace in the null space of C that all maps leave invariant; None if zero.

    Exact; maps (n, n), C (p, n): floats or exact rationals.
    """
    exact_maps, rows = [exact(X) for X in maps], exact(C)
    if surely_observable(exact_maps[0], rows):
        return None
    basis, free = nullspace(rows)
    while free:
        images = [X @ basis for X in exact_maps]
        inside, inner = nullspace(np.vstack([X - basis @ X[free] for X in images]))
        if len(inner) == len(free):
            return HiddenPart(basis, tuple(X[free] for X in images))
        basis, free = basis @ inside, [free[i] for i in inner]
    return None


def fixed_parts(maps: Sequence[Array], C: Array, pattern: Array) -> list[tuple[Exact, ...]]:
    """The maps of parts of the error that no gain of a pattern changes, exact.

    maps: X (n, n) of X - K C; pattern (n, p): which entries of K may differ from zero. Two parts:
    V with X V in V, hidden from the rows of C that some entry uses: (X - K C) v = X v; and the
    quotient by the complement of W with X'W in W, W zero at all states that some entry corrects:
    w'(X - K C) = w'X.
    """
    used = exact(C) * exact(pattern.any(axis=0).astype(float))[:, None]
    corrected = exact(np.diag(pattern.any(axis=1).astype(float)))
    hidden = hidden_part(maps, used)
    untouched = hidden_part([exact(X).T for X in maps], corrected)
    parts = [] if hidden is None else [hidden.maps]
    return parts if untouched is None else [*parts, tuple(X.T for X in untouched.maps)]


def refuted_in_time(F: Array, H: Array, low: float, high: float) -> Verdict:
    """Refuted where x -> e^{F theta} H x does not decay as time passes; otherwise undecided.

    As `refute_spectral`, but for impulses at once: where theta = 0 is repeated no time passes, so
    that a radius of 1 there refutes nothing, growth does. Larger theta are then judged alone.
    """
    verdict = refute_spectral(F, H, low, high)
    if low > 0 or not _is_at_once(verdict):
        return verdict
    fastest = float(np.abs(to_float(exact(F))).sum(axis=1).max(initial=0.0))
    span = min(high, 1 / fastest if fastest > 0 else math.inf)
    if 0 < span < math.inf:
        later = refute_spectral(F, H, _LATER * span, high)
        if later.outcome == "refuted":
            return later
    return undecided("impulses at once do not shrink it, and no time passes between them")


def _is_at_once(verdict: Verdict) -> bool:
    """Whether a refutation is by the spacing 0 alone, where nothing grows."""
    if verdict.outcome != "refuted":
        return False
    witness = verdict.witness
    of_every_theta = "vector" in witness or "Q" in witness
    is_growing = witness["spectral_radius"] > 1 + MARGIN
    return witness["theta"] == 0 and not of_every_theta and not is_growing


def not_detectable(
    A: Matrix,
    G: Matrix | None,
    C: Matrix,
    ends: tuple[float, float],
    names: Sequence[str] = (),
) -> dict[str, object] | None:
    """Witness that (A, G, C) is not detectable over the dwell times; None if detectable.

    G: None without jumps; ends: shortest and longest dwell time; names (n): of the states, x1, ...
    by default. The reason, and its witness.
    """
    witness = unseen_growth(A, G, C, ends, names)
    if witness is None:
        return None
    return {**witness, "reason": f"no observer exists: {witness['reason']}"}


def unseen_growth(
    A: Matrix,
    G: Matrix | None,
    C: Matrix,
    ends: tuple[float, float],
    names: Sequence[str] = (),
) -> dict[str, object] | None:
    """Witness of a part of the state that no output shows and that does not decay, or None.

    As `not_detectable`, which it refutes; no more than that where x stays in a known box.
    """
    names = names or numbered("x", len(A))
    if (G is None or math.isinf(ends[1])) and hidden_growth(A, C):
        ending = "there are no jumps" if G is None else "there is no longest dwell time"
        unseen = hidden_part([A], C)
        assert unseen is not None
        reason = (
            f"no output shows {unseen.directions(names)}, where a mode of flow.A does not decay, "
            f"and {ending}"
        )
        return {"reason": reason}
    hidden = None if G is None else hidden_part([A, G], C)
    if hidden is None:
        return None
    flow, jump = hidden.maps
    verdict = refuted_in_time(flow, jump, *ends)
    if verdict.outcome != "refuted":
        return None
    reason = (
        f"no output ever shows {hidden.directions(names)}, along flow and jumps, which does not "
        f"shrink: {verdict.reason}"
    )
    return {**verdict.witness, "reason": reason}


def nearly_undetectable(A: Matrix, C: Matrix) -> str | None:
    """Warning for a non-decaying mode that is unobservable up to rounding; None otherwise.

    Such a mode is often lossless and unobservable in other coordinates: exactly it is neither, so
    that nothing can be proved against it, and no gain moves it.
    """
    size = max(float(np.abs(A).max(initial=0.0)), 1e-300)
    lasting = [
        mode
        for mode in approx_unobservable_modes(A, C)
        if mode.eigenvalue.real > -RANK_TOLERANCE * size
    ]
    if not lasting:
        return None
    value = lasting[0].eigenvalue
    real = value.real if abs(value.real) > RANK_TOLERANCE * size else 0.0
    shown = f"{real:.3g}" + (f"+-{abs(value.imag):.6g}i" if value.imag else "")
    return (
        f"flow.A has a mode ({shown}) that does not decay and is unobservable up to rounding "
        f"(relative {RANK_TOLERANCE:g}); the stored numbers are not exactly so, and nothing is "
        "refuted: state the plant in coordinates in which they are"
    )


def nullspace(rows: Exact) -> tuple[Exact, list[int]]:
    """Basis of {v: rows v = 0} as columns, the identity at the free columns; exact rationals."""
    table, rank = row_echelon(rows)
    leading = [int(np.flatnonzero(table[i] != 0)[0]) for i in range(rank)]
    free = [j for j in range(table.shape[1]) if j not in leading]
    basis = exact(np.zeros((table.shape[1], len(free))))
    for column, j in enumerate(free):
        basis[j, column] = exact(1.0).item()
        for k, i in enumerate(leading):
            basis[i, column] = -table[k, j]
    return basis, free
