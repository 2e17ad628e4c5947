"""How wide the bounds of an interval observer get: a tube, proved, and widths of constant dwell."""

from __future__ import annotations

import math
from collections.abc import Mapping
from decimal import ROUND_CEILING
from typing import Any

import numpy as np

from lmi.arithmetic.balls import exact, to_float
from lmi.bounds.tube import Tube, periodic_limit, prove_tube
from lmi.verdict import Verdict, proved, undecided
from obsdesign.document import Claim
from obsdesign.equations.interval.width import WidthSystem
from obsdesign.verification.dwell import Dwell
from obsdesign.verification.rates import six_digits


def width_claim(
    system: WidthSystem, ends: tuple[float, float], proposed: Mapping[str, Any], source: str
) -> tuple[Claim, ...]:
    """The bounds on the width that a finder proposes; no claim where none was.

    system: exact, with jumps. proposed: "tube" (width after a jump, in the observer's coordinates),
    "after_jump", "before_jump", "always" (in the plant's).
    """
    names = ("tube", "after_jump", "before_jump", "always")
    found = vectors(proposed, names, len(system.f))
    if found is None:
        return ()
    verdict = _proof(system, ends, found)
    if verdict.outcome == "proved":
        words = {name: to_float(found[name]).tolist() for name in names}
        rows = _constant_dwell(system, ends)
        verdict = Verdict("proved", {**words, "constant_dwell": rows, **verdict.evidence})
    statement = (
        "as jumps go on, the width of the bounds comes to at most after_jump just after a jump, "
        f"before_jump just before one and always at any time, for dwell times in "
        f"{Dwell(*ends)}: a tube that the width system w' = W w + f, w+ = N w + h does not "
        "leave and is drawn to"
    )
    return (Claim("width", statement, f"{source}; tube", verdict.outcome, verdict.evidence),)


def limit_claim(system: WidthSystem, proposed: Mapping[str, Any], source: str) -> tuple[Claim, ...]:
    """The same without jumps: W v + f < 0, exactly."""
    found = vectors(proposed, ("tube", "always"), len(system.f))
    if found is None:
        return ()
    v, always = found["tube"], found["always"]
    holds = all(x < 0 for x in system.W @ v + system.f) and all(x > 0 for x in v)
    verdict = undecided("W v + f < 0 does not hold for the proposed v")
    if holds and all(a >= b for a, b in zip(always, system.out @ v, strict=True)):
        words = {name: to_float(found[name]).tolist() for name in ("tube", "always")}
        verdict = proved(**words, exact=True)
    statement = "as time goes on, the width of the bounds comes to at most `always`: W v + f < 0"
    return (Claim("width", statement, f"{source}; tube", verdict.outcome, verdict.evidence),)


def width_sentence(found: tuple[Claim, ...], measured: str) -> list[tuple[str, list[str]]]:
    """The guarantee of a proved width claim, and the claims behind it."""
    for claim in found:
        if claim.id == "width" and claim.verdict == "proved":
            evidence = claim.evidence
            if "after_jump" not in evidence:
                return [(f"{measured}, the width comes to at most {shown(evidence['always'])}.",
                         ["width"])]  # fmt: skip
            text = (
                f"{measured}, the width comes, as jumps go on, to at most "
                f"{shown(evidence['after_jump'])} after jumps, {shown(evidence['before_jump'])} "
                f"before them and {shown(evidence['always'])} at any time."
            )
            rows = evidence.get("constant_dwell", [])
            return [(text, ["width"]), *((_at_constant(row, measured), ["width"]) for row in rows)]
    return []


def _at_constant(row: Mapping[str, Any], measured: str) -> str:
    """What constant dwell times lead to, in a sentence."""
    return (
        f"{measured} and a constant dwell time of {float(row['dwell_time']):.6g}, the width comes "
        f"to {shown(row['before_jump'])} before jumps, {shown(row['after_jump'])} after them and "
        f"{shown(row['mean'])} on average: the limits, rounded up."
    )


def shown(values: Any) -> str:
    """A vector of upper bounds as a sentence has it: six digits, rounded up."""
    return "(" + ", ".join(six_digits(float(value), ROUND_CEILING) for value in values) + ")"


def vectors(proposed: Mapping[str, Any], names: tuple[str, ...], n: int) -> Any:
    """The proposed vectors, exact; None if one is not there, or not a finite vector."""
    found = {}
    for name in names:
        try:
            value = np.asarray(proposed[name], dtype=np.float64)
            found[name] = exact(value)
        except (KeyError, TypeError, ValueError, OverflowError):
            return None
        if value.shape != (n,):
            return None
    return found


def _proof(system: WidthSystem, ends: tuple[float, float], found: Mapping[str, Any]) -> Verdict:
    W, f, N, h, out = (exact(X) for X in (system.W, system.f, *system.at_jumps, system.out))
    names = ("tube", "after_jump", "before_jump", "always")
    return prove_tube(W, f, N, h, out, Tube(*(found[name] for name in names)), *ends)


def _constant_dwell(system: WidthSystem, ends: tuple[float, float]) -> list[dict[str, Any]]:
    """Widths that constant dwell times at the ends of the range lead to, enclosed from above."""
    rows = []
    W, f, N, h = (exact(X) for X in (system.W, system.f, *system.at_jumps))
    out = to_float(exact(system.out))
    for theta in sorted({end for end in ends if 0 < end < math.inf}):
        limit = periodic_limit(W, N, f, h, theta)
        if limit is not None:
            names = ("before_jump", "after_jump", "mean")
            widths = {name: raised_product(out, x) for name, x in zip(names, limit, strict=True)}
            rows.append({"dwell_time": theta, **widths})
    return rows


def raised_product(out: Any, x: Any) -> list[float]:
    """|S| x, rounded up; x: floats, or exact numbers that are floats."""
    if np.array_equal(to_float(exact(out)), np.eye(len(out))):
        return [float(value) for value in to_float(exact(x))]
    total = to_float(exact(out) @ exact(x))
    return [float(value) for value in np.nextafter(total, np.inf)]
