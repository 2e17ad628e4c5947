"""Widths of bounds are proved again; narrower ones, and those of other plants, are not."""

from __future__ import annotations

import ast
import copy
import json
import math
from collections.abc import Callable
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import obsdesign
from lmi.arithmetic.exponential import expm
from obsdesign.checker import check_design, check_widths
from obsdesign.design_file import from_dict
from tests.systems.checked import (
    CHECK_WIDTHS,
    answer,
    body,
    changed,
    evidence,
    exit_code,
    point_design,
)
from tests.systems.designs import investigated_file

EXAMPLES = Path(__file__).parents[2] / "examples"
NAMES = (
    "degue_4_1", "degue_4_2", "degue_4_2_coordinates", "degue_4_2_two_coordinates",
    "degue_corollary_4",
)  # fmt: skip
Change = Callable[[dict[str, Any]], object]


@cache
def _text(name: str) -> str:
    design = investigated_file(EXAMPLES / f"{name}.toml").design
    assert design is not None
    return json.dumps(design.to_dict())


def example(name: str) -> Any:
    """The document of an example's design, or of one of the plants for tests."""
    return json.loads(_text(name)) if name in NAMES else copy.deepcopy(body(name))


def verdict(document: dict[str, Any]) -> str:
    """What `verify` says."""
    return obsdesign.verify(from_dict(document)).verdict


@pytest.mark.parametrize("name", [*NAMES, "no jumps, bounds", "no jumps, widths", "shaped inputs"])
def test_widths_are_proved_again(name: str) -> None:
    document = example(name)
    code, text = answer(document, CHECK_WIDTHS)
    assert code == 0, text
    assert "the width comes" in text
    assert "not checked: " in text
    assert verdict(document) == "proved"


def test_its_sentences_are_its_own() -> None:
    document = changed(example("degue_4_1"), lambda d: d["guarantees"].clear())
    text = answer(document, CHECK_WIDTHS)[1].splitlines()
    stated = evidence(document, "sampled_width")
    always = ", ".join(map(repr, stated["always"]))
    assert text[2].startswith(
        f"proved: with samples at most {stated['step_limit']!r} apart and at jumps, the"
    )
    assert f"and ({always}) at any time, for every sequence of dwell times in [0.7, inf)" in text[2]


def scaled(claim: str, name: str, factor: float) -> Change:
    """All entries of a vector of a claim, times a factor."""

    def change(document: dict[str, Any]) -> None:
        stated = evidence(document, claim)
        stated[name] = [value * factor for value in stated[name]]

    return change


def constant(name: str, factor: float) -> Change:
    def change(document: dict[str, Any]) -> None:
        row = evidence(document, "width")["constant_dwell"][0]
        row[name] = [value * factor for value in row[name]]

    return change


VECTORS = ("tube", "after_jump", "before_jump", "always")
LOWERED = [
    (name, scaled(claim, vector, 0.9999))
    for name in ("degue_4_1", "degue_4_2_two_coordinates")
    for claim in ("width", "sampled_width")
    for vector in VECTORS
]
LOWERED += [
    ("degue_4_1", constant(name, 1 - 1e-9)) for name in ("before_jump", "after_jump", "mean")
]
LOWERED += [("no jumps, widths", scaled("width", name, 0.9999)) for name in ("tube", "always")]


@pytest.mark.parametrize(("name", "change"), LOWERED)
def test_narrower_widths_are_not_proved(name: str, change: Change) -> None:
    document = changed(example(name), change)
    assert exit_code(document, check_widths) == 1
    assert verdict(document) != "proved"


def in_gains(name: str, value: Any) -> Change:
    return lambda document: document["gains"].update({name: value})


def noise(factor: float) -> Change:
    return lambda d: in_gains("noise_bound", [b * factor for b in d["gains"]["noise_bound"]])(d)


def certificate(claim: str, **entries: Any) -> Change:
    return lambda document: evidence(document, claim).update(entries)


OTHERS: list[tuple[str, str, Change]] = [
    ("degue_4_1", "shorter dwell times", in_gains("dwell_time", [0.69, "inf"])),
    ("degue_4_1", "more noise", noise(1.001)),
    ("degue_4_1", "negative noise", noise(-1.0)),
    ("degue_4_1", "a larger disturbance", in_gains("flow_upper", [0.101, 0.1])),
    ("degue_4_1", "a larger one at jumps", in_gains("jump_lower", [-0.3, -0.301])),
    ("degue_4_1", "bounds that cross", in_gains("flow_upper", [-0.2, 0.1])),
    ("degue_4_1", "a jump that is larger", in_gains("G", [[2.001, 1.0], [1.0, 3.0]])),
    ("degue_4_1", "a flow that grows", in_gains("A", [[1.0, 0.0], [1.0, -2.0]])),
    ("degue_4_1", "a sign of a split", in_gains("Gn", [[0.0, -0.1], [0.0, 0.0]])),
    ("degue_4_1", "an unknown word", in_gains("jump_measurement", "between")),
    ("degue_4_1", "an unknown form", in_gains("form", "none")),
    ("degue_4_1", "rarer samples", certificate("sampled_width", step_limit=0.17)),
    ("degue_4_1", "another limit", in_gains("step_limit", 0.2)),
    ("degue_4_1", "no limit", certificate("sampled_width", step_limit="inf")),
    ("degue_4_1", "no tube", certificate("width", tube=[])),
    ("degue_4_1", "a tube below zero", scaled("width", "tube", -1.0)),
    ("degue_4_1", "true for a number", certificate("width", tube=[True, 1e3])),
    ("degue_4_1", "an empty tube", certificate("width", tube=[0.0, 0.0])),
    ("degue_4_2", "longer dwell times", in_gains("dwell_time", [0.0, 5.1])),
    ("degue_4_2", "a split of another matrix", in_gains("Gp", [[0.0, 0.0], [0.0, 0.8]])),
    ("degue_4_2_coordinates", "other coordinates", in_gains("S", [[1.0, 0.0], [0.0, 1.0]])),
    ("degue_4_2_two_coordinates", "negative", in_gains("T", [[0.0, 0.0], [0.0, -1.0]])),
    ("shaped inputs", "a wider input", in_gains("disturbance_upper", [0.21, 0.3])),
    ("shaped inputs", "no column", in_gains("disturbance_matrix", [[0.1], [0.7]])),
    ("no jumps, widths", "a disturbance", in_gains("flow_upper", [1.0, 1.0])),
]


@pytest.mark.parametrize(
    ("name", "change"), [(n, c) for n, _, c in OTHERS], ids=[w for _, w, _ in OTHERS]
)
def test_twins_that_must_not_be_proved(name: str, change: Change) -> None:
    assert exit_code(example(name), check_widths) == 0
    assert exit_code(changed(example(name), change), check_widths) != 0


def test_a_jump_that_forgets_all_but_adds_more_than_the_tube() -> None:
    """N = 0: what comes after a jump is h alone, and has to be below the tube, too."""
    for share, code in ((0.5, 0), (1.5, 1)):
        document = example("degue_4_1")
        document["claims"] = [c for c in document["claims"] if c["id"] not in ("sampled_width",)]
        stated, gains = evidence(document, "width"), document["gains"]
        stated["constant_dwell"] = []
        zeros = [[0.0, 0.0], [0.0, 0.0]]
        gains.update(G=zeros, Gp=zeros, Gn=zeros, M=[[0.0], [0.0]])
        gains["jump_lower"] = [0.0, 0.0]
        gains["jump_upper"] = [0.0, share * stated["tube"][1]]
        assert exit_code(changed(document, lambda d: None), check_widths) == code


def test_signs_that_a_form_needs_though_widths_would_do() -> None:
    """With wide bounds: F = D0 - D1 with D1 > 0 is a split, and not cooperative."""
    document = example("degue_4_1")
    evidence(document, "width")["constant_dwell"] = []
    for claim in ("width", "sampled_width"):
        for name in VECTORS:
            scaled(claim, name, 1.5)(document)
    assert exit_code(changed(document, lambda d: None), check_widths) == 0
    document["gains"]["A"][0][1], document["gains"]["D1"][0][1] = -1e-6, 1e-6
    for form, code in (("cooperative", 1), ("split", 0)):
        assert exit_code(changed(document, in_gains("form", form)), check_widths) == code
    document["gains"]["D1"][0][1], document["gains"]["D0"][0][1] = 0.0, -1e-6
    assert exit_code(changed(document, in_gains("form", "split")), check_widths) == 1


def test_a_program_that_proves_nothing_reads_nothing() -> None:
    entry = {"id": "width", "verdict": "proved", "evidence": {"vector": [1.0]}}
    document = changed(body("point"), lambda d: d["claims"].append(entry))
    assert exit_code(document, check_widths) == 2
    assert exit_code(document, check_design) == 0


def test_designs_without_widths_are_not_read() -> None:
    for name in ("split", "point"):
        assert exit_code(body(name), check_widths) == 2
    document = changed(example("degue_4_1"), lambda d: d["problem"].update(parameter=[]))
    assert exit_code(document, check_widths) == 2


def test_claims_that_were_not_proved_are_listed() -> None:
    code, text = answer(example("degue_4_1"), CHECK_WIDTHS)
    listed = text.splitlines()[-1].split("[")[1].split("]")[0]
    claims = {claim["id"] for claim in example("degue_4_1")["claims"]}
    assert code == 0
    proved = {"width", "sampled_width", "flow_positive", "jump_positive"}
    assert {name.strip("' ") for name in listed.split(",")} == claims - proved


# paths of positive systems -----------------------------------------------------------------------

Numbers = list[list[float]]


def fractions(X: Any) -> Any:
    return [[Fraction(float(a)) for a in row] for row in X]


def below(W: Any, f: Any, start: Any, bound: Any, low: float, high: float, X: Any = None) -> bool:
    """Is X u(t) < bound proved for u' = W u + f from start; X = I where it is missing?"""
    X = np.eye(len(W)) if X is None else np.array(X)
    f, start = (fractions(np.reshape(v, (-1, 1))) for v in (f, start))
    rows = [
        [a / Fraction(float(b)) for a in row] for row, b in zip(fractions(X), bound, strict=True)
    ]
    ends = Fraction(low), math.inf if math.isinf(high) else Fraction(high)
    try:
        check_widths.Path(fractions(W), f, start).prove(rows, ends)
    except check_widths.NotProved:
        return False
    return True


def largest(W: Any, f: Any, start: Any, low: float, high: float) -> Any:
    """The largest u(t) on a grid; of all later times where there is no end."""
    n = len(f)
    Z = np.zeros((n + 1, n + 1))
    Z[:n, :n], Z[:n, n] = W, f
    end = min(high, low + 4.0)
    times = np.append(np.linspace(low, end, 4001), np.linspace(end, min(high, 80.0), 2001))
    paths = (expm(Z * times[:, None, None]) @ np.append(start, 1.0))[:, :n]
    peak = paths.max(axis=0)
    return np.maximum(peak, np.linalg.solve(-np.array(W), f)) if math.isinf(high) else peak


SYSTEMS = [
    ([[-1.0, 0.0], [1.0, -2.0]], [0.0, 0.0], [1.0, 0.01]),
    ([[-1.0, 0.0], [1.0, -2.0]], [0.2, 0.1], [3.0, 0.01]),
    ([[-1.0, 0.5], [1.0, -2.0]], [1.0, 0.1], [0.1, 0.2]),
    ([[-900.0, 5.0], [1.0, -0.4]], [30.0, 0.0], [9.0, 1.0]),
    ([[-0.3, 0.1], [0.2, -0.5]], [0.01, 0.3], [0.2, 0.01]),
    ([[-50.0, 0.0, 0.0], [50.0, -3.0, 0.0], [0.0, 3.0, -0.1]], [0.0, 0.1, 0.0], [2.0, 1.0, 0.1]),
]


@pytest.mark.parametrize(("W", "f", "start"), SYSTEMS)
def test_peaks_of_paths(W: Any, f: Any, start: Any) -> None:
    for low, high in ((0.0, 2.0), (0.05, math.inf)):
        peak = largest(W, f, start, low, high)
        assert below(W, f, start, peak * 1.00001 + 1e-9, low, high)
        for i in range(len(peak)):
            shares = np.where(np.arange(len(peak)) == i, 0.9999, 1.01)
            assert not below(W, f, start, shares * peak, low, high)


def test_a_flow_that_grows_is_bounded_for_a_while() -> None:
    W, f, start = [[0.5, 0.2], [0.1, 0.3]], [0.1, 0.0], [1.0, 1.0]
    peak = largest(W, f, start, 0.0, 3.0)
    assert below(W, f, start, 1.000001 * peak, 0.0, 3.0)
    assert not below(W, f, start, 1.000001 * peak, 0.0, 3.00001)
    assert not below(W, f, start, 1e9 * peak, 0.0, math.inf)


def test_equality_is_not_less_and_signs_are_due() -> None:
    assert not below([[0.0]], [0.0], [1.0], [1.0], 0.0, 1.0)
    assert below([[0.0]], [0.0], [1.0], [1.0 + 2.0**-52], 0.0, 1.0)
    assert not below([[-1.0, -0.1], [0.0, -1.0]], [0.0, 0.0], [1.0, 1.0], [9.0, 9.0], 0.0, 1.0)
    assert not below([[-1.0]], [-0.1], [1.0], [9.0], 0.0, 1.0)
    assert not below([[-1.0]], [0.0], [-1.0], [9.0], 0.0, 1.0)
    assert not below([[-1.0]], [0.0], [1.0], [9.0], 0.0, 1.0, [[-1.0]])


def test_a_jump_that_forgets_all_has_a_width_though_the_flow_grows() -> None:
    """N = 0: only a longest dwell time bounds the width between jumps."""
    for high, expected in ((2.0, True), (math.inf, False)):
        assert below([[1.0]], [0.0], [1.0], [9.0], 0.0, high) == expected
    assert not below([[1.0]], [0.0], [1.0], [9.0], 0.0, math.inf, [[0.0]])


def test_slow_paths_are_no_shorter() -> None:
    """The same path in another unit of time, in which all rates are far below 1."""
    W, f, start = np.array([[0.5, 0.2], [0.1, 0.3]]), np.array([0.1, 0.0]), [1.0, 1.0]
    peak = largest(W, f, start, 0.0, 3.0)
    for unit in (2.0**-30, 2.0**30):
        assert below(W * unit, f * unit, start, 1.000001 * peak, 0.0, 3.0 / unit)
        assert not below(W * unit, f * unit, start, 0.999999 * peak, 0.0, 3.0 / unit)


def test_remainders_bound_what_they_stand_for() -> None:
    """Scalar: u = e^(w t), of which a box proves any bound above its end, and none below it."""
    one, h, d = [[Fraction(1)]], Fraction(1, 4), check_widths.DEGREE
    for w in (Fraction(3, 2), Fraction(-3, 2), Fraction(0)):
        path = check_widths.Path([[w]], [[Fraction(0)]], one)
        w = path.W[0][0]
        top = math.exp(max(w, 0) * h)
        for share, expected in ((1 + 1e-6, True), (1 - 1e-12, False)):
            path.X, path.remainders = [[1 / Fraction(top * share)]], {}
            rows = [check_widths.ball([[w**k * path.X[0][0]]]) for k in range(d + 1)]
            assert path.is_box(rows, [[abs(w) ** (d + 1)]], h) == expected
        assert not path.is_box(rows, [[Fraction(10**9)]], h)
        path.X = one
        terms = sum(w**k * h**k / math.factorial(k) for k in range(d + 1))
        series = sum(w**k * h**k / math.factorial(k) for k in range(40))
        assert series - terms <= path.remainder_map(h)[0][0] * abs(w) ** (d + 1)


def test_no_box_is_longer_than_a_flow_that_grows_allows() -> None:
    """(I/h - W)^-1 has a sign below zero, or does not exist, for a long h."""
    path = check_widths.Path(fractions([[2.0]]), fractions([[0.0]]), fractions([[1.0]]))
    path.X = fractions([[1.0]])
    assert path.W == [[1]]
    assert path.remainder_map(Fraction(1, 2)) != []
    for h in (Fraction(1), Fraction(2)):
        assert path.remainder_map(h) == []


# stability by a vector ---------------------------------------------------------------------------


def vector_proof(side: str, form: str, v: Any) -> dict[str, Any]:
    return {"vector": v, "side": side, "form": form}


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("form", ["before_jump", "after_jump"])
def test_vectors(side: str, form: str) -> None:
    F, H = [[-2.0, 0.5], [0.3, -1.5]], [[0.9, 0.3], [0.2, 1.1]]
    v = vector_proof(side, form, [1.0, 1.1])
    for ends in ([0.4, 3.0], [0.4, "inf"]):
        assert exit_code(point_design(F, H, ends, v), check_widths) == 0
        assert exit_code(point_design(F, H, [0.0, ends[1]], v), check_widths) == 1
    ends = [0.4, 3.0]
    for proof in (
        vector_proof(side, form, [1.0, -1.1]), vector_proof(side, form, [1.0]),
        vector_proof("up", form, [1.0, 1.1]), vector_proof(side, "at", [1.0, 1.1]),
    ):  # fmt: skip
        assert exit_code(point_design(F, H, ends, proof), check_widths) == 1
    wrong = [[-2.0, -0.5], [0.3, -1.5]]
    assert exit_code(point_design(wrong, H, ends, v), check_widths) == 1
    assert exit_code(point_design(F, [[0.9, -0.3], [0.2, 1.1]], ends, v), check_widths) == 1


def test_each_program_leaves_the_other_its_certificates() -> None:
    F, H = [[-2.0, 0.5], [0.3, -1.5]], [[0.9, 0.3], [0.2, 1.1]]
    by_vector = point_design(F, H, [0.4, 3.0], vector_proof("left", "before_jump", [1.0, 1.1]))
    assert exit_code(by_vector, check_design) == 2
    assert exit_code(body("point"), check_widths) == 2
    cells = changed(by_vector, lambda d: d["gains"].update(M_cells=[[[0.0], [0.0]]]))
    assert exit_code(cells, check_widths) == 2


@pytest.mark.parametrize("seed", range(6))
def test_vectors_against_products_of_many_maps(seed: int) -> None:
    """A vector that the maps of some dwell time do not shrink is not accepted."""
    rng = np.random.default_rng(seed)
    F = rng.uniform(0, 1, (3, 3)) - np.diag(rng.uniform(1, 3, 3))
    H, v = rng.uniform(0, 1, (3, 3)), rng.uniform(0.5, 1.5, 3)
    maps = expm(F * np.linspace(0.1, 2.0, 200)[:, None, None]) @ H
    largest_ratio = float(np.max(v @ maps / v))
    for share, code in ((0.999, 0), (1.001, 1)):
        scaled_H = (H * share / largest_ratio).tolist()
        proof = vector_proof("left", "before_jump", v.tolist())
        assert (
            exit_code(point_design(F.tolist(), scaled_H, [0.1, 2.0], proof), check_widths) == code
        )


# what it shares with check_design.py -------------------------------------------------------------


def definitions(program: Any) -> dict[str, str]:
    """Source of the functions and classes of a program."""
    text = Path(program.__file__).read_text("utf-8")
    return {
        node.name: ast.get_source_segment(text, node) or ""
        for node in ast.parse(text).body
        if isinstance(node, ast.FunctionDef | ast.ClassDef)
    }


def test_what_it_shares_with_the_first_program_is_the_same_text() -> None:
    """So that what is tested of one is tested of both."""
    own, first = definitions(check_widths), definitions(check_design)
    shared = set(own) & set(first)
    assert {name for name in shared if own[name] != first[name]} == {"Design", "prove_design"}
    assert {"Ball", "Flow", "exponential", "width_map", "error_maps", "array"} <= shared


@pytest.mark.parametrize(("scale", "code"), [(1.0, 0), (0.9999, 1)])
def test_one_dwell_time_with_a_flow_that_grows(scale: float, code: int) -> None:
    """A range that is one time is its own proof; a smaller bound is refused there too."""
    document = json.loads(_at_one_time())
    document = changed(
        document, lambda d: evidence(d, "width").update(
            before_jump=[scale * a for a in evidence(d, "width")["before_jump"]]
        )
    )  # fmt: skip
    assert exit_code(document, check_widths) == code


@cache
def _at_one_time() -> str:
    problem = obsdesign.load_problem(EXAMPLES / "degue_corollary_4.toml").to_dict()
    problem["jump"]["dwell_time"] = [3.0, 3.0]
    return json.dumps(obsdesign.design(obsdesign.Problem.from_dict(problem)).to_dict())


def test_sentences_say_when_y_is_measured() -> None:
    _, text = answer(example("degue_4_1"), CHECK_WIDTHS)
    assert "with y measured continuously and at jumps, the width comes" in text
    assert " apart and at jumps, the width comes" in text
    _, text = answer(example("degue_corollary_4"), CHECK_WIDTHS)
    assert "with samples at jumps, the width comes" in text
