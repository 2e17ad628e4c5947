"""Asymptotic width of interval bounds: a proved tube, and limits at constant dwell times."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from lmi.arithmetic.arrays import Array, Entries
from lmi.arithmetic.balls import exact, to_float
from lmi.bounds.tube import Tube, periodic_limit, prove_tube
from lmi.verdict import Verdict, proved, undecided
from obsdesign.document import Claim
from obsdesign.equations.interval.width import WidthSystem
from obsdesign.verification.dwell import Dwell
from obsdesign.verification.proposal import vectors
from obsdesign.verification.rates import shown


@dataclass(frozen=True)
class ConstantDwell:
    """Widths of x that a constant dwell time leads to: limits, rounded up."""

    dwell_time: float
    before_jump: Sequence[float]
    after_jump: Sequence[float]
    mean: Sequence[float]

    @classmethod
    def from_evidence(cls, entries: Entries) -> ConstantDwell:
        """Those of one row of a claim."""
        names = ("before_jump", "after_jump", "mean")
        return cls(float(entries["dwell_time"]), *(entries[name] for name in names))


@dataclass(frozen=True)
class AsymptoticWidth:
    """Bounds of the width of x in a proved claim `width`; those at jumps are None without jumps."""

    always: Sequence[float]
    after_jump: Sequence[float] | None
    before_jump: Sequence[float] | None
    constant_dwell: tuple[ConstantDwell, ...]

    @classmethod
    def from_evidence(cls, evidence: Entries) -> AsymptoticWidth:
        """Those of a proved claim."""
        rows = tuple(map(ConstantDwell.from_evidence, evidence.get("constant_dwell", ())))
        return cls(
            evidence["always"], evidence.get("after_jump"), evidence.get("before_jump"), rows
        )


def width_claim(
    system: WidthSystem, ends: tuple[float, float], proposed: Entries, source: str
) -> tuple[Claim, ...]:
    """Claim of the proposed bounds of the width; no claim where there is no proposal.

    system: exact, with jumps. proposed: "tube" (width after a jump, in the observer's coordinates),
    "after_jump", "before_jump", "always" (in the plant's).
    """
    names = ("tube", "after_jump", "before_jump", "always")
    bounds = vectors(proposed, names, len(system.f))
    if bounds is None:
        return ()
    verdict = _proof(system, ends, Tube(*bounds))
    if verdict.outcome == "proved":
        stated = {name: to_float(v).tolist() for name, v in zip(names, bounds, strict=True)}
        rows = [asdict(row) for row in _constant_dwell(system, ends)]
        verdict = Verdict("proved", {**stated, "constant_dwell": rows, **verdict.evidence})
    statement = (
        "ultimate bounds of the width are after_jump just after a jump, "
        f"before_jump just before one and always at any time, for dwell times in "
        f"{Dwell(*ends)}: a tube that the width system w' = W w + f, w+ = N w + h does not "
        "leave and is drawn to"
    )
    return (Claim.from_verdict("width", statement, f"{source}; tube", verdict),)


def limit_claim(system: WidthSystem, proposed: Entries, source: str) -> tuple[Claim, ...]:
    """Claim of the bounds of the width without jumps: W v + f < 0, exactly."""
    names = ("tube", "always")
    bounds = vectors(proposed, names, len(system.f))
    if bounds is None:
        return ()
    v, always = bounds
    holds = all(x < 0 for x in system.W @ v + system.f) and all(x > 0 for x in v)
    verdict = undecided("W v + f < 0 does not hold for the proposed v")
    if holds and all(a >= b for a, b in zip(always, system.out @ v, strict=True)):
        stated = {name: to_float(x).tolist() for name, x in zip(names, bounds, strict=True)}
        verdict = proved(**stated, exact=True)
    statement = "`always` is an ultimate bound of the width: W v + f < 0"
    return (Claim.from_verdict("width", statement, f"{source}; tube", verdict),)


def width_sentence(claims: tuple[Claim, ...], measured: str) -> list[tuple[str, list[str]]]:
    """The guarantees of a proved width claim, each with the claims that it rests on."""
    evidence = [c.evidence for c in claims if c.id == "width" and c.verdict == "proved"]
    if not evidence:
        return []
    width = AsymptoticWidth.from_evidence(evidence[0])
    always = shown(width.always)
    if width.after_jump is None or width.before_jump is None:
        return [(f"{measured}, the ultimate bound of the width is {always}.", ["width"])]
    sentence = (
        f"{measured}, the ultimate bound of the width is "
        f"{shown(width.after_jump)} after jumps, {shown(width.before_jump)} "
        f"before them and {always} at any time."
    )
    constant = [_constant_dwell_sentence(row, measured) for row in width.constant_dwell]
    return [(each, ["width"]) for each in (sentence, *constant)]


def _constant_dwell_sentence(row: ConstantDwell, measured: str) -> str:
    return (
        f"{measured} and a constant dwell time of {row.dwell_time:.6g}, the width comes "
        f"to {shown(row.before_jump)} before jumps, {shown(row.after_jump)} after them and "
        f"{shown(row.mean)} on average: the limits, rounded up."
    )


def _proof(system: WidthSystem, ends: tuple[float, float], tube: Tube) -> Verdict:
    W, f, N, h, out = (exact(X) for X in (system.W, system.f, *system.at_jumps, system.out))
    return prove_tube(W, f, N, h, out, tube=tube, low=ends[0], high=ends[1])


def _constant_dwell(system: WidthSystem, ends: tuple[float, float]) -> list[ConstantDwell]:
    """Widths at constant dwell times, the ends of the range, enclosed from above."""
    rows: list[ConstantDwell] = []
    W, f, N, h = (exact(X) for X in (system.W, system.f, *system.at_jumps))
    out = to_float(exact(system.out))
    for theta in sorted({end for end in ends if 0 < end < math.inf}):
        limit = periodic_limit(W, N, f, h, theta)
        if limit is not None:
            before, after, mean = (raised_product(out, x) for x in limit)
            rows.append(ConstantDwell(theta, before, after, mean))
    return rows


def raised_product(out: Array, x: Array) -> list[float]:
    """|S| x, rounded up; x: floats, or exact numbers that are floats."""
    if np.array_equal(to_float(exact(out)), np.eye(len(out))):
        return [float(value) for value in to_float(exact(x))]
    total = to_float(exact(out) @ exact(x))
    return [float(value) for value in np.nextafter(total, np.inf)]
