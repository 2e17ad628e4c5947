"""All observers of a plant on one record: the same as each alone, and honest about what is missing."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import obsdesign
from lmi.memory import OversizeError
from lmi.time_budget import TimeBudget
from obsdesign import workflow
from obsdesign.cli.commands import cli
from obsdesign.data.execution import execute
from obsdesign.kinds import GIVING_BOUNDS, KINDS
from obsdesign.runtime import from_design
from obsdesign.studies.comparison import compare as comparison
from obsdesign.studies.comparison.compare import compare, compare_with_kalman
from obsdesign.studies.comparison.record import ComparisonRecord
from obsdesign.studies.comparison.row import REFERENCE, run

EXAMPLES = Path(__file__).parents[3] / "examples"


@pytest.fixture(scope="module", autouse=True)
def _designed_once() -> Iterator[None]:
    """The design of a problem is the same on every record: each is made once here."""
    made: dict[str, workflow.Outcome] = {}
    own = workflow.investigate_each

    def each(
        problems: dict[Any, obsdesign.Problem], budget: TimeBudget, **options: Any
    ) -> dict[Any, workflow.Outcome]:
        texts = {key: json.dumps(problem.to_dict()) for key, problem in problems.items()}
        new = {text: problems[key] for key, text in texts.items() if text not in made}
        made.update(own(new, budget, **options))
        return {key: made[text] for key, text in texts.items()}

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(workflow, "investigate_each", each)
        yield


def load(name: str) -> obsdesign.Problem:
    return obsdesign.load_problem(EXAMPLES / f"{name}.toml")


def test_every_kind_is_answered_and_the_filter_comes_last() -> None:
    problem = load("degue_4_1")
    record = ComparisonRecord.from_simulation(
        problem.plant, until=6.0, rng=np.random.default_rng(3)
    )
    rows = list(compare(problem, record))
    assert {row.kind for row in rows} == {*KINDS, REFERENCE}
    assert rows[-1].kind == REFERENCE
    for row in rows[:-1]:
        ran = row.seconds is not None
        assert ran == (row.verdict == "proved")
        assert ran or row.reason
    forms = {row.variant for row in rows if row.kind == "interval" and row.seconds is not None}
    assert {"cooperative", "split"} <= forms
    # a proved bound is a bound: the middle is never farther from the state than half the width
    assert record.x is not None
    for row in rows:
        if row.width is not None:
            assert row.error is not None
            assert row.error <= row.width / 2 * (1 + 1e-9)


@pytest.mark.parametrize("name", ["mazenc_4", "degue_4_1", "ahn_1", "gantry_crane"])
def test_a_row_guarantees_what_its_design_guarantees_and_nothing_else(name: str) -> None:
    problem = load(name)
    record = ComparisonRecord.from_simulation(problem.plant, rng=np.random.default_rng(3))
    design = obsdesign.design(problem)
    given = [one.statement for one in design.guarantees if one.given]
    rows = list(compare(problem, record, kinds=("set_membership", "luenberger", problem.kind)))
    assert given[0] in [row.guarantee for row in rows if row.kind == problem.kind]
    assert all(bool(row.guarantee) == (row.verdict == "proved") for row in rows)


def test_the_approximate_observer_is_not_called_exact() -> None:
    """Observer (14) of Mazenc and Ahmed has a bias; observers (9) and (16) have none."""
    problem = load("mazenc_4")
    record = ComparisonRecord.from_simulation(problem.plant, rng=np.random.default_rng(3))
    rows = {row.variant: row for row in compare(problem, record) if row.kind == "finite_time"}
    approximate, exact = rows["approximate"], rows["exact"]
    assert approximate.error is not None
    assert approximate.error > 1e-3
    assert "is off by at most 0.0137" in approximate.guarantee
    assert exact.error is not None
    assert exact.error < 1e-12
    assert "the estimate is the state" in exact.guarantee


def test_numbers_are_those_of_the_observer_alone() -> None:
    problem = load("degue_4_1")
    record = ComparisonRecord.from_simulation(
        problem.plant, until=12.0, rng=np.random.default_rng(3)
    )
    row = next(row for row in compare(problem, record, [-3, 3, -3, 3]) if row.kind == "interval")
    observer: Any = from_design(obsdesign.design(problem))
    state = observer.init(t=0.0, lower=[-3, -3], upper=[3, 3])
    estimates = list(observer.run(state, record.samples))
    half = len(estimates) // 2
    widths = np.array([e.upper - e.lower for e in estimates])[half:]
    assert row.width == pytest.approx(float(np.sqrt(np.mean(widths**2))), rel=1e-12)
    assert row.without == sum(e.status != "ok" for e in estimates)


def test_a_kind_that_is_too_large_is_one_row(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = load("degue_4_1")
    record = ComparisonRecord.from_simulation(
        problem.plant, until=3.0, rng=np.random.default_rng(3)
    )
    text = "65 exponentials of 1100 states needs 600 MiB of memory, and the budget is 512 MiB: ..."
    own = comparison.run

    def run(design: obsdesign.Design, *given: Any) -> dict[str, Any]:
        if design.kind == "luenberger":
            raise OversizeError(text)
        return own(design, *given)

    monkeypatch.setattr(comparison, "run", run)
    rows = list(compare(problem, record, kinds=("interval", "luenberger")))
    large = [row for row in rows if row.kind == "luenberger"]
    assert [(row.reason, row.seconds) for row in large] == [(text, None)]
    assert any(row.kind == "interval" and row.seconds is not None for row in rows)
    assert rows[-1].kind == REFERENCE


def test_a_wider_start_never_narrows_the_bounds() -> None:
    problem = load("degue_4_1")
    record = ComparisonRecord.from_simulation(
        problem.plant, until=3.0, rng=np.random.default_rng(3)
    )
    narrow, wide = (
        {
            row.variant: row.width
            for row in compare(problem, record, initial, kinds=GIVING_BOUNDS)
            if row.width
        }
        for initial in ([0, 2, 0, 2], [-5, 5, -5, 5])
    )
    assert narrow.keys() == wide.keys()
    # what forgets its start gives equal widths, but for rounding
    assert all(narrow[form] <= wide[form] * (1 + 1e-12) for form in narrow)


def test_infinite_bounds_leave_an_estimate() -> None:
    """What no sample shows has no bound: the estimate is what is compared, and nothing warns."""
    problem = obsdesign.Problem(
        flow={"A": np.diag([-1000.0, -900.0, -1.0])},
        output={"C": [[1, 1, 1]], "measured": "periodic", "period": 0.1, "noise_bound": [0.1]},
        observer={"kind": "finite_time", "window": 0.9},
    )
    record = ComparisonRecord.from_simulation(
        problem.plant, until=6.0, rng=np.random.default_rng(3)
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        rows = compare_with_kalman([obsdesign.design(problem)], record)
    ran = [row for row in rows if row.kind == "finite_time"]
    assert ran
    assert all(row.width is None for row in ran)
    assert all(row.error is not None and row.error < 0.2 for row in ran)


def test_unknown_inputs_and_methods_are_compared() -> None:
    body = load("ahn_1").to_dict()
    body["output"]["noise_std"] = [0.01, 0.01]
    problem = obsdesign.Problem.from_dict(body)
    record = ComparisonRecord.from_simulation(
        problem.plant, until=4.0, rng=np.random.default_rng(0)
    )
    rows = {
        (row.kind, row.variant): row for row in compare(problem, record, kinds=("unknown_input",))
    }
    mine = {variant for kind, variant in rows if kind == "unknown_input"}
    assert mine == {"cell", "damped", "batch", "fixed_lag"}
    assert all(rows["unknown_input", variant].input_error is not None for variant in mine)
    reference = next(row for (kind, _), row in rows.items() if kind == REFERENCE)
    assert reference.input_error is not None
    assert reference.variant.startswith("walk ")


def test_a_file_gives_what_its_simulation_gave(tmp_path: Path) -> None:
    runner, data = CliRunner(), tmp_path / "data.csv"
    source = str(EXAMPLES / "degue_4_1.toml")
    base = ["simulate", source, "--until", "4", "--seed", "5", "-o", str(data)]
    assert runner.invoke(cli, base, standalone_mode=False).return_value == 0
    answers, kinds = [], ["--kinds", "interval,luenberger"]
    for how in (["--data", str(data)], ["--simulate", "--until", "4", "--seed", "5"]):
        done = runner.invoke(
            cli, ["compare", source, "--json", *kinds, *how], standalone_mode=False
        )
        assert done.return_value == 0, done.exception
        answers.append(json.loads(done.stdout))
    for one, other in zip(*(answer["result"]["rows"] for answer in answers), strict=True):
        assert one | {"seconds": 0} == other | {"seconds": 0}
    assert answers[0]["verdict"] == "proved"
    # without the truth nothing is said of errors
    text = "\n".join(line.rsplit(",", 2)[0] for line in data.read_text().splitlines())
    assert text.startswith("t,y1,jump\n")
    data.write_text(text + "\n")
    done = runner.invoke(cli, ["compare", source, "--json", *kinds, "--data", str(data)])
    rows = json.loads(done.stdout)["result"]["rows"]
    assert all(row["error"] is None for row in rows)
    assert any(row["width"] is not None for row in rows)


@pytest.mark.parametrize("columns", ["b", "c", "v", "bcv"])
def test_bounds_of_rows_are_used_as_run_uses_them(tmp_path: Path, columns: str) -> None:
    problem, data = load("degue_4_1"), tmp_path / "data.csv"
    quiet = ["--until", "4", "--seed", "5", "--disturbance", "zero", "-o", str(data)]
    source = str(EXAMPLES / "degue_4_1.toml")
    assert CliRunner().invoke(cli, ["simulate", source, *quiet]).exit_code == 0
    declared = {"b": (0.1, 2), "c": (0.3, 2), "v": (0.03, 1)}
    added = [
        (f"{letter}{i + 1}_{end}", sign * declared[letter][0] / 4)
        for letter in columns
        for i in range(declared[letter][1])
        for end, sign in (("lo", -1), ("hi", 1))
    ]
    plain = data.read_text().splitlines()
    tail = [",".join(str(value) for _, value in added)] * (len(plain) - 1)
    more = [",".join(title for title, _ in added), *tail]
    narrow = tmp_path / "narrow.csv"
    narrow.write_text("\n".join(map(",".join, zip(plain, more, strict=True))) + "\n")
    design = obsdesign.design(problem)
    design.save(tmp_path / "design.json")
    start = np.array([[-3.0, 3.0], [-3.0, 3.0]])
    widths = []
    for path in (data, narrow):
        record = ComparisonRecord.from_file(str(path), problem)
        compared = run(design, record, start)
        estimates = tmp_path / "est.csv"
        execute(
            str(tmp_path / "design.json"), str(path), str(estimates), start.ravel().tolist(), None
        )
        table = np.genfromtxt(estimates, delimiter=",", names=True, dtype=None, encoding="utf-8")
        half = len(table) // 2
        ends = np.array([table[f"x{i + 1}_hi"] - table[f"x{i + 1}_lo"] for i in range(2)])[:, half:]
        assert compared["width"] == pytest.approx(float(np.sqrt(np.mean(ends**2))), rel=1e-12)
        widths.append(compared["width"])
    assert widths[1] < 0.99 * widths[0]
    # the twin: kinds that promise no bounds read the same file as before
    point = obsdesign.design(problem.for_kind("luenberger")[0])
    records = [ComparisonRecord.from_file(str(path), problem) for path in (data, narrow)]
    assert len({run(point, record, start)["error"] for record in records}) == 1


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["--initial", "0,1"], "--initial must be 4 numbers"),
        (["--initial", "1,0,0,1"], "lo <= hi"),
        (["--data", "none.csv"], "none.csv: cannot be read"),
        (["--data", "x.csv", "--until", "3"], "--data takes no"),
        (["--kinds", "interval,kalman"], "--kinds: kind must be one of interval, set_membership"),
        (["--kinds", ""], "got ''"),
    ],
)
def test_bad_requests(arguments: list[str], line: str) -> None:
    done = CliRunner().invoke(
        cli, ["compare", str(EXAMPLES / "degue_4_1.toml"), *arguments], standalone_mode=False
    )
    assert line in str(done.exception)


def test_the_kinds_of_a_comparison_are_those_stated() -> None:
    """In the order of the table, each with the numbers it has alone; nothing else is designed."""
    problem, kinds = load("degue_4_1"), ["luenberger", "set_membership", "impulsive"]
    record = ComparisonRecord.from_simulation(problem.plant, until=2.0)
    rows = list(compare(problem, record, kinds=kinds))
    assert [row.kind for row in rows] == ["set_membership", "luenberger", "impulsive", REFERENCE]
    for kind in kinds:
        alone = list(compare(problem, record, kinds=[kind]))
        assert [replace(row, seconds=None) for row in alone] == [
            replace(row, seconds=None) for row in rows if row.kind in (kind, REFERENCE)
        ]
    done = CliRunner().invoke(
        cli,
        ["compare", str(EXAMPLES / "degue_4_1.toml"), "--until", "2", "--json",
         "--kinds", "impulsive, luenberger"],
        standalone_mode=False,
    )  # fmt: skip
    listed = [row["kind"] for row in json.loads(done.stdout)["result"]["rows"]]
    assert listed == ["luenberger", "impulsive", REFERENCE]


def test_a_name_that_is_no_kind_is_refused() -> None:
    problem = load("degue_4_1")
    record = ComparisonRecord.from_simulation(problem.plant, until=4.0)
    with pytest.raises(
        obsdesign.InputError, match=r"kind must be one of interval, .*; got 'kalman'"
    ):
        list(compare(problem, record, kinds=["interval", "kalman"]))


def test_the_table_names_what_runs_and_why_the_rest_does_not() -> None:
    done = CliRunner().invoke(
        cli, ["compare", str(EXAMPLES / "degue_4_1.toml"), "--until", "2"], standalone_mode=False
    )
    assert done.return_value == 0
    text = " ".join(done.output.split())
    assert "interval, cooperative" in text
    assert "Kalman filter" in text
    assert "impulsive input: jump.H is required" in text
