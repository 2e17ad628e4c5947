"""`docs/papers.md` has one line for every number of the papers, and its commands exist."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "papers.md").read_text(encoding="utf-8")
STATUSES = {"full", "corrected", "refuted", "not built"}


def equations(first: int, last: int) -> list[str]:
    return [f"({number})" for number in range(first, last + 1)]


def figures(count: int) -> list[str]:
    return [f"Figure {number}" for number in range(1, count + 1)]


# author -> what the paper numbers, and the unnumbered statements that something rests on
NUMBERS = {
    "Degue": [
        *equations(1, 11), *figures(3), "Lemma 1", "Lemma 2", "Theorem 3", "Corollary 4",
        "Theorem 5", "Remark 6", "Theorem 7", "Theorem 8", "Remark 9", "Remark 10",
        *(f"Assumption {number}" for number in range(1, 6)),
        *(f"Example 4.{number}" for number in range(1, 4)), "jump times (introduction)",
        "positive systems (2.3)", "linear program (2.3)", "positive systems (2.4)",
        "W(x) = xᵀPx (after Theorem 3; Assumptions 2 and 4)", "similarity (after Assumption 4)",
        "choice of the split (after Assumption 5)", "theorems 7 and 8 combined (after (11))",
    ],
    "Medina": [
        *equations(1, 16), *figures(5), "Assumption 2.1", "Theorem 2.2", "Definition 2.3",
        "Definition 2.4", "Definition 2.5", "Lemma 2.6", "Theorem 3.1", "Lemma 3.2",
        "state response (before (3))", "unobservable set (before Definition 2.3)",
        "proof of Theorem 3.1", "ρ_ℓ (before (14))", "Section IV", "determinant (Section IV)",
        "gain of the spline (Section IV)",
    ],
    "Mazenc": [
        *equations(1, 48), *figures(1), "Assumption 1", "Lemma 1", "Lemma 2", "Theorem 1",
        "existence of T and L (before (2))", "sentence after (9)", "sentence after (20)",
        "robust stability (introduction)", "accuracy (conclusion)", "proof of Lemma 2",
    ],
    "Ahn": [
        *equations(1, 44), *figures(8), "Example 1", "Example 2", "Table 1", "Table 2",
        "(14) as a differentiator", "observability (after (22))", "convergence (after (27))",
    ],
    "Mattsson": [
        *equations(1, 19), *figures(6), "Proposition 3.1", "Proposition 3.2",
        "assumptions of Section II", "Section III-A", "Section III-B", "V = I",
        "maximum instead of η (end of Section III-C)", "η for the largest weight (Section III-C)", "inequality after (19)", "Section III-E",
        "Section III-F", "Section IV",
    ],
}  # fmt: skip


def section(author: str) -> str:
    return next(part for part in PAGE.split("\n## ") if part.startswith(author))


def lines(author: str) -> list[list[str]]:
    """Cells of the table rows in an author's section."""
    rows = [line for line in section(author).splitlines() if line.startswith("| ")]
    return [re.split(r"(?<!\\)\| ", row.strip("| ")) for row in rows[1:]]


def numbers(cell: str) -> list[str]:
    """What a first cell names; (34)–(48) names fifteen equations."""
    stated = []
    for item in map(str.strip, cell.split(",")):
        ends = re.fullmatch(r"\((\d+)\)–\((\d+)\)", item)
        stated += equations(int(ends[1]), int(ends[2])) if ends else [item]
    return stated


TESTS = {
    name
    for path in (ROOT / "tests").rglob("test_*.py")
    for name in re.findall(r"^def (test_\w+)", path.read_text(encoding="utf-8"), re.MULTILINE)
}


@pytest.mark.parametrize("author", NUMBERS)
def test_every_number_of_a_paper_has_exactly_one_line(author: str) -> None:
    stated = Counter(item for row in lines(author) for item in numbers(row[0]))
    assert stated == Counter(NUMBERS[author])


@pytest.mark.parametrize("author", NUMBERS)
def test_every_line_has_a_status_and_tests_that_exist(author: str) -> None:
    for item, status, reason, named in lines(author):
        names = re.findall(r"`(test_\w+)`", named)
        assert status.strip() in STATUSES, item
        assert names or status.strip() == "not built", item
        assert set(names) <= TESTS, item
        assert reason.strip(), item


@pytest.mark.parametrize("author", NUMBERS)
def test_the_scripts_and_test_files_of_a_section_exist(author: str) -> None:
    """`tests/test_figures.py` runs the scripts, `tests/test_site.py` the other commands."""
    (script,) = re.findall(r"`\.venv/bin/python -m (docs\.[\w.]+)`", section(author))
    (files,) = re.findall(r"`\.venv/bin/python -m pytest -q -n 0 ([\w./ ]+)`", section(author))
    for name in (f"{script.replace('.', '/')}.py", *files.split()):
        assert (ROOT / name).is_file(), name


@pytest.mark.parametrize(
    "author", [author for author in NUMBERS if "All tests named below" in section(author)]
)
def test_the_command_of_a_section_runs_all_tests_that_it_names(author: str) -> None:
    (files,) = re.findall(r"`\.venv/bin/python -m pytest -q -n 0 ([\w./ ]+)`", section(author))
    texts = [(ROOT / name).read_text(encoding="utf-8") for name in files.split()]
    tests = {name for text in texts for name in re.findall(r"^def (test_\w+)", text, re.MULTILINE)}
    assert set(re.findall(r"`(test_\w+)`", section(author))) - tests == set()
