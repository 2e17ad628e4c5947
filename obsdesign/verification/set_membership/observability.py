"""Whether bounds come down to a limit that does not depend on the start.

They do where the samples of every window determine the state, or where the part that no sample
sees contracts by itself.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from lmi.arithmetic.arrays import Entries, NewEntries
from lmi.arithmetic.balls import Exact, to_float
from lmi.arithmetic.exponential import expm
from lmi.prove.hurwitz import prove_hurwitz
from lmi.verdict import Verdict, proved, refuted, undecided
from obsdesign.analysis.hidden_modes import HiddenPart, not_detectable
from obsdesign.analysis.set_membership.observable_window import determines_state
from obsdesign.analysis.set_membership.requirements import (
    pattern_of,
    sampled_matrix,
    unobservable_part,
)
from obsdesign.column_names import combination
from obsdesign.document import Claim
from obsdesign.equations.set_membership.gains import SetMembershipGains
from obsdesign.equations.set_membership.pattern import Pattern
from obsdesign.equations.time_grid import steps_of
from obsdesign.problem.problem import Problem
from obsdesign.verification.dwell import Dwell, dwell_stability, step_stability

_ZERO = 1e-9  # of the largest entry of a direction
_MOST_STEPS = 400  # of discrete time, of which a map is computed exactly
_LONGEST_MORE = 40  # stages beyond the stored window that are tried


def observability_claims(
    problem: Problem, gains: SetMembershipGains, certificate: Entries, paranoid: bool
) -> tuple[Claim, ...]:
    """`observable_window`, or `attainable` where a part of the state is never seen.

    In a known box what no sample sees is bounded by the box.
    """
    hidden = unobservable_part(problem.plant)
    if hidden is not None and gains.state_lower is not None:
        return (_within_box(hidden),)
    if hidden is not None:
        return (_attainable(problem, hidden, certificate, paranoid),)
    pattern = pattern_of(problem.plant)
    if isinstance(pattern, str):
        return (_at_any_spacing(gains),)
    return (_of_every_window(gains, pattern),)


def _within_box(hidden: HiddenPart) -> Claim:
    count = hidden.basis.shape[1]
    return Claim.from_verdict(
        "attainable",
        f"the part of the state that no sample of the nominal plant sees, of dimension {count}, "
        "stays in the box of x: in steady state no bounds depend on the start",
        "the box of x",
        proved(dimension=count),
    )


def _attainable(
    problem: Problem, hidden: HiddenPart, certificate: Entries, paranoid: bool
) -> Claim:  # fmt: skip
    count = hidden.basis.shape[1]
    if len(problem.plant.events) > 1:
        verdict = undecided("whether it contracts is not decided for several events")
    else:
        verdict = _contracts(problem, hidden, certificate, paranoid)
    return Claim.from_verdict(
        "attainable",
        f"the part of the state that no sample sees, of dimension {count}, contracts by itself: "
        "in steady state no bounds depend on the start",
        "detectability",
        verdict,
    )


def _contracts(
    problem: Problem, hidden: HiddenPart, certificate: Entries, paranoid: bool
) -> Verdict:  # fmt: skip
    """Does a part that no sample sees contract along the flow, and jumps if there are any?"""
    if problem.plant.flow.dt is not None:
        return _contracts_in_steps(problem, hidden, paranoid)
    dwell, plant = _dwell(problem), problem.plant
    G = None if plant.jump is None else plant.jump.G
    ends, names = (dwell.low, dwell.high), problem.names.states_of(plant.n)
    witness = not_detectable(plant.flow.A, G, sampled_matrix(plant), ends, names)
    if witness is not None:
        return refuted(_with_direction(witness, hidden, names))
    if G is not None:
        flow, jump = hidden.maps
        return dwell_stability(flow, jump, dwell, certificate, paranoid)
    verdict = prove_hurwitz(hidden.maps[0])
    if verdict.outcome == "refuted":
        return verdict
    return Verdict(verdict.outcome, {**verdict.evidence, "dimension": hidden.basis.shape[1]})


def _contracts_in_steps(problem: Problem, hidden: HiddenPart, paranoid: bool) -> Verdict:
    """The same in discrete time, for one time between jumps."""
    plant = problem.plant
    step, jump, dt = hidden.maps[0], plant.jump, plant.flow.dt
    assert dt is not None
    cycle = step
    if jump is not None:
        low, high = jump.dwell_time or (0.0, math.inf)
        count = steps_of(low, dt) or 1
        if low != high or count > _MOST_STEPS:
            return undecided(
                "whether it contracts is decided for one time between jumps alone, of at most "
                f"{_MOST_STEPS} steps"
            )
        for _ in range(count - 1):
            cycle = cycle @ step
        cycle = hidden.maps[1] @ cycle
    verdict = step_stability(cycle, paranoid)
    if verdict.outcome != "refuted":
        return verdict
    each = "step" if jump is None else "jump"
    radius = verdict.witness.get("spectral_radius", 1.0)
    reason = (
        f"no observer exists: an unobservable part of the state does not decay; from {each} to "
        f"{each} its factor is {radius:.6g}"
    )
    witness = {"spectral_radius": radius, "reason": reason}
    return refuted(_with_direction(witness, hidden, problem.names.states_of(plant.n), cycle))


def _with_direction(
    witness: Entries, hidden: HiddenPart, names: Sequence[str], cycle: Exact | None = None
) -> NewEntries:  # fmt: skip
    """The witness with a direction of the state that does not contract; true of all windows.

    names (n): of the states; cycle: the map of discrete time that does not contract, None for a
    flow.
    """
    F, H = (to_float(X) for X in (hidden.maps[0], hidden.maps[-1]))
    if cycle is not None:
        values, vectors = np.linalg.eig(to_float(cycle))
        worst = vectors[:, np.abs(values).argmax()]
    elif isinstance(theta := witness.get("theta"), float):
        values, vectors = np.linalg.eig(expm(F * theta) @ H)
        worst = vectors[:, np.abs(values).argmax()]
    else:
        values, vectors = np.linalg.eig(F)
        worst = vectors[:, values.real.argmax()]
    along = to_float(hidden.basis) @ worst
    along = (along / along[np.abs(along).argmax()]).real
    direction = np.where(np.abs(along) < _ZERO, 0.0, along).tolist()
    reason = f"{witness['reason']}; the worst direction is {combination(direction, names)}"
    return {**witness, "reason": reason, "approx_direction": direction, "of_all_gains": True}


def _dwell(problem: Problem) -> Dwell:
    """The range of dwell times; every one without jumps, or where none is stated."""
    jump = problem.plant.jump
    if jump is None:
        return Dwell(math.inf, math.inf)
    return Dwell(0.0, math.inf) if jump.dwell_time is None else Dwell.from_problem(problem)


def _at_any_spacing(gains: SetMembershipGains) -> Claim:
    return Claim.from_verdict(
        "observable_window",
        "the state is observable along flow and jumps: the samples of a window determine it, "
        "except at spacings at which modes alias",
        "observability",
        proved(states=gains.n, method="exact"),
    )


def _of_every_window(gains: SetMembershipGains, pattern: Pattern) -> Claim:
    count = gains.window
    verdict = proved(states=gains.n, windows=len(pattern.windows(count)))
    if not determines_state(gains, pattern, count):
        text = f"the samples of a window of {count} stages are not proved to determine the state"
        verdict = undecided(text)
        longer = range(count + 1, count + _LONGEST_MORE)
        shortest = next((k for k in longer if determines_state(gains, pattern, k)), None)
        if shortest is not None:
            text += f"; the shortest window that does has {shortest} stages"
            verdict = undecided(text, shortest=shortest)
    return Claim.from_verdict(
        "observable_window",
        f"on the nominal pattern, {pattern}, the samples of every window of {count} stages "
        "determine the state",
        "observability",
        verdict,
    )
