"""Does a plant with parameters ever contradict its verdict?

    python -m tests.long.random_parameters [PLANTS] [FIRST_SEED]

Random plants (n = 1..3, one to three parameters in the flow, the jump or both, some constant; dwell
times in a range, from 0 on, or without an end). Proved: no random parameters, switching at random,
at corners or inside, with random dwell times, enlarge the certificate's form from jump to jump.
Refuted: the witness, replayed by exponentials of scipy, does not decay. Prints how many of each;
exits with 1 on a contradiction.
"""

from __future__ import annotations

import math
import sys
from collections import Counter

import numpy as np
from scipy.linalg import expm

from lmi.arithmetic.arrays import Entries
from lmi.decide.uncertain_stability import decide_uncertain
from lmi.parameters import AffineFamily
from lmi.prove.parameter_cells import prove_cells
from tests.lmi.parameter_examples import from_ranges

# of a form from jump to jump, and of a product that persists
ROUNDING = 1e-7
_STEPS = 60


def random_family(rng: np.random.Generator) -> tuple[AffineFamily, float, float]:
    """A family, and its range of dwell times."""
    n, q = int(rng.integers(1, 4)), int(rng.integers(1, 4))
    A, G = rng.standard_normal((n, n)), rng.uniform(0.3, 0.9) * rng.standard_normal((n, n))
    A -= rng.uniform(0.0, 2.0) * np.eye(n)
    effects = []
    for _ in range(q):
        flow = rng.standard_normal((n, n)) * (rng.random((n, n)) < 0.5)
        jump = rng.standard_normal((n, n)) * (rng.random((n, n)) < 0.3)
        size = float(rng.choice([0.02, 0.1, 0.3]))
        effects.append((size * flow, size * jump))
    low = float(rng.choice([0.0, 0.2, 0.5]))
    high = float(rng.choice([low, low + 0.4, low + 1.5, math.inf]))
    constant = (rng.random(q) < 0.3).tolist()
    ranges = [(-1.0, float(rng.uniform(-0.5, 1.0))) for _ in range(q)]
    return from_ranges(A, G, effects, ranges, constant), low, high


def _at(parts: np.ndarray, p: np.ndarray) -> np.ndarray:
    return np.asarray(parts[0] + np.tensordot(p, parts[1:], 1))


def _form(certificate: Entries, family: AffineFamily, p: np.ndarray) -> np.ndarray:
    """R_0 of the cell in which the constant parameters of p are."""
    node, place = certificate, p.copy()
    while "halves" in node:
        i = node["parameter"]
        side = int(place[i] > 0)
        place[i] = 2 * place[i] + (1 if side == 0 else -1)
        node = node["halves"][side]
    return np.array(node["R"][0])


def largest_ratio(
    family: AffineFamily, ends: tuple[float, float], certificate: Entries, rng: np.random.Generator
) -> float:
    """The largest V(after a jump) / V(after the jump before), for random p and dwell times."""
    A, G = family.floats()
    constant, q = np.array(family.is_constant), family.count
    low, last = ends[0], ends[1] if math.isfinite(ends[1]) else ends[0] + 3.0
    ratio = 0.0
    for _ in range(3):
        fixed = rng.uniform(-1, 1, q)

        def draw(fixed: np.ndarray = fixed) -> np.ndarray:
            p = np.sign(rng.standard_normal(q)) if rng.random() < 0.7 else rng.uniform(-1, 1, q)
            return np.where(constant, fixed, p)

        R = _form(certificate, family, fixed)
        x = rng.standard_normal(family.order)
        for _ in range(_STEPS):
            before = x @ R @ x
            theta = float(rng.choice([low, last, rng.uniform(low, last)]))
            pieces = int(rng.integers(1, 6))
            for length in theta * rng.dirichlet(np.ones(pieces)):
                x = expm(_at(A, draw()) * length) @ x
            x = _at(G, draw()) @ x
            if before > 0:
                ratio = max(ratio, float(x @ R @ x / before))
            size = float(np.linalg.norm(x))
            if size == 0:
                break
            x = x / size
    return ratio


def replayed(family: AffineFamily, witness: Entries) -> float:
    """The spectral radius of the witness, with exponentials of scipy."""
    A, G = family.floats()
    product = np.eye(family.order)
    if "stays" in witness:
        for stay in witness["stays"]:
            if stay["jump"] is not None:
                product = _at(G, np.array(stay["jump"])) @ product
            for piece in stay["flow"]:
                product = expm(_at(A, np.array(piece["p"])) * piece["duration"]) @ product
    elif "theta" not in witness and "thetas" not in witness:
        product = expm(_at(A, np.array(witness["p"])))
    else:
        p = np.array(witness["p"])
        for theta in witness.get("thetas", [witness.get("theta")]):
            product = expm(_at(A, p) * theta) @ _at(G, p) @ product
    return float(np.abs(np.linalg.eigvals(product)).max())


def contradiction(seed: int) -> tuple[str, str]:
    """(verdict, what contradicts it, or "") of a random plant."""
    rng = np.random.default_rng(seed)
    family, low, high = random_family(rng)
    verdict = decide_uncertain(family, low, high)
    if verdict.outcome == "proved":
        if prove_cells(family, low, high, verdict.evidence).outcome != "proved":
            return "proved", "its certificate does not prove it again"
        ratio = largest_ratio(family, (low, high), verdict.evidence, rng)
        return "proved", f"its form grows by {ratio}" if ratio > 1 + ROUNDING else ""
    if verdict.outcome == "refuted":
        radius = replayed(family, verdict.witness)
        return "refuted", f"its witness has radius {radius}" if radius < 1 - ROUNDING else ""
    return "undecided", ""


def main(plants: int = 200, first: int = 0) -> int:
    """Return 1 where a verdict is contradicted."""
    outcomes, wrong = Counter[str](), 0
    for seed in range(first, first + plants):
        outcome, what = contradiction(seed)
        outcomes[outcome] += 1
        if what:
            wrong += 1
            print(f"seed {seed}: {outcome}, and {what}")
    print(f"{plants} plants: {dict(outcomes)}, {wrong} contradicted")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
