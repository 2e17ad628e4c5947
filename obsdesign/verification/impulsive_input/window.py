"""Claims about the window and the features of an observer of unknown impulses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lmi.arithmetic.balls import (
    PRECISIONS,
    Ball,
    Exact,
    Rational,
    ball,
    ball_column,
    characteristic_polynomial,
    exact,
    exp_times,
    fixed_vector,
    nearest_float,
    number,
    precision,
    rational,
)
from lmi.prove import exponential_sign as signs
from lmi.prove.hurwitz import prove_hurwitz
from lmi.verdict import Verdict, proved, refuted, undecided
from obsdesign.column_names import combination
from obsdesign.document import Claim
from obsdesign.equations.impulsive_input.features import FeatureWindow
from obsdesign.verification.impulsive_input.directions import ratio_of_weights
from obsdesign.verification.impulsive_input.witnesses import TooFewFeatures

PAPER = "Mattsson, Medvedev, ECC 2013"


def observable(A: Exact, C: Exact, names: Sequence[str]) -> Claim:
    """(A, C) is observable, exactly; the witness is an unobservable direction.

    names (n): of the states.
    """
    rows = [C]
    for _ in range(len(A) - 1):
        rows.append(rows[-1] @ A)
    hidden = fixed_vector(rows)
    verdict = proved(method="rank of [C; C A; ...], exact")
    if hidden is not None:
        reason = f"no output shows the direction {combination(hidden, names)} of the state"
        verdict = refuted({"vector": hidden, "reason": reason})
    return Claim.from_verdict("observable", "the output sees every direction of the state",
                  f"{PAPER}, Section II", verdict)  # fmt: skip


def dwell(window: float, shortest: float) -> Claim:
    """The window is shorter than the shortest dwell time: it holds one impulse at most."""
    if window < shortest:
        verdict = proved(window=window, shortest=shortest)
    else:
        reason = (
            f"the window {window!r} is not below the shortest dwell time {shortest!r}: impulses at "
            f"t = 0 and t = {shortest!r} would share one window"
        )
        verdict = refuted({"times": [0.0, shortest], "window": window, "reason": reason})
    return Claim.from_verdict("window", f"a window of length {window!r} holds one impulse at most",
                  f"{PAPER}, Section III", verdict)  # fmt: skip


def hurwitz(D: Exact) -> Claim:
    """The error decays between impulses."""
    return Claim.from_verdict("hurwitz", "the error between impulses decays: A - K C is Hurwitz",
                  f"{PAPER}, Section III", prove_hurwitz(D))  # fmt: skip


def enough_exponents(D: Exact, C: Exact, exponents: list[float]) -> Claim:
    """(12): m p >= n, and no exponent is an eigenvalue of D; both exactly."""
    n, count = len(D), len(exponents) * len(C)
    statement = (
        "there are as many features as states or more, and no exponent is an eigenvalue of A - K C"
    )
    verdict = proved(features=count, states=n)
    if count < n:
        reason = f"{count} features (exponents times outputs) cannot show {n} states"
        verdict = refuted(TooFewFeatures(count, n, reason).to_dict())
    else:
        polynomial = characteristic_polynomial(D)
        for lam in exponents:
            at = rational(lam)
            value = 0 * at
            for coefficient in reversed(polynomial):
                value = value * at + coefficient
            if value == 0:
                reason = f"the exponent {float(lam)!r} is an eigenvalue of A - K C"
                verdict = refuted({"exponent": lam, "reason": reason})
                break
    return Claim.from_verdict("exponents", statement, f"{PAPER}, (12)", verdict)


def ratio(window: FeatureWindow, bound: float) -> Claim:
    """|E_i| <= ratio |b_i| for every feature and age in [margin, window] (Prop. 3.2).

    f = ratio b_i +- E_i is one entry of [z; f]' = [D z; lambda f + C z] by the age s, with
    z = ratio e^{D s} H -+ e^{lambda tau} e^{D (s - tau)} H; it must keep the sign of b_i.

    With several columns of H a feature vanishes for some weights: |E g| <= ratio |b g| for all g.
    """
    several = window.H.shape[1] > 1
    kept = (
        "features in Euclidean norm, for all weights" if several else "feature, for every feature"
    )
    statement = (
        f"what (15) neglects of an impulse is at most {bound!r} of its {kept} "
        f"and every age in [{window.margin!r}, {window.tau!r}]"
    )
    try:
        verdict = (ratio_of_weights if several else _ratio_by_feature)(window, bound)
    except ValueError as error:
        verdict = undecided(str(error))
    return Claim.from_verdict("ratio", statement, f"{PAPER}, Proposition 3.2", verdict)


def _ratio_by_feature(window: FeatureWindow, bound: float) -> Verdict:
    """Verdict on the features of a window with one column of H, each by itself."""
    outputs = (replace(window, C=window.C[j : j + 1]) for j in range(len(window.C)))
    obstacles = (_obstacle(part, lam, bound) for part in outputs for lam in part.exponents)
    return next((each for each in obstacles if each is not None), proved(ratio=bound))


def _obstacle(part: FeatureWindow, lam: float, bound: float) -> Verdict | None:
    """Verdict for one feature that is not proved to keep the ratio; None where it is."""
    D, h, tau, margin = part.D, part.H, part.tau, part.margin
    n, length = len(D), rational(tau) - rational(margin)
    with precision(PRECISIONS[-1]):
        F, at_margin, E = _feature(part, lam, margin)
        far = exp_times(D, -length) * ball(h)  # e^{D (eps - tau)} h
        growth = (number(lam) * number(tau)).exp()
        b = at_margin[n]
        if not (b > 0 or b < 0):
            return undecided(f"the sign of a feature at age {margin!r} is not certain")
        sign = 1 if b > 0 else -1
        back = [row[0] for row in far.tolist()]
        for side in (1, -1):
            z = [number(bound) * x - side * growth * y
                 for x, y in zip(at_margin[:n], back, strict=True)]  # fmt: skip
            f = number(bound) * b + side * E
            end = math.nextafter(nearest_float(length), math.inf)
            cover = signs.boxes(F, ball_column([*z, f]), 0.0, end, [n])
            holds, place = signs.one_sign(cover, lambda box: box.rows[0], sign)
            if holds is True:
                continue
            age = min(margin + place, tau)
            violation = _violation(part, lam, bound, sign, age) if holds is False else None
            if violation is not None:
                age = violation
                reason = (
                    f"exponent {float(lam)!r}: at age {age!r} the neglected part exceeds "
                    f"{bound!r} of the feature (where the impulse response changes sign a feature "
                    "has a zero)"
                )
                return refuted({"age": age, "exponent": float(lam), "reason": reason})
            return undecided(f"exponent {float(lam)!r}, near age {age:.6g}", age=age)
    return None


def _violation(
    part: FeatureWindow, lam: float, bound: float, sign: int, age: float
) -> float | None:
    """An age up to this one at which |E| > bound |b|, certainly; None where none was met.

    sign: of b at the margin. Where b has the other sign at an age, it has a zero before, near
    which any E that is not zero exceeds the bound.
    """
    low, high = part.margin, age
    while True:
        _, state, E = _feature(part, lam, age)
        if abs(E) > number(bound) * abs(state[-1]):
            return age
        low, high = (age, high) if sign * state[-1] > 0 else (low, age)
        age = (low + high) / 2
        if not low < age < high:
            return None


def _feature(part: FeatureWindow, lam: float, age: float) -> tuple[Exact, list[Ball], Ball]:
    """(F of [z; b]' = F [z; b], [e^{D s} h; b] at age s, E there), at the precision in force."""
    D, c, h = part.D, part.C, part.H
    n = len(D)
    F = np.vstack([np.hstack([D, exact(np.zeros((n, 1)))]), np.hstack([c, exact([[lam]])])])
    state = exp_times(F, age) * ball(np.vstack([h, exact([[0.0]])]))
    # E(s) = e^{lam s} c int_0^{tau - s} e^{(lam - D) u} du h
    left = _inner(D, c, h, lam, rational(part.tau) - rational(age))
    return F, [row[0] for row in state.tolist()], left * (number(lam) * number(age)).exp()


def _inner(D: Exact, c: Exact, h: Exact, lam: float, length: Rational) -> Ball:
    """Ball of c int_0^length e^{(lam - D) u} du h."""
    n = len(D)
    shifted = exact(np.eye(n)) * rational(lam) - D
    inner = np.block([[shifted, exact(np.eye(n))], [exact(np.zeros((n, 2 * n)))]])
    pick = ball(np.hstack([c, exact(np.zeros((1, n)))])) * exp_times(inner, length)
    tail, column = pick.tolist()[0][n:], [x[0] for x in ball(h).tolist()]
    return sum((a * b for a, b in zip(tail, column, strict=True)), number(0.0))


def shown(vector: Sequence[float]) -> str:
    """A direction as people read it, its largest entry 1."""
    largest = max((abs(x) for x in vector), default=1.0) or 1.0
    return "[" + ", ".join(f"{x / largest:.4g}" for x in vector) + "]"
