"""Quadratic forms that bound what a flow makes of a state, now and for all later times.

    Q >= left' left, F'Q + QF <= 2 r Q   give    |left e^{Fs} y|^2 <= e^{2rs} y'Qy    for all s >= 0

since y'Qy grows at most with the rate 2r along the flow. With r = 0 it falls: a tail, which settles
all later times at once.
"""

from __future__ import annotations

import math

import numpy as np

from lmi.arithmetic.balls import Balls, ball, certify_positive_definite, exact, middle
from lmi.prove.hurwitz import lyapunov_matrix, modal_matrix


def falling_forms(F: Balls, bound: Balls) -> list[Balls]:
    """Certified Q >= bound with F'Q + QF < 0, for ball matrices; bound >= 0.

    Any such Q is positive definite and shows that F is Hurwitz. Modal coordinates do not mind slow
    modes, a Lyapunov equation does not mind multiple ones.
    """
    if _falling(F, bound):
        return [bound]
    approx, weight = middle(F), middle(bound)
    if not (np.isfinite(approx).all() and np.isfinite(weight).all()):
        return []
    unit = np.eye(len(approx))
    weight = weight + (1e-3 * np.trace(weight) / len(weight) + 1e-300) * unit
    forms = []
    for Q in (modal_matrix(approx), lyapunov_matrix(approx, weight)):
        if Q is None:
            continue
        try:
            scale = float(np.linalg.eigvals(np.linalg.solve(Q, weight)).real.max())
        except np.linalg.LinAlgError:
            continue
        if not 0 < scale < math.inf:
            continue
        Q_ball = ball(exact(Q * scale * (1 + 1e-6)))
        if certify_positive_definite(Q_ball - bound) and _falling(F, Q_ball):
            forms.append(Q_ball)
    return forms


def _falling(F: Balls, Q: Balls) -> bool:
    return certify_positive_definite(-(F.transpose() * Q + Q * F))
