"""Documents name only what exists, and every command is documented."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from obsdesign.cli.commands import cli

ROOT = Path(__file__).parent.parent
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])


def test_every_test_named_in_the_papers_page_exists() -> None:
    page = (ROOT / "docs" / "papers.md").read_text("utf-8")
    tests = "\n".join(path.read_text("utf-8") for path in (ROOT / "tests").rglob("*.py"))
    names = re.findall(r"`(test_\w+)(\*?)`", page)
    assert len(names) > 10
    for name, star in names:
        ending = r"\w+" if star else r"\("
        assert re.search(rf"def {name}{ending}", tests), name
    for path in re.findall(r"`((?:tests/|test_)[\w/]+\.py)`", page):
        assert list((ROOT / "tests").rglob(Path(path).name)), path


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#:]+)\)", page.read_text("utf-8")):
        assert (page.parent / target).exists(), target


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_files_that_a_page_names_exist(page: Path) -> None:
    if page.name == "CHANGELOG.md":
        return
    named = re.findall(r"`([\w./]+/\w+\.(?:py|json|toml|html))`", page.read_text("utf-8"))
    layers = [ROOT, ROOT / "obsdesign", ROOT / "lmi"] if page.name == "ARCHITECTURE.md" else [ROOT]
    for name in named:
        assert any((layer / name).exists() for layer in layers), name


def test_every_folder_is_on_the_map() -> None:
    page = (ROOT / "ARCHITECTURE.md").read_text("utf-8")
    assert len(page.splitlines()) <= 120
    for package in ("lmi", "obsdesign"):
        for path in (ROOT / package).iterdir():
            folder = path.is_dir() and any(path.rglob("*.py"))
            if folder or (path.suffix == ".py" and path.name != "__init__.py"):
                name = f"{path.name}/" if folder else path.name
                assert name in page, f"{package}/{name} is not in ARCHITECTURE.md"


def test_the_map_names_what_the_code_has() -> None:
    """Its last table has names of files without their folder, of functions and of constants too."""
    table = (ROOT / "ARCHITECTURE.md").read_text("utf-8").split("## Where do I change …")[1]
    paths = [path for layer in ("lmi", "obsdesign", "docs") for path in (ROOT / layer).rglob("*.*")]
    files = {path.name for path in paths}
    named = re.findall(r"`(\w+\.(?:py|json|html))`", table)
    assert [name for name in named if name not in files] == []
    code = "\n".join(path.read_text("utf-8") for path in paths if path.suffix == ".py")
    words = set(re.findall(r"\w+", code))
    assert [name for name in re.findall(r"`([\w.]+)`", table) if name not in files
            and not set(name.split(".")) <= words] == []  # fmt: skip


def test_every_command_has_help_and_is_documented() -> None:
    words = "\n".join(page.read_text("utf-8") for page in PAGES)
    for name, command in cli.commands.items():
        assert command.help, name
        assert re.search(rf"`(obsdesign )?{name}\b", words), name
        for option in command.params:
            if option.param_type_name == "option" and option.name != "version":
                assert getattr(option, "help", None) or option.name in ("seed",), (
                    name,
                    option.name,
                )


def test_nothing_speaks_of_how_it_was_made() -> None:
    forbidden = re.compile(r"/work/|\.\./shared|\bCEO\b")
    files = (path for path in ROOT.glob("examples/**/*") if path.is_file())
    examples = [path for path in files if path.suffix != ".pyc"]
    for path in [*PAGES, *ROOT.rglob("*.py"), *examples]:
        if path.name == "test_docs.py" or {".venv", ".venv-lowest"} & set(path.parts):
            continue
        assert not forbidden.search(path.read_text("utf-8")), path


@pytest.mark.parametrize("page", sorted((ROOT / "docs").glob("*.md")), ids=lambda path: path.name)
def test_tables_have_as_many_cells_in_every_row(page: Path) -> None:
    """A bar inside of a cell has to be written \\|, or the row falls apart."""
    columns = 0
    for number, line in enumerate(page.read_text("utf-8").splitlines(), 1):
        bars = len(re.findall(r"(?<!\\)\|", line)) if line.startswith("|") else 0
        columns = columns if columns and bars else bars
        assert bars == columns, f"{page.name} line {number}"
