"""Tutorials as notebooks: code of a page becomes cells, its files cells that write them.

The site has a notebook beside each tutorial (a hook of mkdocs.yml), and a shell writes them:

python -m docs.notebooks FOLDER
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import nbformat
from nbformat import v4

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files
    from mkdocs.structure.pages import Page

TUTORIALS = Path(__file__).parent / "tutorials"
# a block of code: its language, its file, its text
BLOCK = re.compile(r"^```(\w+)(?: title=\"([^\"]+)\")?\n(.*?)^```\n", re.MULTILINE | re.DOTALL)


def notebook(page: str) -> str:
    """The notebook of a page of Markdown, as JSON; pictures are those that its cells draw."""
    cells, end = [], 0
    for k, block in enumerate(BLOCK.finditer(page)):
        cells.append(v4.new_markdown_cell(_text(page[end : block.start()]), id=f"text{k}"))
        language, file, code = block.groups()
        written = f"%%writefile {file}\n{code}" if file else code
        if language == "python" or file:
            cells.append(v4.new_code_cell(written.rstrip(), id=f"code{k}"))
        else:
            cells.append(v4.new_markdown_cell(block.group(), id=f"code{k}"))
        end = block.end()
    cells.append(v4.new_markdown_cell(_text(page[end:]), id="end"))
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    made = v4.new_notebook(cells=cells, metadata={"kernelspec": kernel})
    nbformat.validate(made)
    return nbformat.writes(made)


def _text(markdown: str) -> str:
    """Without pictures, which stand in the folder of the page."""
    return re.sub(r"^!\[.*?\]\(.*?\)\n", "", markdown, flags=re.MULTILINE).strip()


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the notebooks to the files of the site."""
    from mkdocs.structure.files import File

    for page in sorted(TUTORIALS.glob("*.md")):
        name = f"tutorials/{page.stem}.ipynb"
        files.append(File.generated(config, name, content=notebook(page.read_text("utf-8"))))
    return files


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """A tutorial of the site links its notebook."""
    own = Path(page.file.src_uri)
    if own.parent.name != TUTORIALS.name:
        return markdown
    return f"{markdown}\n\n[This page as a notebook]({own.stem}.ipynb)\n"


def main(folder: str) -> None:
    """Write the notebook of every tutorial into a folder."""
    Path(folder).mkdir(parents=True, exist_ok=True)
    for page in sorted(TUTORIALS.glob("*.md")):
        target = Path(folder, f"{page.stem}.ipynb")
        target.write_text(notebook(page.read_text("utf-8")), encoding="utf-8")
        print(f"written: {target}")


if __name__ == "__main__":
    main(sys.argv[1])
