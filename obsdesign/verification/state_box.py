"""The box of the state of an uncertain plant: stated, or proved from its own tube."""

from __future__ import annotations

import math

import numpy as np

from lmi.arithmetic.arrays import Array, Entries
from lmi.arithmetic.balls import exact, to_float
from lmi.bounds.tube import Tube, prove_tube
from lmi.verdict import Verdict, proved, undecided
from obsdesign.analysis.widened import StateBounds, absolute_plant
from obsdesign.document import Claim
from obsdesign.problem.plant import Plant
from obsdesign.verification.assumptions import STATE_BOX
from obsdesign.verification.dwell import Dwell
from obsdesign.verification.proposal import vectors

_NAMES = ("tube", "after_jump", "before_jump", "always")
_SOURCE = "comparison with the positive system of |x|; tube"


def state_box(plant: Plant, proposed: Entries) -> tuple[tuple[Claim, ...], StateBounds | None]:
    """The claim on a proposed box and the box; no claim where the problem states one."""
    if (stated := StateBounds.stated(plant)) is not None:
        return (), stated
    names = _NAMES if plant.jump is not None else ("tube", "always")
    bounds = vectors(proposed, names, plant.n)
    if bounds is None:
        return (), None
    tube = dict(zip(names, bounds, strict=True))
    claim = Claim.from_verdict(STATE_BOX, _statement(plant), _SOURCE, _verdict(plant, tube))
    before = to_float(tube.get("before_jump", tube["always"]))
    always = to_float(tube["always"])
    return (claim,), StateBounds.proved(to_float(tube["tube"]), always, before)


def _verdict(plant: Plant, tube: dict[str, Array]) -> Verdict:
    W, f, N, h = absolute_plant(plant, exact)
    stated = {name: to_float(values).tolist() for name, values in tube.items()}
    if N is None or h is None:
        v, always = tube["tube"], tube["always"]
        holds = all(x < 0 for x in W @ v + f) and all(x > 0 for x in v)
        if holds and all(a >= b for a, b in zip(always, v, strict=True)):
            return proved(**stated, exact=True)
        return undecided("W v + f < 0 does not hold for the proposed v")
    dwell, unit = _dwell(plant), exact(np.eye(plant.n))
    bounds = Tube(*(tube[name] for name in _NAMES))
    verdict = prove_tube(W, f, N, h, unit, tube=bounds, low=dwell.low, high=dwell.high)
    if verdict.outcome != "proved":
        return verdict
    return Verdict("proved", {**stated, **verdict.evidence})


def _dwell(plant: Plant) -> Dwell:
    assert plant.jump is not None
    return Dwell(*(plant.jump.dwell_time or (0.0, math.inf)))


def _statement(plant: Plant) -> str:
    if plant.jump is None:
        return (
            "`always` is an ultimate bound of |x|, for every course of the parameters inside their "
            "ranges: W v + f < 0 for |x|' <= W |x| + f"
        )
    return (
        "ultimate bounds of |x| are after_jump just after a jump, before_jump just before one and "
        "always at any time, for every course of the parameters inside their "
        f"ranges and dwell times in {_dwell(plant)}: a tube that |x|' <= W |x| + f, |x+| <= N |x| "
        "+ h does not leave and is drawn to"
    )
