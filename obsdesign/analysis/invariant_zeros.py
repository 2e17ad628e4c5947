"""Can an unknown input be told from the output? Rank of C D, and the invariant zeros of (A, D, C).

    x' = A x + D d,   y = C x;   s is an invariant zero if [[sI - A, -D], [C, 0]] loses rank there

Both are decided on the exact numbers, each answer with its witness.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.balls import Exact, ball, certify_positive_definite, exact, precision, to_float
from lmi.prove.hurwitz import prove_hurwitz
from lmi.verdict import Verdict, proved, refuted, undecided
from obsdesign.analysis.hidden_modes import approx_unobservable_modes, hidden_subspace, nullspace
from obsdesign.equations.unknown_input import matrices as equations

Matrix = NDArray[np.float64]


def shows_every_input(C: Matrix, D: Matrix) -> Verdict:
    """|C D v| > margin |M| |v| for every v != 0, M = |C| |D| entry by entry, or a v that does not.

    C (p, n), D (n, q). Rows of M (y) and columns (d) are brought to one size; units of x drop out
    of both products.
    """
    rows, columns = exact(C), exact(D)
    seen, terms = rows @ columns, abs(rows) @ abs(columns)
    of_y, of_d = _even_sizes(terms)
    factor = _powers(-of_y[:, None] - of_d)
    seen, terms = seen * factor, terms * factor
    size = (terms**2).sum()
    room = seen.T @ seen - exact(equations.RANK_MARGIN**2 * np.eye(D.shape[1])) * size
    approx = to_float(seen)
    values = np.linalg.svd(approx, compute_uv=False)
    whole = float(np.linalg.norm(to_float(terms)))
    with precision(256):
        if certify_positive_definite(ball(room)):
            return proved(approx_margin=float(values[-1] / whole))
    v = np.linalg.svd(approx)[2][-1]
    direction = exact(v)
    if not direction @ room @ direction <= 0:
        return undecided("C D is at the border between full and deficient rank")
    blind = np.ldexp(v, (of_d.min() - of_d).clip(-2000))
    rank = int((values > equations.RANK_MARGIN * whole).sum())
    left = float(values[0] / whole) if whole and values.size else 0.0
    return refuted(_blind(C, D, blind / np.abs(blind).max(), rank, left))


def _even_sizes(terms: Exact) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Exponents of rows (p,) and columns (q,) that bring positive entries to one size.

    Least squares of logarithms: other units of rows and columns move them by exactly those.
    """
    p, q = terms.shape
    table = np.zeros((p * q, p + q))
    table[np.arange(p * q), np.repeat(np.arange(p), q)] = 1.0
    table[np.arange(p * q), p + np.tile(np.arange(q), p)] = 1.0
    values: list[Any] = list(terms.flat)
    there = [k for k, value in enumerate(values) if value != 0]
    if not there:
        return np.zeros(p, np.int64), np.zeros(q, np.int64)
    bits = [int(v.p).bit_length() - int(v.q).bit_length() for v in values if v != 0]
    found = np.linalg.lstsq(table[there], np.array(bits, dtype=np.float64), rcond=None)[0]
    sizes = np.round(found).astype(np.int64)
    return sizes[:p], sizes[p:]


def _powers(exponents: NDArray[np.int64]) -> Exact:
    """2^e, exactly, for any e."""
    values = exact(np.ones(exponents.shape))
    two = exact(2.0).item()
    for index, e in np.ndenumerate(exponents):
        values[index] = two ** int(e)
    return values


def _blind(C: Matrix, D: Matrix, v: Matrix, rank: int, left: float) -> dict[str, Any]:
    """Witness: d = v moves y' by nothing that could be told from rounding, and why.

    left: the largest part of |C| |D| that C D leaves of any input.
    """
    p, q = len(C), D.shape[1]
    columns = np.ldexp(D, -equations.exponents(D)[:, None])
    columns = np.ldexp(columns, -equations.exponents(columns.T))
    own = int((np.linalg.svd(columns, compute_uv=False) > equations.RANK_MARGIN).sum())
    if own < q:
        why = f"the columns of flow.D are dependent (rank {own}); drop inputs that others replace"
    elif p < q:
        why = f"there are fewer outputs ({p}) than unknown inputs ({q})"
    elif rank == 0:
        equal = "C D = 0" if left == 0 else f"C D cancels to {left:.1g} of |C| |D|"
        why = f"{equal}, so that d reaches y only through further integrations"
    else:
        why = "this combination of unknown inputs reaches y only through further integrations"
    shown = ", ".join(f"{entry:.6g}" for entry in v)
    reason = f"rank(C D) = {rank}, {q} is needed: d = [{shown}] does not show in y'; {why}"
    return {"input": v.tolist(), "rank": rank, "reason": reason}


def zero_flow(A: Matrix, C: Matrix, D: Matrix) -> Exact | None:
    """Exact matrix whose eigenvalues are the invariant zeros; None if there are none.

    C D must have full column rank: then they are the modes that C does not see of the flow that
    keeps y' = 0.
    """
    found = _hidden(A, C, D)
    return None if found is None else found[0]


def hidden_states(A: Matrix, C: Matrix, D: Matrix) -> Matrix:
    """Basis (n, h), rounded, of the states that can move unseen: those of the h zeros."""
    found = _hidden(A, C, D)
    return np.zeros((len(A), 0)) if found is None else to_float(found[1])


def _hidden(A: Matrix, C: Matrix, D: Matrix) -> tuple[Exact, Exact] | None:
    numbers = exact(A), exact(C), exact(D)
    seen = numbers[1] @ numbers[2]
    # N = (seen' seen)^-1 seen': solutions of [seen' seen, -seen'] [N; I] = 0
    solutions, _ = nullspace(np.hstack([seen.T @ seen, -seen.T]))
    kept = equations.zero_dynamics(*numbers, solutions[: D.shape[1]])
    found: tuple[Exact, Exact] | None = hidden_subspace(kept, numbers[1])
    return found


def zeros_decay(A: Matrix, C: Matrix, D: Matrix) -> Verdict:
    """Every invariant zero has a negative real part, or the one that has not; C D of full rank."""
    restricted = zero_flow(A, C, D)
    if restricted is None:
        return proved(zeros=[], **_nearly(A, C, D))
    approx = _eigenvalues(to_float(restricted))
    found = [[z.real, abs(z.imag)] for z in sorted(approx, key=lambda z: -z.real) if z.imag >= 0]
    verdict = prove_hurwitz(restricted)
    if verdict.outcome == "proved":
        return proved(zeros=found, method=verdict.evidence["method"], **_nearly(A, C, D))
    mode = verdict.evidence["witness"]["eigenvalue"]
    text = f"{mode['real']:.6g}" + (f" +- {mode['imag']:.6g}i" if mode["imag"] else "")
    reason = (
        f"invariant zero at s = {text}: an unknown input and a state that move like e^(st) and "
        "never show in y; no gain changes that"
    )
    return refuted({"zero": mode, "zeros": found, "reason": reason})


def _nearly(A: Matrix, C: Matrix, D: Matrix) -> dict[str, Any]:
    """A mode with Re s >= 0 that floats cannot tell from a zero; exactly it is none."""
    from scipy.linalg import matrix_balance

    with np.errstate(all="ignore"):  # all signals of one size: only then a margin means something
        # by A alone: C and D could lend a coupling that is mere rounding the units to look real
        sizes = matrix_balance(A, permute=False, separate=True)[1][0]
        A, (C, D, _) = A * sizes / sizes[:, None], equations.scaled(C * sizes, D / sizes[:, None])
        N = np.linalg.pinv(C @ D) if np.isfinite(C @ D).all() else C @ D
        kept = equations.zero_dynamics(A, C, D, N.reshape(D.shape[1], len(C)))
    if not np.isfinite(kept).all():  # nothing to steer by
        return {}
    modes = approx_unobservable_modes(kept, C)
    border = -1e-12 * float(np.abs(A).max(initial=0.0))
    growing = [mode for mode in modes if mode.eigenvalue.real >= border]
    if not growing:
        return {}
    value = growing[0].eigenvalue
    return {"nearly": {"real": value.real, "imag": abs(value.imag), "margin": growing[0].margin}}


def _eigenvalues(F: Matrix) -> NDArray[np.complex128]:
    """Approximate ones, to be shown; none where the numbers are beyond binary64."""
    if not np.isfinite(F).all():
        return np.zeros(0, dtype=np.complex128)
    return np.asarray(np.linalg.eigvals(F), dtype=np.complex128)
