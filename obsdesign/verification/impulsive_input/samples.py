"""Claims of the discrete operator: N samples after an onset, and what they determine.

With samples t_o + h, ..., t_o + N h, an impulse at t_o + v, 0 <= v < h, leaves
M e^{-A v} H g, M = [C e^{A h}; ...; C e^{A N h}]. If M has rank n and e^{A t} has no other
eigenvectors than A for 0 < t < h (no aliasing), (v, g) is determined if and only if H is not an
eigenvector of A: otherwise every v explains the samples equally well.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from lmi.arithmetic.balls import ball, exact, exp_times, rational, to_float
from lmi.prove.hurwitz import exactly_schur, prove_hurwitz, real_spectrum
from lmi.verdict import Verdict, proved, refuted, undecided
from obsdesign.document import Claim
from obsdesign.equations.estimation_error import flow_error_matrix
from obsdesign.equations.impulsive_input import features as equations
from obsdesign.verification.impulsive_input.rank import rank_verdict

_FEWEST_CELLS = 3  # of a window: two samples after an onset that is most of the window old
_MOST_ROWS = 64  # of a window that are looked at
SOURCE = "Mattsson, Medvedev, ECC 2013, Section III-B, for samples"


def sampled_claims(A: Any, C: Any, H: Any, gains: Mapping[str, Any]) -> tuple[Claim, ...]:
    """Rank of the samples of a window, and uniqueness of an onset in its first interval."""
    h, window = float(gains["period"]), float(gains["window"])
    count = round(window / h)

    rank = _rank(A, C, h, count, first=1)
    onset = _uniqueness(A, H, h)
    return (
        Claim(
            "rank",
            f"the {count} samples of a window determine the error of the state",
            SOURCE,
            rank.outcome,
            rank.evidence,
        ),
        Claim(
            "uniqueness",
            "without noise the samples of a window determine time and weight of an impulse in its "
            "first interval",
            SOURCE,
            onset.outcome,
            onset.evidence,
        ),
    )


def window_samples(
    A: Any, C: Any, directions: int, gains: Mapping[str, Any], shortest: float
) -> Claim:
    """Operator `integral`: a window holds samples enough for a state, an onset and its weights.

    And two periods fit between the window and the shortest dwell time: the last sample of a window
    comes up to a period after its end, t_o is a sample too, and an impulse after that must still
    be before its peak when the next search begins. Modes of A - K C and exponents are slow enough
    for the period (`equations.impulsive_input.longest_period`), exactly.
    """
    n, p = len(A), len(C)
    period, window = float(gains["period"]), float(gains["window"])
    D = flow_error_matrix(A, exact(gains["K"]), C)
    cells = math.floor(window / period * (1 + 1e-9))
    unknown = n + 1 + directions
    statement = f"the samples of a window show the state, and time and weight of an impulse: {n}"
    statement += f" + {1 + directions} unknown numbers, two samples after the onset, and no sample "
    statement += "of another impulse; they are close enough for A - K C and the exponents"
    if cells < 2:
        reason = (
            f"output.period = {period!r} leaves {cells + 1} sample{'s' * (cells > 0)} in a window "
            f"of {window!r}: two after an onset are needed"
        )
        verdict = refuted({"samples": cells + 1, "reason": reason})
    elif (cells + 1) * p < unknown or cells < _FEWEST_CELLS:
        verdict = undecided(
            f"{cells + 1} samples in a window are too few to be certain: {unknown} numbers are "
            f"unknown, and {_FEWEST_CELLS + 1} samples are asked for at least (fewer do where the "
            "state is known from before, which nothing here proves); choose operator 'samples' "
            "(with output.noise_std), or a longer window",
            samples=cells + 1,
        )
    elif rational(window) + 2 * rational(period) > rational(shortest):
        verdict = undecided(
            f"the window {window!r} and two periods of {period!r} exceed the shortest dwell time "
            f"{shortest!r}: the sample that ends a window may show the next impulse, which may be "
            "past its peak when its search begins; choose a shorter window",
            samples=cells + 1,
        )
    else:
        fast = _too_fast(D, gains)
        verdict = _rank(A, C, period, cells) if fast is None else fast
    verdict = replace(verdict, evidence={**verdict.evidence, **_speeds(D, gains)})
    return Claim("samples", statement, SOURCE, verdict.outcome, verdict.evidence)


def _speeds(D: Any, gains: Mapping[str, Any]) -> dict[str, float]:
    """The fastest mode of A - K C and the largest exponent, times the period; floats."""
    period, modes = float(gains["period"]), np.linalg.eigvals(to_float(D))
    exponents = np.asarray(gains["exponents"], float)
    return {
        "approx_mode_times_period": float(np.abs(modes).max()) * period,
        "approx_exponent_times_period": float(np.abs(exponents).max()) * period,
    }


def _too_fast(D: Any, gains: Mapping[str, Any]) -> Verdict | None:
    """Undecided where integrals of samples cannot follow, with a period that would do; or None."""
    period, window = float(gains["period"]), float(gains["window"])
    # every mode decays by more than LONG time constants within the window
    faster = D + exact(np.eye(len(D))) * (rational(equations.LONG) / rational(window))
    long = prove_hurwitz(faster).outcome == "proved"
    limit = equations.fastest_limit(long)
    speeds, reasons = _speeds(D, gains), []
    if not exactly_schur(D * (rational(period) / rational(limit))):
        which = f" in a window of more than {equations.LONG:g} time constants" if long else ""
        reasons.append(
            f"the fastest mode of A - K C times the period is "
            f"{speeds['approx_mode_times_period']:.3g}, not below {limit:g}{which}"
        )
    steepest = speeds["approx_exponent_times_period"]
    if steepest > equations.STEEPEST:
        reasons.append(
            f"the largest exponent times the period is {steepest:.3g}, above {equations.STEEPEST:g}"
        )
    if not reasons:
        return None
    exponents = np.asarray(gains["exponents"], float)
    enough = equations.rounded_down(equations.longest_period(to_float(D), exponents, window))
    return undecided(
        f"{'; '.join(reasons)}: integrals of samples may miss impulses. An output.period of at "
        f"most {enough:g} would do, or operator 'samples' (with output.noise_std)",
        period=enough,
    )


def _rank(A: Any, C: Any, period: float, cells: int, first: int = 0) -> Verdict:
    """Of many samples some, evenly spaced, are enough: more do not lower a rank.

    Samples `first` .. `cells` of a window; where some do not do, nothing follows for all.
    """
    every = cells // min(cells, _MOST_ROWS)
    found = _rank_of(A, C, period * every, first, min(cells, _MOST_ROWS))
    if found.outcome != "proved" and every * _MOST_ROWS < cells:  # they end before the window does
        every += 1
        wider = _rank_of(A, C, period * every, first, cells // every)
        found = wider if wider.outcome == "proved" else found
    count = min(cells, _MOST_ROWS)
    if found.outcome == "refuted" and count < cells:
        return undecided(
            f"{count} of the {cells} samples of a window do not determine the state: change the "
            "window or the period"
        )
    return found


def _rank_of(A: Any, C: Any, step: float, first: int, count: int) -> Verdict:
    """Rank of samples first .. count, `step` apart."""
    rows = _sampled_rows(A, C, step, first, count)
    sizes = np.tile(np.linalg.norm(to_float(C), axis=1), count + 1 - first)
    return rank_verdict(rows, sizes, len(A), "the samples of a window")


def _sampled_rows(
    A: Any, C: Any, step: float, first: int, count: int
) -> Callable[[], list[list[Any]]]:
    """Function of no arguments: rows C e^{A k step}, k = first .. count, as balls."""

    def rows() -> list[list[Any]]:
        forward = exp_times(A, step)
        at = ball(C)
        found: list[list[Any]] = []
        for k in range(count + 1):
            if k >= first:
                found += at.tolist()
            at = at * forward
        return found

    return rows


def _uniqueness(A: Any, H: Any, h: float) -> Verdict:
    along = A @ H
    k = next((i for i in range(len(H)) if H[i, 0] != 0), None)
    if k is None:
        reason = "jump.H is zero: impulses do nothing"
        return refuted({"vector": [0.0] * len(H), "reason": reason, "of_all_gains": True})
    rate = along[k, 0] / H[k, 0]
    if all(along[i, 0] == rate * H[i, 0] for i in range(len(H))):
        mode = float(rate.p) / float(rate.q)
        reason = (
            f"jump.H is an eigenvector of flow.A (eigenvalue {mode:.6g}): impulses at any two "
            "times between two samples leave the same samples, so that only the interval is known"
        )
        return refuted({"eigenvalue": mode, "onsets": [0.0, h / 2], "reason": reason})
    if real_spectrum(A):
        return proved(method="jump.H is no eigenvector of flow.A, whose spectrum is real")
    skew = (A - A.T) * exact(np.array(0.5)).item()
    turning = max(sum(abs(x) for x in row) for row in skew.tolist())
    if turning * exact(np.array(h)).item() < 3:  # |Im mu| h < pi: logarithms are unique
        return proved(method="jump.H is no eigenvector of flow.A, and no mode turns by pi")
    return undecided("modes of flow.A may turn by more than half a circle between two samples")
