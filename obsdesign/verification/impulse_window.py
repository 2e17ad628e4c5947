"""Claims about the window and the features of an observer for impulsive inputs, one by one."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from lmi.balls import (
    PRECISIONS,
    ball,
    ball_column,
    certify_pivots,
    characteristic_polynomial,
    exact,
    exp_times,
    fixed_vector,
    number,
    precision,
    rational,
    to_float,
)
from lmi.exponential import exponential_grid
from lmi.hurwitz import prove_hurwitz
from lmi.verdict import Verdict, proved, refuted, undecided
from obsdesign.document import Claim
from obsdesign.verification import exponential_sign as signs

PAPER = "Mattsson, Medvedev, ECC 2013"
# rank is decided relative to size: smallest singular value of W, rows and columns scaled to one
RANK_TOLERANCE = 1e-10


def observable(A: Any, C: Any) -> Claim:
    """(A, C) is observable, exactly; the witness is a direction that no output ever sees."""
    rows = [C]
    for _ in range(len(A) - 1):
        rows.append(rows[-1] @ A)
    hidden = fixed_vector(rows)
    verdict = proved(method="rank of [C; C A; ...], exact")
    if hidden is not None:
        reason = f"the output never sees the direction {_shown(hidden)} of the state"
        verdict = refuted({"vector": hidden, "reason": reason})
    return _claim("observable", "the output sees every direction of the state",
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
    return _claim("window", f"a window of length {window!r} holds one impulse at most",
                  f"{PAPER}, Section III", verdict)  # fmt: skip


def hurwitz(D: Any) -> Claim:
    """The error decays between impulses."""
    return _claim("hurwitz", "the error between impulses decays: A - K C is Hurwitz",
                  f"{PAPER}, Section III", prove_hurwitz(D))  # fmt: skip


def enough_exponents(D: Any, C: Any, exponents: list[float]) -> Claim:
    """(12): m p >= n, and no exponent is an eigenvalue of D; both exactly."""
    n, count = len(D), len(exponents) * len(C)
    statement = (
        "there are as many features as states or more, and no exponent is an eigenvalue of A - K C"
    )
    verdict = proved(features=count, states=n)
    if count < n:
        reason = f"{count} features (exponents times outputs) cannot show {n} states"
        verdict = refuted({"features": count, "states": n, "reason": reason})
    else:
        polynomial = characteristic_polynomial(D)
        for lam in exponents:
            at = rational(lam)
            value = 0 * at
            for coefficient in reversed(polynomial):
                value = value * at + coefficient
            if value == 0:
                reason = f"the exponent {lam!r} is an eigenvalue of A - K C"
                verdict = refuted({"exponent": lam, "reason": reason})
                break
    return _claim("exponents", statement, f"{PAPER}, (12)", verdict)


def full_rank(D: Any, C: Any, exponents: list[float], window: float) -> Claim:
    """W(tau) has rank n; (12) is not enough for this where the spectrum of D is complex."""
    statement = (
        "the features of a window determine the error of the state: W(tau) has rank n, its "
        f"smallest singular value at least {RANK_TOLERANCE!r} of the largest when scaled"
    )
    rows = _operator_ball(D, C, exponents, window)
    verdict = rank_verdict(rows, _row_sizes(D, C, exponents, window), len(D), "the features")
    return _claim("rank", statement, f"{PAPER}, Section III-B", verdict)


def _operator_ball(D: Any, C: Any, exponents: list[float], window: float) -> Any:
    """Function of no arguments: rows of W(tau) as balls at the precision in force."""

    def rows() -> list[list[Any]]:
        n = len(D)
        zero, unit = exact(np.zeros((n, n))), exact(np.eye(n))
        found = []
        for row in range(len(C)):
            for lam in exponents:
                F = np.block([[exact(lam * np.eye(n)) - D, unit], [zero, zero]])
                pick = np.hstack([C[row : row + 1], exact(np.zeros((1, n)))])
                whole = ball(pick) * exp_times(F, window)
                found.append(whole.tolist()[0][n:])
        return found

    return rows


def _row_sizes(D: Any, C: Any, exponents: list[float], window: float) -> Any:
    """Size of each row of W if nothing in its integral cancelled; floats, to scale by."""
    D_float, C_float, count = to_float(D), to_float(C), 64
    found = []
    for lam in exponents:
        grid = exponential_grid(lam * np.eye(len(D)) - D_float, 0.0, window / count, count + 1)
        found.append(np.abs(C_float @ grid).mean(axis=0).max(axis=1) * window)
    return np.array(found).T.reshape(-1)  # output by output


def rank_verdict(rows: Callable[[], list[list[Any]]], row_sizes: Any, n: int, what: str) -> Verdict:
    """n columns of balls are independent, relative to RANK_TOLERANCE; refuted with a vector.

    row_sizes: natural size of each row; rows are divided by them, columns by their own size.
    """
    margin = math.nan
    for bits in PRECISIONS:
        with precision(bits):
            table = rows()
            W = np.array([[float(x.mid()) for x in row] for row in table])
            if not (np.isfinite(W).all() and np.isfinite(row_sizes).all()):
                return undecided("W(tau) overflows: exponents times window are too large")
            if all(x == 0 for row in table for x in row):
                reason = f"{what} are zero: they show nothing of the state"
                return refuted({"vector": [1.0] + [0.0] * (n - 1), "reason": reason})
            row_scale = _powers(np.asarray(row_sizes))
            scaled = W / row_scale[:, None]
            column_scale = _powers(np.linalg.norm(scaled, axis=0))
            scaled = scaled / column_scale
            sizes = np.linalg.svd(scaled, compute_uv=False)
            margin = float(sizes[-1] / sizes[0]) if sizes[0] > 0 and len(W) >= n else 0.0
            balls = [
                [
                    x / number(float(a)) / number(float(b))
                    for x, b in zip(row, column_scale, strict=True)
                ]
                for row, a in zip(table, row_scale, strict=True)
            ]
            gram = [[_dot(balls, i, j) for j in range(i + 1)] for i in range(n)]
            total = sum((gram[i][i] for i in range(n)), number(0.0))
            least = number(RANK_TOLERANCE) ** 2 * total  # trace >= largest singular value squared
            for i in range(n):
                gram[i][i] = gram[i][i] - least
            if certify_pivots(gram):
                return proved(approx_margin=margin, tolerance=RANK_TOLERANCE)
            vector = np.linalg.svd(scaled)[2][-1]
            v = [number(float(x)) for x in vector]
            through = [
                sum((a * b for a, b in zip(row, v, strict=True)), number(0.0)) for row in balls
            ]
            seen = sum((x * x for x in through), number(0.0))
            size = sum((x * x for x in v), number(0.0))
            # the largest singular value squared is at least trace / n
            if seen < number(RANK_TOLERANCE) ** 2 * (total / n) * size:
                direction = (vector / column_scale).tolist()
                reason = (
                    f"{what} hardly show the direction {_shown(direction)} of the state: "
                    f"relative size {margin:.3g}, below {RANK_TOLERANCE:g}; change the window"
                )
                return refuted({"vector": direction, "approx_margin": margin, "reason": reason})
    return undecided(f"the rank is not certain: relative margin {margin:.3g}", approx_margin=margin)


def _powers(sizes: Any) -> Any:
    with np.errstate(divide="ignore"):
        exponents = np.where(sizes > 0, np.round(np.log2(np.where(sizes > 0, sizes, 1.0))), 0.0)
    return np.ldexp(1.0, exponents.astype(int))


def _dot(rows: list[list[Any]], i: int, j: int) -> Any:
    return sum((row[i] * row[j] for row in rows), number(0.0))


def ratio(
    D: Any, C: Any, H: Any, exponents: list[float], window: float, margin: float, asked: float
) -> Claim:
    """|E_i| <= ratio |b_i| for every feature, direction and age in [margin, window] (Prop. 3.2).

    f = ratio b_i +- E_i is one entry of [z; f]' = [D z; lambda f + C z] by the age s, with
    z = ratio e^{D s} H -+ e^{lambda tau} e^{D (s - tau)} H; it must keep the sign of b_i.
    """
    statement = (
        f"what (15) neglects of an impulse is at most {asked!r} of its feature, for every feature "
        f"and every age in [{margin!r}, {window!r}]"
    )
    verdict = proved(ratio=asked)
    try:
        for j in range(len(C)):
            for k in range(H.shape[1]):
                for lam in exponents:
                    found = _ratio(D, C[j : j + 1], H[:, k : k + 1], lam, window, margin, asked)
                    if found is not None:
                        verdict = found
                        raise StopIteration
    except StopIteration:
        pass
    except ValueError as error:
        verdict = undecided(str(error))
    return _claim("ratio", statement, f"{PAPER}, Proposition 3.2", verdict)


def _ratio(
    D: Any, c: Any, h: Any, lam: float, window: float, margin: float, asked: float
) -> Verdict | None:
    """None: proved for one feature; else why not."""
    n = len(D)
    F = np.vstack([np.hstack([D, exact(np.zeros((n, 1)))]), np.hstack([c, exact([[lam]])])])
    rest = np.vstack([h, exact([[0.0]])])
    with precision(PRECISIONS[-1]):
        at_margin = exp_times(F, margin) * ball(rest)  # [e^{D eps} h; b(eps)]
        far = exp_times(D, margin - window) * ball(h)  # e^{D (eps - tau)} h
        growth = (number(lam) * number(window)).exp()
        # E(eps) = e^{lam eps} c int_0^{tau - eps} e^{(lam - D) u} du h
        shifted = exact(lam * np.eye(n)) - D
        inner = np.block([[shifted, exact(np.eye(n))], [exact(np.zeros((n, 2 * n)))]])
        pick = ball(np.hstack([c, exact(np.zeros((1, n)))])) * exp_times(inner, window - margin)
        tail = pick.tolist()[0][n:]
        column = [x[0] for x in ball(h).tolist()]
        left = sum((a * b for a, b in zip(tail, column, strict=True)), number(0.0))
        E = left * (number(lam) * number(margin)).exp()
        b = at_margin.tolist()[n][0]
        if not (b > 0 or b < 0):
            return undecided(f"the sign of a feature at age {margin!r} is not certain")
        sign = 1 if b > 0 else -1
        state = [row[0] for row in at_margin.tolist()[:n]]
        back = [row[0] for row in far.tolist()]
        for side in (1, -1):
            z = [number(asked) * x - side * growth * y for x, y in zip(state, back, strict=True)]
            f = number(asked) * b + side * E
            cover = signs.boxes(F, ball_column([*z, f]), 0.0, window - margin, [n])
            found, place = signs.one_sign(cover, lambda box: box.rows[0], sign)
            if found is True:
                continue
            age = margin + place
            if found is False:
                reason = (
                    f"exponent {lam!r}: near age {age:.6g} the neglected part exceeds {asked!r} "
                    "of the feature (where the impulse response changes sign a feature has a zero)"
                )
                return refuted({"age": age, "exponent": lam, "reason": reason})
            return undecided(f"exponent {lam!r}, near age {age:.6g}", age=age)
    return None


def _shown(vector: Any) -> str:
    largest = max((abs(x) for x in vector), default=1.0) or 1.0
    return "[" + ", ".join(f"{x / largest:.4g}" for x in vector) + "]"


def _claim(name: str, statement: str, source: str, verdict: Verdict) -> Claim:
    return Claim(name, statement, source, verdict.outcome, verdict.evidence)
