"""One curve per kind of design, in floats: illustration, not proof.

Kinds with jumps: growth of the error from jump to jump, over the dwell time. Without jumps: its
decay. Windows: smallest singular value of the window matrix, or the weight of each sample.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Entries, EntriesByClaim, Matrix
from lmi.arithmetic.balls import exact
from lmi.arithmetic.exponential import absolute_flow, expm
from lmi.arithmetic.spectrum import spectral_radii
from lmi.rank.stack import Stack, approx_margin, coordinates
from obsdesign.document import Design
from obsdesign.equations.estimation_error import (
    flow_error_matrix,
    jump_error_matrix,
    seen_before_jump,
)
from obsdesign.equations.finite_time.gains import FiniteTimeGains
from obsdesign.equations.finite_time.steps import StepWindowGains
from obsdesign.equations.impulsive.formulas import Core
from obsdesign.equations.impulsive.gains import ImpulsiveGains
from obsdesign.equations.impulsive_input import features as impulsive_input
from obsdesign.equations.impulsive_input.gains import IntegralGains, gains_from_document
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.equations.interval.width import WidthSystem
from obsdesign.equations.luenberger.gains import LuenbergerGains
from obsdesign.equations.unknown_input.gains import UnknownInputGains
from obsdesign.verification.dwell import DwellCertificate
from obsdesign.verification.impulsive.uncorrected_blocks import Contraction

_POINTS = 400
# beyond a range of dwell times so much of it is shown, and of an endless one so many shortest ones
_BEYOND, _ENDLESS = 0.15, 4.0


# gains and evidence as a design file has them
_Stored = Entries
_Evidence = EntriesByClaim


@dataclass(frozen=True)
class Curve:
    """Named series (points,) over x, a level to stay below or above, and the proved range.

    steps: values hold from one x to the next. caption: one sentence.
    """

    title: str
    x_label: str
    y_label: str
    x: Matrix
    series: Mapping[str, Matrix]
    caption: str
    level: float | None = None
    proved: tuple[float, float] | None = None
    steps: bool = False


@np.errstate(all="ignore")
def curve_of(design: Design) -> Curve | None:
    """The curve of a design's kind; None where floats have nothing to show.

    What its caption calls proved rests on the verdicts of `design.claims`.
    """
    if "modes" in design.gains:  # no single map shows how modes take turns
        return None
    curve = {
        "interval": _interval,
        "set_membership": _nothing_to_show,
        "luenberger": _luenberger,
        "impulsive": _impulsive,
        "finite_time": _finite_time,
        "impulsive_input": _impulsive_input,
        "unknown_input": _unknown_input,
    }[design.kind](design.gains, {c.id: c.evidence for c in design.claims if c.verdict == "proved"})
    if curve is None or not all(np.isfinite(y).any() for y in curve.series.values()):
        return None
    return curve


def _nothing_to_show(stored: _Stored, evidence: _Evidence) -> Curve | None:
    del stored, evidence
    return None


def _interval(stored: _Stored, evidence: _Evidence) -> Curve | None:
    if "sensors" in stored:  # clocks of their own have no one dwell time to draw it over
        return None
    gains = IntervalGains.from_document(stored)
    system = WidthSystem.from_gains(gains)
    if system.K is not None and gains.period is not None:
        return _growth_from_sample_to_sample(system, gains.period)
    if system.N is None:
        return _decay(system.W)
    return _growth(system.W, system.N, gains.dwell_range, evidence, "width of the bounds")


def _growth_from_sample_to_sample(system: WidthSystem, period: float) -> Curve:
    """Spectral radius of |K e^(A s)| over the time s between samples, if constant."""
    assert system.A is not None
    theta = _around(period, period)
    maps, _ = absolute_flow(system.at_samples[0], system.A, system.f, theta)
    return Curve(
        "Growth of the width of the bounds from sample to sample",
        "time between samples",
        "factor per sample",
        theta,
        {"constant time between samples": spectral_radii(np.nan_to_num(maps))},
        "Below 1 it shrinks from each sample to the next; the design is for the marked one.",
        1.0,
        (period, period),
    )


def _unknown_input(stored: _Stored, evidence: _Evidence) -> Curve | None:
    if "dt" in stored:
        return None
    return _decay(UnknownInputGains.from_document(stored).F)


def _luenberger(stored: _Stored, evidence: _Evidence) -> Curve | None:
    if "dt" in stored:  # the flow of a curve is one of continuous time
        return None
    gains = LuenbergerGains.from_document(stored)
    F = flow_error_matrix(gains.A, gains.L, gains.C)
    if gains.G is None:
        return _decay(F)
    H = jump_error_matrix(gains.G, gains.M, gains.C, gains.jump_measurement)
    return _growth(F, H, gains.dwell_range, evidence, "estimation error")


def _growth(
    F: Matrix, H: Matrix, span: tuple[float, float], evidence: _Evidence, what: str
) -> Curve:
    """Growth from jump to jump over the time between them, if constant, and in the norm of P."""
    low, high = span
    theta = _around(low, high)
    flows = expm(F * theta[:, None, None])
    series: dict[str, Matrix] = {"constant dwell time": spectral_radii(np.nan_to_num(flows @ H))}
    P = DwellCertificate.from_document(evidence.get("dwell_stability", {})).P
    if P is not None:
        root = np.linalg.cholesky(np.asarray(P)).T
        maps = np.linalg.solve(root.T, np.swapaxes(root @ flows @ H, -1, -2))
        norms = np.linalg.norm(np.nan_to_num(maps), ord=2, axis=(1, 2))
        series |= {"worst direction, norm of P": norms}
    marked = "the shaded range is proved, for every order in which dwell times may come"
    marked = marked if "dwell_stability" in evidence else "the design is for the shaded range"
    return Curve(
        f"Growth of the {what} from jump to jump",
        "dwell time",
        "factor per jump",
        theta,
        series,
        f"Below 1 it shrinks from each jump to the next; {marked}.",
        1.0,
        (low, min(high, float(theta[-1]))),
    )


def _around(low: float, high: float) -> Matrix:
    """Dwell times in a range and a little beyond it."""
    if math.isinf(high):
        top = _ENDLESS * low if low > 0 else 10.0
        return np.linspace(0.4 * low, top, _POINTS)
    beyond = _BEYOND * (high - low) or 0.5 * high or 1.0
    return np.linspace(max(low - beyond, 0.0), high + beyond, _POINTS)


def _decay(F: Matrix) -> Curve | None:
    """Decay of the worst unit error, over time."""
    if not len(F):
        return None
    slowest = -float(np.linalg.eigvals(F).real.max())
    end = 6 / slowest if slowest > 0 else 1.0
    t = np.linspace(0.0, end, _POINTS)
    norms = np.linalg.norm(np.nan_to_num(expm(F * t[:, None, None])), ord=2, axis=(1, 2))
    return Curve(
        "What is left of the estimation error",
        "time",
        "of the worst unit error",
        t,
        {"norm of e^(F t)": norms},
        "An error of length 1 at time 0, in its worst direction, without disturbance and noise.",
    )


def _impulsive(stored: _Stored, evidence: _Evidence) -> Curve | None:
    gains = ImpulsiveGains.from_document(stored)
    if gains.table is not None:
        return _quadratic(gains, evidence)
    proof = evidence.get("strongly_observable", {})
    low, high = gains.dwell_range
    core = Core.from_gains(gains, exact)
    stack = Stack(*core.stack(int(proof.get("blocks", gains.window_length))))
    theta = _around(low, high)
    R, full = coordinates(stack, low, high)
    if not full or not stack.thetas:
        return None
    margin = approx_margin(stack, np.repeat(theta[:, None], stack.thetas, axis=1), R)
    return Curve(
        "How well the impulses of one window determine the state",
        "constant spacing of impulses",
        "smallest singular value",
        theta,
        {"of the scaled window matrix": np.asarray(margin)},
        "At 0 a state is unobservable. Shaded: the spacings "
        + (
            "for which it is proved to stay above the dashed level, in every order."
            if proof
            else "of the design."
        ),
        proof.get("margin"),
        (low, min(high, float(theta[-1]))),
    )


def _quadratic(gains: ImpulsiveGains, evidence: _Evidence) -> Curve | None:
    norm = Contraction.from_evidence(evidence.get("contracting", {}), gains.n)
    if norm is None:
        return None
    G, root = gains.jump_matrix, np.linalg.cholesky(norm.P).T
    C = seen_before_jump(G, gains.C, gains.jump_measurement)
    low, high = gains.dwell_range
    theta: Matrix = np.linspace(low, high, _POINTS)
    maps = root @ (G + gains.table_gain(theta) @ C) @ expm(gains.A * theta[:, None, None])
    in_norm = np.linalg.solve(root.T, np.swapaxes(maps, 1, 2))
    return Curve(
        "What is left of the error after an impulse",
        "spacing of impulses",
        "factor, in the norm of P",
        theta,
        {"worst error": np.linalg.norm(in_norm, 2, axis=(1, 2))},
        "With the gain of the cell that the last spacing is in. Shaded: the spacings for which it "
        "is proved to stay below the dashed level.",
        norm.gamma,
        (low, high),
    )


def _finite_time(stored: _Stored, evidence: _Evidence) -> Curve:
    read = StepWindowGains if "dt" in stored else FiniteTimeGains
    gains = read.from_document(stored)
    n, p = gains.n, gains.p
    weights = gains.window_gain.reshape(n, -1, p)
    age: Matrix = gains.period * np.arange(weights.shape[1], dtype=np.float64)[::-1]
    series = {
        f"x{i + 1}" + (f" from y{j + 1}" if p > 1 else ""): weights[i, :, j]
        for i in range(n)
        for j in range(p)
    }
    return Curve(
        "Weight of each sample of the window",
        "age of the sample",
        "weight",
        age,
        series,
        "The estimate is this weighted sum of the samples, plus what the known inputs contribute.",
        0.0,
    )


def _impulsive_input(stored: _Stored, evidence: _Evidence) -> Curve | None:
    gains = gains_from_document(stored)
    A, C, H = gains.A, gains.C, gains.H
    step = gains.window / (_POINTS - 1)
    ages: Matrix = step * np.arange(_POINTS, dtype=np.float64)
    if isinstance(gains, IntegralGains):
        D = flow_error_matrix(A, gains.K, C)
        F = impulsive_input.filtered_system(D, C, gains.exponents)
        response = impulsive_input.impulse_responses(F, H, step, _POINTS)[:, len(A) :]
        what = "features of the window"
    else:
        response = C @ expm(A * ages[:, None, None]) @ H
        what = "measurements"
    sizes = np.linalg.norm(response, axis=1)
    return Curve(
        f"What one unit impulse leaves in the {what}",
        "age of the impulse",
        "size",
        ages,
        {
            f"impulse {k + 1}" if H.shape[1] > 1 else "unit impulse": s
            for k, s in enumerate(sizes.T)
        },
        "Its time and its weight are read from this response.",
    )
