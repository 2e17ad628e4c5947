"""What a program prints as proved or as checked, it proved or checked in that run."""

from __future__ import annotations

import hashlib
import json
from typing import Any

import pytest

from obsdesign.checker import (
    check_design,
    check_events,
    check_gains,
    check_sets,
    check_uncertain,
    check_widths,
)
from tests.checker.test_check_events import document as clocked
from tests.checker.test_check_sets import document as in_sets
from tests.systems.checked import (
    CHECK_GAINS,
    FOLDER,
    PROBLEMS,
    answer,
    body,
    changed,
    exit_code,
)
from tests.systems.designs import designed

RADIUS = [[0.1, 0.0], [0.0, 0.0]]
PROGRAMS = (check_design, check_widths, check_gains, check_uncertain, check_events, check_sets)


def not_checked(document: Any) -> set[str]:
    """Claims that check_design.py lists as not checked, of a design that it proves."""
    code, text = answer(document)
    assert code == 0, text
    listed = text.splitlines()[-1].split("[")[1].split("]")[0]
    return {name.strip("' ") for name in listed.split(",")} - {""}


def claimed(name: str, claim: str) -> dict[str, Any]:
    """A design with a claim more, whatever it says of itself."""
    entry = {"id": claim, "verdict": "proved", "evidence": {}}
    return changed(body(name), lambda d: d["claims"].append(entry))


@pytest.mark.parametrize(
    ("name", "claim"),
    [
        ("point", "hurwitz"),
        ("point", "flow_positive"),
        ("point", "jump_positive"),
        ("point, no jumps", "dwell_stability"),
        ("no jumps, bounds", "jump_positive"),
    ],
)
def test_a_claim_that_was_not_proved_is_listed(name: str, claim: str) -> None:
    assert claim not in {entry["id"] for entry in body(name)["claims"]}
    assert claim in not_checked(claimed(name, claim))


@pytest.mark.parametrize("name", PROBLEMS)
def test_claims_that_were_proved_are_not_listed(name: str) -> None:
    """The twin: with no longest dwell time the flow is proved to decay, too."""
    proved = {"flow_positive", "jump_positive", "hurwitz", "dwell_stability", "decay_rate", "rates"}
    claims = {entry["id"] for entry in body(name)["claims"]}
    assert not_checked(body(name)) == claims - proved


def test_a_decay_rate_is_claimed_where_it_is_an_option() -> None:
    assert exit_code(body("point, decay"), check_design) == 0
    for name in ("point", "cooperative"):
        assert exit_code(claimed(name, "decay_rate"), check_design) == 1
    document = body("point, decay")
    document["claims"] = [entry for entry in document["claims"] if entry["id"] != "decay_rate"]
    assert exit_code(changed(document, lambda d: None), check_design) == 1


def test_problem_and_gains_agree_about_jumps() -> None:
    assert exit_code(body("point, no jumps"), check_design) == 0
    jump = {"G": [[100.0, 0.0], [0.0, 100.0]], "dwell_time": [1.0, 2.0]}
    document = changed(body("point, no jumps"), lambda d: d["gains"].update(jump))
    assert exit_code(document, check_design) == 2
    document = changed(body("point"), lambda d: d["problem"].pop("jump"))
    assert exit_code(document, check_design) == 2


def test_nothing_is_corrected_where_nothing_is_measured() -> None:
    assert any(map(any, body("point")["gains"]["L"]))
    for measured, code in (("continuous", 0), ("at_jumps", 1)):
        document = body("point")
        document["problem"]["output"]["measured"] = measured
        assert exit_code(changed(document, lambda d: None), check_design) == code


@pytest.mark.parametrize("program", PROGRAMS)
def test_integers_that_are_no_doubles_are_refused(program: Any) -> None:
    """They would be printed, and run with, as another number."""
    assert program.number(2**53) == 2**53
    refusal = tuple(getattr(each, "NotProved", None) or check_gains.Difference for each in PROGRAMS)
    for value in (2**53 + 1, -(2**53) - 1, 10**149 + 1, 10**400):
        with pytest.raises(refusal):
            program.number(value)


def signed_with(document: dict[str, Any], value: float) -> dict[str, Any]:
    """The design with one more number in evidence, signed although it may be no number."""
    document["claims"][0]["evidence"]["extra"] = value
    del document["digest"]
    text = json.dumps(document, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return document | {"digest": f"sha256:{hashlib.sha256(text.encode()).hexdigest()}"}


@pytest.mark.parametrize("program", PROGRAMS)
@pytest.mark.parametrize("value", ["NaN", "Infinity", "1e999"])
def test_evidence_that_no_proof_reads_is_finite_too(program: Any, value: str) -> None:
    """JSON has no such numbers, although Python reads them."""
    for entry, code in ((json.loads(value), 2), (1.0, 0)):
        document = uncertain(RADIUS) if program is check_uncertain else body("cooperative")
        if program is check_events:
            document = clocked("no events")
        if program is check_sets:
            document = in_sets("samples")
        assert exit_code(signed_with(document, entry), program) == code


@pytest.mark.parametrize("first", ["C", "noise_bound"])
def test_a_bound_is_due_for_each_output_whatever_stands_first(first: str) -> None:
    for count, code in ((1, 2), (2, 0)):
        assert exit_code(two_outputs(first, count), check_gains) == code


def two_outputs(first: str, count: int) -> dict[str, Any]:
    """Two outputs, of which `count` have bounds in the problem; an entry stands first in it."""
    document = body("shaped inputs")
    for name in ("problem", "gains"):
        block = document[name]["output"] if name == "problem" else document[name]
        block["C"] = [[0.0, 1.0], [1.0, 0.0]]
    document["problem"]["observer"]["gains"] = {}
    document["gains"].update(L=[[0.0, 0.0]] * 2, M=[[0.0, 0.0]] * 2)
    document["gains"].update(noise_bound=[0.2] * 2, noise_centre=[0.1] * 2)
    output = document["problem"]["output"]
    output.update(noise_std=[0.0] * 2, noise_cv=[0.0] * 2, noise_bound=[[-0.1, 0.3]] * count)
    document["problem"]["output"] = {first: output[first], **output}
    return changed(document, lambda d: None)


def observer(name: str, **options: Any) -> dict[str, Any]:
    return changed(body(name), lambda d: d["problem"]["observer"].update(options))


def test_options_that_are_not_checked_are_named() -> None:
    for option in ({"objective": "narrowest"}, {"decay_rate": 0.1}, {"memory": 2}):
        code, text = answer(observer("cooperative", **option), CHECK_GAINS)
        assert (code, text.splitlines()[-1]) == (0, f"not checked: {next(iter(option))}")
    text = answer(body("cooperative"), CHECK_GAINS)[1]
    assert text.splitlines()[-1] == "no option is left unchecked"


def test_the_limit_of_gains_holds_for_those_of_a_schedule() -> None:
    cells = [abs(a) for M in body("schedule")["gains"]["M_cells"] for row in M for a in row]
    assert max(cells) > max(abs(a) for row in body("schedule")["gains"]["M"] for a in row) >= 0
    for limit, code in ((0.999 * max(cells), 1), (max(cells), 0)):
        assert exit_code(observer("schedule", gain_limit=limit), check_gains) == code


def with_rate(block: str, rate: Any) -> dict[str, Any]:
    return changed(body("shaped inputs"), lambda d: d["problem"]["flow"][block].update(rate=rate))


def test_a_rate_of_an_input_is_read_and_named() -> None:
    code, text = answer(with_rate("d_bounds", [1.0]), CHECK_GAINS)
    assert (code, text.splitlines()[-1]) == (0, "not checked: d_bounds.rate")
    for block, rate in (
        ("d_bounds", [-1.0]),
        ("d_bounds", [1.0, 1.0]),
        ("d_bounds", "x"),
        ("disturbance", [1.0]),
    ):
        assert exit_code(with_rate(block, rate), check_gains) == 2


def uncertain(radius: Any) -> dict[str, Any]:
    """A stable plant with A_radius, by itself, and R = I."""
    problem = {
        "flow": {"A": [[-1.0, 0.0], [0.0, -1.0]], "A_radius": RADIUS},
        "output": {"C": [[1.0, 0.0]]},
        "observer": {"kind": "luenberger", "gains": {"L": [[0.0], [0.0]]}},
    }
    document = designed(problem).to_dict()
    return changed(document, lambda d: d["problem"]["flow"].update(A_radius=radius))


@pytest.mark.parametrize(
    "radius",
    [{}, [], None, [[0.1, 0.0]], [[0.1, 0.0, 9.0], [0.0, 0.0]], [[0.1], [0.0]], [[0.1, 0.0], 3]],
)
def test_radii_of_another_size_are_refused(radius: Any) -> None:
    assert exit_code(uncertain(RADIUS), check_uncertain) == 0
    assert exit_code(uncertain(radius), check_uncertain) == 2


def test_dwell_times_are_named_where_there_are_jumps() -> None:
    code, text = answer(uncertain(RADIUS), FOLDER / "check_uncertain.py")
    assert code == 0
    assert "dwell times" not in text
    assert "the box of the state" in text.splitlines()[-1]
