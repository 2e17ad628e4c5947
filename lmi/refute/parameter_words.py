"""Parameters and dwell times that destabilise: a product of spectral radius >= 1, in balls.

A stay is a jump with G(p) and the flow after it, in pieces of constant p. A word of stays is
repeated without end. It is the witness itself: a simulation of it grows, or persists.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Array, Entries, NewEntries
from lmi.arithmetic.balancing import Scaling
from lmi.arithmetic.balls import (
    Balls,
    Exact,
    ball,
    exact,
    exp_times,
    identity,
    rational,
    to_float,
)
from lmi.arithmetic.exponential import expm
from lmi.arithmetic.spectrum import spectral_radius
from lmi.parameters import AffineFamily, Point
from lmi.prove.hurwitz import prove_hurwitz
from lmi.refute.spectral import decide_radius, refute_spectral, refute_word
from lmi.verdict import Verdict, refuted, undecided


@dataclass(frozen=True)
class Stay:
    """p at the jump, or None: the flow goes on without one; then (p, duration) of each piece."""

    jump: Point | None
    flow: tuple[tuple[Point, float], ...]

    @property
    def points(self) -> list[Point]:
        """Every p of this stay."""
        return [p for p, _ in self.flow] + ([] if self.jump is None else [self.jump])

    def is_admissible(self, low: float, high: float) -> bool:
        """Do the durations add up to a dwell time of the range, exactly?"""
        durations = [rational(duration) for _, duration in self.flow]
        total = sum(durations, rational(0.0))
        if any(duration < 0 for duration in durations):
            return False
        if self.jump is None:
            return math.isinf(high) and total > 0
        return total >= rational(low) and (math.isinf(high) or total <= rational(high))

    def entry(self) -> NewEntries:
        """Evidence: {"jump", "flow": [{"p", "duration"}]}."""
        pieces = [{"p": list(p), "duration": duration} for p, duration in self.flow]
        return {"jump": None if self.jump is None else list(self.jump), "flow": pieces}


def refute_parameters(
    family: AffineFamily, low: float, high: float, word: Sequence[Stay]
) -> Verdict:
    """Refuted where these stays, repeated, make a solution grow or persist; proved in balls.

    Undecided also where they are none of the family: a p outside the box, a constant one that
    changes, a dwell time out of range, or a stay without a jump beside others.
    """
    reason = _reason_against(family, low, high, word)
    if reason:
        return undecided(reason)
    n = family.order
    scaling = Scaling.from_pair(abs(family.A).sum(axis=0), abs(family.G).sum(axis=0), low)
    factors = [(scaling.map(M), duration) for M, duration in _factors(family, word)]

    def product() -> Balls:
        M = identity(n)
        for factor, duration in factors:
            M = (ball(factor) if duration is None else exp_times(factor, duration)) * M
        return M

    inside, method, _ = decide_radius(product, n)
    radius = spectral_radius(word_product(family, word))
    evidence = {"stays": [stay.entry() for stay in word], "spectral_radius": radius,
                "growth_per_jump": radius ** (1 / len(word))}  # fmt: skip
    if inside is False:
        radius = max(radius, 1.0)
        reason = (
            f"parameters that switch like that, {_when(word)}, "
            f"give a product of maps with spectral radius {radius:.9g} >= 1"
        )
        return refuted({**evidence, "spectral_radius": radius, "method": method, "reason": reason})
    return undecided("this word of parameters is not proved to grow", **evidence)


def refute_witness(family: AffineFamily, low: float, high: float, witness: Entries) -> Verdict:
    """Refuted where a stored witness, of constant parameters or of stays, is one; see above."""
    try:
        if "stays" in witness:
            return refute_parameters(family, low, high, read_stays(witness["stays"]))
        thetas = witness.get("thetas", [witness["theta"]] if "theta" in witness else [])
        p, times = tuple(map(float, witness["p"])), [float(theta) for theta in thetas]
        if len(p) != family.count:
            return undecided("these parameters are not in the box")
        return refute_constant_parameters(family, p, low, high, times)
    except (AttributeError, KeyError, OverflowError, TypeError, ValueError):
        return undecided("the witness holds no parameters and dwell times")


def read_stays(entries: Sequence[Entries]) -> tuple[Stay, ...]:
    """The word of a witness: the inverse of `Stay.entry`."""
    return tuple(
        Stay(
            None if entry["jump"] is None else tuple(map(float, entry["jump"])),
            tuple(
                (tuple(map(float, piece["p"])), float(piece["duration"])) for piece in entry["flow"]
            ),
        )
        for entry in entries
    )


def refute_constant_parameters(
    family: AffineFamily, p: Point, low: float, high: float, thetas: Sequence[float] = ()
) -> Verdict:
    """Refuted where this constant p makes some flow, or a constant dwell time, unstable.

    thetas: also this word of dwell times, and each of them alone. The witness has "p", exact.
    """
    if not _in_box(p):
        return undecided("p is not in the box")
    flow, jump = family.flow(p), family.jump(p)
    if math.isinf(high):
        endless = prove_hurwitz(flow)
        if endless.outcome == "refuted":
            return _at(endless, p)
    counter = refute_spectral(flow, jump, low, high, thetas)
    if counter.outcome != "refuted" and thetas and all(low <= t <= high for t in thetas):
        counter = refute_word(flow, jump, thetas)
    return _at(counter, p)


def word_product(family: AffineFamily, word: Sequence[Stay]) -> Array:
    """The product of a word in floats."""
    M = np.eye(family.order)
    with np.errstate(all="ignore"):
        for factor, duration in _factors(family, word):
            own = to_float(factor)
            M = (own if duration is None else expm(own * duration)) @ M
    return M


def _at(verdict: Verdict, p: Point) -> Verdict:
    """The verdict on a family at this p."""
    if verdict.outcome != "refuted":
        return verdict
    return refuted({**verdict.witness, "p": list(p)})


def _factors(family: AffineFamily, word: Sequence[Stay]) -> Iterator[tuple[Exact, float | None]]:
    """(A(p), duration) of a piece of flow, (G(p), None) of a jump, in the order of time."""
    for stay in word:
        if stay.jump is not None:
            yield family.jump(stay.jump), None
        for p, duration in stay.flow:
            yield family.flow(p), duration


def _in_box(p: Point) -> bool:
    return all(abs(entry) <= 1 for entry in exact(p).tolist())


def _reason_against(
    family: AffineFamily, low: float, high: float, word: Sequence[Stay]
) -> str | None:
    points = [p for stay in word for p in stay.points]
    if not points or not all(len(p) == family.count and _in_box(p) for p in points):
        return "these parameters are not in the box"
    constant = [tuple(x for x, c in zip(p, family.is_constant, strict=True) if c) for p in points]
    if len(set(constant)) > 1:
        return "a constant parameter would change"
    if not all(stay.is_admissible(low, high) for stay in word):
        return "these dwell times are not in the range"
    if len(word) > 1 and any(stay.jump is None for stay in word):
        return "a flow without jumps has no others"
    return None


def _when(word: Sequence[Stay]) -> str:
    if word[0].jump is None:
        return "without jumps"
    thetas = [sum(duration for _, duration in stay.flow) for stay in word]
    return "in turn with dwell times " + ", ".join(f"{theta:.9g}" for theta in thetas)
