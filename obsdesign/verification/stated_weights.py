"""The claim that a gain is that of a Kalman filter with the weights that a problem states."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from lmi.arithmetic.arrays import Array, Matrix
from lmi.arithmetic.balls import (
    Exact,
    ball,
    certify_positive_definite,
    exact,
    precision,
    rational,
    to_float,
)
from lmi.verdict import Verdict, proved, refuted, undecided
from obsdesign.analysis.balancing import balancing_units
from obsdesign.document import Claim

ID = "weights"

# distance from the gain of the weights, in parts of standard deviations, that counts as none
TOLERANCE = 1e-6
# relative errors of the covariance for which its enclosure is tried
_ENCLOSURES = (1e-12, 1e-9, TOLERANCE / 10)
_BITS = 256


def weights_claim(
    A: Matrix,
    C: Matrix,
    L: Array,
    weights: Mapping[str, Sequence[float]],
    shifts: Sequence[float],
    *,
    letter: str = "L",
) -> Claim:
    """Claim that L (n, p) solves the Riccati equation of A + a I for an a of `shifts`.

    With S the covariance that L itself leaves of the error, for variances Q of b and R of v, L is
    optimal if and only if L = S C' R^-1: no solution of the equation is needed.
    """
    variances = (
        np.asarray(weights.get("state", np.ones(len(A))), dtype=np.float64),
        np.asarray(weights.get("output", np.ones(len(C))), dtype=np.float64),
    )
    verdicts = [_optimal(A, C, L, variances, shift) for shift in shifts]
    order = ("proved", "refuted", "undecided")
    best = min(verdicts, key=lambda verdict: order.index(verdict.outcome))
    return Claim.from_verdict(
        ID,
        f"{letter} is the gain of the Kalman filter of A + a I with the stated weights, a that of "
        f"the evidence: {letter} = S C' R^-1 up to {TOLERANCE:g} of standard deviations, S the "
        f"covariance of the error under {letter}",
        "Riccati equation; Lyapunov's theorem",
        best,
    )


def _optimal(
    A: Matrix, C: Matrix, L: Array, variances: tuple[Array, Array], shift: float
) -> Verdict:
    """Decide L = S C' R^-1, S the covariance of the error of A + shift I under L."""
    Q, R = (exact(np.diag(values)) for values in variances)
    F = exact(A) + rational(shift) * exact(np.eye(len(A))) - exact(L) @ exact(C)
    W = Q + exact(L) @ R @ exact(L).T
    S = _covariance(F, W, balancing_units(A, C, np.zeros((len(A), 0)))[0])
    error = None if S is None else _relative_error(F, W, S)
    if S is None or error is None:
        return undecided(f"the covariance for a = {shift!r} could not be enclosed", shift=shift)
    gap = exact(L) @ R - S @ exact(C).T
    of_output = to_float((exact(C) @ S * exact(C)).sum(axis=1))
    # |S_ij - true| <= error sqrt(S_ii S_jj), of standard deviations of states and outputs
    deviations = np.sqrt(np.outer(to_float(np.diag(S)), of_output))
    of_states = np.sqrt(to_float(np.diag(S)))
    room = error * np.outer(of_states, np.abs(C) @ of_states) * (1 + 1e-9)
    distances = np.abs(to_float(gap))
    if np.all(distances + room <= TOLERANCE * deviations * (1 - 1e-9)):
        return proved(shift=shift)
    i, j = np.unravel_index(np.argmax(distances / np.maximum(deviations, 1e-300)), gap.shape)
    relative = float(distances[i, j] / max(deviations[i, j], 1e-300))
    text = (
        f"the gain is not that of the stated weights: entry ({i + 1}, {j + 1}) is off by "
        f"{relative:.3g} of standard deviations"
    )
    if np.any(distances - room > TOLERANCE * deviations * (1 + 1e-9)):
        return refuted({"relative": relative, "reason": text}, shift=shift)
    return undecided(text, shift=shift)


def _covariance(F: Exact, W: Exact, sizes: Array) -> Exact | None:
    """S with F S + S F' = -W nearly, in floats and refined; sizes: units of the states."""
    from scipy.linalg import solve_continuous_lyapunov

    units = exact(sizes)
    flow = to_float(F * units / units[:, None])
    if not np.linalg.eigvals(flow).real.max() < 0:
        return None
    S, residual = exact(np.zeros(F.shape)), W
    for _ in range(3):
        scaled = to_float(residual / units / units[:, None])
        with np.errstate(all="ignore"):
            step = solve_continuous_lyapunov(flow, -scaled)
        if not np.isfinite(step).all():
            return None
        S = S + exact((step + step.T) / 2) * units * units[:, None]
        residual = W + F @ S + S @ F.T
    return S


def _relative_error(F: Exact, W: Exact, S: Exact) -> float | None:
    """e with (1 - e) S* <= S <= (1 + e) S* for F S* + S* F' = -W, F Hurwitz; None if none shows.

    With E = W + F S + S F', -e W <= E <= e W says so, since S* grows with W.
    """
    E = W + F @ S + S @ F.T
    with precision(_BITS):
        if not (certify_positive_definite(ball(S)) and certify_positive_definite(ball(W - E))):
            return None
        for size in _ENCLOSURES:
            room = rational(size) * W
            if all(certify_positive_definite(ball(room + sign * E)) for sign in (1, -1)):
                return math.nextafter(size / (1 - size), math.inf)
    return None
