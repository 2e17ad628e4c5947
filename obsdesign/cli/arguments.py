"""Arguments of the command line as plants, numbers, dwell times and answers."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import click

from obsdesign.errors import InputError, naming
from obsdesign.kinds import KINDS, kind_named

if TYPE_CHECKING:
    from lmi.arithmetic.arrays import NewEntries, Value  # the help does without numpy
    from obsdesign.problem.problem import Problem

_Command = TypeVar("_Command", bound=Callable[..., object])


def one_of(*words: str) -> Callable[[click.Context, click.Parameter, str], list[str]]:
    """Completion of an option by these words."""
    return lambda context, option, begun: [word for word in words if word.startswith(begun)]


KIND = click.option(
    "--kind", shell_complete=one_of(*KINDS),
    help="Observer kind; options of another kind in the file are dropped.",
)  # fmt: skip


def _kinds(context: click.Context, option: click.Parameter, value: str | None) -> list[str]:
    """Names of kinds from a,b,..., all of them where the option is not given."""
    names = list(KINDS) if value is None else [name.strip() for name in value.split(",")]
    with naming("--kinds", InputError):
        for name in names:
            kind_named(name)
    return names


KINDS_OPTION = click.option(
    "--kinds", metavar="A,B", callback=_kinds,
    help="Observers of these kinds alone.  [default: all]",
)  # fmt: skip


class _Number(click.types.FloatParamType):
    """A number as data files have it: click takes what Python does, 1_0 and other scripts."""

    def convert(
        self, value: Value, param: click.Parameter | None, ctx: click.Context | None
    ) -> Value:
        """The number, or a usage error."""
        from obsdesign.entries import number_from_text

        try:
            return number_from_text(value) if isinstance(value, str) else float(value)
        except ValueError:
            self.fail(f"{value!r} is not a number.", param, ctx)


class Count(click.IntRange):
    """A whole number in digits 0 to 9."""

    def convert(
        self, value: Value, param: click.Parameter | None, ctx: click.Context | None
    ) -> Value:
        """The number, or a usage error."""
        if isinstance(value, str) and not re.fullmatch("[+-]?[0-9]+", value):
            self.fail(f"{value!r} is not a whole number.", param, ctx)
        return super().convert(value, param, ctx)


NUMBER = _Number()
AS_JSON = click.option("--json", "as_json", is_flag=True, help="Print one JSON object on stdout.")


def _seconds(context: click.Context, option: click.Parameter, value: float | None) -> float | None:
    if value is not None and not 0 < value < math.inf:
        raise InputError(f"--time must be a positive finite number of seconds; got {value!r}.")
    return value


def time_option(more: str = "in all") -> Callable[[_Command], _Command]:
    """--time SECONDS as `seconds`; more: what the seconds are for."""
    return click.option(
        "--time", "seconds", type=NUMBER, metavar="SECONDS", callback=_seconds,
        help=f"Processor seconds that searches may take {more}.  [default: each its own budget]",
    )  # fmt: skip


def output_option(default: str, what: str) -> Callable[[_Command], _Command]:
    """-o FILE as `output`; what: is written there."""
    return click.option(
        "-o", "--output", type=click.Path(), default=default, show_default=True, help=what
    )


def problem_of(path: str, kind: str | None) -> tuple[Problem, list[str]]:
    """The problem in a file, for its own kind or another, and the entries dropped for that."""
    from obsdesign.problem.problem import load_for_kind, load_problem

    return (load_problem(path), []) if kind is None else load_for_kind(path, kind)


def source_of(source: str) -> Problem:
    """The problem in a problem file, or inside a design file."""
    from obsdesign.design_file import load_design
    from obsdesign.document import FORMAT
    from obsdesign.input_files import read_text
    from obsdesign.problem.problem import Problem, load_problem

    if source.endswith(".json") and f'"{FORMAT}"' in read_text(source):
        return Problem.from_dict(load_design(source).problem)
    return load_problem(source)


def dwell_times(text: str) -> float | list[float]:
    """A dwell time, or a file of them."""
    from obsdesign.entries import number_from_text

    try:
        return number_from_text(text)
    except ValueError:
        from obsdesign.data.dwell_file import read_dwell_times

        if Path(text).is_file():
            return read_dwell_times(text)
        raise InputError(
            f"--dwell must be shortest, random, a number or a file; got {text!r}."
        ) from None


def numbers(text: str, option: str) -> list[float]:
    """x1,x2,... as an option has them."""
    from obsdesign.entries import LARGEST, number_from_text

    try:
        values = [number_from_text(part.strip()) for part in text.split(",")]
    except ValueError:
        raise InputError(f"{option} must be numbers separated by commas; got {text!r}.") from None
    for value in values:
        if LARGEST < abs(value) < math.inf:
            raise InputError(f"{option} must be at most {LARGEST:g} in size; got {value!r}.")
    return values


def _titles(context: click.Context, option: click.Parameter, value: str | None) -> dict[str, str]:
    """Column by title from TITLE=COLUMN,...; none where the option is not given."""
    pairs = [] if value is None else [part.split("=") for part in value.split(",")]
    if not all(len(pair) == 2 and all(name.strip() for name in pair) for pair in pairs):
        raise InputError(f"--rename must be TITLE=COLUMN, separated by commas; got {value!r}.")
    return {title.strip(): column.strip() for title, column in pairs}


RENAME = click.option(
    "--rename", "titles", metavar="TITLE=COLUMN,…", callback=_titles,
    help="Titles of columns of the data that differ from those of the problem: speed=y1,volt=u1.",
)  # fmt: skip


def values_by_name(text: str) -> dict[str, float]:
    """name=value,... as --parameters has them."""
    from obsdesign.entries import number_from_text

    try:
        pairs = [part.split("=") for part in text.split(",")]
        return {name.strip(): number_from_text(value.strip()) for name, value in pairs}
    except ValueError:
        raise InputError(
            f"--parameters must be a word or name=value, separated by commas; got {text!r}."
        ) from None


def answer_of(path: str) -> NewEntries:
    """The JSON that a command printed, or a design file with its valid digest."""
    from obsdesign.design_file import load_design
    from obsdesign.input_files import parse_json, read_text, require_depth

    try:
        body = parse_json(read_text(path))
    except InputError:
        raise
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: cannot be read as JSON: {error}.") from None
    require_depth(body, path)
    if not isinstance(body, dict):
        raise InputError(f"{path}: one JSON object is required; got {type(body).__name__}.")
    if "command" not in body:
        load_design(path)
    return body
