"""Can an unknown input be told from the output? Rank of C D, and the invariant zeros of (A, D, C).

    x' = A x + D d,   y = C x;   s is an invariant zero if [[sI - A, -D], [C, 0]] loses rank there

Both are decided on the exact numbers, each answer with its witness.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lmi.balls import Exact, ball, certify_positive_definite, exact, precision, to_float
from lmi.hurwitz import prove_hurwitz
from lmi.verdict import Verdict, proved, refuted, undecided
from obsdesign.equations import unknown_input as equations
from obsdesign.structure import approx_unobservable_modes, hidden_flow, nullspace, own_units

Matrix = NDArray[np.float64]


def shows_every_input(C: Matrix, D: Matrix) -> Verdict:
    """|C D v| > margin |C| |D| |v| for every v != 0, or a v that shows the opposite.

    C (p, n), D (n, q), scaled so that neither the units of y nor those of d matter.
    """
    C_unit, D_unit, units = equations.scaled(C, D)
    rows, columns = exact(C_unit), exact(D_unit)
    seen = rows @ columns
    size = (rows**2).sum() * (columns**2).sum()
    room = seen.T @ seen - exact(equations.RANK_MARGIN**2 * np.eye(D.shape[1])) * size
    approx = to_float(seen)
    with precision(256):
        if certify_positive_definite(ball(room)):
            smallest = np.linalg.svd(approx, compute_uv=False)[-1]
            whole = np.linalg.norm(C_unit) * np.linalg.norm(D_unit)
            return proved(approx_margin=float(smallest / whole))
    v = np.linalg.svd(approx)[2][-1]
    direction = exact(v)
    if not direction @ room @ direction <= 0:
        return undecided("C D is at the border between full and deficient rank")
    blind = np.ldexp(v, (units.min() - units).clip(-2000))
    return refuted(_blind(C_unit, D_unit, blind / np.abs(blind).max()))


def _blind(C: Matrix, D: Matrix, v: Matrix) -> dict[str, Any]:
    """Witness: d = v moves y' by nothing that could be told from rounding, and why."""
    p, q = len(C), D.shape[1]
    size = np.linalg.norm(C) * np.linalg.norm(D)
    values = np.linalg.svd(C @ D, compute_uv=False)
    rank = int((values > equations.RANK_MARGIN * size).sum())
    own = int((np.linalg.svd(D, compute_uv=False) > equations.RANK_MARGIN).sum())
    if own < q:
        why = f"the columns of flow.D are dependent (rank {own}); drop inputs that others replace"
    elif p < q:
        why = f"there are fewer outputs ({p}) than unknown inputs ({q})"
    elif rank == 0:
        why = "C D = 0, so that d reaches y only through further integrations"
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
    numbers = exact(A), exact(C), exact(D)
    seen = numbers[1] @ numbers[2]
    # N = (seen' seen)^-1 seen': solutions of [seen' seen, -seen'] [N; I] = 0
    solutions, _ = nullspace(np.hstack([seen.T @ seen, -seen.T]))
    kept = equations.zero_dynamics(*numbers, solutions[: D.shape[1]])
    found: Exact | None = hidden_flow(kept, numbers[1])
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
    with np.errstate(all="ignore"):  # all signals of one size: only then a margin means something
        sizes = own_units(A)[0]
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
