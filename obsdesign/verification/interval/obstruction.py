"""Why no gains at all can do: modes that no output sees, entries that no gain can touch.

Decided in exact numbers. Each answer is about every L and M that the problem leaves open, in the
form and the coordinates at hand (the first one about every observer whatever).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from lmi.arithmetic.balls import exact, inverse, to_float
from lmi.prove.hurwitz import prove_hurwitz
from lmi.refute.spectral import refute_spectral
from lmi.verdict import Verdict
from obsdesign.analysis.hidden_modes import hardly_hidden, hidden_for_ever, nullspace
from obsdesign.document import Claim
from obsdesign.equations.estimation_error import idle_gains, seen_before_jump
from obsdesign.equations.interval.splits import absolute_metzler, flow_and_jump, in_coordinates
from obsdesign.equations.interval.width import Coordinates
from obsdesign.problem.problem import Problem

# supports of Farkas vectors that are looked at, one row after the other
_MOST_SUPPORTS = 2000
_STABILITY = ("dwell_stability", "sampled_stability")


def obstruction_claim(problem: Problem, gains: Mapping[str, Any], source: str) -> tuple[Claim, ...]:
    """A refuted claim where gains are open and none can do; nothing otherwise."""
    plant = problem.plant
    idle = idle_gains(plant)
    is_open = {name: name not in problem.gains and name not in idle for name in ("L", "M")}
    if plant.output.measured == "periodic":
        found = _hidden(problem) if is_open["L"] else None
        if not is_open["L"] and "S" in gains and "S" not in problem.gains:
            found = _unstable_between_samples(problem, gains)
    elif any(is_open.values()):
        found = _hidden(problem) or _in_these_coordinates(problem, gains, is_open)
    elif "S" in gains and "S" not in problem.gains:
        found = _unstable_error(problem, gains)
    else:
        return ()
    if found is None:
        return ()
    return (
        Claim(
            "attainable",
            f"some gains L, M make a design of form {gains['form']}",
            source,
            "refuted",
            {"witness": {**found, "of_all_gains": True}},
        ),
    )


def _hidden(problem: Problem) -> dict[str, Any] | None:
    """Two states that no output ever tells apart, and whose distance does not shrink."""
    A, G, C, ends = _plant(problem)
    return hidden_for_ever(A, G, C, ends)


def _plant(problem: Problem) -> tuple[Any, Any, Any, tuple[float, float]]:
    """A, G (None without jumps), C, and the range of dwell times."""
    plant = problem.plant
    if plant.jump is None:
        return plant.flow.A, None, plant.output.C, (math.inf, math.inf)
    return plant.flow.A, plant.jump.G, plant.output.C, problem.require_dwell_time()


def explained(problem: Problem, found: tuple[Claim, ...]) -> tuple[Claim, ...]:
    """The same claims; what fails says so where a mode is hidden but for rounding.

    Only where gains are open: a given one is judged by itself.
    """
    failed = [c for c in found if c.id in _STABILITY and c.verdict != "proved"]
    is_open = {"L", "M"} - {*problem.gains, *idle_gains(problem.plant)}
    if not failed or not is_open or any(c.id == "attainable" for c in found):
        return found
    missing = hardly_hidden(problem.plant.flow.A, problem.plant.output.C)
    if missing is None:
        return found
    return tuple(_with_hint(c, missing) if c in failed else c for c in found)


def _with_hint(claim: Claim, missing: str) -> Claim:
    witness = claim.evidence.get("witness")
    if witness is not None:
        witness = {**witness, "reason": f"{witness['reason']}; {missing}"}
        return replace(claim, evidence={**claim.evidence, "witness": witness})
    why = f"{claim.evidence.get('reason', 'not proved')}; {missing}"
    return replace(claim, evidence={**claim.evidence, "reason": why})


def _unstable_error(problem: Problem, gains: Mapping[str, Any]) -> dict[str, Any] | None:
    """With gains that are given no coordinates help if the error itself does not shrink."""
    numbers = {name: exact(gains[name]) for name in ("A", "C", "G", "L", "M") if name in gains}
    F, H = flow_and_jump(numbers, gains["jump_measurement"], periodic=False)
    beginning = "with these gains no coordinates help, the estimation error does not shrink: "
    if H is None:
        return _told(prove_hurwitz(F), beginning)
    low, high = problem.require_dwell_time()
    found = _told(prove_hurwitz(F), beginning) if math.isinf(high) else None
    return found or _told(refute_spectral(F, H, low, high), beginning)


def _unstable_between_samples(problem: Problem, gains: Mapping[str, Any]) -> dict[str, Any] | None:
    """The same for samples as events, without jumps if they may stay away for ever."""
    if problem.plant.jump is not None and math.isfinite(problem.require_dwell_time()[1]):
        return None
    A, C, L = (exact(gains[name]) for name in ("A", "C", "L"))
    period = float(gains["period"])
    beginning = "with this L no coordinates help, the estimation error does not shrink: "
    return _told(refute_spectral(A, exact(np.eye(len(A))) - L @ C, period, period), beginning)


def _told(verdict: Verdict, beginning: str) -> dict[str, Any] | None:
    if verdict.outcome != "refuted":
        return None
    witness = dict(verdict.evidence["witness"])
    return {**witness, "reason": beginning + str(witness["reason"])}


def _in_these_coordinates(
    problem: Problem, gains: Mapping[str, Any], is_open: Mapping[str, bool]
) -> dict[str, Any] | None:
    plant = problem.plant
    if gains["form"] == "two_coordinates":
        return None
    frame = Coordinates.of({n: exact(gains[n]) for n in ("S",) if n in gains}, inverse)
    C = exact(plant.output.C)
    zero = 0 * exact(gains["L"])
    L, M = (zero if is_open[name] else exact(gains[name]) for name in ("L", "M"))
    F = in_coordinates(exact(plant.flow.A) - L @ C, frame.S, frame.S_inverse)
    H, C_jump = None, C
    if plant.jump is not None:
        G = exact(plant.jump.G)
        C_jump = seen_before_jump(G, C, plant.output.jump_measurement)
        H = in_coordinates(G - M @ C_jump, frame.S, frame.S_inverse)
    if frame.S is not None:
        C, C_jump = C @ frame.S, C_jump @ frame.S
    flow_seen, jump_seen = C if is_open["L"] else 0 * C, C_jump if is_open["M"] else 0 * C
    if gains["form"] == "cooperative":
        found = _wrong_sign(F, flow_seen, "A - L C", metzler=True)
        if found is None and H is not None:
            found = _wrong_sign(H, jump_seen, "the jump matrix of the error", metzler=False)
        if found is not None:
            return found
    if "S" in gains and "S" not in problem.gains:
        return None  # other coordinates are open as well
    return _untouched(problem, F, H, flow_seen, jump_seen)


def _untouched(
    problem: Problem, F: Any, H: Any, flow_seen: Any, jump_seen: Any
) -> dict[str, Any] | None:
    """Columns that no gain reaches keep their part of W and N, and it does not contract."""
    columns = [
        j for j in range(len(F)) if all(x == 0 for x in [*flow_seen[:, j], *jump_seen[:, j]])
    ]
    if not columns:
        return None
    part = np.ix_(columns, columns)
    names = ", ".join(str(j + 1) for j in columns)
    beginning = (
        f"in these coordinates no gain can touch column{'s' * (len(columns) > 1)} {names} of "
        "A - L C and of the jump matrix: "
    )
    W = absolute_metzler(F[part])
    if H is None:
        return _told(prove_hurwitz(W), beginning)
    low, high = problem.require_dwell_time()
    found = _told(refute_spectral(W, np.abs(H[part]), low, high), beginning)
    if found is None and math.isinf(high):
        found = _told(prove_hurwitz(W), beginning)
    return found


def _wrong_sign(X: Any, seen: Any, name: str, metzler: bool) -> dict[str, Any] | None:
    """A row that no gain makes nonnegative: y >= 0 with C y = 0 and (row) y < 0 (Farkas)."""
    n = len(X)
    for i in range(n):
        others = [j for j in range(n) if not (metzler and j == i)]
        for support, y in _unseen_vectors(seen, others):
            total = sum(X[i, j] * value for j, value in zip(support, y, strict=True))
            if total < 0:
                return _entry(X, i, support, y, name)
    return None


def _entry(X: Any, i: int, support: tuple[int, ...], y: Any, name: str) -> dict[str, Any]:
    values = [float(v) for v in to_float(np.array([X[i, j] for j in support], dtype=object))]
    if len(support) == 1:
        j = support[0]
        reason = f"entry ({i + 1}, {j + 1}) of {name} is {values[0]:.6g}, and no gain can touch it"
    else:
        places = ", ".join(f"({i + 1}, {j + 1})" for j in support)
        reason = (
            f"entries {places} of {name} cannot all be made nonnegative: a positive combination "
            "of them that no gain can touch is negative"
        )
    weights = [float(v) for v in to_float(np.array(list(y), dtype=object))]
    return {"row": i + 1, "columns": [j + 1 for j in support], "weights": weights, "reason": reason}


def _unseen_vectors(seen: Any, columns: list[int]) -> Iterator[tuple[tuple[int, ...], Any]]:
    """Vectors y > 0 on a few columns with (seen) y = 0, of least support."""
    supports = itertools.chain.from_iterable(
        itertools.combinations(columns, size) for size in range(1, len(seen) + 2)
    )
    for support in itertools.islice(supports, _MOST_SUPPORTS):
        basis, free = nullspace(seen[:, list(support)])
        if len(free) != 1:
            continue
        y = basis[:, 0]
        if all(v > 0 for v in y) or all(v < 0 for v in y):
            yield support, np.abs(y)
