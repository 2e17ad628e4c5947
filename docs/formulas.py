"""Formulas of the pages as MathML, which browsers draw without a script (a hook of mkdocs.yml)."""

from __future__ import annotations

import html
import re
from typing import Any

from latex2mathml.converter import convert

# what the Markdown extension `arithmatex` makes of $...$ and of $$...$$
_FORMULA = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.DOTALL)


def on_page_content(content: str, **_: Any) -> str:
    """The HTML of a page with its formulas drawn."""

    def drawn(match: re.Match[str]) -> str:
        display = "block" if match[2] == "[" else "inline"
        return convert(html.unescape(match[3]), display=display)

    return _FORMULA.sub(drawn, content)
