"""What a problem must state for set-membership bounds, and how long a window must be."""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Array
from lmi.arithmetic.balls import exact, row_echelon
from obsdesign.analysis.hidden_modes import HiddenPart, hidden_part
from obsdesign.analysis.hidden_samples import reason_against_hidden_samples
from obsdesign.analysis.unbounded_inputs import reason_against_unbounded
from obsdesign.equations.set_membership.gains import SetMembershipGains
from obsdesign.equations.set_membership.pattern import Pattern, nominal_pattern
from obsdesign.problem.options import SetMembershipOptions
from obsdesign.problem.plant import Plant
from obsdesign.problem.problem import Problem


def reason_against(problem: Problem) -> str | None:
    """Reason for which no bounds can be given for the problem; None if they can."""
    if reason := problem.reason_without_noise_bound():
        return reason
    return (
        reason_against_unbounded(problem.plant, "set_membership")
        or reason_against_hidden_samples(problem.plant)
        or _against_window(problem)
    )


def pattern_of(plant: Plant) -> Pattern | str:
    """The nominal pattern of a plant, or the reason for which there is none."""
    return nominal_pattern(SetMembershipGains.from_plant(plant, window=1, steps=1))


def shortest_window(plant: Plant) -> int:
    """The fewest stages whose samples can determine the observable part of the state."""
    hidden = unobservable_part(plant)
    missing = plant.n - (0 if hidden is None else hidden.basis.shape[1])
    if missing == 0:
        return 1
    samples = -(-missing // row_echelon(exact(sampled_matrix(plant)))[1])
    pattern = pattern_of(plant)
    if isinstance(pattern, str) or not any(step.sampled for step in pattern.cycle):
        return samples
    count = samples
    while pattern.fewest_samples(count) < samples:
        count += 1
    return count


def sampled_matrix(plant: Plant) -> Array:
    """C of all sensors, zero where no sample is ever taken."""
    is_blind = plant.sensors[0].measured == "at_jumps" and not plant.events
    return np.zeros_like(plant.outputs.C) if is_blind else plant.outputs.C


def unobservable_part(plant: Plant) -> HiddenPart | None:
    """The part of the state that no sample sees along flow and jumps, exact; None if zero."""
    maps = [plant.flow.A, *(event.G for event in plant.events)]
    return hidden_part(maps, sampled_matrix(plant))


def _against_window(problem: Problem) -> str | None:
    window = problem.options_as(SetMembershipOptions).window
    if window is None or window >= (shortest := shortest_window(problem.plant)):
        return None
    return (
        f"observer.window must be at least {shortest}: fewer stages have fewer samples than it "
        f"takes to determine the state; got {window}."
    )
