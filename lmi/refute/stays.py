"""Cycles of modes and stays that destabilise: products of maps with spectral radius >= 1."""

from __future__ import annotations

import math

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import Balls, ball, exp_times, identity, to_float
from lmi.arithmetic.exponential import expm
from lmi.arithmetic.spectrum import spectral_radius
from lmi.modes import Modes, StayWord
from lmi.prove.hurwitz import prove_hurwitz
from lmi.refute.spectral import decide_radius
from lmi.verdict import Verdict, refuted, undecided


def refute_endless_stay(modes: Modes) -> Verdict:
    """Refuted by a mode that may last without end, and has a mode of its flow that stays."""
    for i, (_, high) in enumerate(modes.stays):
        if math.isinf(high):
            flow = prove_hurwitz(modes.flows[i])
            if flow.outcome == "refuted":
                return refuted({**flow.witness, "mode": modes.names[i]})
    return undecided("every mode that may last is stable")


def refute_stays(modes: Modes, word: StayWord) -> Verdict:
    """Refuted where this cycle of stays, repeated, makes a solution grow or persist.

    The product of e^{F_i theta} G_i has spectral radius >= 1, proved in balls; stays are floats
    taken exactly. Undecided also where the graph has no such cycle.
    """
    for (i, theta), (j, _) in zip(word, (*word[1:], word[0]), strict=True):
        low, high = modes.stays[i]
        if j not in modes.following[i] or not (low <= theta <= high and math.isfinite(theta)):
            return undecided("these stays are no cycle of the modes")

    def product() -> Balls:
        M = identity(len(modes.flows[0]))
        for i, theta in word:
            M = exp_times(modes.flows[i], theta) * (ball(modes.entry[i]) * M)
        return M

    inside, method, _ = decide_radius(product, len(modes.flows[0]))
    radius = spectral_radius(word_product(modes, word))
    stays = [[modes.names[i], theta] for i, theta in word]
    if inside is False:
        radius = max(radius, 1.0)
        return refuted({"stays": stays, "spectral_radius": radius, "method": method,
                        "reason": _reason(modes, word, radius)})  # fmt: skip
    return undecided("this cycle of stays is not proved to grow", stays=stays,
                     spectral_radius=radius)  # fmt: skip


def word_product(modes: Modes, word: StayWord) -> Matrix:
    """The product of a word in floats."""
    M = np.eye(len(modes.flows[0]))
    with np.errstate(all="ignore"):
        for i, theta in word:
            M = expm(to_float(modes.flows[i]) * theta) @ to_float(modes.entry[i]) @ M
    return M


def _reason(modes: Modes, word: StayWord, radius: float) -> str:
    stays = ", ".join(f"{theta!r} in {modes.names[i]}" for i, theta in word)
    return f"the stays {stays}, repeated in turn, give a map with spectral radius {radius:.9g} >= 1"
