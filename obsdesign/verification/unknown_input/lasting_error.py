"""What the rounding of stored matrices leaves of the estimates of an unknown input for ever.

Rounded matrices are no exact observer: the state, the inputs and the unknown input drive the error
by `equations.leftovers`. What that comes to is bounded by the peak gain from each to each estimate.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from lmi.arithmetic.balls import exact, to_float
from lmi.bounds.peak_gain import peak_gains
from lmi.verdict import Verdict, proved, refuted, undecided
from obsdesign.document import Claim
from obsdesign.equations.unknown_input import matrices as equations

PAPER = "Ahn (2002)"


def lasting_error(
    plant: tuple[Any, Any, Any, Any], gains: Mapping[str, Any], pace: float, decays: bool
) -> Claim:
    """Exact matrices with all signals of about unit size; inputs are counted in units of pace.

    decays: F is proved to be Hurwitz, without which there is nothing to bound.
    """
    verdict = undecided("F is not proved to be Hurwitz")
    if decays:
        verdict = _verdict(equations.leftovers(plant, gains), gains, pace)
    return Claim(
        "rounding",
        "what the rounding of the stored matrices leaves of the estimates for ever is at most "
        f"{equations.LASTING:g} of the signals, in units that balance the plant: states of "
        "unit size, and inputs that move them at the pace of the plant",
        f"{PAPER}, (27); peak gain of the error system",
        verdict.outcome,
        verdict.evidence,
    )


def _verdict(
    left: Mapping[str, Mapping[str, Any]], gains: Mapping[str, Any], pace: float
) -> Verdict:
    inputs = {"x": 1.0, "u": pace, "d": pace}
    drive, *direct = (
        np.hstack([left[row][signal] * exact(size).item() for signal, size in inputs.items()])
        for row in ("error", "state", "input")
    )
    found = peak_gains(gains["F"], drive, np.vstack([gains["X"], gains["Q"]]))
    if found is None:
        return undecided("F is too close to the border of stability for a bound")
    n = len(gains["X"])
    feed = np.abs(to_float(np.vstack(direct)))
    # a constant signal of the better sign leaves at least this; two sums of floats: room for both
    low = (found[0] - feed).clip(0.0).sum(axis=1) * (1 - 1e-9)
    high = (found[1] + feed).sum(axis=1) * (1 + 1e-9)
    for bound in (low, high):
        bound[n:] /= pace
    bounds = {"state": float(high[:n].max(initial=0.0)), "input": float(high[n:].max(initial=0.0))}
    if max(bounds.values()) <= equations.LASTING:
        return proved(bounds=bounds)
    if low.max(initial=0.0) > equations.LASTING:
        entry = int(np.argmax(low))
        name = f"x{entry + 1}" if entry < n else f"d{entry - n + 1}"
        reason = (
            f"constant signals of unit size leave an error of {low[entry]:.3g} in {name} for ever; "
            f"{equations.LASTING:g} is allowed for rounding"
        )
        return refuted({"estimate": name, "error": float(low[entry]), "reason": reason})
    worst = max(bounds.values())
    return undecided(
        f"rounding of the stored matrices may leave {worst:.3g} of the signals for ever; "
        f"{equations.LASTING:g} is allowed",
        bounds=bounds,
    )
