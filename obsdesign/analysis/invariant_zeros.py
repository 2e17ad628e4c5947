"""Existence of unknown-input observers: rank of C D, and the invariant zeros of (A, D, C).

    x' = A x + D d,   y = C x;   s is an invariant zero if [[sI - A, -D], [C, 0]] loses rank there

Both are decided on the exact numbers, each answer with its witness.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Entries, Matrix
from lmi.arithmetic.balls import Exact, ball, certify_positive_definite, exact, precision, to_float
from lmi.prove.hurwitz import prove_hurwitz
from lmi.verdict import Verdict, proved, refuted, undecided
from obsdesign.analysis.hidden_modes import (
    HiddenPart,
    approx_unobservable_modes,
    hidden_part,
    nullspace,
)
from obsdesign.equations.unknown_input import formulas as equations


@dataclass(frozen=True)
class NearZero:
    """A mode with Re s >= 0 that is an invariant zero up to rounding.

    imag: its absolute value; margin: relative distance from a loss of rank.
    """

    real: float
    imag: float
    margin: float

    @classmethod
    def from_evidence(cls, evidence: Entries) -> NearZero | None:
        """That of the evidence of `zeros_decay`, if there is one."""
        nearly = evidence.get("nearly")
        return None if nearly is None else cls(**nearly)

    def to_evidence(self) -> dict[str, object]:
        """As it stands in the evidence of `zeros_decay`."""
        return {"nearly": asdict(self)}

    def __str__(self) -> str:
        return f"{self.real:.6g}" + (f" +- {self.imag:.6g}i" if self.imag else "")


def shows_every_input(C: Matrix, D: Matrix) -> Verdict:
    """Decide |C D v| > margin |M| |v| for all v != 0, M = |C| |D|; a witness is a v that fails.

    C (p, n), D (n, q). Rows of M (y) and columns (d) are brought to one size; units of x drop out
    of both products.
    """
    rows, columns = exact(C), exact(D)
    slope, terms = rows @ columns, abs(rows) @ abs(columns)
    of_y, of_d = _even_sizes(terms)
    factor = _powers(-of_y[:, None] - of_d)
    slope, terms = slope * factor, terms * factor
    size = (terms**2).sum()
    room = slope.T @ slope - exact(equations.RANK_MARGIN**2 * np.eye(D.shape[1])) * size
    approx = to_float(slope)
    values = np.linalg.svd(approx, compute_uv=False)
    whole = float(np.linalg.norm(to_float(terms)))
    with precision(256):
        if certify_positive_definite(ball(room)):
            return proved(approx_margin=float(values[-1] / whole))
    v = np.linalg.svd(approx)[2][-1]
    direction = exact(v)
    if not direction @ room @ direction <= 0:
        return undecided("C D is at the border between full and deficient rank")
    hidden = np.ldexp(v, (of_d.min() - of_d).clip(-2000))
    rank = int((values > equations.RANK_MARGIN * whole).sum())
    left = float(values[0] / whole) if whole and values.size else 0.0
    return refuted(_hidden_input(C, D, hidden / np.abs(hidden).max(), rank, left))


def _even_sizes(terms: Exact) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Exponents of rows (p,) and columns (q,) that bring positive entries to one size.

    Least squares of logarithms: other units of rows and columns shift them by exactly those.
    """
    p, q = terms.shape
    table = np.zeros((p * q, p + q))
    table[np.arange(p * q), np.repeat(np.arange(p), q)] = 1.0
    table[np.arange(p * q), p + np.tile(np.arange(q), p)] = 1.0
    positive = np.flatnonzero(terms != 0)
    if not len(positive):
        return np.zeros(p, np.int64), np.zeros(q, np.int64)
    bits = [int(v.p).bit_length() - int(v.q).bit_length() for v in terms.ravel().tolist() if v]
    logarithms = np.linalg.lstsq(table[positive], np.array(bits, dtype=np.float64), rcond=None)[0]
    sizes = np.round(logarithms).astype(np.int64)
    return sizes[:p], sizes[p:]


def _powers(exponents: NDArray[np.int64]) -> Exact:
    """2^e, exactly, for any e."""
    values = exact(np.ones(exponents.shape))
    two = exact(2.0).item()
    for index, e in np.ndenumerate(exponents):
        values[index] = two ** int(e)
    return values


def _hidden_input(C: Matrix, D: Matrix, v: Matrix, rank: int, left: float) -> dict[str, object]:
    """Witness: d = v changes y' by no more than rounding, and the reason.

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


def zero_part(A: Matrix, C: Matrix, D: Matrix) -> HiddenPart | None:
    """States that d keeps out of the output, and their flow; exact, None if there are none.

    C D must have full column rank: then the invariant zeros are the modes of this flow.
    """
    flow, rows, inputs = exact(A), exact(C), exact(D)
    CD = rows @ inputs
    # N = (CD' CD)^-1 CD': solutions of [CD' CD, -CD'] [N; I] = 0
    solutions, _ = nullspace(np.hstack([CD.T @ CD, -CD.T]))
    return hidden_part([equations.zero_dynamics(flow, rows, inputs, solutions[: D.shape[1]])], rows)


def zero_states(A: Matrix, C: Matrix, D: Matrix) -> Matrix:
    """Basis (n, h), rounded, of the states of the h zeros: d keeps them out of the output."""
    hidden = zero_part(A, C, D)
    return np.zeros((len(A), 0)) if hidden is None else to_float(hidden.basis)


def zeros_decay(A: Matrix, C: Matrix, D: Matrix) -> Verdict:
    """Decide whether all invariant zeros have negative real parts; C D must have full rank."""
    hidden = zero_part(A, C, D)
    if hidden is None:
        return proved(zeros=[], **_nearly(A, C, D))
    approx = _eigenvalues(to_float(hidden.maps[0]))
    zeros = [[z.real, abs(z.imag)] for z in sorted(approx, key=lambda z: -z.real) if z.imag >= 0]
    verdict = prove_hurwitz(hidden.maps[0])
    if verdict.outcome == "proved":
        return proved(zeros=zeros, method=verdict.evidence.get("method"), **_nearly(A, C, D))
    mode = verdict.witness.get("eigenvalue", {})
    real, imag = (float(mode[part]) for part in ("real", "imag"))
    text = f"{real:.6g}" + (f" +- {imag:.6g}i" if imag else "")
    reason = (
        f"invariant zero at s = {text}: an unknown input and a state that move like e^(st) and "
        "never show in y; no gain changes that"
    )
    return refuted({"zero": mode, "zeros": zeros, "reason": reason})


def _nearly(A: Matrix, C: Matrix, D: Matrix) -> dict[str, object]:
    """A mode with Re s >= 0 that is a zero up to rounding, though not exactly; {} if none."""
    from scipy.linalg import matrix_balance

    with np.errstate(all="ignore"):  # all signals of one size: only then a margin means something
        # by A alone: C and D could lend a coupling that is mere rounding the units to look real
        sizes = matrix_balance(A, permute=False, separate=True)[1][0]
        A, (C, D, _) = A * sizes / sizes[:, None], equations.scaled(C * sizes, D / sizes[:, None])
        N = np.linalg.pinv(C @ D) if np.isfinite(C @ D).all() else C @ D
        flow = equations.zero_dynamics(A, C, D, N.reshape(D.shape[1], len(C)))
    if not np.isfinite(flow).all():
        return {}
    modes = approx_unobservable_modes(flow, C)
    border = -1e-12 * float(np.abs(A).max(initial=0.0))
    growing = [mode for mode in modes if mode.eigenvalue.real >= border]
    if not growing:
        return {}
    value = growing[0].eigenvalue
    return NearZero(value.real, abs(value.imag), growing[0].margin).to_evidence()


def _eigenvalues(F: Matrix) -> NDArray[np.complex128]:
    """Approximate ones, to be shown; none where the numbers are beyond binary64."""
    if not np.isfinite(F).all():
        return np.zeros(0, dtype=np.complex128)
    return np.asarray(np.linalg.eigvals(F), dtype=np.complex128)
