"""`check` says of every kind what `design --kind` says, and no time ever undoes an answer.

python -m tests.long.check_agrees [FOLDER]     problems of the examples, of FOLDER, random ones
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import obsdesign
from benchmarks.glance_is_fast import plants
from obsdesign.kinds import KINDS
from obsdesign.studies.check.which_kinds import check_all
from obsdesign.verification.answers import verdict_of_refusal

EXAMPLES = Path(__file__).parent.parent.parent / "examples"
SECONDS = (0.01, 0.1, 1.0, 20.0)


def designed(problem: obsdesign.Problem, kind: str, seconds: float | None = None) -> str:
    """What `design --kind` answers, in the words of `check`."""
    try:
        return obsdesign.investigate(problem.for_kind(kind)[0], seconds=seconds).verdict
    except obsdesign.InputError as error:
        return verdict_of_refusal(error)


def disagreements(problem: obsdesign.Problem) -> list[tuple[str, str, str]]:
    """(kind, check, design) where they differ."""
    _, answers = check_all(problem)
    both = [(kind, answers[kind].verdict, designed(problem, kind)) for kind in KINDS]
    return [row for row in both if row[1] != row[2]]


def undone(problem: obsdesign.Problem) -> list[tuple[str, list[str]]]:
    """(kind, verdicts as time grows) where more time undoes a decision."""
    rows = []
    for kind in KINDS:
        verdicts = [designed(problem, kind, seconds) for seconds in SECONDS]
        decided = [verdict for verdict in verdicts if verdict != "undecided"]
        ordered = ["undecided"] * (len(verdicts) - len(decided)) + decided
        if len(set(decided)) > 1 or verdicts != ordered:
            rows.append((kind, verdicts))
    return rows


def problems(folders: list[Path]) -> Iterator[tuple[str, obsdesign.Problem]]:
    for folder in folders:
        for path in sorted(folder.glob("*.toml")):
            yield path.stem, obsdesign.load_problem(path)
    for seed, problem in enumerate(plants()):
        yield f"random plant {seed}", problem


def main() -> bool:
    count, wrong = 0, 0
    for name, problem in problems([EXAMPLES, *map(Path, sys.argv[1:])]):
        faults = [*disagreements(problem), *undone(problem)]
        count, wrong = count + 1, wrong + bool(faults)
        print(f"{name}: {faults or 'agrees'}", flush=True)
    print(f"{count} plants of {len(KINDS)} kinds, {wrong} wrong")
    return wrong == 0


if __name__ == "__main__":
    sys.exit(not main())
