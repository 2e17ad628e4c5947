"""Widths where a sensor is silent around a window of uncertain time: samples in it do not count."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

import obsdesign
from lmi.arithmetic.balls import to_float
from lmi.arithmetic.exponential import expm
from lmi.bounds.graph_tube import Least
from obsdesign.analysis.interval.uncertain_widths import UncertainSystem
from obsdesign.analysis.interval.uncertain_widths_additive import UncertainAdditiveSystem
from obsdesign.analysis.interval.uncertain_widths_general import UncertainGeneralSystem, turns
from obsdesign.document import Design
from obsdesign.equations.interval.clock_gains import ClockedIntervalGains
from obsdesign.problem.problem import Problem
from obsdesign.runtime import from_design
from obsdesign.runtime.base import Sample

ERROR, GAP, APART = 0.05, 0.9, 2.3
# two states that a dose enters with opposite signs, their sum flows into a measured one
PAIR: dict[str, Any] = {
    "flow": {
        "A": [[-1, 0, 0], [0, -1, 0], [1, 1, -0.05]],
        "disturbance": {"lower": [0, 0, -0.5], "upper": [0, 0, 0.5]},
    },
    "event": [
        {
            "name": "dose", "E": [[1], [-1], [0]], "input_bound": [2000], "every": [2, 2.5],
            "time_error": ERROR,
        }
    ],
    "sensor": [{"name": "s", "C": [[0, 0, 1]], "noise_bound": 0.01, "every": [0, GAP]}],
    "observer": {"kind": "interval"},
}  # fmt: skip
# the same twice: a leaking tank that is read, each event of which takes a part out
EMPTIED: dict[str, Any] = {
    "flow": {"A": [[-0.05]], "disturbance": {"lower": [-0.5], "upper": [0.5]}},
    "event": [{"name": "draw", "G": [[0.9]], "every": [2, 2.5], "time_error": ERROR}],
    "sensor": [{"name": "s", "C": [[1]], "noise_bound": 0.01, "every": [0, GAP]}],
    "observer": {"kind": "interval"},
}


@cache
def design_of(name: str) -> Design:
    design = obsdesign.design(Problem(**{"pair": PAIR, "emptied": EMPTIED}[name]))
    assert design.claims[-1].id == "late_width"
    assert design.claims[-1].verdict == "proved"
    return design


def test_a_sample_in_a_window_does_not_shorten_the_silence_behind_it() -> None:
    """Samples a gap before, at, and a gap behind each stamp; the width just before the last."""
    design, flow = design_of("pair"), np.array(PAIR["flow"]["A"])
    stamps = APART * np.arange(1, 41)
    happened = stamps + 0.03 * (-1) ** np.arange(len(stamps))
    jump = np.array([2000.0, -2000.0, 0.0])

    def row(t: float, *, is_read: bool, is_dose: bool = False) -> Sample:
        x = sum((expm(flow * (t - s)) @ jump for s in happened if s <= t), np.zeros(3))
        w = np.array([2000.0]) if is_dose else None
        y = np.array([x[2] if is_read else np.nan])
        return Sample(t, y, None, w, is_dose, None, (0,) if is_dose else ())

    rows = [row(0.0, is_read=True), row(0.5, is_read=True), row(1.3, is_read=True)]
    for s in stamps.tolist():
        rows += [row(s - GAP, is_read=True), row(s, is_read=True, is_dose=True)]
        rows += [row(s + GAP - 0.001, is_read=False), row(s + GAP, is_read=True)]
    observer: Any = from_design(design)
    state = observer.init(0.0, lower=[-1] * 3, upper=[1] * 3)
    listed = list(observer.run(state, rows))
    assert {each.status for each in listed[2:-2]} <= {"ok"}
    far = [each for each in listed if np.abs(stamps - each.t).min() > ERROR][60:]
    widest = np.max([each.upper - each.lower for each in far], axis=0)
    assert (widest <= design.claims[-1].evidence["always"]).all()
    # silent for a gap on both sides: more than one gap and the window could have made of it
    assert widest[2] > 1.5 * GAP


def system_of(design: Design) -> UncertainSystem:
    gains = ClockedIntervalGains.from_document(design.gains)
    if not turns(gains):
        return UncertainAdditiveSystem(gains)
    return UncertainGeneralSystem(gains, tuple(design.claims[-1].evidence["sizes"]["before"]))


def smallest(w: Any, stages: tuple[Least, ...]) -> Any:
    for stage in stages:
        w = np.min([to_float(N) @ w + to_float(k) for N, k in stage.maps], axis=0)
    return w


@pytest.mark.parametrize("name", ["pair", "emptied"])
@pytest.mark.parametrize("chance", [0.0, 0.5, 1.0])
def test_widths_of_any_clocks_stay_below_the_claim(name: str, chance: float) -> None:
    """The comparison system itself, between windows; chance: of times that are not the longest."""
    design, rng = design_of(name), np.random.default_rng(5)
    system, evidence = system_of(design), design.claims[-1].evidence
    W, f, n = to_float(system.W), to_float(system.f), len(system.f)
    shortest, longest = system.dwell(0)
    largest, w = np.zeros(n), np.zeros(n)

    def later(w: Any, t: float) -> Any:
        whole = np.zeros((n + 1, n + 1))
        whole[:n, :n], whole[:n, n] = W, f
        return (expm(whole * t) @ np.append(w, 1.0))[:n]

    def silence() -> float:
        return GAP * (1.0 if rng.random() >= chance else rng.uniform(0.2, 1))

    for k in range(150):
        left = shortest if rng.random() >= chance else rng.uniform(shortest, longest)
        times = [0.0]
        while (t := times[-1] + silence()) < left - GAP:
            times.append(t)
        times.append(min(left - silence(), times[-1] + GAP))
        for step in np.diff(times).tolist():
            w = later(w, step)
            largest = np.maximum(largest, w) if k > 50 else largest
            w = smallest(w, (system.sampled(0),))
        w = later(w, left - times[-1])
        largest = np.maximum(largest, w) if k > 50 else largest
        w = smallest(w, system.happened((0,)))
    assert (largest <= np.array(evidence.get("body", evidence["always"])) * (1 + 1e-9)).all()
    assert largest[-1] > 1.4 * GAP
