"""Tubes of positive systems with inputs that take turns, proved for all paths and stays.

    u' = W_i u + f_i  in mode i,    u+ = N_j u + h_j  on entry into mode j

A tube v_j > 0 with N_j u(theta; v_i) + h_j < v_j for all theta in the stays of i and all modes j
that can follow is not left. It attracts from any size, geometrically: u(theta; s v) <= s u(theta;
v) for s >= 1, since f and h are not negative.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lmi.arithmetic.balls import Exact, exact
from lmi.bounds.tube import Affine, prove_below
from lmi.modes import Modes
from lmi.verdict import Verdict, proved, undecided


def prove_mode_tube(modes: Modes, f: Sequence[Exact], *, entry: Exact, always: Exact) -> Verdict:
    """Prove that u is at most `entry` on entry into each mode, `always` at any time in it.

    modes: W are its flows, N >= 0 its maps on entry; f (n,) of each; entry, always: (modes, n),
    exact.
    """
    unit, steps = exact(np.eye(len(modes.flows[0]))), 0
    if not all(x > 0 for x in entry.reshape(-1)):
        return undecided("the tube is not positive")
    for i, (low, high) in enumerate(modes.stays):
        flow = Affine(modes.flows[i], f[i], entry[i])
        checks = [(unit, always[i], 0.0)]
        checks += [(modes.entry[j], entry[j], low) for j in modes.following[i]]
        for X, bound, start in checks:
            verdict = prove_below(flow, X, bound, start, high)
            if verdict.outcome != "proved":
                return verdict
            steps += verdict.evidence["steps"]
    return proved(method="mean value form in balls", steps=steps)
