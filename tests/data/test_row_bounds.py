"""Columns b1_lo, b1_hi, ..., c1_lo, ..., v1_lo, ... of data files, and runs in parts with them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import obsdesign
from obsdesign.data.execution import execute
from obsdesign.data.left_out import LEFT_OUT
from obsdesign.errors import InputError
from tests.systems.designs import designed

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def design(tmp_path_factory: pytest.TempPathFactory) -> str:
    """|b| <= 0.1, |c| <= 0.3, |v| <= 0.03."""
    path = tmp_path_factory.mktemp("rows") / "design.json"
    obsdesign.design(obsdesign.load_problem(EXAMPLES / "degue_4_1.toml")).save(path)
    return str(path)


def data(titles: str, *rows: str) -> str:
    return "\n".join([f"t,y1,jump,{titles}", *rows]) + "\n"


def estimate(design: str, folder: Path, text: str, **options: object) -> tuple[str, list[str]]:
    """(text of the estimate file, remarks)."""
    source, out, remarks = folder / "data.csv", folder / "est.csv", list[str]()
    source.write_text(text, encoding="utf-8")
    initial = None if options.pop("resume", False) else [0.0, 2.0, 0.0, 2.0]
    execute(design, str(source), str(out), initial, None, remark=remarks.append, **options)  # type: ignore[arg-type]
    return out.read_text(encoding="utf-8"), remarks


# y of x(0) = (1.5, 1), b = (0.06, -0.07) after the jump, c = 0, v = 0, 0, 0.01, 0, 0.025
WHOLE = data(
    "b1_lo,b2_hi,v1_lo,v1_hi,c2_hi",
    "0,1,0,-0.05,0.01,-0.01,0.01,",
    "0.5,0.726,0,,,,,",
    "1,0.494,1,0.02,-0.05,0,0.03,0.1",
    "1.5,1.099,0,-0.1,0.1,-0.03,0.03,0.3",
    "2,0.665,0,,,0.02,,",
)


def test_columns_narrow_and_parts_are_the_whole(design: str, tmp_path: Path) -> None:
    whole, _ = estimate(design, tmp_path, WHOLE)
    plain = "\n".join(",".join(line.split(",")[:3]) for line in WHOLE.splitlines()) + "\n"
    wide, _ = estimate(design, tmp_path, plain)
    ours, theirs = (
        np.array([[float(x) for x in line.split(",")[1:5]] for line in text.splitlines()[1:]])
        for text in (whole, wide)
    )
    assert np.all(ours[:, ::2] >= theirs[:, ::2] - 1e-12)
    assert np.all(ours[:, 1::2] <= theirs[:, 1::2] + 1e-12)
    assert np.all(ours[1:] != theirs[1:])
    lines = WHOLE.splitlines()
    for cut in range(2, len(lines)):
        state = tmp_path / f"state{cut}.json"
        first = "\n".join(lines[:cut]) + "\n"
        second = "\n".join([lines[0], *lines[cut:]]) + "\n"
        one, _ = estimate(design, tmp_path, first, state=str(state))
        two, _ = estimate(design, tmp_path, second, state=str(state), resume=True)
        assert one.splitlines() + two.splitlines()[1:] == whole.splitlines()


@pytest.mark.parametrize(
    ("column", "cells", "sentence"),
    [
        ("b2_hi", ["0.05", "0.2"],
         "line 3: b2_hi must be within the declared bounds [-0.1, 0.1]; got 0.2."),
        ("v1_lo", ["", "-0.04"],
         "line 3: v1_lo must be within the declared bounds [-0.03, 0.03]; got -0.04."),
        ("c1_lo", ["", "nan"], "line 3: c1_lo must be a finite number or empty; got 'nan'."),
        ("v1_lo,v1_hi", ["0,0", "0.02,0.01"],
         "line 3: v1_lo must not exceed v1_hi; got 0.02 above 0.01."),
        ("b1_lo,b1_lo", ["0,0", "0,0"], "column 'b1_lo' stands 2 times in the header."),
    ],
)  # fmt: skip
def test_a_bad_bound_is_one_line(
    design: str, tmp_path: Path, column: str, cells: list[str], sentence: str
) -> None:
    text = data(column, *(f"{k},1,0,{cell}" for k, cell in enumerate(cells)))
    with pytest.raises(InputError) as error:
        estimate(design, tmp_path, text)
    assert str(error.value).endswith(sentence)
    assert not (tmp_path / "est.csv").exists()


def test_columns_without_use_are_named(design: str, tmp_path: Path) -> None:
    _, remarks = estimate(design, tmp_path, data("b3_lo,x1", "0,1,0,0,0"))
    assert len(remarks) == 1
    assert "b3_lo of the header are not used: the design's plant has b1_lo, b1_hi" in remarks[0]
    luenberger = tmp_path / "point.json"
    problem = obsdesign.load_problem(EXAMPLES / "degue_4_1.toml").to_dict()
    problem["observer"] = {"kind": "luenberger"}
    designed(problem).save(luenberger)
    remarks = []
    execute(str(luenberger), str(tmp_path / "data.csv"), str(tmp_path / "est.csv"), None, None,
            remark=remarks.append)  # fmt: skip
    assert any("b3_lo of the header are not used: this kind uses no bounds" in x for x in remarks)


def test_bounds_of_b_are_not_used_where_lines_are_skipped(design: str, tmp_path: Path) -> None:
    rows = ["0,1,0,0,0", "broken", "1,1,0,0,0"]
    text = data("b1_lo,b1_hi", *rows)
    skipped, remarks = estimate(design, tmp_path, text, skip_bad=True)
    assert any("b1_lo, b1_hi are not used with --skip-bad" in x for x in remarks)
    plain, _ = estimate(design, tmp_path, data("x1", "0,1,0,0", "1,1,0,0"))
    assert skipped == plain.replace("its bounds\n", f"its bounds; {LEFT_OUT}\n")


@pytest.mark.parametrize("kind", ["interval", "set_membership"])
@pytest.mark.parametrize("block", ["flow", "jump"])
def test_bounds_of_what_a_matrix_spreads_are_those_of_w(
    kind: str, block: str, tmp_path: Path
) -> None:
    """b = (3, 1) w, or c, with w = 0.1 known by columns: the truth stays in the bounds."""
    body = obsdesign.load_problem(EXAMPLES / "degue_4_1.toml").to_dict()
    spread = {"disturbance_matrix": [[3.0], [1.0]]}
    body[block] |= spread | {"disturbance": {"lower": [-0.1], "upper": [0.1]}}
    body["observer"] = {"kind": kind}
    path = tmp_path / "spread.json"
    designed(body).save(path)
    problem = obsdesign.Problem.from_dict(body)
    A, G, C = problem.plant.flow.A, problem.plant.jump.G, problem.plant.output.C
    x, letter, rows = np.array([1.0, 1.0]), block[0].replace("f", "b").replace("j", "c"), []
    push, truth = 0.1 * np.array([3.0, 1.0]), [np.array([1.0, 1.0])]
    for k in range(21):
        if k:
            drive = push if block == "flow" else 0 * push
            for _ in range(200):
                x = x + 0.0005 * (A @ x + drive)
        y = float((C @ x)[0])
        if k % 10 == 5:
            x = G @ x + (push if block == "jump" else 0 * push)
        rows.append(f"{0.1 * k!r},{y!r},{int(k % 10 == 5)},0.1,0.1")
        truth.append(x)
    text, remarks = estimate(str(path), tmp_path, data(f"{letter}1_lo,{letter}1_hi", *rows))
    cells = [line.split(",") for line in text.splitlines()]
    for x, row in zip(truth[1:], cells[1:], strict=True):
        values = dict(zip(cells[0], row, strict=True))
        for i in range(2):
            assert float(values[f"x{i + 1}_lo"]) <= x[i] + 1e-3
            assert x[i] - 1e-3 <= float(values[f"x{i + 1}_hi"])
    assert not remarks
