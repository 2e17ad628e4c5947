"""Windows of impulsive observers: the shortest one that can be proved."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from lmi.arithmetic.balls import exact, inverse, to_float
from lmi.rank.decide import decide_full_rank
from lmi.rank.full_rank import BOX_LIMIT
from lmi.rank.stack import Stack, coordinates
from lmi.rank.witness import check_deficient
from lmi.time_budget import ended, remaining, remark_end
from lmi.verdict import Verdict
from obsdesign.analysis.impulsive_noise import estimate
from obsdesign.equations.estimation_error import plant_data
from obsdesign.equations.impulsive import gains as equations
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.impulsive.noise import quiet_enough

# weight of the past where nothing else says: the error is certified to shrink by a quarter
ALPHA = 1.3
_RANK = 1e-10
# log of the largest alpha that is worth its name
_FASTEST = 200.0
# the least weight that the impulses of a window may have
_SPREAD = 1e7
# a proof that took so many boxes in vain is not repeated in more dimensions
_TIRED = 1000


def base(problem: Problem, strategy: str) -> dict[str, Any]:
    """What every windowed design stores."""
    return plant_data(problem.plant) | {"strategy": strategy, "alpha": weight(problem)}


def weight(problem: Problem, margin: float = 1.0) -> float:
    """alpha as asked for, or so that the decay rate that is asked for follows, or the default."""
    if "alpha" in problem.options:
        return float(problem.options["alpha"])
    rate = margin * float(problem.options.get("decay_rate", 0.0))
    if rate == 0:
        return ALPHA
    if rate * problem.require_dwell_time()[1] > _FASTEST:
        raise InputError(
            f"observer.decay_rate must be at most {_FASTEST:g} / jump.dwell_time[1] here; got "
            f"{problem.options['decay_rate']!r}. Is it in the plant's unit of time?"
        )
    return max(math.exp(rate * problem.require_dwell_time()[1]) * (1 + 1e-6), 1 + 1e-6)


def image_of(G: Any) -> tuple[Any, Any]:
    """(U, S) with G = U S up to rounding: independent columns of G, and what makes up the others.

    For G = 0 one column that nothing comes from.
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
    S = np.linalg.lstsq(U, G, rcond=None)[0]
    S[:, chosen] = np.eye(rank)
    return U, S


@np.errstate(all="ignore")
def windowed(
    problem: Problem,
    gains: Mapping[str, Any],
    label: str,
    certificates: Mapping[str, Mapping[str, Any]] | None = None,
    limit: int = BOX_LIMIT,
) -> Candidate:
    """The candidate with the window that is asked for, or the shortest one that is proved.

    A shorter window that is proved proves every longer one. limit: boxes of a proof that is tried.
    """
    ends = problem.require_dwell_time()
    others = dict(certificates or {})
    numbers = dict(gains) | {
        name: exact(value)
        for name, value in gains.items()
        if isinstance(value, np.ndarray) and value.ndim == 2
    }
    core = equations.core_of(numbers)
    shortest = math.ceil(core.size / problem.plant.p)
    asked = problem.options.get("window")
    if asked is not None and asked > equations.LONGEST_WINDOW:
        raise InputError(
            f"observer.window must be at most {equations.LONGEST_WINDOW} impulses; got {asked}."
        )
    if math.isinf(ends[1]):
        return Candidate(label, dict(gains) | {"window": int(asked or shortest)}, others)
    blocks, verdict, searched = _provable(core, shortest, asked, ends, limit)
    others["strongly_observable"] = {**verdict.evidence, "blocks": blocks}
    found = dict(gains) | {"window": int(asked or blocks)}
    _refuse_lost_digits(problem, float(gains["alpha"]), blocks)
    if verdict.outcome == "proved" and "noise_target" in problem.options:
        found, short = quiet_enough(problem, found)
        others["noise_target"] = short
    if verdict.outcome == "proved" and remaining() > 0:
        others["rate"] = {"estimated": estimate(problem, found)}
    return Candidate(label, found, others, searched=searched)


def _refuse_lost_digits(problem: Problem, alpha: float, blocks: int) -> None:
    """InputError where the oldest of the impulses that are needed would weigh next to nothing."""
    if (blocks - 1) * math.log(alpha) <= math.log(_SPREAD):
        return
    name, value = "alpha", alpha
    if "alpha" not in problem.options:
        name, value = "decay_rate", float(problem.options["decay_rate"])
    raise InputError(
        f"observer.{name} = {value!r} weighs the oldest of {blocks} impulses by "
        f"alpha^{1 - blocks} with alpha = {alpha:.4g}: fewer digits than binary64 has; at most "
        f"alpha = {_SPREAD ** (1 / (blocks - 1)):.4g} can be executed."
    )


def _provable(
    core: equations.Core, shortest: int, asked: int | None, ends: tuple[float, float], limit: int
) -> tuple[int, Verdict, bool]:
    """(blocks, verdict on a window of so many, whether longer ones might still do)."""
    last = equations.most_blocks(core, len(core.C))
    last = last if asked is None else min(asked, last)
    blocks = min(shortest, last)
    for blocks in range(min(shortest, last), last + 1):
        verdict = decide_full_rank(_stack(core, blocks), *ends, limit)
        if verdict.outcome == "proved":
            return blocks, verdict, False
        if _hopeless(core, verdict, *ends):
            return _for_window(core, verdict, blocks, asked or blocks, ends)
        if verdict.evidence.get("boxes", 0) > _TIRED:
            break
        if out_of_time := ended():
            remark_end("windows of impulses", out_of_time, matters=False)
            break
    return blocks, verdict, asked is None or asked > blocks


def _for_window(
    core: equations.Core, verdict: Verdict, blocks: int, asked: int, ends: tuple[float, float]
) -> tuple[int, Verdict, bool]:
    """What defeats a short window at one spacing, as the witness against the one asked for."""
    thetas = verdict.evidence["witness"].get("thetas", [])
    if asked == blocks or not thetas:
        return asked, verdict, False
    longer = _stack(core, asked)
    same = {"thetas": [float(np.mean(thetas))] * longer.thetas}
    return asked, check_deficient(longer, *ends, same), False


def _stack(core: equations.Core, window: int) -> Stack:
    return Stack(*core.stack(window))


def _hopeless(core: equations.Core, verdict: Verdict, low: float, high: float) -> bool:
    """Does what refutes this window refute every longer one too? One spacing, kept for ever."""
    witness = verdict.evidence.get("witness", {})
    thetas = witness.get("thetas", [])
    if verdict.outcome != "refuted":
        return False
    if witness.get("method") == "exact":
        return True  # the state is destroyed unseen by the next jump
    if not thetas or max(thetas) - min(thetas) > 1e-6 * max(thetas):
        return False
    longer = _stack(core, core.size + 1)
    if not coordinates(longer, low, high)[1]:
        return True
    same = {"thetas": [float(np.mean(thetas))] * longer.thetas}
    return check_deficient(longer, low, high, same).outcome == "refuted"
