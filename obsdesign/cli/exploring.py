"""`explore`: a page in the browser with sliders over the numbers of a problem."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.resources import files
from importlib.util import find_spec

import click

from obsdesign.cli.arguments import Count
from obsdesign.errors import InputError

_NEEDED = ("marimo", "tomlkit")


@click.command()
@click.argument("problem", type=click.Path())
@click.option(
    "--port", type=Count(min=1024, max=65535), help="Port of the page.  [default: a free one]"
)
@click.option("--kind", help="Observer kind; options of another kind in the file are dropped.")
@click.option("--headless", is_flag=True, help="Print the address and open no browser.")
def explore(*, problem: str, kind: str | None, port: int | None, headless: bool) -> int:
    """Open a page with sliders over the numbers of PROBLEM, on this machine alone.

    Beside them: what is proved, the widths, a simulated run and brackets. Ctrl-C ends it.
    """
    from obsdesign.problem.problem import load_for_kind

    load_for_kind(problem, kind)[0].require_kind()
    if missing := [name for name in _NEEDED if find_spec(name) is None]:
        raise InputError(
            f"explore requires {' and '.join(missing)}; missing: pip install 'obsdesign[explore]'."
        )
    page = str(files("obsdesign").joinpath("explore/page.py"))
    command = [sys.executable, "-m", "marimo", "run", page, "--host", "127.0.0.1"]
    command += [] if port is None else ["--port", str(port)]
    command += ["--headless"] if headless else []
    quiet = {**os.environ, "MARIMO_SKIP_UPDATE_CHECK": "1"}
    stated = ["--problem", problem, *([] if kind is None else ["--kind", kind])]
    ended = subprocess.run([*command, "--", *stated], env=quiet, check=False)
    if ended.returncode:
        raise InputError(f"marimo ended with exit code {ended.returncode}; it says why above.")
    return 0
