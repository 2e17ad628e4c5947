"""Candidates with samples as events: gains and coordinates until one is proved."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from lmi.arithmetic.arrays import Array, Entries
from lmi.arithmetic.balls import exact, inverse
from lmi.solvers import Solvers, merged
from obsdesign.equations.interval.width import WidthSystem
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.convex_gain import unmet_constraints
from obsdesign.synthesis.interval.certified import plain_frame, with_zero_gains
from obsdesign.synthesis.interval.forms import gains_of_form
from obsdesign.synthesis.interval.periodic import SampledPlant
from obsdesign.synthesis.interval.sampled_width import propose_samples, sampled_tube
from obsdesign.synthesis.interval.task import GainSearch

# proofs for samples as events that are tried before a candidate is given up as not proved
_MOST_PROOFS = 4
# gains that are tried for samples as events, times n^3
_TRIAL_WORK = 75_000


def sampled_candidates(
    search: GainSearch, form: str, frames: Iterable[Entries]
) -> Iterator[Candidate]:
    """Yield one candidate with samples as events: gain and coordinates that are proved, if any.

    frames: coordinates S (S2, T) to choose from. M, which acts only when a jump meets a sample, is
    zero if open. With `narrowest` the least width is tried first, else the first gain.
    """
    budget, narrow = search.budget, search.objective == "narrowest"
    most = budget.scaled(_TRIAL_WORK) // search.problem.plant.n**3
    trials: list[_SampledTrial] = []
    last, frame = None, plain_frame(search.problem, form)
    for frame in frames:
        for trial in _sampled_trials(search, frame):
            trials.append(trial)
            if not narrow and math.isfinite(trial.cost):
                last = _sampled_candidate(search, form, trial)
                if _is_proved(last):
                    yield last
                    return
        if len(trials) > most or budget.remaining() < 0:
            break
    trials = sorted(trials, key=lambda trial: trial.cost) if narrow else trials[:1]
    for trial in trials[:_MOST_PROOFS]:
        last = _sampled_candidate(search, form, trial)
        if _is_proved(last):
            break
    if last is None and search.user is not None:
        yield unmet_constraints(f"form {form}", "gains were")
        return
    # without any trial, a refutation of zero gains holds for the gains that were not tried too
    yield last or with_zero_gains(search.problem, form, search.given, frame)


@dataclass(frozen=True)
class _SampledTrial:
    """L in the plant's coordinates for coordinates S (S2, T); cost: inf if floats have no tube."""

    cost: float
    L: Array
    frame: Entries
    solvers: Solvers


def _sampled_trials(search: GainSearch, frame: Entries) -> Iterator[_SampledTrial]:
    problem, given = search.problem, search.given
    plant = SampledPlant(problem, frame.get("S"), search.budget, search.user)
    skips_jumps = problem.plant.output.jump_measurement == "none" and plant.G is not None
    gains: Iterable[Array] = (L for _, L in plant.gains())
    if "L" in given:
        gains = [plant.to_z(given["L"])]
    for L in gains:
        tube = sampled_tube(plant.system(L), plant.h, plant.dwell, skips_jumps)
        cost = math.inf if tube is None else plant.width(L)
        yield _SampledTrial(
            cost, given["L"] if "L" in given else plant.outward(L), frame, plant.solvers
        )


def _sampled_candidate(search: GainSearch, form: str, trial: _SampledTrial) -> Candidate:
    problem, given = search.problem, search.given
    searched = "L" not in given or ("S" in trial.frame and "S" not in problem.gains)
    gains = gains_of_form(problem, form, trial.L, given.get("M", 0 * trial.L), trial.frame)
    system = WidthSystem.from_gains(gains, exact, inverse)
    certificate = propose_samples(gains, system)
    value = trial.cost if search.objective == "narrowest" else None
    certificates = {"sampled_stability": certificate}
    solvers: Solvers = () if "L" in given else trial.solvers
    if "tube" in certificate:
        solvers = merged(solvers, ("HiGHS",))
    return Candidate(form, gains, certificates, searched, value, goes_on=True, solvers=solvers)


def _is_proved(candidate: Candidate) -> bool:
    return "tube" in candidate.certificates["sampled_stability"]
