"""What the programs print of a proof: when it holds, what else the file claims, the exit code."""

from __future__ import annotations

import json
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from obsdesign.checker import check_design, check_widths
from tests.systems.checked import body, changed, point_design

F, H = [[-1.0, 0.0], [0.0, -1.0]], [[0.5, 0.0], [0.0, 0.5]]
PROOFS = {
    check_design: {"P": [[1.0, 0.0], [0.0, 1.0]]},
    check_widths: {"vector": [1.0, 1.0], "side": "left", "form": "before_jump"},
}
PROGRAMS = list(PROOFS)


def lines(program: ModuleType, document: Any) -> list[str]:
    """Sentences of a document with a change, signed anew."""
    text = json.dumps(changed(document, lambda d: None))
    return list(program.prove_design(program.Design(text)))


def claimed(document: Any, name: str, **evidence: Any) -> Any:
    document["claims"].append({"id": name, "verdict": "proved", "evidence": evidence})
    return document


@pytest.mark.parametrize("program", PROGRAMS)
def test_when_it_holds(program: ModuleType) -> None:
    for measured, y in (("continuous", "continuously and at"), ("at_jumps", "at")):
        for high, end in (("inf", "inf)"), (3.0, "3.0]")):
            document = point_design(F, H, [0.5, high], PROOFS[program])
            document["problem"]["output"]["measured"] = measured
            first = lines(program, document)[0]
            assert first.startswith(
                f"proved: with y measured {y} jumps, without disturbances and noise, the error "
            )
            assert first.endswith(f"for every sequence of dwell times in [0.5, {end}")


@pytest.mark.parametrize("program", PROGRAMS)
@pytest.mark.parametrize(
    ("measured", "y"), [("continuous", "continuously"), ("at_jumps", "at no time")]
)
def test_nothing_is_said_to_be_measured_at_jumps_where_it_is_not(
    program: ModuleType, measured: str, y: str
) -> None:
    document = point_design(F, H, [0.5, 3.0], PROOFS[program])
    document["problem"]["output"]["measured"] = measured
    document["gains"].update(jump_measurement="none")
    assert lines(program, document)[0].startswith(f"proved: with y measured {y}, without")


def test_without_jumps_none_are_named_and_no_vector_is_proved() -> None:
    first = lines(check_design, body("point, no jumps"))[0]
    assert first.startswith("proved: with y measured continuously, without disturbances")
    said = lines(check_widths, body("no jumps, widths"))
    assert any(line.startswith("proved: with y measured continuously, the width") for line in said)
    assert not any("jumps" in line for line in said)
    vector = {"vector": [1.0, 1.0], "side": "left", "form": "before_jump"}
    with pytest.raises(check_widths.NotProved, match="over jumps"):
        lines(check_widths, claimed(body("no jumps, widths"), "dwell_stability", **vector))


def test_how_fast_dwell_times_change() -> None:
    for jitter, words in ((0.25, " that change by at most 0.25 at a time"), ("inf", "")):
        document = point_design(F, H, [0.5, 3.0], PROOFS[check_design])
        document["gains"]["dwell_jitter"] = jitter
        assert lines(check_design, document)[0].endswith(f"in [0.5, 3.0]{words}")


@pytest.mark.parametrize("program", PROGRAMS)
def test_what_was_not_checked(program: ModuleType) -> None:
    """A flow that decays is proved where dwell times have no longest one."""
    for high, rest in (("inf", "['spare']"), (3.0, "['hurwitz', 'spare']")):
        document = point_design(F, H, [0.5, high], PROOFS[program])
        document["claims"] = [c for c in document["claims"] if c["id"] == "dwell_stability"]
        document = claimed(claimed(document, "hurwitz"), "spare")
        assert lines(program, document)[-1].startswith(
            f"not checked: {rest}, whether A, C, G, L, M, times"
        )


@pytest.mark.parametrize("program", PROGRAMS)
def test_a_decay_rate_is_an_option_and_a_claim(program: ModuleType) -> None:
    for rate, is_claimed, is_proved in (
        (0.25, True, True), (0.25, False, False), (0.0, True, False), (0.0, False, True),
        (3.0, True, False),
    ):  # fmt: skip
        document = point_design(F, H, [0.5, "inf"], PROOFS[program])
        document["problem"]["observer"]["decay_rate"] = rate
        document = claimed(document, "decay_rate", **PROOFS[program]) if is_claimed else document
        if not is_proved:
            with pytest.raises(program.NotProved):
                lines(program, document)
            continue
        said = [line for line in lines(program, document) if "decays like e^(-0.25 t)" in line]
        assert len(said) == (rate > 0)


def test_rates_of_a_schedule_and_without_jumps_are_not_checked() -> None:
    rates = {"per_jump": 0.75, "in_time": 0.125}
    proved = lines(
        check_design,
        claimed(point_design(F, H, [0.5, 3.0], PROOFS[check_design]), "rates", **rates),
    )
    assert "in a norm per window to at most 0.75 of itself and like e^(-0.125 t)" in proved[1]
    assert "'rates'" not in proved[-1]
    for name in ("schedule", "point, no jumps"):
        document = body(name)
        document["claims"] = [c for c in document["claims"] if c["id"] != "rates"]
        said = lines(check_design, claimed(document, "rates", **rates))
        assert "'rates'" in said[-1]
        assert not any("of itself" in line for line in said)


@pytest.mark.parametrize("program", PROGRAMS)
def test_exit_codes(
    program: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    true = point_design(F, H, [0.5, 3.0], PROOFS[program])
    false = point_design(F, [[9.0, 0.0], [0.0, 9.0]], [0.5, 3.0], PROOFS[program])
    for document, code, words in (
        (true, 0, "proved: with"), (false, 1, "not proved: "), (true | {"digest": ""}, 2, "not read: "),
    ):  # fmt: skip
        path = tmp_path / "design.json"
        path.write_text(json.dumps(document), "utf-8")
        assert program.main(str(path)) == code
        assert capsys.readouterr().out.startswith(words)
