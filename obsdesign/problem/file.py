"""The text of a problem file, TOML or JSON, as nested dicts and lists, whatever they mean."""

from __future__ import annotations

import os
import tomllib
from pathlib import Path

from lmi.arithmetic.arrays import Value
from obsdesign.document import FORMAT
from obsdesign.errors import InputError
from obsdesign.input_files import parse_json, read_text, require_depth


def read_problem_file(path: str | os.PathLike[str]) -> Value:
    """Nested dicts and lists: JSON by its suffix .json, else TOML. InputError names the file."""
    text = read_text(path)
    if not text.strip():
        raise InputError(f"{path}: a problem is required; the file is empty.")
    is_json = Path(path).suffix.lower() == ".json"
    try:
        body = parse_json(text) if is_json else tomllib.loads(text)
    except RecursionError:
        raise InputError(f"{path}: nested too deeply to be a problem file.") from None
    except ValueError as error:
        raise InputError(f"{path}: not valid {_complaint(error, text, is_json)}") from None
    require_depth(body, str(path))
    if isinstance(body, dict) and body.get("format") == FORMAT:
        raise InputError(
            f"{path}: a problem file is required; this is a design. `obsdesign verify {path}` "
            "proves it again."
        )
    return body


def _complaint(error: ValueError, text: str, is_json: bool) -> str:
    reason = "an integer has thousands of digits" if "4300 digits" in str(error) else str(error)
    hint = ""
    if text.lstrip().startswith("{") != is_json:
        hint = " Is it TOML? Name it .toml." if is_json else " Is it JSON? Name it .json."
    return f"{'JSON' if is_json else 'TOML'}: {reason}.{hint}"
