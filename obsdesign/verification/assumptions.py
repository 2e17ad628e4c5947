"""What guarantees for uncertain plants assume: ranges of parameters, box of the state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from lmi.arithmetic.arrays import Array
from obsdesign.document import Claim, Guarantee
from obsdesign.problem.plant import Plant
from obsdesign.verification.parameter_ranges import parameter_ranges
from obsdesign.verification.rates import shown

# id of the claim on a box that is proved
STATE_BOX = "state_box"


def under_assumptions(
    plant: Plant, claims: Sequence[Claim], guarantees: tuple[Guarantee, ...]
) -> tuple[Guarantee, ...]:
    """Each guarantee with a first sentence on what it assumes of parameters and of x."""
    if not plant.parameters:
        return guarantees
    box = next((claim for claim in claims if claim.id == STATE_BOX), None)
    added = () if box is None else (STATE_BOX,)
    parts, counted = [parameter_ranges(plant)], ""
    if is_bounded(plant, claims):
        parts += [_assumed_inputs(plant), _assumed_box(plant)]
        counted = f" {_counted(box)}"
    text = f"Assumed: {'; '.join(part for part in parts if part)}.{counted}"
    return tuple(
        replace(
            entry.under(text),
            claims=(*entry.claims, *added) if entry.claims else (),
            given=entry.given and (box is None or box.verdict == "proved"),
        )
        for entry in guarantees
    )


def is_bounded(plant: Plant, claims: Sequence[Claim]) -> bool:
    """Do the bounds of a design include the effects of parameters, in a box of the state?"""
    proved = any(claim.id == STATE_BOX for claim in claims)
    return not plant.parameters or plant.state is not None or proved


def _assumed_box(plant: Plant) -> str:
    """The stated box, in words."""
    if plant.state is None:
        return ""
    ends = (_plain(plant.state.lower), _plain(plant.state.upper))
    return f"x from {ends[0]} to {ends[1]} at every instant, as [state] says"


def _counted(box: Claim | None) -> str:
    """How the effects of parameters enter, with a proved box or a stated one."""
    effects = "the effects of parameters count as disturbance and noise"
    if box is None:
        return f"{effects[0].upper()}{effects[1:]}."
    if box.verdict != "proved":
        return "The box of x is not proved."
    before = ""
    if "before_jump" in box.evidence:
        before = f", {shown(box.evidence['before_jump'])} just before jumps"
    return (
        f"The proved ultimate bound of |x| is {shown(box.evidence['always'])}{before}; from "
        f"then on {effects}."
    )


def _assumed_inputs(plant: Plant) -> str:
    """Known inputs that effects or the box count on, in words."""
    blocks = (plant.flow, plant.jump)
    is_bounded = any(block is not None and block.input_bound is not None for block in blocks)
    return "known inputs within input_bound" if is_bounded else ""


def _plain(values: Array) -> str:
    return "(" + ", ".join(f"{value:g}" for value in values) + ")"
