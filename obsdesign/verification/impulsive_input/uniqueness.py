"""Is an impulse determined by its features? (17): is b(age) g = R solved by one (age, g) only?

The paper calls uniqueness likely; it is false in general. What decides here, for ages in
[margin, window], exponents lambda_1..lambda_m, and h(s) = C_j e^{D s} H g:

1. D with real spectrum. A second solution makes the integral of e^{lambda u} q(u), q piecewise a
   sum of n exponentials, vanish at m real lambda; by Descartes' rule for Laplace transforms it has
   no more zeros than q has sign changes, at most 2 n - 1, or n where h has no zero. So m >= 2 n
   suffices, m >= n + 1 if h has no zero, and m >= 2 if C_j (s I - D)^-1 H has no zero at all: then
   h is a Polya frequency function and b_i / b_j is strictly monotone.
2. Any spectrum: the plane curve (b_i, b_j) turns one way, by less than pi. Proved in balls. Among
   nonnegative weights less than 2 pi is enough: opposite directions are no longer one answer.
3. A second solution, where two or three features are all there is: `second_solution`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from lmi.arithmetic.balls import ball, exact, fixed_vector, precision, to_float
from lmi.arithmetic.exponential import exponential_grid
from lmi.prove import exponential_sign as signs
from lmi.prove.hurwitz import real_spectrum
from lmi.verdict import Verdict, proved, refuted, undecided
from obsdesign.equations.impulsive_input.features import filtered_system
from obsdesign.verification.impulsive_input.second_solution import second_solution

SOURCE = "Mattsson, Medvedev, ECC 2013, (17); Descartes' rule for Laplace transforms"
_BITS = 160
_PAIRS = 4  # pairs of features that are tried
_GRID = 200
_EFFORT = 6000  # boxes and halvings, a few seconds


def markov_parameters(D: Any, c: Any, H: Any) -> list[Any]:
    """c D^k H for k = 0..n-1, exact, each (q,)."""
    found, row = [], c
    for _ in range(len(D)):
        found.append(row @ H)
        row = row @ D
    return found


def decide_uniqueness(
    D: Any, C: Any, H: Any, exponents: Any, window: float, margin: float,
    nonnegative: bool = False,
) -> Verdict:  # fmt: skip
    """Verdict on (17) for ages in [margin, window]; D, C, H exact, exponents floats.

    nonnegative: among weights that are not negative, of one direction.
    """
    n, m, q = len(D), len(exponents), H.shape[1]
    idle = fixed_vector([H])
    if idle is not None:
        reason = f"impulses with weights {idle} do nothing: the columns of jump.H are dependent"
        return refuted({"weights": idle, "reason": reason, "of_all_gains": True})
    real = real_spectrum(D)
    if real:
        found = _by_theorem(D, C, H, m, exponents, window)
        if found is not None:
            return found
    if q > 1:
        return undecided(
            f"with {q} directions the theorem is what decides: it needs a real spectrum of A - K C "
            f"and {2 * n} exponents; got {m}"
        )
    if m * len(C) == 1:
        return _one_feature(D, C, H, exponents, window, margin)
    try:
        return _by_turning(D, C, H, exponents, window, margin, nonnegative)
    except ValueError as error:
        return undecided(str(error))


def _by_theorem(D: Any, C: Any, H: Any, m: int, exponents: Any, window: float) -> Verdict | None:
    n, q = len(D), H.shape[1]
    for j in range(len(C)):
        c = C[j : j + 1]
        moments = [entry.ravel() for entry in markov_parameters(D, c, H)]
        if q == 1:
            seen = any(entry[0] != 0 for entry in moments)
        else:
            rows = [c]
            for _ in range(n - 1):
                rows.append(rows[-1] @ D)
            seen = fixed_vector(rows) is None and fixed_vector([H]) is None
        if not seen:
            continue
        if q == 1 and m >= 2 and all(e[0] == 0 for e in moments[:-1]) and moments[-1][0] != 0:
            return proved(method="no zeros: b_i/b_j is strictly monotone", output=j + 1)
        if m >= 2 * n:
            return proved(method=f"real spectrum and {m} >= 2 n exponents", output=j + 1)
        if q == 1 and m >= n + 1 and _no_zero(D, c, H, moments, window):
            return proved(method=f"real spectrum, h without zero, {m} >= n + 1", output=j + 1)
    return None


def _no_zero(D: Any, c: Any, H: Any, moments: list[Any], window: float) -> bool:
    """h(s) = c e^{D s} H has no zero on (0, window]; h ~ s^k at 0, k its relative degree."""
    n = len(D)
    k = next(i for i, entry in enumerate(moments) if entry[0] != 0)
    sign = 1 if moments[k][0] > 0 else -1
    F = np.vstack([np.hstack([D, exact(np.zeros((n, 1)))]), np.hstack([c @ D, exact([[0.0]])])])
    z = np.vstack([H, c @ H])
    with precision(_BITS):
        try:
            for i, box in enumerate(signs.boxes(F, ball(z), 0.0, window, [n])):
                p = [sign * a for a in box.rows[0]]
                if i == 0:  # divided by s^k, exactly zero coefficients in front
                    p = p[k:]
                if signs.positive(p) is not True:
                    return False
        except ValueError:
            return False
    return True


def _one_feature(D: Any, C: Any, H: Any, exponents: Any, window: float, margin: float) -> Verdict:
    """A single feature: any two ages at which it does not vanish explain it equally well."""
    F = filtered_system(D, C, exact(exponents))
    z = np.vstack([H, exact([[0.0]])])
    for part in range(1, 12):  # close to the window the signs are the same: weights may not differ
        ages = (window, window - (window - margin) * 0.5**part)
        with precision(_BITS):
            first, second = (signs.value(F, z, age)[-1] for age in ages)
        if (first > 0 and second > 0) or (first < 0 and second < 0):
            other = float(first / second)
            reason = (
                f"one feature cannot tell two unknowns: age {ages[0]!r}, weight 1 and age "
                f"{ages[1]!r}, weight {other:.9g} leave the same; give more exponents"
            )
            return refuted({"ages": list(ages), "weights": [1.0, other], "reason": reason})
    return undecided("a single feature, and its sign is not certain")


def _by_turning(
    D: Any, C: Any, H: Any, exponents: Any, window: float, margin: float, nonnegative: bool
) -> Verdict:
    n, rows = len(D), len(exponents) * len(C)
    F = filtered_system(D, C, exact(exponents))
    z = np.vstack([H, exact(np.zeros((rows, 1)))])
    step = (window - margin) / _GRID
    # from the margin on: next to the window, steps are far shorter than the way there
    grid = exponential_grid(to_float(F), margin, step, _GRID + 1)
    b = (grid[:, n:, :n] @ to_float(H))[:, :, 0]
    pairs = list(itertools.combinations(range(rows), 2))
    pairs.sort(key=lambda pair: -_least_turn(b, *pair))
    place, stopped, effort = margin, "", signs.Effort(_EFFORT)
    with precision(_BITS):
        for i, j in pairs[:_PAIRS]:
            back = _opposite(b, i, j, margin, step) if nonnegative else None
            try:
                turns, place = _turns_one_way(F, z, n, (i, j), (margin, window), back, effort)
            except ValueError as error:
                stopped = f"{error}; "
                break
            if turns:
                angle = "pi" if back is None else "2 pi, for nonnegative weights"
                return proved(method=f"a pair of features turns one way, by less than {angle}",
                              features=[i + 1, j + 1])  # fmt: skip
        found = second_solution(F, z, n, b, window, margin, nonnegative)
        if found is not None:
            return found
    return undecided(
        f"{stopped}no pair of features was seen to turn one way for all ages; the last one tried "
        f"fails near age {place:.6g}. With a real spectrum of A - K C, {2 * n} exponents decide",
        age=place,
        **effort.ended,
    )


def _opposite(b: Any, i: int, j: int, margin: float, step: float) -> float | None:
    """Age at which (b_i, b_j) is opposite to what it is at the margin, or None; floats."""
    cross = b[0, i] * b[:, j] - b[0, j] * b[:, i]
    along = b[0, i] * b[:, i] + b[0, j] * b[:, j]
    back = np.flatnonzero((cross[1:-1] * cross[2:] < 0) & (along[1:-1] < 0))
    return None if len(back) == 0 else margin + step * (float(back[0]) + 1.5)


def _least_turn(b: Any, i: int, j: int) -> float:
    """Least turning speed of (b_i, b_j) along the grid, signed by the majority; floats."""
    size = np.hypot(b[:, i], b[:, j])
    size = np.where(size > 0, size, 1.0)
    unit = b[:, [i, j]] / size[:, None]
    turn = unit[:-1, 0] * unit[1:, 1] - unit[:-1, 1] * unit[1:, 0]
    return float(max(turn.min(), (-turn).min()))


def _turns_one_way(
    F: Any, z: Any, n: int, pair: tuple[int, int], ages: tuple[float, float], back: float | None,
    effort: signs.Effort,
) -> tuple[bool, float]:  # fmt: skip
    """b_i b_j' - b_j b_i' has one sign, and the curve never comes back to its first direction.

    back: None, or an age at which it is about opposite to it. Then it must be beside the first
    direction before, behind it around that age, and on the other side of it afterwards: so it
    turns by less than 2 pi.
    """
    margin, window = ages
    rows = [n + pair[0], n + pair[1]]
    first = signs.value(F, z, margin)
    start = [first[row] for row in rows]

    def with_rates(s: float, end: float) -> Any:
        whole, state = _with_derivatives(F, z, rows)
        return signs.boxes(whole, ball(state), s, end, list(range(4)), effort)

    def turn(box: signs.Box) -> Any:
        p, q, dp, dq = box.rows
        return signs.combined((1, signs.times(p, dq)), (-1, signs.times(q, dp)))

    def against_start(box: signs.Box) -> Any:
        return signs.combined((start[0], box.rows[1]), (-start[1], box.rows[0]))

    def behind(box: signs.Box) -> Any:
        return signs.combined((-start[0], box.rows[0]), (-start[1], box.rows[1]))

    def leaving(box: signs.Box) -> Any:
        return signs.combined((start[0], box.rows[3]), (-start[1], box.rows[2]))

    sign, place = _one_way(lambda: with_rates(margin, window), turn, effort)
    if sign == 0:
        return False, place
    near = margin + (window - margin) / 64
    leaves, place = signs.one_sign(with_rates(margin, near), leaving, sign, effort)
    if leaves is not True:
        return False, place
    parts = [(near, window, against_start, sign)]
    if back is not None:
        room = min(back - near, window - back) / 2
        if room <= 0:
            return False, place
        parts = [
            (near, back - room / 2, against_start, sign),
            (back - room, back + room, behind, 1),
            (back + room / 2, window, against_start, -sign),
        ]
    for low, high, side, wanted in parts:
        away, place = signs.one_sign(with_rates(low, high), side, wanted, effort)
        if away is not True:
            return False, place
    return True, place


def _one_way(
    cover: Callable[[], Iterator[signs.Box]], turn: Any, effort: signs.Effort
) -> tuple[int, float]:
    """(the sign that `turn` has on all boxes, 0 if it has none, where that was not seen)."""
    place = math.nan
    for sign in (1, -1):  # boxes are used up by being looked at: new ones for each sign
        found, place = signs.one_sign(cover(), turn, sign, effort)
        if found is True:
            return sign, place
    return 0, place


def _with_derivatives(F: Any, z: Any, rows: list[int]) -> tuple[Any, Any]:
    """A system whose first four entries are b_i, b_j and their derivatives, then the old one."""
    N = len(F)
    picked = np.vstack([F[rows[0] : rows[0] + 1], F[rows[1] : rows[1] + 1]])
    top = np.vstack([picked, picked @ F])
    whole = np.hstack([np.vstack([exact(np.zeros((4, 4))), exact(np.zeros((N, 4)))]),
                       np.vstack([top, F])])  # fmt: skip
    start = np.vstack([z[rows[0] : rows[0] + 1], z[rows[1] : rows[1] + 1], picked @ z, z])
    return whole, start
