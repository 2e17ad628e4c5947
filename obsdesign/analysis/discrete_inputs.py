"""Unknown inputs in discrete time: what a problem must state."""

from __future__ import annotations

from obsdesign.problem.problem import Problem


def reason_against_inputs(problem: Problem) -> str | None:
    """Reason against an unknown-input observer for a problem in discrete time, or None."""
    plant = problem.plant
    for name in problem.options.to_document():
        return f"observer.{name} is not available with flow.dt: there is nothing to differentiate."
    if problem.gains:
        return "observer.gains is not available for kind 'unknown_input' with flow.dt."
    if plant.jump is not None:
        return f"{plant.stated('jump')} is refused by kind 'unknown_input'."
    if reason := problem.reason_without("flow.D"):
        return reason
    output, dt = plant.output, plant.flow.dt
    if dt is None or output.measured != "periodic" or output.sample_period > 1.5 * dt:
        entry = plant.stated("output.period")
        return (
            f"{entry} must be flow.dt for kind 'unknown_input': between samples that are further "
            "apart any input may act."
        )
    return None
