"""Guarantees of a design in phrases of a few words.

The sentences of `guarantees` say it in full; a phrase is given where they are.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from lmi.arithmetic.arrays import Entries
from obsdesign.document import Claim
from obsdesign.kinds import GIVING_BOUNDS
from obsdesign.problem.problem import Problem
from obsdesign.verification.parameter_ranges import parameter_ranges

_Proved = Mapping[str, Entries]
# claims of stability for all times that the plant's clocks allow
_STABILITY = (
    "dwell_stability", "sampled_stability", "event_stability", "mode_stability", "step_stability",
    "robust_stability", "strongly_observable",
)  # fmt: skip
# what holds of kinds with one guarantee, where all their claims are proved
_ESSENCE: Mapping[str, str] = {
    "finite_time": "the estimate needs one full window, and no initial state",
    "impulsive_input": "time and weight of an impulse alone in its window are determined",
    "unknown_input": "errors of state and input tend to zero without noise and disturbance, for "
    "sampling intervals of any lengths",
}


def headline(problem: Problem, claims: tuple[Claim, ...]) -> tuple[str, ...]:
    """Phrases that follow from the claims that are proved; none unless `consistent` is."""
    proved = {claim.id: claim.evidence for claim in claims if claim.verdict == "proved"}
    kind = problem.require_kind()
    if "consistent" not in proved:
        return ()
    if kind in _ESSENCE:
        phrases = [_ESSENCE[kind] if len(proved) == len(claims) else ""]
    else:
        phrases = [
            _enclosure(kind, claims), _stability(problem, proved), _spacing(problem, proved),
            _decay(problem, proved),
        ]  # fmt: skip
    return tuple(phrase for phrase in (_assumed(problem), *phrases) if phrase)


def _assumed(problem: Problem) -> str:
    """What a plant with parameters assumes."""
    plant = problem.plant
    if not plant.parameters:
        return ""
    return f"assumes {parameter_ranges(plant)}" + ("" if plant.state is None else ", x in [state]")


def _enclosure(kind: str, claims: tuple[Claim, ...]) -> str:
    verdicts = {claim.id: claim.verdict for claim in claims}
    signs = {verdicts.get(name, "proved") for name in ("flow_positive", "jump_positive")}
    holds = kind in GIVING_BOUNDS and signs == {"proved"}
    return "bounds hold at any spacing of samples" if holds else ""


def _stability(problem: Problem, proved: _Proved) -> str:
    if not any(name in proved for name in _STABILITY):
        return ""
    bounded = problem.kind in GIVING_BOUNDS
    what = "widths stay bounded" if bounded else "the error tends to zero without disturbance"
    times = _times(problem)
    return f"{what} for {times}" if times else what


def _times(problem: Problem) -> str:
    """The dwell times, clocks of events and stays for which it is proved."""
    plant = problem.plant
    listed = [f"{mode.name} for {_range(mode.every, problem)}" for mode in plant.modes]
    for event in plant.events:
        if event.dwell_time is not None and not plant.modes:
            called = f"{event.name} every" if plant.has_tables else "dwell times"
            listed.append(f"{called} {_range(event.dwell_time, problem)}")
    return ", ".join(listed)


def _spacing(problem: Problem, proved: _Proved) -> str:
    """How often samples are needed for the certified widths."""
    limit = proved.get("sampled_width", {}).get("step_limit")
    if limit is not None and math.isfinite(float(limit)):
        return f"widths with a sample every {_in_unit(float(limit), problem)}"
    if "sampled_stability" in proved:
        return f"widths with a sample every {_in_unit(problem.plant.output.sample_period, problem)}"
    if "width" in proved and problem.kind == "set_membership":
        from obsdesign.analysis.set_membership.requirements import pattern_of  # of this kind alone

        pattern = pattern_of(problem.plant)
        return (
            ""
            if isinstance(pattern, str)
            else (f"widths with {pattern.described(problem.names.time_unit)}")
        )
    if "width" in proved and "sampled_width" not in proved and problem.kind == "interval":
        at_jumps = problem.plant.output.measured == "at_jumps"
        return "widths with y measured " + ("at every jump" if at_jumps else "continuously")
    return ""


def _decay(problem: Problem, proved: _Proved) -> str:
    rate = next((proved[name]["in_time"] for name in ("rates", "rate") if name in proved), None)
    if rate is None:
        return ""
    unit = problem.names.time_unit
    size = f"{_rounded_down(rate):g}"
    return f"decay rate at least {size} per {unit}" if unit else f"decay rate at least {size}"


def _in_unit(value: float, problem: Problem) -> str:
    return f"{value:.4g} {problem.names.time_unit}".strip()


def _range(ends: tuple[float, float], problem: Problem) -> str:
    low, high = ends
    if low == high:
        return _in_unit(low, problem)
    if math.isinf(high):
        return f"{_in_unit(low, problem)} or longer"
    return f"{low:.4g} … {_in_unit(high, problem)}"


def _rounded_down(value: float) -> float:
    """A number to three digits, positive ones rounded down."""
    if value <= 0:
        return value
    scale = 10.0 ** (2 - math.floor(math.log10(value)))
    return math.floor(value * scale) / scale
