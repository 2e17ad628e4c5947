"""Are all eigenvalues of a matrix real? Decided exactly, by Sturm's sequence."""

from __future__ import annotations

import itertools
from typing import Any

from lmi.arithmetic.balls import characteristic_polynomial


def real_spectrum(F: Any) -> bool:
    """Are all eigenvalues of the exact matrix F real? By Sturm's sequence of its polynomial."""
    chain = [characteristic_polynomial(F)]
    chain.append([k * c for k, c in enumerate(chain[0])][1:])
    while True:
        rest = _remainder(chain[-2], chain[-1])
        if not rest:
            break
        chain.append([-c for c in rest])
    distinct = (len(chain[0]) - 1) - (len(chain[-1]) - 1)
    at_ends = []
    for end in (-1, 1):
        leading = [p[-1] * end ** (len(p) - 1) for p in chain]
        at_ends.append(sum(a * b < 0 for a, b in itertools.pairwise(leading)))
    return bool(at_ends[0] - at_ends[1] == distinct)


def _remainder(p: list[Any], q: list[Any]) -> list[Any]:
    rest = list(p)
    while len(rest) >= len(q):
        factor, shift = rest[-1] / q[-1], len(rest) - len(q)
        for i, c in enumerate(q):
            rest[i + shift] = rest[i + shift] - factor * c
        rest.pop()
    while rest and rest[-1] == 0:
        rest.pop()
    return rest
