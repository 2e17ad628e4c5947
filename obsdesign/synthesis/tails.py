"""Tail matrices beside the certificates of a design, for its checker (docs/proofs.md)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lmi.arithmetic.arrays import Array, Entries, Matrix
from lmi.arithmetic.balls import exact, rank_factors, to_float
from lmi.find.tails import propose_tails
from obsdesign.synthesis.candidate import Certificates


def with_tails(
    certificates: Certificates, flows: Mapping[str, Array], H: Array | None
) -> Certificates:
    """Certificates with matrices that fall along the flow of each claim in `flows`.

    flows: (n, n) floats or exact, by the id of the claim; H (n, n): the jump, None without jumps.
    Claims that have no certificate of jumps get none.
    """
    evidence = dict(certificates.evidence)
    for name, flow in flows.items():
        stated = evidence.get(name, {})
        bound = _bound(stated, H, len(flow))
        tails = [] if bound is None else propose_tails(exact(flow), exact(bound))
        if tails:
            evidence[name] = {**stated, "tails": [X.tolist() for X in tails]}
    return Certificates(evidence, certificates.solvers)


def _bound(evidence: Entries, H: Array | None, n: int) -> Matrix | None:
    """Sum of what the tails are to bound, (n, n) and of trace 1; None without a certificate."""
    if H is None or "vector" in evidence:
        return np.eye(n) / n
    if "P" in evidence:
        matrices = [evidence["P"]]
    elif "windows" in evidence:
        matrices = [window["P"] for window in evidence["windows"]]
    elif "P_cells" in evidence:
        matrices = evidence["P_cells"]
    else:
        return None
    total = np.sum([np.asarray(P) / np.trace(P) for P in matrices], axis=0) / len(matrices)
    if len(total) == n:
        return np.asarray(total)
    V = rank_factors(exact(H))[1]
    return np.asarray(to_float(V @ exact(total) @ V.T))
