"""What a positive system with inputs tends to under one constant dwell time, from above."""

from __future__ import annotations

from typing import Any

import numpy as np

from lmi.arithmetic.balls import (
    PRECISIONS,
    Exact,
    ball,
    exact,
    exp_times,
    identity,
    number,
    precision,
    solve,
    upper_ends,
)


def periodic_limit(
    W: Exact, N: Exact, f: Exact, h: Exact, theta: float
) -> tuple[Any, Any, Any] | None:
    """Upper ends of what u' = W u + f, u+ = N u + h tends to under a constant theta > 0.

    (before a jump, after it, on average), (n,) floats that exceed the exact limits by less than an
    ulp or two; None when no limit can be certified. The system must be stable: not checked here.
    """
    n = len(f)
    zero, unit = np.full((n, n), f[0] * 0, dtype=object), exact(np.eye(n))
    Z = np.block([[W, unit, zero], [zero, zero, unit], [zero, zero, zero]])
    with precision(PRECISIONS[1]):
        whole = exp_times(Z, theta).tolist()
        flow, once, twice = (
            type(ball(unit))([row[k * n : (k + 1) * n] for row in whole[:n]]) for k in range(3)
        )
        push, kick = ball(f[:, None]), ball(h[:, None])
        before = solve(identity(n) - flow * ball(N), flow * kick + once * push)
        if before is None:
            return None
        after = ball(N) * before + kick
        total = once * after + twice * push
        mean = total * (1 / number(theta))
        ends = [upper_ends(x).reshape(-1) for x in (before, after, mean)]
    return (ends[0], ends[1], ends[2]) if np.isfinite(ends).all() else None
