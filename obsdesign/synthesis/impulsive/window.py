"""Windows of impulsive observers: the shortest one that can be proved."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from lmi.arithmetic.arrays import EntriesByClaim, Matrix, Value
from lmi.arithmetic.balls import exact, inverse, to_float
from lmi.rank.decide import decide_full_rank
from lmi.rank.full_rank import BOX_LIMIT
from lmi.rank.stack import Stack, coordinates
from lmi.rank.witness import check_deficient
from lmi.time_budget import Remark, TimeBudget, remark_end
from lmi.verdict import Verdict
from obsdesign.analysis.impulsive_noise import estimate
from obsdesign.equations.impulsive.formulas import Core, most_blocks
from obsdesign.equations.impulsive.gains import LONGEST_WINDOW, ImpulsiveGains
from obsdesign.errors import InputError
from obsdesign.problem.options import ImpulsiveOptions
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.impulsive.noise import quiet_enough

# weight of the past where nothing else says: the error is certified to shrink by a quarter
ALPHA = 1.3
_RANK = 1e-10
_LARGEST_LOG_ALPHA = 200.0
# largest ratio of the weights of the impulses in a window
_LARGEST_WEIGHT_RATIO = 1e7
# a proof that failed with so many boxes is not repeated in more dimensions
_MOST_BOXES_BEFORE_SKIPPING = 1000


def window_gains(problem: Problem, strategy: str, **entries: Value) -> ImpulsiveGains:
    """Gains of a windowed strategy, of one impulse until a window is chosen."""
    alpha = weight(problem)
    return ImpulsiveGains.from_plant(
        problem.plant, strategy=strategy, alpha=alpha, window=1, **entries
    )


def weight(problem: Problem, margin: float = 1.0) -> float:
    """Return alpha: the problem's own, or the one that its decay rate needs, or the default."""
    options, high = problem.options_as(ImpulsiveOptions), problem.require_dwell_time()[1]
    if options.alpha is not None:
        return options.alpha
    rate = margin * options.decay_rate
    if rate == 0:
        return ALPHA
    if rate * high > _LARGEST_LOG_ALPHA:
        raise InputError(
            f"observer.decay_rate must be at most {_LARGEST_LOG_ALPHA:g} / jump.dwell_time[1] "
            f"here; got {options.decay_rate!r}. Is it in the plant's unit of time?"
        )
    return max(math.exp(rate * high) * (1 + 1e-6), 1 + 1e-6)


def factors_of(G: Matrix) -> tuple[Matrix, Matrix]:
    """(U, S) with G = U S up to rounding: U independent columns of G, S the coefficients of all.

    For G = 0 one column, its coefficients zero.
    """
    from scipy.linalg import qr  # slow to import

    sizes = np.abs(G).max(axis=0)
    scale = np.where(sizes > 0, sizes, 1.0)
    upper, order = qr(G / scale, mode="r", pivoting=True)
    diagonal = np.abs(np.diag(upper))
    rank = int(np.sum(diagonal > _RANK * max(float(diagonal.max(initial=0.0)), 1e-300)))
    if not rank:
        return np.eye(len(G))[:, :1], np.zeros((1, len(G)))
    chosen = np.sort(order[:rank])
    U = G[:, chosen]
    rows = np.sort(qr(U.T, mode="r", pivoting=True)[1][:rank])
    back = inverse(exact(U[rows]))
    if back is not None:
        exactly = to_float(back @ exact(G[rows]))
        if not np.any(exact(U) @ exact(exactly) != exact(G)):
            return U, exactly
    S = np.asarray(np.linalg.lstsq(U, G, rcond=None)[0], dtype=np.float64)
    S[:, chosen] = np.eye(rank)
    return U, S


@np.errstate(all="ignore")
def windowed(
    problem: Problem,
    gains: ImpulsiveGains,
    label: str,
    budget: TimeBudget,
    certificates: EntriesByClaim | None = None,
    *,
    limit: int = BOX_LIMIT,
) -> Candidate:
    """The candidate with the problem's own window, or the shortest one that is proved.

    A shorter window that is proved proves every longer one. limit: boxes of a proof that is tried.
    """
    ends, options = problem.require_dwell_time(), problem.options_as(ImpulsiveOptions)
    others = dict(certificates or {})
    core = Core.from_gains(gains, exact)
    shortest = math.ceil(core.size / problem.plant.p)
    given = options.window
    if given is not None and given > LONGEST_WINDOW:
        raise InputError(f"observer.window must be at most {LONGEST_WINDOW} impulses; got {given}.")
    if math.isinf(ends[1]):
        return Candidate(label, replace(gains, window=given or shortest), others)
    decided = _provable(core, shortest, given, ends, limit=limit, budget=budget)
    blocks, verdict = decided.blocks, decided.verdict
    others |= {"strongly_observable": {**verdict.evidence, "blocks": blocks}}
    gains = replace(gains, window=given or blocks)
    _refuse_lost_digits(options, gains.window_weight, blocks)
    if verdict.outcome == "proved" and options.noise_target is not None:
        gains, target = quiet_enough(problem, gains)
        others |= {"noise_target": target}
    if verdict.outcome == "proved" and budget.remaining() > 0:
        others |= {"rate": {"estimated": estimate(problem, gains), "theorem_2_2": {}}}
    return Candidate(label, gains, others, searched=decided.is_searched, remarks=decided.remarks)


def _refuse_lost_digits(options: ImpulsiveOptions, alpha: float, blocks: int) -> None:
    """InputError where the oldest of the impulses that are needed would weigh next to nothing."""
    if (blocks - 1) * math.log(alpha) <= math.log(_LARGEST_WEIGHT_RATIO):
        return
    name, value = "alpha", alpha
    if options.alpha is None:
        name, value = "decay_rate", options.decay_rate
    raise InputError(
        f"observer.{name} = {value!r} weighs the oldest of {blocks} impulses by "
        f"alpha^{1 - blocks} with alpha = {alpha:.4g}: fewer digits than binary64 has; at most "
        f"alpha = {_LARGEST_WEIGHT_RATIO ** (1 / (blocks - 1)):.4g} can be executed."
    )


@dataclass(frozen=True)
class _DecidedWindow:
    """Blocks, the verdict on a window of so many, and whether longer ones might still do."""

    blocks: int
    verdict: Verdict
    is_searched: bool
    remarks: tuple[Remark, ...] = ()


def _provable(
    core: Core,
    shortest: int,
    given: int | None,
    ends: tuple[float, float],
    *,
    limit: int,
    budget: TimeBudget,
) -> _DecidedWindow:
    """The shortest window that is proved, or the last one that was tried."""
    last = most_blocks(core, len(core.C))
    last = last if given is None else min(given, last)
    remarks: tuple[Remark, ...] = ()
    for blocks in range(min(shortest, last), last + 1):
        verdict = decide_full_rank(_stack(core, blocks), *ends, limit, budget=budget)
        if verdict.outcome == "proved":
            return _DecidedWindow(blocks, verdict, False)
        if _no_window_exists(core, verdict, ends):
            return _for_window(core, verdict, blocks, given or blocks, ends)
        if verdict.evidence.get("boxes", 0) > _MOST_BOXES_BEFORE_SKIPPING:
            break
        if remarks := remark_end("windows of impulses", budget.ended(), matters=False):
            break
    return _DecidedWindow(blocks, verdict, given is None or given > blocks, remarks)


def _for_window(
    core: Core, verdict: Verdict, blocks: int, window: int, ends: tuple[float, float]
) -> _DecidedWindow:
    """The witness against a window of so many blocks, extended to a longer window."""
    thetas = verdict.witness.get("thetas", [])
    if window == blocks or not thetas:
        return _DecidedWindow(window, verdict, False)
    longer = _at_one_spacing(_stack(core, window), thetas, ends)
    return _DecidedWindow(window, longer, False)


def _at_one_spacing(stack: Stack, thetas: list[float], ends: tuple[float, float]) -> Verdict:
    """Decide whether a stack is deficient where all spacings are the mean of a witness's."""
    same = {"thetas": [float(np.mean(thetas))] * stack.thetas}
    return check_deficient(stack, *ends, same)


def _stack(core: Core, window: int) -> Stack:
    return Stack(*core.stack(window))


def _no_window_exists(core: Core, verdict: Verdict, ends: tuple[float, float]) -> bool:
    """Whether the witness against this window refutes longer ones too: one spacing for all."""
    witness = verdict.witness
    thetas = witness.get("thetas", [])
    if verdict.outcome != "refuted":
        return False
    if witness.get("method") == "exact":
        return True  # the next jump destroys the unobserved state
    if not thetas or max(thetas) - min(thetas) > 1e-6 * max(thetas):
        return False
    longer = _stack(core, core.size + 1)
    is_spanned = coordinates(longer, *ends)[1]
    return not is_spanned or _at_one_spacing(longer, thetas, ends).outcome == "refuted"
