"""Steady-state error caused by rounding the stored matrices.

Rounded matrices are no exact observer: the state, the inputs and the unknown input drive the error
by `error_drives`. The error is bounded by the peak gain from each to each estimate.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from lmi.arithmetic.arrays import Entries
from lmi.arithmetic.balls import exact, to_float
from lmi.bounds.peak_gain import peak_gains
from lmi.verdict import Verdict, proved, refuted, undecided
from obsdesign.document import Claim
from obsdesign.equations.unknown_input.formulas import (
    LARGEST_STEADY_STATE_ERROR,
    ErrorDrives,
    ObserverMatrices,
    PlantMatrices,
    error_drives,
)

PAPER = "Ahn (2002)"


@dataclass(frozen=True)
class SteadyBounds:
    """Largest steady-state errors of xhat and of dhat for signals of unit size."""

    state: float
    input: float

    @classmethod
    def from_evidence(cls, evidence: Entries) -> SteadyBounds | None:
        """The bounds in the evidence of the claim `rounding`, if there are any."""
        bounds = evidence.get("bounds")
        return None if bounds is None else cls(**bounds)


def steady_state_error(
    plant: PlantMatrices, matrices: ObserverMatrices, pace: float, is_hurwitz: bool
) -> Claim:
    """Bound the error of exact matrices with signals of unit size; inputs in units of pace.

    is_hurwitz: F is proved to be Hurwitz, without which there is nothing to bound.
    """
    verdict = undecided("F is not proved to be Hurwitz")
    if is_hurwitz:
        verdict = _verdict(error_drives(plant, matrices), matrices, pace)
    return Claim.from_verdict(
        "rounding",
        "the steady-state error of the estimates from rounding the stored matrices is at most "
        f"{LARGEST_STEADY_STATE_ERROR:g} of the signals, in units that balance the plant: states "
        "of unit size, and inputs that move them at the pace of the plant",
        f"{PAPER}, (27); peak gain of the error system",
        verdict,
    )


def _verdict(drives: ErrorDrives, matrices: ObserverMatrices, pace: float) -> Verdict:
    sizes = (1.0, pace, pace)  # of x, u and d
    drive, *direct = (
        np.hstack([part * exact(size).item() for part, size in zip(row, sizes, strict=True)])
        for row in drives
    )
    peaks = peak_gains(matrices.F, drive, np.vstack([matrices.X, matrices.Q]))
    if peaks is None:
        return undecided("F is too close to the border of stability for a bound")
    n = len(matrices.X)
    feed = np.abs(to_float(np.vstack(direct)))
    # a constant signal of the better sign leaves at least this; two sums of floats: room for both
    low = (peaks[0] - feed).clip(0.0).sum(axis=1) * (1 - 1e-9)
    high = (peaks[1] + feed).sum(axis=1) * (1 + 1e-9)
    for bound in (low, high):
        bound[n:] /= pace
    largest = (float(part.max(initial=0.0)) for part in (high[:n], high[n:]))
    bounds = asdict(SteadyBounds(*largest))
    if max(bounds.values()) <= LARGEST_STEADY_STATE_ERROR:
        return proved(bounds=bounds)
    if low.max(initial=0.0) > LARGEST_STEADY_STATE_ERROR:
        entry = int(np.argmax(low))
        name = f"x{entry + 1}" if entry < n else f"d{entry - n + 1}"
        reason = (
            f"constant signals of unit size leave a steady-state error of {low[entry]:.3g} in "
            f"{name}; {LARGEST_STEADY_STATE_ERROR:g} is allowed for rounding"
        )
        return refuted({"estimate": name, "error": float(low[entry]), "reason": reason})
    worst = max(bounds.values())
    return undecided(
        f"rounding the stored matrices may leave a steady-state error of {worst:.3g} of the "
        f"signals; {LARGEST_STEADY_STATE_ERROR:g} is allowed",
        bounds=bounds,
    )
