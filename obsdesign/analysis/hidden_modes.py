"""What a plant's matrices allow: modes that no output sees. Each answer carries its witness."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.balls import exact, row_echelon, surely_observable
from lmi.prove.hurwitz import prove_hurwitz
from lmi.refute.spectral import refute_spectral

Matrix = NDArray[np.float64]

# A mode counts as unseen when [A - s I; C] is this close to losing rank, relative to its size
RANK_TOLERANCE = 1e-10


@dataclass(frozen=True)
class Mode:
    """Eigenvalue of A, and how far [A - s I; C] is from losing rank there, relative to its size."""

    eigenvalue: complex
    margin: float


def approx_unobservable_modes(A: Matrix, C: Matrix) -> list[Mode]:
    """Modes of A, (n, n), that C, (p, n), does not see (Popov-Belevitch-Hautus), in floats.

    The least decaying mode comes first.
    """
    size = max(float(np.abs(A).max(initial=0.0)), 1e-300)
    seen = C / max(float(np.abs(C).max(initial=0.0)), 1e-300)
    found = []
    for value in np.linalg.eigvals(A):
        pencil = np.vstack([(A - value * np.eye(len(A))) / size, seen])
        margin = float(np.linalg.svd(pencil, compute_uv=False)[-1])
        if margin < RANK_TOLERANCE:
            found.append(Mode(complex(value), margin))
    return sorted(found, key=lambda mode: -mode.eigenvalue.real)


def hidden_growth(A: Matrix, C: Matrix, rate: float = 0.0) -> bool:
    """Is there, exactly, a mode that C never sees and that does not decay faster than `rate`?

    In rational arithmetic: the unobservable subspace of (A, C), and Routh's test on A + rate I
    restricted to it. No gain L moves such a mode of A - L C.
    """
    unseen = hidden_flow(A, C)
    if unseen is None:
        return False
    return prove_hurwitz(unseen + exact(rate * np.eye(len(unseen)))).outcome == "refuted"


def hidden_pair(A: Any, G: Any, C: Any) -> tuple[Any, Any] | None:
    """(A, G) restricted to the largest subspace that C never sees, along flow and jumps; exact.

    No gain L or M reaches the error there, so that its stability is the plant's own. None if the
    subspace is zero.
    """
    maps = [exact(A), exact(G)]
    rows = exact(C)
    if surely_observable(maps[0], rows):
        return None
    hidden, free = nullspace(rows)
    while free:
        further = [rows @ X for X in maps]
        stacked = np.vstack([rows, *further])
        smaller, fewer = nullspace(stacked)
        if len(fewer) == len(free):
            flow, jump = ((X @ hidden)[free] for X in maps)
            return flow, jump
        rows, hidden, free = stacked, smaller, fewer
    return None


def hidden_for_ever(
    A: Any, G: Any | None, C: Any, ends: tuple[float, float]
) -> dict[str, Any] | None:
    """Why two states are never told apart and never come together, whatever the gains; or None.

    G: None without jumps; ends: shortest and longest dwell time. The reason, and its witness.
    """
    if (G is None or math.isinf(ends[1])) and hidden_growth(A, C):
        ending = "there are no jumps" if G is None else "there is no longest dwell time"
        reason = f"no observer exists: an unobservable mode of flow.A does not decay, and {ending}"
        return {"reason": reason}
    pair = None if G is None else hidden_pair(A, G, C)
    if pair is None:
        return None
    verdict = refute_spectral(*pair, *ends)
    if verdict.outcome != "refuted":
        return None
    witness = dict(verdict.evidence["witness"])
    part = "a direction" if len(pair[0]) == 1 else f"a {len(pair[0])}-dimensional part"
    reason = (
        f"no observer exists: {part} of the state that no output ever sees, along flow and "
        f"jumps, does not shrink: {witness['reason']}"
    )
    return {**witness, "reason": reason}


def hardly_hidden(A: Matrix, C: Matrix) -> str | None:
    """What is missing where a mode that lasts is hidden but for rounding, in floats; or None.

    Such a mode is often one that is lossless and unseen in other coordinates: exactly it is
    neither, so that nothing can be proved against it, and no gain does anything about it.
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
        f"flow.A has a mode ({shown}) that no output sees and that lasts, but for rounding "
        f"(relative {RANK_TOLERANCE:g}); the stored numbers do not have it exactly, so it is no "
        "proof that no observer exists: give the plant in coordinates in which they do"
    )


def hidden_flow(A: Any, C: Any) -> Any | None:
    """A restricted to the largest A-invariant subspace that C never sees; exact.

    A, C: floats or exact rationals. Its modes are those that no output sees. None if the subspace
    is zero.
    """
    found = hidden_subspace(A, C)
    return None if found is None else found[0]


def hidden_subspace(A: Any, C: Any) -> tuple[Any, Any] | None:
    """(`hidden_flow`, basis (n, h) of the subspace in whose coordinates it stands); exact."""
    flow, seen = exact(A), exact(C)
    if surely_observable(flow, seen):
        return None
    hidden, free = nullspace(seen)
    while free:
        moved = flow @ hidden
        inside, kept = nullspace(moved - hidden @ moved[free])
        if len(kept) == len(free):
            return moved[free], hidden
        hidden, free = hidden @ inside, [free[i] for i in kept]
    return None


def nullspace(rows: Any) -> tuple[Any, list[int]]:
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
