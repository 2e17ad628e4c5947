"""Quadratic forms that bound what a flow makes of a state, now and for all later times.

    Q >= left' left, F'Q + QF <= 2 r Q   give    |left e^{Fs} y|^2 <= e^{2rs} y'Qy    for all s >= 0

since y'Qy grows at most with the rate 2r along the flow. With r = 0 it falls: a tail, which settles
all later times at once.
"""

from __future__ import annotations

import math

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import (
    PRECISIONS,
    Balls,
    Exact,
    ball,
    certify_positive_definite,
    exact,
    middle,
    precision,
)
from lmi.prove.hurwitz import lyapunov_matrix, modal_matrix


def falling_forms(F: Balls, bound: Balls) -> list[Balls]:
    """Certified Q >= bound with F'Q + QF < 0, for ball matrices; bound >= 0.

    Any such Q is positive definite and shows that F is Hurwitz.
    """
    if _falling(F, bound):
        return [bound]
    forms = []
    for Q in proposed_forms(middle(F), middle(bound)):
        Q_ball = ball(exact(Q))
        if certify_positive_definite(Q_ball - bound) and _falling(F, Q_ball):
            forms.append(Q_ball)
    return forms


def proposed_forms(F: Matrix, bound: Matrix) -> list[Matrix]:
    """Matrices Q > bound that fall along the flow F as far as floats tell; bound >= 0.

    Modal coordinates do not mind slow modes, a Lyapunov equation does not mind multiple ones.
    """
    if not (np.isfinite(F).all() and np.isfinite(bound).all()):
        return []
    weight = bound + (1e-3 * np.trace(bound) / len(bound) + 1e-300) * np.eye(len(F))
    forms = []
    for Q in (modal_matrix(F), lyapunov_matrix(F, weight)):
        if Q is None:
            continue
        try:
            scale = float(np.linalg.eigvals(np.linalg.solve(Q, weight)).real.max())
        except np.linalg.LinAlgError:
            continue
        if 0 < scale < math.inf:
            forms.append(Q * scale * (1 + 1e-6))
    return forms


def certify_falling(F: Exact, X: Exact) -> bool:
    """Certify X > 0 and F'X + XF < 0 for exact matrices, X symmetric: F is Hurwitz."""
    for bits in PRECISIONS:
        with precision(bits):
            if certify_positive_definite(ball(X)) and _falling(ball(F), ball(X)):
                return True
    return False


def _falling(F: Balls, Q: Balls) -> bool:
    return certify_positive_definite(-(F.transpose() * Q + Q * F))
