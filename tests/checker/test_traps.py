"""Ways in which a checker is led to accept what is false: each is refused, beside its true twin."""

from __future__ import annotations

import json
import math
from fractions import Fraction
from types import ModuleType
from typing import Any

import pytest

from obsdesign.checker import check_design, check_events, check_gains, check_widths
from tests.checker.test_check_design import both, certificate, set_in, verdict
from tests.checker.test_check_events import document as clocked
from tests.checker.test_check_widths import example
from tests.systems.checked import body, changed, evidence, exit_code, point_design

# words, truth values, numbers --------------------------------------------------------------------

LEAVES = [
    ("cooperative", name, (0, 0)) for name in ("A", "C", "G", "L", "M", "D0", "D1", "Gp", "Gn")
]
LEAVES += [("coordinates", "S", (0, 0)), ("schedule", "M_cells", (0, 0, 0))]
LEAVES += [("schedule", "dwell_borders", (0,)), ("cooperative", "dwell_time", (0,))]
LEAVES += [("windows, jitter", "dwell_jitter", ())]


@pytest.mark.parametrize(("name", "gain", "place"), LEAVES)
@pytest.mark.parametrize("value", [True, None, "1", [], {}])
def test_every_gain_is_made_of_numbers(
    name: str, gain: str, place: tuple[int, ...], value: Any
) -> None:
    path = "/".join(["gains", gain, *map(str, place)])
    document = changed(body(name), set_in(path, value))
    assert exit_code(document, check_design) != 0


@pytest.mark.parametrize("value", [True, 1.0, "1", 2, None])
def test_the_version_is_an_integer(value: Any) -> None:
    for document, program in (
        (body("cooperative"), check_design), (example("degue_4_1"), check_widths),
        (clocked("one event"), check_events),
    ):  # fmt: skip
        assert exit_code(document, program) == 0
        assert exit_code(changed(document, set_in("version", value)), program) == 2


PROGRAMS = [
    ("cooperative", check_design), ("degue_4_1", check_widths), ("one event", check_events),
]  # fmt: skip


def true_design(name: str) -> Any:
    return clocked(name) if name == "one event" else example(name)


@pytest.mark.parametrize(("name", "program"), PROGRAMS)
def test_nothing_is_read_that_was_not_signed(name: str, program: ModuleType) -> None:
    document = true_design(name)
    text = json.dumps(document)
    assert exit_code(text, program) == 0
    assert exit_code(json.dumps(document | {"name": "another"}), program) == 2
    assert exit_code(json.dumps(document | {"digest": document["digest"][:-1]}), program) == 2
    assert exit_code(text.replace('{"format"', '{"name": "x", "format"', 1), program) == 2


@pytest.mark.parametrize(("name", "program"), PROGRAMS)
def test_letters_beyond_ascii_are_signed_as_they_are(name: str, program: ModuleType) -> None:
    document = changed(true_design(name), lambda d: d.update(name="θ"))
    assert exit_code(document, program) == 0


@pytest.mark.parametrize(("name", "program"), PROGRAMS)
@pytest.mark.parametrize(
    ("entry", "value"), [("format", "obsdesign/problem"), ("kind", "finite_time"), ("kind", None)]
)
def test_other_files_are_not_read(name: str, program: ModuleType, entry: str, value: Any) -> None:
    assert exit_code(changed(true_design(name), set_in(entry, value)), program) == 2


@pytest.mark.parametrize(("name", "program"), PROGRAMS[:2])
@pytest.mark.parametrize("measured", ["periodic", "", None, True])
def test_words_have_no_other_branch(name: str, program: ModuleType, measured: Any) -> None:
    """L = 0, so that nothing but the word decides."""
    for word, code in (("at_jumps", 0), (measured, 2)):
        document = without_sampling(true_design(name))
        document["problem"]["output"]["measured"] = word
        assert exit_code(changed(document, lambda d: None), program) == code


def without_sampling(document: Any) -> Any:
    """The design with L = 0 for the same A - L C, and no width by samples."""
    gains = document["gains"]
    for i, row in enumerate(gains["A"]):
        for j in range(len(row)):
            row[j] -= sum(a * c[j] for a, c in zip(gains["L"][i], gains["C"], strict=True))
    gains["L"] = [[0.0] * len(gains["C"]) for _ in gains["A"]]
    document["claims"] = [claim for claim in document["claims"] if claim["id"] != "sampled_width"]
    return document


@pytest.mark.parametrize(("name", "program"), PROGRAMS[:2])
@pytest.mark.parametrize("word", ["cooperative", "", None, "After"])
def test_when_a_jump_is_measured_is_a_known_word(name: str, program: ModuleType, word: Any) -> None:
    document = true_design(name)
    document["gains"]["M"] = [[0.0] for _ in document["gains"]["M"]]
    document["gains"]["jump_measurement"] = word
    assert exit_code(changed(document, lambda d: None), program) == 1


@pytest.mark.parametrize(("name", "program"), PROGRAMS[:2])
def test_blocks_that_a_program_does_not_know(name: str, program: ModuleType) -> None:
    for path in ("flow/dt", "jump/modes", "output/sees", "parameter", "event"):
        assert exit_code(changed(true_design(name), set_in(f"problem/{path}", 1.0)), program) == 2


@pytest.mark.parametrize(("name", "program"), PROGRAMS[:2])
def test_jumps_are_those_of_the_problem(name: str, program: ModuleType) -> None:
    document = changed(true_design(name), lambda d: d["problem"].pop("jump"))
    assert exit_code(document, program) == 2
    document = changed(true_design(name), lambda d: d["gains"].pop("G"))
    assert exit_code(document, program) == 2


def test_vectors_of_other_kinds_are_not_read() -> None:
    proof = {"vector": [1.0, 1.0], "side": "left", "form": "before_jump"}
    document = point_design([[-1.0, 0.0], [0.0, -1.0]], DEAD, [0.5, 3.0], proof)
    for kind, code in (("luenberger", 0), ("finite_time", 2)):
        assert exit_code(changed(document, set_in("kind", kind)), check_widths) == code


# certificates ------------------------------------------------------------------------------------

FALLS = {"P": [[1.0, 0.0], [0.0, 1.0]]}
DEAD = [[0.0, 0.0], [0.0, 0.5]]  # the first state is reset at each jump


def decaying(ends: Any, rate: float, proof: Any) -> Any:
    """A design of rates -0.1 and -1 between jumps, with a decay rate as option and claim."""
    document = point_design([[-0.1, 0.0], [0.0, -1.0]], DEAD, ends, FALLS)
    document["problem"]["observer"]["decay_rate"] = rate
    document["claims"].append({"id": "decay_rate", "verdict": "proved", "evidence": proof})
    return changed(document, lambda d: None)


def test_late_times_need_a_flow_that_decays_at_the_claimed_rate() -> None:
    """P falls for e^((F + r I) T) H whatever F + r I does to the first state."""
    for rate, ends, code in (
        (0.05, [0.5, "inf"], 0), (0.2, [0.5, 3.0], 0), (0.2, [0.5, "inf"], 1), (0.1, [0.5, "inf"], 1),
    ):  # fmt: skip
        assert exit_code(decaying(ends, rate, FALLS), check_design) == code


def test_so_does_a_rate_of_the_error() -> None:
    """`rates`, with dwell times up to 3 and up to infinity."""
    for ends, rate, code in (([0.5, 3.0], 0.2, 0), ([0.5, "inf"], 0.05, 0), ([0.5, "inf"], 0.2, 1)):
        document = point_design([[-0.1, 0.0], [0.0, -1.0]], DEAD, ends, FALLS)
        stated = {"per_jump": 0.9, "in_time": rate}
        document["claims"].append({"id": "rates", "verdict": "proved", "evidence": stated})
        assert exit_code(changed(document, lambda d: None), check_design) == code


@pytest.mark.parametrize(
    ("entry", "value"),
    [
        ("per_jump", True), ("per_jump", 0.0), ("per_jump", 1.0), ("per_jump", "inf"),
        ("per_jump", None), ("per_jump", -0.9), ("in_time", True), ("in_time", -0.05), ("in_time", None),
    ],
)  # fmt: skip
def test_a_rate_is_a_number_of_its_range(entry: str, value: Any) -> None:
    document = point_design([[-0.1, 0.0], [0.0, -1.0]], DEAD, [0.5, 3.0], FALLS)
    stated = {"per_jump": 0.9, "in_time": 0.05}
    for entries, code in ((stated, 0), (stated | {entry: value}, 1)):
        claim = {"id": "rates", "verdict": "proved", "evidence": entries}
        whole = changed(document, lambda d, own=claim: d["claims"].append(own))
        assert exit_code(whole, check_design) == code


@pytest.mark.parametrize("rate", [True, -0.1, "0.1", None, []])
def test_a_decay_rate_is_a_number(rate: Any) -> None:
    document = decaying([0.5, "inf"], 0.05, FALLS)
    assert exit_code(document, check_design) == 0
    assert (
        exit_code(changed(document, set_in("problem/observer/decay_rate", rate)), check_design) == 1
    )


@pytest.mark.parametrize(
    "tails", [True, [True], [[[True, 0.0], [0.0, 1.0]]], [[[1.0, 0.5], [0.0, 1.0]]], [[1.0]], {"0": 1}]
)  # fmt: skip
def test_tails_are_symmetric_matrices_of_numbers(tails: Any) -> None:
    document = body("cooperative")
    assert exit_code(document, check_design) == 0
    assert exit_code(changed(document, certificate("tails", tails)), check_design) == 1


def test_a_tail_of_another_size_proves_nothing() -> None:
    for tail, code in (([[1.0]], 1), ([[1.0, 0.0], [0.0, 1.0]], 0)):
        proof = {"P": [[1.0, 0.0], [0.0, 1.0]], "tails": [tail]}
        document = point_design([[-1.0, 0.0], [0.0, -1.0]], DEAD, [0.5, "inf"], proof)
        assert exit_code(document, check_design) == code


def test_no_certificate_is_none() -> None:
    for proof in ({}, {"windows": []}, {"P": None}, {"P": []}, {"P": [[]]}):
        document = point_design([[-1.0, 0.0], [0.0, -1.0]], DEAD, [0.5, 3.0], proof)
        assert exit_code(document, check_design) == 1


@pytest.mark.parametrize("cell", [[0.5, 0.5], [0.4, 1.0], [2.0, 3.5], [True, 3.0], ["inf", "inf"]])
def test_cells_are_inside_of_the_range(cell: Any) -> None:
    def design(first: Any) -> Any:
        P = FALLS["P"]
        windows = [{"dwell": {"0": first}, "P": P}, {"dwell": {"0": [1.0, 3.0]}, "P": P}]
        return point_design([[-1.0, 0.0], [0.0, -1.0]], DEAD, [0.5, 3.0], {"windows": windows})

    assert exit_code(design([0.5, 1.0]), check_design) == 0
    assert exit_code(design(cell), check_design) == 1


@pytest.mark.parametrize("offset", ["101", "-101", "zero", "0.0"])
def test_offsets_are_near_integers(offset: str) -> None:
    P, ends = FALLS["P"], [0.5, 3.0]
    for name, code in (("100", 0), ("-100", 0), (offset, 1)):
        windows = [{"dwell": {name: ends}, "P": P}]
        document = point_design([[-1.0, 0.0], [0.0, -1.0]], DEAD, ends, {"windows": windows})
        assert exit_code(document, check_design) == code


# schedules ---------------------------------------------------------------------------------------


def scheduled(second: float, jitter: float, P: Any, **gains: Any) -> Any:
    """x' = 0, x+ = 1/2 x for dwell times below 1 and `second` x for those up to 2."""
    document = point_design([[0.0]], [[0.5]], [0.5, 2.0], {})
    stated = {"C": [[1.0]], "M_cells": [[[0.0]], [[0.5 - second]]], "dwell_borders": [1.0]}
    document["gains"].update(stated | {"dwell_jitter": jitter} | gains)
    document["problem"]["jump"]["dwell_jitter"] = jitter
    evidence(document).update(P_cells=P)
    return changed(document, lambda d: None)


def test_cells_of_a_schedule_by_their_neighbours() -> None:
    """From cell i to j: h_j^2 P_j < P_i, wherever j can follow i."""
    P = [[[1.0]], [[3.0]]]
    for second, code in ((0.5, 0), (0.57, 0), (0.58, 1), (-0.57, 0), (-0.58, 1)):  # 3 h^2 < 1
        assert exit_code(scheduled(second, 9.0, P), check_design) == code
    for wrong in ([[[1.0]]], [[[1.0]], [[-3.0]]], [[[1.0]], [[3.0]], [[3.0]]], [[[0.0]], [[3.0]]]):
        assert exit_code(scheduled(0.5, 9.0, wrong), check_design) == 1


@pytest.mark.parametrize("borders", [[0.5], [2.0], [0.4], [2.1], [1.0, 1.5], [True]])
def test_borders_increase_inside_of_the_range(borders: Any) -> None:
    P = [[[1.0]], [[3.0]]]
    assert exit_code(scheduled(0.5, 9.0, P), check_design) == 0
    assert exit_code(scheduled(0.5, 9.0, P, dwell_borders=borders), check_design) == 1


def test_cells_that_the_jitter_keeps_apart() -> None:
    """Three cells: the third follows the first alone where the jitter is the middle's length."""
    for jitter, code in ((0.4, 0), (0.6, 1)):
        document = scheduled(0.5, jitter, [[[1.0]], [[2.0]], [[4.5]]])
        document["gains"].update(M_cells=[[[0.0]]] * 3, dwell_borders=[1.0, 1.5])
        assert exit_code(changed(document, lambda d: None), check_design) == code


def test_times_next_to_a_border_count_to_both_cells() -> None:
    """x grows by e^(1/2 T) up to the border at 1, and a little beyond it."""
    document = scheduled(0.1, 9.0, [[[1.0]], [[1.0]]])
    border = Fraction(1) + check_design.BORDER
    for share, code in ((1 - 1e-10, 0), (1 - 2e-9, 0), (1 - 1e-9 / 4, 0), (1 + 1e-9, 1)):
        # |H| e^(T / 2) < 1 up to the border and its room: e^(BORDER / 2) = 1 + 2e-9
        gain = math.exp(-0.5 * float(border)) * share
        document["gains"]["A"] = document["problem"]["flow"]["A"] = [[0.5]]
        document["gains"]["G"] = document["problem"]["jump"]["G"] = [[gain]]
        document["gains"]["M_cells"] = [[[0.0]], [[gain - 0.1]]]
        assert exit_code(changed(document, lambda d: None), check_design) == code


def moving(rate: float, gains: Any, ends: Any, P: Any, tails: Any = ()) -> Any:
    """x' = rate x, x+ = a gain of two x, for dwell times below 1 and beyond."""
    document = scheduled(0.1, 9.0, P)
    document["gains"]["A"] = document["problem"]["flow"]["A"] = [[rate]]
    for block in (document["gains"], document["problem"]["jump"]):
        block["G"], block["dwell_time"] = [[gains[0]]], ends
    document["gains"]["M_cells"] = [[[0.0]], [[gains[0] - gains[1]]]]
    evidence(document)["tails"] = list(tails)
    return changed(document, lambda d: None)


def test_each_cell_is_proved_from_its_first_time_to_its_last() -> None:
    """|gain| e^(rate T) < 1 at the end of a cell where it is largest, borders with their room."""
    room, P = float(check_design.BORDER), [[[1.0]], [[1.0]]]
    for rate, ends, cells in (
        (0.5, [0.5, 2.0], (1 + room, 2.0)), (-0.5, [0.5, 2.0], (0.5, 1 - room)),
    ):  # fmt: skip
        for k, worst in enumerate(cells):
            for share, code in ((1 - 5e-10, 0), (1 + 5e-10, 1)):
                gains = [0.1, 0.1]
                gains[k] = math.exp(-rate * worst) * share
                assert exit_code(moving(rate, gains, ends, P), check_design) == code


def test_matrices_of_a_schedule_are_positive() -> None:
    """-4 e^(-T / 5) < -1, where x grows at each jump."""
    for sign, gain, code in ((1.0, 0.5, 0), (-1.0, 2.0, 1)):
        P, tail = [[[sign]], [[sign]]], [[1.0]]
        document = moving(-0.1, [gain, gain], [0.5, 2.0], P, [tail])
        assert exit_code(document, check_design) == code


# what `verify` says of the same ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "gain"), [("schedule", "M_cells/0/0/0"), ("schedule", "dwell_borders/0"),
                       ("coordinates", "S/0/0"), ("cooperative", "C/0/0")],
)  # fmt: skip
def test_verify_takes_no_truth_values_either(name: str, gain: str) -> None:
    document = changed(body(name), set_in(f"gains/{gain}", True))
    assert verdict(document) != "proved"
    assert exit_code(document, check_gains) != 0


def test_a_range_of_times_is_refused_whole() -> None:
    for ends in ([True, 3.0], [0.5, True], [3.0, 0.5], [-0.5, 3.0], ["inf", "inf"], [0.5], None):
        document = changed(body("split"), both("jump/dwell_time", ends))
        assert exit_code(document, check_design) != 0
