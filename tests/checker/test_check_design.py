"""The checker proves what is true, and nothing that is made false or is no design."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.checker import check_design, check_gains
from obsdesign.design_file import from_dict
from obsdesign.errors import InputError
from tests.systems.checked import (
    CHECK_DESIGN,
    CHECK_GAINS,
    PROBLEMS,
    answer,
    body,
    changed,
    evidence,
    exit_code,
    point_design,
)

Change = Callable[[dict[str, Any]], object]


def verdict(document: dict[str, Any]) -> str:
    """What `verify` says; "unreadable" where it refuses the file."""
    try:
        return obsdesign.verify(from_dict(document)).verdict
    except InputError:
        return "unreadable"


@pytest.mark.parametrize("name", PROBLEMS)
def test_designs_are_proved_again(name: str) -> None:
    document = body(name)
    code, text = answer(document, CHECK_DESIGN)
    assert code == 0, text
    assert "proved: with y " in text
    assert "not checked: " in text
    assert exit_code(document, check_gains) == 0
    assert verdict(document) == "proved"


def test_its_sentences_are_its_own() -> None:
    document = changed(body("cooperative"), lambda d: d["guarantees"].clear())
    code, text = answer(document)
    assert (code, text.splitlines()[1]) == (
        0,
        "proved: with y measured continuously and at jumps, without disturbances and noise, the width of the bounds tends to zero, for every sequence of dwell times in [0.7, inf)",
    )
    code, text = answer(body("windows, jitter"))
    assert "[0.1, 2.0] that change by at most 0.2 at a time" in text


def set_in(path: str, value: Any) -> Change:
    """A change of one entry: names and positions with slashes between."""

    def change(document: dict[str, Any]) -> None:
        *parents, last = [int(key) if key.isdigit() else key for key in path.split("/")]
        table: Any = document
        for key in parents:
            table = table[key]
        table[last] = value

    return change


def both(path: str, value: Any) -> Change:
    """The same entry of the plant and of the gains: a plant for which the design does not hold."""
    place, name = path.split("/")[0], "/".join(path.split("/")[1:])

    def change(document: dict[str, Any]) -> None:
        set_in(f"problem/{place}/{name}", value)(document)
        set_in(f"gains/{name}", value)(document)

    return change


def certificate(path: str, value: Any, claim: str = "dwell_stability") -> Change:
    return lambda document: set_in(path, value)(evidence(document, claim))


FALSE: list[tuple[str, str, Change]] = [
    ("cooperative", "shorter dwell times", both("jump/dwell_time", [0.3, "inf"])),
    ("cooperative", "a jump that is too large", both("jump/G/1/1", 4.5)),
    ("cooperative", "a flow that grows", both("flow/A/0/0", 0.5)),
    ("cooperative", "P is not positive", certificate("P", [[1.0, 0.0], [0.0, -1.0]])),
    ("cooperative", "P is not symmetric", certificate("P", [[1.0, 0.5], [0.0, 1.0]])),
    ("cooperative", "P is another one", certificate("P", [[1.0, 0.0], [0.0, 1.0]])),
    ("cooperative", "M is missing", set_in("gains/M", [[0.0], [0.0]])),
    ("cooperative", "a sign of the split", set_in("gains/Gn/0/1", -0.5)),
    ("cooperative", "D0 is not A - L C", set_in("gains/D0/0/0", -1.5)),
    ("split", "the split is not that of H", set_in("gains/Gp/0/0", 1.5)),
    ("split", "no upper end", both("jump/dwell_time", [0.0, 3.0])),
    ("coordinates", "singular coordinates", set_in("gains/S", [[1.0, 1.0], [1.0, 1.0]])),
    ("point, decay", "a faster decay", set_in("problem/observer/decay_rate", 9.0)),
    ("point, no jumps", "a flow that grows", both("flow/A/0/0", 30.0)),
    ("schedule", "gains of other cells", lambda d: d["gains"]["M_cells"].reverse()),
    ("schedule", "borders do not increase", lambda d: d["gains"]["dwell_borders"].reverse()),
    ("schedule", "a P too few", lambda d: evidence(d)["P_cells"].pop()),
    ("windows, jitter", "quicker changes", both("jump/dwell_jitter", 0.6)),
    ("windows, jitter", "a window less", lambda d: evidence(d)["windows"].pop()),
    (
        "windows, jitter", "a window twice",
        lambda d: evidence(d)["windows"].append(evidence(d)["windows"][0]),
    ),
    (
        "windows, reduced", "P of another size",
        lambda d: [w.update(P=[[1.0]]) for w in evidence(d)["windows"]],
    ),
]  # fmt: skip


@pytest.mark.parametrize(
    ("name", "change"), [(n, c) for n, _, c in FALSE], ids=[w for _, w, _ in FALSE]
)
def test_twins_that_must_not_be_proved(name: str, change: Change) -> None:
    document = changed(body(name), change)
    assert exit_code(document, check_design) != 0
    assert verdict(document) != "proved"


READ_WRONG: list[tuple[str, Change]] = [
    ("cooperative", both("output/jump_measurement", "cooperative")),
    ("cooperative", set_in("gains/form", "none")),
    ("cooperative", set_in("kind", "interval ")),
    ("cooperative", set_in("version", True)),
    ("cooperative", set_in("version", 1.0)),
    ("cooperative", set_in("format", "obsdesign/problem")),
    ("cooperative", set_in("gains/L/0/0", True)),
    ("cooperative", both("flow/A/1/0", True)),
    ("cooperative", both("jump/dwell_time", [True, "inf"])),
    ("cooperative", both("jump/dwell_time", ["inf", "inf"])),
    ("cooperative", both("jump/dwell_time", [3.0, 1.0])),
    ("cooperative", both("jump/dwell_time", [-1.0, 3.0])),
    ("cooperative", both("flow/A/1/0", "1.0")),
    ("cooperative", both("flow/A", [[-1.0], [1.0, -2.0]])),
    ("cooperative", both("flow/A", [])),
    ("cooperative", both("flow/A/0/0", -1e200)),
    ("cooperative", both("flow/dt", 0.1)),
    ("cooperative", set_in("problem/parameter", [])),
    ("cooperative", set_in("problem/output/measured", "periodic")),
    ("cooperative", set_in("gains/S", [[1.0, 0.0], [0.0, 1.0]])),
    ("cooperative", set_in("gains/M_cells", [[[0.0], [0.0]]])),
    ("cooperative", certificate("P", [["1.0", "0.0"], ["0.0", "1.0"]])),
    ("cooperative", certificate("P", [])),
    ("cooperative", certificate("tails", [[[-1.0, 0.0], [0.0, -1.0]], "x"])),
    ("cooperative", lambda d: d["claims"].append(d["claims"][4])),
    ("cooperative", lambda d: d["claims"].clear()),
    ("point, decay", set_in("problem/observer/decay_rate", -0.2)),
    ("windows, jitter", certificate("windows/0/dwell", {"zero": [0.1, 2.0]})),
    ("windows, jitter", certificate("windows/0/P/0/0", "1")),
]


@pytest.mark.parametrize(("name", "change"), READ_WRONG)
def test_entries_that_are_none_are_refused(name: str, change: Change) -> None:
    """Every word has its list, every number a type; true is not 1."""
    document = changed(body(name), change)
    assert exit_code(document, check_design) != 0
    assert verdict(document) != "proved"


INCONSISTENT: list[tuple[str, Change]] = [
    ("cooperative", set_in("gains/A/0/0", -1.1)),
    ("cooperative", set_in("problem/flow/A/0/0", -1.1)),
    ("cooperative", set_in("gains/flow_lower/0", 0.1)),
    ("cooperative", set_in("problem/flow/disturbance", {"lower": [1.0, 1.0], "upper": [0.0, 2.0]})),
    ("cooperative", both("output/noise_bound", [-0.1])),
    ("cooperative", set_in("problem/output/noise_bound", ["inf"])),
    ("cooperative", set_in("problem/output/noise_std", [-1.0])),
    ("cooperative", set_in("problem/output/measured", "at_jumps")),
    ("cooperative", set_in("problem/observer/gains/M", [[1.0], [2.7]])),
    ("cooperative", set_in("problem/observer/objective", "widest")),
    ("cooperative", set_in("problem/observer/gain_limit", 1.0)),
    ("cooperative", set_in("problem/observer/form", "split")),
    ("cooperative", set_in("problem/observer/unknown", 1.0)),
    ("cooperative", set_in("problem/observer/structure", {"M": [[1.0], [{}]]})),
    ("cooperative", set_in("problem/observer/structure", {"M": [[1.0], ["1"]]})),
    ("cooperative", set_in("problem/observer/width_weights", [1.0, True])),
    ("cooperative", both("jump/dwell_jitter", -1.0)),
    ("cooperative", both("jump/G/0/0", 5e-324)),
    ("cooperative", certificate("dwell_time", [True, "inf"])),
    ("cooperative", set_in("gains/dwell_time", [0.8, "inf"])),
    ("cooperative", set_in("gains/unknown", 1.0)),
    ("cooperative", set_in("problem/jump/H", [[1.0], [0.0]])),
    ("cooperative", set_in("problem/flow/D", [[1.0], [0.0]])),
    ("cooperative", set_in("name", 3)),
    ("no jumps, bounds", set_in("problem/output/measured", "at_jumps")),
    ("no jumps, bounds", set_in("gains/M", [[1.0], [0.0]])),
    ("shaped inputs", set_in("gains/flow_lower/0", 0.0)),
    ("shaped inputs", set_in("gains/disturbance_lower/0", 0.0)),
    ("shaped inputs", set_in("gains/noise_bound/0", 0.1)),
    ("schedule", set_in("problem/observer/schedule", 5)),
    ("schedule", set_in("problem/observer/schedule", [0.5, 0.6, 0.7])),
]


@pytest.mark.parametrize(("name", "change"), INCONSISTENT)
def test_gains_of_another_problem_are_not_confirmed(name: str, change: Change) -> None:
    document = changed(body(name), change)
    assert exit_code(document, check_gains) != 0
    assert verdict(document) != "proved"


def test_texts_that_are_no_designs() -> None:
    cases = [
        "",
        "{}",
        "[]",
        "null",
        "[" * 5000,
        '{"a": 1, "a": 1}',
        json.dumps({"digest": ""}),
        "\ud800"[:0],
    ]
    for text in cases:
        for program in (check_design, check_gains):
            assert exit_code(text, program) == 2
    twice = json.dumps(body("cooperative")).replace('"version": 1', '"version": 1, "version": 1')
    assert answer(twice) == (2, "not read: a key stands twice\n")
    assert answer(twice, CHECK_GAINS)[0] == 2


def test_tails_are_hints_alone() -> None:
    """Whatever stands there, nothing false is proved by it."""
    true, false = body("cooperative"), changed(body("cooperative"), both("jump/G/1/1", 4.5))
    rng = np.random.default_rng(3)
    hostile: list[Any] = [[], [[[0.0, 0.0], [0.0, 0.0]]], [[[1e150, 0.0], [0.0, 1e150]]]]
    for _ in range(20):
        B = rng.standard_normal((2, 2))
        hostile.append([(B @ B.T).tolist()])
    for tails in hostile:
        exit_code(changed(true, certificate("tails", tails)), check_design)
        assert exit_code(changed(false, certificate("tails", tails)), check_design) == 1


def test_a_flow_that_grows_is_no_observer_although_P_falls() -> None:
    """H removes the state that grows: products vanish, and inputs between jumps do not."""
    unit, H = [[1.0, 0.0], [0.0, 1.0]], [[0.0, 0.0], [0.0, 0.5]]
    grows, falls = [[0.1, 0.0], [0.0, -1.0]], [[-0.1, 0.0], [0.0, -1.0]]
    assert exit_code(point_design(grows, H, [0.5, 3.0], {"P": unit}), check_design) == 0
    assert exit_code(point_design(grows, H, [0.5, "inf"], {"P": unit}), check_design) == 1
    assert exit_code(point_design(falls, H, [0.5, "inf"], {"P": unit}), check_design) == 0


def test_equality_is_not_less() -> None:
    one = {"P": [[1.0]]}
    assert exit_code(point_design([[0.0]], [[1.0]], [1.0, 2.0], one), check_design) == 1
    assert exit_code(point_design([[0.0]], [[-1.0]], [1.0, 2.0], one), check_design) == 1
    nearly = 1.0 - 2.0**-53
    assert exit_code(point_design([[0.0]], [[nearly]], [1.0, 2.0], one), check_design) == 0


def test_long_ranges_of_a_flow_that_grows_end() -> None:
    """Numbers double at each squaring: they are refused, not kept."""
    document = point_design([[1.0]], [[1e-3]], [1.0, 1e9], {"P": [[1.0]]})
    assert exit_code(document, check_design) == 1


def test_one_dwell_time_needs_no_certificate() -> None:
    rotation = [[0.0, 5.0], [-5.0, 0.0]]
    assert (
        exit_code(point_design(rotation, [[0.9, 3.0], [0.0, 0.9]], [0.3, 0.3], {}), check_design)
        == 1
    )
    assert (
        exit_code(point_design(rotation, [[0.9, 0.1], [0.0, 0.9]], [0.3, 0.3], {}), check_design)
        == 0
    )
    assert (
        exit_code(point_design(rotation, [[0.9, 0.1], [0.0, 0.9]], [0.3, 0.4], {}), check_design)
        == 1
    )


@pytest.mark.parametrize("edges", [[], [[0, 0, 0.1, 2.0]], True])
def test_edges_are_computed_and_not_read(edges: Any) -> None:
    true, change = body("windows, jitter"), certificate("edges", edges)
    assert exit_code(changed(true, change), check_design) == 0
    false = changed(true, both("jump/dwell_jitter", 0.6))
    assert exit_code(changed(false, change), check_design) == 1


def test_windows_that_overlap_do_not_divide() -> None:
    ends = check_design.interval([0.0, 1.0])
    half = check_design.interval([0.0, 0.5])[1]
    low, high, whole = {0: (ends[0], half)}, {0: (half, ends[1])}, {}
    check_design.check_partition([low, high], {}, ends)
    check_design.check_partition([whole], {}, ends)
    wide = {0: (ends[0], half + half / 2)}
    for windows in (
        [low],
        [low, low],
        [wide, high],
        [low, wide],
        [whole, whole],
        [low, high, high],
    ):
        with pytest.raises(check_design.NotProved):
            check_design.check_partition(windows, {}, ends)


def test_a_stiff_flow_and_a_fast_rotation() -> None:
    stiff = [[-1e4, 0.0], [1.0, -1.0]]
    P = {"P": [[1.0, 0.0], [0.0, 1.0]]}
    assert (
        exit_code(point_design(stiff, [[0.5, 0.0], [0.0, 0.5]], [0.1, "inf"], P), check_design) == 0
    )
    rotation = [[0.0, 300.0], [-300.0, 0.0]]
    assert (
        exit_code(point_design(rotation, [[0.9, 0.0], [0.0, 0.9]], [0.1, 0.3], P), check_design)
        == 0
    )
    assert (
        exit_code(point_design(rotation, [[0.9, 0.5], [0.0, 0.9]], [0.1, 0.3], P), check_design)
        == 1
    )


def test_rates_are_proved_and_higher_ones_are_not() -> None:
    for name in ("cooperative", "point"):
        code, text = answer(body(name))
        stated = evidence(body(name), "rates")
        assert code == 0
        assert f"to at most {stated['per_jump']!r} of itself" in text
        assert f"like e^(-{stated['in_time']!r} t)" in text
        for rate, value in (
            ("per_jump", 0.99 * stated["per_jump"]), ("in_time", 1.05 * stated["in_time"]),
            ("per_jump", 1.0), ("per_jump", -0.5), ("in_time", -1.0), ("in_time", "inf"),
            ("P_per_jump", [[1.0, 0.0], [0.0, -1.0]]),
        ):  # fmt: skip
            document = changed(body(name), certificate(rate, value, "rates"))
            assert exit_code(document, check_design) == 1
            assert verdict(document) != "proved"


def test_rates_by_windows() -> None:
    """Without a P of their own they are in the norms of the windows."""
    true = body("windows, jitter")
    stated = evidence(true, "rates")
    assert exit_code(true, check_design) == 0
    for rate, value in (
        ("per_jump", stated["per_jump"] ** 1.2),
        ("in_time", stated["in_time"] * 1.2),
    ):
        assert exit_code(changed(true, certificate(rate, value, "rates")), check_design) == 1


def in_other_units(document: dict[str, Any], d: list[float], second: float) -> dict[str, Any]:
    """The design of the same point observer for states in units d, and another unit of time."""
    D = np.diag(d)
    gains, inverse = document["gains"], np.diag([1 / a for a in d])
    A, G, C = (np.array(gains[name]) for name in ("A", "G", "C"))
    L, M = np.array(gains["L"]), np.array(gains["M"])
    new = {
        "A": inverse @ A @ D / second, "G": inverse @ G @ D, "C": C @ D,
        "L": inverse @ L / second, "M": inverse @ M,
    }  # fmt: skip
    proof = copy.deepcopy(evidence(document))
    for name in ("P", "tails"):
        if name in proof:
            proof[name] = (D @ np.array(proof[name]) @ D).tolist()
    low, high = gains["dwell_time"]
    ends = [low * second, high if high == "inf" else high * second]
    result = point_design(new["A"].tolist(), new["G"].tolist(), ends, proof)
    result["gains"].update({name: X.tolist() for name, X in new.items()})
    result["problem"]["output"]["C"] = new["C"].tolist()
    return changed(result, lambda d: None)


@pytest.mark.parametrize("second", [2.0**-40, 1.0, 2.0**40])
@pytest.mark.parametrize("d", [[1.0, 1.0], [2.0**30, 2.0**-30]])
def test_units_of_states_and_time_do_not_count(d: list[float], second: float) -> None:
    true = in_other_units(body("point"), d, second)
    assert exit_code(true, check_design) == 0
    G = [[3 * a for a in row] for row in true["gains"]["G"]]
    false = changed(true, lambda document: document["gains"].update(G=G))
    assert exit_code(false, check_design) == 1
