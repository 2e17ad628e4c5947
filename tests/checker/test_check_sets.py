"""Widths of set-membership bounds are proved again; on other patterns and plants they are not."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import obsdesign
from lmi.arithmetic.units import balance
from obsdesign.analysis.set_membership.enclosed import upper_rows
from obsdesign.analysis.set_membership.pieces import pieces_of
from obsdesign.bundle import write_bundle
from obsdesign.checker import check_events, check_sets
from obsdesign.design_file import from_dict
from obsdesign.equations.set_membership.gains import SetMembershipGains
from obsdesign.equations.set_membership.pattern import Pattern, nominal_pattern
from tests.checker.test_check_widths import definitions
from tests.systems.checked import CHECK_SETS, answer, changed, evidence, exit_code
from tests.systems.designs import designed, investigated_file
from tests.systems.nominal_patterns import body_of
from tests.systems.random_sets import random_set_problem

CRANE = Path(__file__).parents[2] / "examples" / "gantry_crane_bounds.toml"
Change = Callable[[dict[str, Any]], object]


def _box(*radii: float) -> dict[str, Any]:
    return {"lower": [-r for r in radii], "upper": [*radii]}


def _output(**words: Any) -> dict[str, Any]:
    return {"C": [[1, 0]], "noise_bound": [0.05], "measured": "periodic", "period": 0.1} | words


def _plant(flow: dict[str, Any], output: dict[str, Any], **blocks: Any) -> dict[str, Any]:
    return {"flow": flow, "output": output, **blocks,
            "observer": {"kind": "set_membership", "window": 6}}  # fmt: skip


_FLOW = {"A": [[0, 1], [-1, 0.2]], "disturbance": _box(0.0, 0.1)}
_JUMP = {"G": [[1, 0], [0.2, 0.5]], "disturbance": _box(0.02, 0), "dwell_time": [0.2, "inf"]}
PROBLEMS: dict[str, dict[str, Any]] = {
    "samples": body_of("rand2_21", 0.1, window=8),
    "before": _plant(_FLOW, _output(), jump=_JUMP),
    "after": _plant(_FLOW, _output(jump_measurement="after"), jump=_JUMP),
    "none": _plant(_FLOW, _output(jump_measurement="none"), jump=_JUMP),
    "at jumps": _plant(
        _FLOW, {"C": [[1, 0]], "noise_bound": [0.05], "measured": "at_jumps"}, jump=_JUMP
    ),
    "stiff": _plant(
        {"A": [[-1e3, 1e6], [0, 0.01]], "disturbance": _box(1e3, 0.1)}, _output(C=[[0, 1]])
    ),
    "shaped": _plant(
        {"A": [[0, 1], [-1, -0.1]], "B": [[0], [1]], "D": [[0], [1]], "d_bounds": _box(0.2),
         "disturbance_matrix": [[0.1, 1], [0.7, 0]], "disturbance": _box(0.1, 0)},
        _output(noise_bound=[[-0.01, 0.04]]), jump=_JUMP | {
            "disturbance_matrix": [[0.3], [-0.1]], "disturbance": _box(0.1), "dwell_jitter": 0.3,
        },
    ),
    "discrete": _plant(
        {"A": [[1, 0.1], [-0.1, 1.02]], "disturbance": _box(0.001, 0.01), "dt": 0.05}, _output(),
        jump=_JUMP,
    ),
    "no disturbance": _plant(
        {"A": [[-1, 1], [0, -1]], "disturbance": _box(0, 0)}, _output(noise_bound=[0.0])
    ),
    "an output of nothing": _plant(
        {"A": [[-1, 0], [0, 0.5]], "disturbance": _box(0, 0.1)},
        _output(C=[[1, 0], [0, 1]], noise_bound=[0, 0.2]),
    ),
}  # fmt: skip


def document(name: str) -> Any:
    """The document of a design, signed."""
    if name == "crane":
        design = investigated_file(CRANE).design
        assert design is not None
        return json.loads(json.dumps(design.to_dict()))
    return json.loads(json.dumps(designed(PROBLEMS[name]).to_dict()))


@pytest.mark.parametrize("name", [*PROBLEMS, "crane"])
def test_it_is_proved_again(name: str) -> None:
    body = document(name)
    code, text = answer(body, CHECK_SETS)
    assert code == 0, text
    lines = text.splitlines()
    assert f"at most {tuple(evidence(body, 'width')['always'])}" in lines[0]
    assert ("no observer can guarantee" in lines[1]) == (len(lines) == 3)
    others = "attainable', 'consistent" if name == "stiff" else "consistent', 'observable_window"
    assert lines[-1].startswith(f"not checked: ['{others}'], other times of samples and jumps")


def test_its_sentences_are_its_own() -> None:
    body = document("none")
    text = answer(body, CHECK_SETS)[1]
    assert text.startswith("proved: with a sample every 0.1 and a jump every 2 periods: the width")
    at_jumps = answer(document("at jumps"), CHECK_SETS)[1]
    assert at_jumps.startswith("proved: with a sample and a jump every 0.2: the width")
    assert ", steps cut into 1 pieces" in text
    assert "pieces" not in answer(document("discrete"), CHECK_SETS)[1]
    without = changed(body, lambda d: d["claims"].pop())
    assert evidence(body, "optimal")
    assert "no observer" not in answer(without, CHECK_SETS)[1]
    wider = changed(body, stated("width", always=[9.0, 9.5]))
    assert "at most (9.0, 9.5)" in answer(wider, CHECK_SETS)[1]


def stated(claim: str, **entries: Any) -> Change:
    return lambda d: evidence(d, claim).update(entries)


def in_gains(*path: Any, value: Any) -> Change:
    return entry("gains", *path, value=value)


def entry(*path: Any, value: Any) -> Change:
    """An entry of the file is another."""

    def change(d: dict[str, Any]) -> None:
        block: Any = d
        for name in path[:-1]:
            block = block[name]
        block[path[-1]] = value

    return change


def both(block: str, name: str, value: Any) -> Change:
    """An entry of the problem and of the gains."""

    def change(d: dict[str, Any]) -> None:
        d["problem"][block][name] = d["gains"][name] = value

    return change


def _scaled(value: Any, factor: float) -> Any:
    return [_scaled(x, factor) for x in value] if isinstance(value, list) else factor * value


def multiplied(factor: float) -> Change:
    return lambda d: d["gains"].update(multipliers=_scaled(d["gains"]["multipliers"], factor))


def tube(factor: float, row: int = 0, state: int = 0) -> Change:
    def change(d: dict[str, Any]) -> None:
        evidence(d, "width")["tube"][row][state] *= factor

    return change


def trajectory(name: str, value: Any) -> Change:
    return lambda d: evidence(d, "optimal")["trajectories"].update({name: value})


def unsampled(d: dict[str, Any]) -> None:
    for window in d["gains"]["multipliers"]:
        for stages in window:
            for step in stages:
                step[0] += 1e-12


def louder(d: dict[str, Any]) -> None:
    own = evidence(d, "optimal")["trajectories"]["disturbances"]
    own[0] = [1.0] * len(own[0])


WRONG: list[tuple[str, str, Change]] = [
    ("samples", "a narrower tube", tube(1 - 1e-5)),
    ("samples", "of the other state", tube(1 - 1e-5, state=1)),
    ("before", "of one row", tube(1 - 1e-5, row=1)),
    ("samples", "a tube of zeros", tube(0.0)),
    ("samples", "its sign", tube(-1.0)),
    ("before", "a row is missing", lambda d: evidence(d, "width")["tube"].pop()),
    ("samples", "a lower bound", stated("width", always=[0.1, 0.1])),
    ("samples", "other multipliers", multiplied(0.5)),
    ("samples", "their sign", multiplied(-1.0)),
    ("samples", "none", multiplied(0.0)),
    ("before", "fewer windows", lambda d: d["gains"]["multipliers"].pop()),
    ("before", "their order", lambda d: d["gains"]["multipliers"].reverse()),
    ("before", "where nothing is sampled", unsampled),
    ("samples", "a deviation of no sign", entry("problem", "output", "noise_std", value=[-1.0])),
    ("samples", "one that is a word", entry("problem", "output", "noise_cv", value=["none"])),
    ("samples", "a longer window", in_gains("window", value=9)),
    ("samples", "another one of the problem", entry("problem", "observer", "window", value=7)),
    ("samples", "other directions", in_gains("directions", value=[[1.0, 1.0]])),
    ("samples", "another lag", in_gains("fixed_lag", value=2)),
    ("samples", "more steps", in_gains("steps", value=21)),
    ("samples", "another kind", entry("problem", "observer", "kind", value="interval")),
    ("samples", "a flow of the gains", in_gains("A", 0, 0, value=-0.17)),
    ("samples", "of the problem", entry("problem", "flow", "A", 0, 0, value=-0.17)),
    ("samples", "another output", in_gains("C", 0, 0, value=-0.06)),
    ("before", "another jump", in_gains("G", 0, 0, value=1.1)),
    ("before", "no jump of the gains", lambda d: d["gains"].pop("G")),
    ("shaped", "another known input", in_gains("B", 0, 0, value=1.0)),
    ("samples", "less noise", in_gains("noise_bound", value=[0.04])),
    ("samples", "more noise", entry("problem", "output", "noise_bound", value=[0.06])),
    ("samples", "more of it in both", both("output", "noise_bound", [0.0501])),
    ("shaped", "another centre", in_gains("noise_centre", value=[0.0])),
    ("shaped", "a pair that crosses", entry("problem", "output", "noise_bound", value=[[0.1, 0]])),
    ("samples", "a smaller disturbance", in_gains("flow_upper", 0, value=0.03)),
    ("samples", "a larger one", entry("problem", "flow", "disturbance", "upper", 0, value=0.05)),
    ("before", "of the jump", entry("problem", "jump", "disturbance", "upper", 0, value=0.03)),
    ("before", "of the gains", in_gains("jump_lower", 0, value=-0.01)),
    ("shaped", "its matrix", in_gains("disturbance_matrix", 0, 0, value=0.0)),
    ("shaped", "no matrix of the problem",
     lambda d: d["problem"]["jump"].pop("disturbance_matrix")),
    ("samples", "a matrix that is not due",
     in_gains("disturbance_matrix", value=[[1.0, 0.0], [0.0, 1.0]])),
    ("shaped", "bounds of its image", in_gains("jump_upper", 0, value=0.02)),
    ("shaped", "smaller bounds of d", in_gains("d_upper", value=[0.1])),
    ("shaped", "no bounds of d", lambda d: d["problem"]["flow"].pop("d_bounds")),
    ("shaped", "another jitter", in_gains("dwell_jitter", value=0.4)),
    ("before", "another dwell time", in_gains("dwell_time", value=[0.3, "inf"])),
    ("before", "another pattern", both("jump", "dwell_time", [0.3, "inf"])),
    ("before", "no pattern", both("jump", "dwell_time", [0.21, 0.29])),
    ("before", "no dwell time", lambda d: [
        d["problem"]["jump"].pop("dwell_time"), d["gains"].pop("dwell_time")]),
    ("samples", "another period", both("output", "period", 0.11)),
    ("samples", "of the gains", in_gains("period", value=0.11)),
    ("samples", "no period", both("output", "period", 0.0)),
    ("samples", "another word", both("output", "measured", "continuous")),
    ("samples", "of the gains", in_gains("measured", value="at_jumps")),
    ("before", "when it is read", both("output", "jump_measurement", "after")),
    ("before", "never", both("output", "jump_measurement", "none")),
    ("before", "no word", both("output", "jump_measurement", "later")),
    ("at jumps", "at any dwell time", both("jump", "dwell_time", [0.0, "inf"])),
    ("discrete", "another step", both("flow", "dt", 0.07)),
    ("discrete", "of the gains", in_gains("dt", value=0.1)),
    ("discrete", "too many in a stage", both("flow", "dt", 0.1 / 64)),
    ("samples", "a disturbance outside of its bounds",
     lambda d: evidence(d, "optimal")["trajectories"]["disturbances"][0].__setitem__(-1, 1.0000001)),
    ("samples", "a trajectory that samples notice", louder),
    ("samples", "a larger distance", stated("optimal", least=[0.3747, 0.1])),
    ("before", "another row", trajectory("rows", [2, 0])),
    ("before", "a row from the end", trajectory("rows", [-1, 0])),
    ("before", "rows that are no numbers", trajectory("rows", [True, True])),
    ("samples", "a trajectory less", trajectory("rows", [0])),
    ("samples", "fewer steps", trajectory("steps", 7)),
    ("samples", "other pieces", trajectory("pieces", 8)),
    ("samples", "no pieces", trajectory("pieces", 0)),
    ("samples", "no disturbances", trajectory("disturbances", None)),
]  # fmt: skip


@pytest.mark.parametrize(("name", "what", "change"), WRONG)
def test_what_does_not_hold_is_not_proved(name: str, what: str, change: Change) -> None:
    assert exit_code(changed(document(name), change), check_sets) == 1


TRUE: list[tuple[str, str, Change]] = [
    ("samples", "a wider tube", lambda d: evidence(d, "width").update(
        tube=_scaled(evidence(d, "width")["tube"], 2.0), always=[2.0, 2.0])),
    ("samples", "less noise", lambda d: [
        both("output", "noise_bound", [0.0499])(d), d["claims"].pop()]),
    ("samples", "a smaller distance", stated("optimal", least=[0.3, 0.1])),
    ("samples", "a trajectory that samples notice, made smaller", lambda d: [
        louder(d), stated("optimal", least=[0.01, 0.1])(d)]),
    ("before", "a longer dwell time at most", both("jump", "dwell_time", [0.2, 0.2])),
    ("before", "a dwell time between samples", both("jump", "dwell_time", [0.15, "inf"])),
]  # fmt: skip


@pytest.mark.parametrize(("name", "what", "change"), TRUE)
def test_what_holds_beside_it_is_proved(name: str, what: str, change: Change) -> None:
    assert exit_code(changed(document(name), change), check_sets) == 0


UNREAD: list[tuple[str, Change]] = [
    ("several events", entry("problem", "event", value=[])),
    ("modes", entry("problem", "mode", value=[])),
    ("parameters", entry("problem", "parameter", value=[])),
    ("uncertain entries", entry("problem", "flow", "A_radius", value=[[0.1, 0], [0, 0]])),
    ("effects of parameters", in_gains("effects", value=[])),
    ("a stated box", entry("problem", "state", value=_box(1.0, 1.0))),
    ("an estimated input", in_gains("d_rate", value=[0.1])),
    ("its rate", entry("problem", "flow", "d_bounds", value=_box(1.0) | {"rate": [1.0]})),
    ("impulses of unknown weights", entry("problem", "jump", "H", value=[[1.0], [0.0]])),
    ("another kind", entry("kind", value="interval")),
    ("another name", entry("name", value="any")),
    ("a name that is no text", lambda d: [x.update(name=1) for x in (d, d["problem"])]),
    ("no claim of this program", lambda d: d["claims"].clear()),
    ("a claim twice", lambda d: d["claims"].append(d["claims"][-1])),
]


@pytest.mark.parametrize(("what", "change"), UNREAD)
def test_other_plants_are_not_read(what: str, change: Change) -> None:
    assert exit_code(changed(document("before"), change), check_sets) == 2


@pytest.mark.parametrize("value", [True, None, "1", 1e200, 2**53 + 1, [0.1]])
def test_what_is_no_number_is_refused(value: Any) -> None:
    for path in (("gains", "A", 0, 0), ("gains", "multipliers", 0, 0, 0, 0), ("gains", "period"),
                 ("gains", "noise_bound", 0), ("problem", "jump", "disturbance", "upper", 0),
                 ("problem", "output", "C", 0, 0)):  # fmt: skip
        assert exit_code(changed(document("before"), entry(*path, value=value)), check_sets) == 1


def test_verify_agrees_with_what_is_refused() -> None:
    body = document("before")
    outcome = obsdesign.verify(from_dict(body), paranoid=True)
    assert outcome.verdict == "proved"
    assert "checker" in {claim.id for claim in outcome.claims}
    for change in (tube(1 - 1e-5), multiplied(0.5), louder):
        assert obsdesign.verify(from_dict(changed(body, change))).verdict != "proved"


def test_a_bundle_has_this_program_alone(tmp_path: Path) -> None:
    answers = write_bundle(from_dict(document("before")), tmp_path)
    assert [(each.program.name, each.code) for each in answers] == [("check_sets.py", 0)]
    assert "check_sets.py       proves" in (tmp_path / "README.txt").read_text("utf-8")


# what `verify` computes --------------------------------------------------------------------------


def unproved(seed: int) -> tuple[check_sets.Design, SetMembershipGains, Pattern]:
    """A random plant and random multipliers, as the program reads them; and its pattern."""
    rng = np.random.default_rng([250, seed])
    body = random_set_problem(rng) | {"name": "any"}
    window = body["observer"]["window"] = int(rng.integers(1, 5))
    problem = obsdesign.Problem.from_dict(body)
    gains = SetMembershipGains.from_plant(problem.plant, window=window, steps=20)
    pattern = nominal_pattern(gains)
    assert isinstance(pattern, Pattern)
    windows = pattern.windows(window)
    mu = rng.standard_normal((len(windows), gains.n, window, gains.p))
    mu *= np.array([[step.sampled for step in stages] for stages in windows])[:, None, :, None]
    gains = replace(gains, multipliers=mu)
    document = {
        "format": "obsdesign/design", "version": 1, "name": "any", "kind": "set_membership",
        "problem": problem.to_dict(), "gains": gains.to_document(),
        "claims": [{"id": "width", "verdict": "proved", "evidence": {}}],
    }  # fmt: skip
    text = json.dumps(document, default=np.ndarray.tolist).replace("Infinity", '"inf"')
    design = check_sets.Design(json.dumps(changed(json.loads(text), lambda d: None)))
    design.read()
    return design, gains, pattern


@pytest.mark.parametrize("seed", range(16))
def test_rows_are_those_of_verify(seed: int) -> None:
    """The pattern, the pieces of a step, and what all stages of a window make of half widths."""
    design, gains, pattern = unproved(seed)
    own = check_sets.Pattern(design)
    assert own.cycle == [(Fraction(h), *words) for h, *words in pattern.cycle]
    assert tuple(own.ends) == pattern.ends
    h = own.cycle[0].h
    pieces = [] if gains.dt else check_sets.piece_counts(design, h)
    if not gains.dt:
        assert tuple(pieces) == pieces_of(gains)(float(h))
    system = check_sets.row_maps(design, own, pieces)
    s = np.array([float(a) for a in design.scales])
    assert gains.multipliers is not None
    for (start, M, k), row in zip(
        system, upper_rows(gains, pattern, gains.multipliers), strict=True
    ):
        assert start == row.start
        exact = np.array([[float(a) for a in line] for line in M]) * s / s[:, None]
        assert np.allclose(exact, row.M, rtol=1e-12, atol=1e-300)
        assert np.allclose(np.array([float(a) for a in k]) / s, row.k, rtol=1e-12, atol=1e-300)


@pytest.mark.parametrize("seed", range(20))
def test_units_are_those_of_the_observer(seed: int) -> None:
    """Maps in parts, with zeros, of any scale."""
    rng = np.random.default_rng([251, seed])
    n = int(rng.integers(1, 7))
    maps = rng.standard_normal((2, n, n)) * (rng.random((2, n, n)) < rng.uniform(0.2, 1))
    sizes = 10.0 ** rng.uniform(-9, 9, n)
    maps *= sizes[:, None] / sizes
    own = check_sets.units([[[Fraction(a) for a in row] for row in X] for X in maps])
    assert own == balance(maps).tolist()


def test_an_output_without_noise_shows_what_reaches_it() -> None:
    """The first state is moved by nothing; the twin is moved by the second one, a little."""
    for coupling, is_hidden in ((0.0, True), (1e-9, False)):
        change = both("flow", "A", [[-1.0, coupling], [0.0, 0.5]])
        body = changed(document("an output of nothing"), change)
        design = check_sets.Design(json.dumps(body))
        design.read()
        proposed = evidence(body, "optimal")["trajectories"]
        least = check_sets.prove_least(design, check_sets.Pattern(design), proposed)
        assert (least[1] > 0) == is_hidden


# its own arithmetic ------------------------------------------------------------------------------


def test_a_piece_holds_its_integral(monkeypatch: pytest.MonkeyPatch) -> None:
    """g = a + b s + c s^2 / 2 on [-d/2, d/2], in few bits: it may have any sign, and two zeros."""
    monkeypatch.setattr(check_sets, "BITS", 10)
    rng, d = np.random.default_rng(252), Fraction(3, 4)
    step = check_sets.StepMap(check_sets.ball([[d]]), [check_sets.ball([[d]])], [d])
    step.d, unit, bounds = d, 1 << 10, [0, 0]
    for a, b, c in rng.uniform(-1, 1, (2000, 3)) * 10.0 ** rng.uniform(-2, 0, (2000, 3)):
        sizes = (abs(float(a) * d + float(c) * d**3 / 24), abs(b) * d / 2, abs(c) * d * d / 4)
        total, slope, bend = (int(float(x) * unit) + 1 for x in sizes)
        bound = step.of_piece(total, round(a * unit), slope, bend, 1) / unit
        s = np.linspace(-0.375, 0.375, 2001)
        integral = np.trapezoid(np.abs(a + b * s + c * s * s / 2), s)
        assert bound >= integral - 1e-6
        bounds[int(bound <= integral + 4e-3)] += 1
    assert bounds[1] > bounds[0]  # it is no guess


def test_sizes_and_parts_of_balls() -> None:
    X = check_sets.Ball([[-3, 2], [1, -5]], 2)
    both = check_sets.side_by_side([X, check_sets.Ball([[7], [-8]], 4)])
    assert (both.x, both.radius) == ([[-3, 2, 7], [1, -5, -8]], 4)
    assert check_sets.part(both, 1, 3).x == [[2, 7], [-5, -8]]
    assert check_sets.part(both, 1, 3).radius == 4
    assert (check_sets.magnitude(X).x, check_sets.magnitude(X).radius) == ([[3, 2], [1, 5]], 2)
    assert check_sets.tops(X) == [[5, 4], [3, 7]]


def test_what_it_shares_is_the_same_text() -> None:
    """So that what is tested of one is tested of both."""
    own, other = definitions(check_sets), definitions(check_events)
    shared = set(own) & set(other)
    differing = {name for name in shared if own[name] != other[name]}
    assert differing == {"Design", "prove_width", "prove_design"}
    assert {"Ball", "exponential", "array", "number", "main"} <= shared


@pytest.mark.parametrize("rows", [slice(None), slice(1, None)], ids=["all rows", "one row"])
def test_a_tube_below_zero_bounds_nothing(rows: slice) -> None:
    """Without multipliers the state expands: half widths of -1e6 come back as lower ones."""
    body = json.loads(json.dumps(designed(_plant(
        {"A": [[1.0]], "disturbance": _box(1.0)}, _output(C=[[1.0]], noise_bound=[0.1]),
        jump={"G": [[2.0]], "dwell_time": [0.2, 0.2]},
    )).to_dict()))  # fmt: skip
    assert exit_code(body, check_sets) == 0

    def change(d: dict[str, Any]) -> None:
        for table in d["gains"]["multipliers"][rows]:
            table[:] = _scaled(table, 0.0)
        tube = evidence(d, "width")["tube"]
        for row in tube[rows]:
            row[:] = [-1e6]
        evidence(d, "width")["always"] = [2 * max(row[0] for row in tube)]
        d["claims"] = [claim for claim in d["claims"] if claim["id"] != "optimal"]

    forged = changed(body, change)
    assert exit_code(forged, check_sets) == 1
    verdicts = {claim.id: claim.verdict for claim in obsdesign.verify(from_dict(forged)).claims}
    assert verdicts["width"] == "undecided"
