"""The column of a data file that names the mode of each row."""

from __future__ import annotations

import io

import pytest

from obsdesign.data.layout import Layout
from obsdesign.data.records import read_samples
from obsdesign.errors import InputError

LAYOUT = Layout(1, modes=("open", "closed"))


def rows(text: str) -> list[str | None]:
    return [sample.mode for sample in read_samples(io.StringIO(text), LAYOUT, "data.csv")]


def test_a_blank_mode_is_unchanged() -> None:
    assert rows("t,y1,mode\n0,1,open\n1,1,\n2,1, closed\n") == ["open", None, "closed"]


def test_a_blank_mode_is_unchanged_in_rows_that_may_be_late() -> None:
    text = "t,y1,mode,received\n0,1,open,0\n1,1,,1\n2,1,closed,2\n"
    assert rows(text) == ["open", None, "closed"]


@pytest.mark.parametrize(
    ("text", "refusal"),
    [
        ("t,y1\n0,1\n", "column 'mode' is required"),
        ("t,y1,mode\n0,1,\n", "data.csv line 2: mode is required in the first row"),
        ("t,y1,mode\n0,1,open\n1,1,ajar\n", "data.csv line 3: mode must be one of open, closed"),
    ],
)
def test_modes_that_are_none_are_refused(text: str, refusal: str) -> None:
    with pytest.raises(InputError) as error:
        rows(text)
    assert refusal in str(error.value)
