"""Interval observers for linear impulsive systems: the formulas.

    x'(t) = A x + B u + b(t)          between jumps,   lower <= b <= upper
    x(t)  = G x(t-) + E w + c         at jumps,        lower <= c <= upper
    y     = C x + v,                  |v_i(t)| <= V_i at every instant

Source: K. H. Degue, D. Efimov, J.-P. Richard, Interval Observers for Linear Impulsive Systems,
NOLCOS 2016: observers (6) (Theorem 5) and (11) (Theorem 8). Deviations from the print, with
reasons in docs/papers.md: the measurement used at a jump is the pre-jump one (the print says
post-jump, which breaks the enclosure); J of (10) has second row [n, p]; stability is tested on
the n-dimensional pair (D0 + D1, p + n), which is equivalent to (10) and cheaper.

Notation
    flow_error_matrix   F = A - L C                  n x n
    jump_error_matrix   H = G - M C  (pre-jump y), (I - M C) G  (post-jump y), G (no y)   n x n
    D0, D1              F = D0 - D1, D0 Metzler, D1 >= 0
    Gp, Gn              H = Gp - Gn, Gp >= 0, Gn >= 0
    width pair          (W, N): w' = W w + ...,  w+ = N w- + ...  for the width w = upper - lower
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lmi.exponential import expm
from obsdesign.equations.estimation_error import jump_disturbance_matrix

Array = NDArray[Any]  # float64, or object arrays of exact rationals

FORMS = ("cooperative", "split")


def objection(plant: Any, gains: Any, options: Any) -> str | None:
    """What forbids an interval observer of this version for a plant, or None; one sentence.

    `gains` and `options` are those of the problem file. Anything that moves the state without
    bounds, and any request that would not be honoured.
    """
    if plant.flow.D is not None:
        return (
            "flow.D is refused by kind 'interval': an unknown input without bounds leaves no "
            "bounds on the state. Give bounds as flow.disturbance."
        )
    if plant.jump is not None and plant.jump.H is not None:
        return (
            "jump.H is refused by kind 'interval': impulses of unknown weight leave no bounds "
            "on the state. Give bounds as jump.disturbance."
        )
    form = options.get("form", "auto")
    if form not in (*FORMS, "auto"):
        return (
            f"observer.form = {form!r} is not available in this version; it must be one of "
            f"{', '.join(FORMS)} or auto."
        )
    for name in ("S", "S2", "T"):
        if name in gains:
            return (
                f"observer.gains.{name} belongs to forms that are not available in this version; "
                f"the forms are {', '.join(FORMS)}."
            )
    for name in ("objective", "gain_limit"):
        if options.get(name) not in (None, "feasible"):
            return f"observer.{name} = {options[name]!r} is not available in this version."
    return None


def positive_part(X: Array) -> Array:
    """X+ = max(X, 0) of section 2.2."""
    part: Array = np.maximum(X, 0 * X)
    return part


def metzler_split(F: Array) -> tuple[Array, Array]:
    """Minimal D0 (Metzler), D1 >= 0 with F = D0 - D1: no other split has a smaller D0 + D1."""
    diagonal = np.diag(np.diag(F))
    return diagonal + positive_part(F - diagonal), positive_part(diagonal - F)


def nonnegative_split(H: Array) -> tuple[Array, Array]:
    """Minimal Gp, Gn >= 0 with H = Gp - Gn: H+ and H-."""
    return positive_part(H), positive_part(-H)


def absolute_metzler(X: Array) -> Array:
    """Diagonal of X kept, the other entries replaced by their absolute values."""
    plus, minus = metzler_split(X)
    return plus + minus


def completed_split(X: Array, plus: Array, minus: Array) -> tuple[Array, Array]:
    """The split of X itself that is nearest to a stored (rounded) one.

    plus - minus may differ from X by rounding; the remainder E = plus - minus - X goes where it
    keeps signs: plus + E-, minus + E+. In exact arithmetic the result is an exact split.
    """
    remainder = plus - minus - X
    return plus + positive_part(-remainder), minus + positive_part(remainder)


def width_pair(F: Array, H: Array, splits: dict[str, Array] | None) -> tuple[Array, Array]:
    """(W, N) of the width dynamics.

    Theorem 5 (`splits` is None): (F, H) themselves. Theorem 8: (D0 + D1, Gp + Gn), which is what
    (10) comes to after adding and subtracting the two error vectors.
    """
    if splits is None:
        return F, H
    D0, D1 = completed_split(F, splits["D0"], splits["D1"])
    Gp, Gn = completed_split(H, splits["Gp"], splits["Gn"])
    return D0 + D1, Gp + Gn


def width_inputs(gains: dict[str, Any]) -> tuple[Array, Array]:
    """(f, h): what feeds the width between jumps, Delta b + 2 |L| V, and at them."""
    L, M, V = gains["L"], gains["M"], gains["noise_bound"]
    flow = gains["flow_upper"] - gains["flow_lower"] + 2 * np.abs(L) @ V
    through = np.abs(
        jump_disturbance_matrix(M, gains["C"], len(gains["A"]), gains["jump_measurement"])
    )
    jump = through @ (gains["jump_upper"] - gains["jump_lower"]) + 2 * np.abs(M) @ V
    return flow, jump


def periodic_width(
    W: Array, N: Array, f: Array, h: Array, dwell: float
) -> tuple[Array, Array, Array]:
    """Width that constant dwell times lead to: just before a jump, just after it, on average.

    w' = W w + f between jumps, w+ = N w- + h at them; shapes (n,). Its limit exists when the
    spectral radius of e^{W dwell} N is below 1; ValueError otherwise.
    """
    n = len(W)
    identity, zero = np.eye(n), np.zeros((n, n))
    blocks = np.block([[W, identity, zero], [zero, zero, identity], [zero, zero, zero]])
    flow, once, twice = np.hsplit(expm(blocks * dwell)[:n], 3)
    cycle = flow @ N
    if max(abs(np.linalg.eigvals(cycle))) >= 1:
        raise ValueError(f"the width does not settle at dwell time {dwell:g}")
    before = np.linalg.solve(identity - cycle, flow @ h + once @ f)
    after = N @ before + h
    return before, after, (once @ after + twice @ f) / dwell
