"""The first row of a file states the known inputs: no row before it does."""

from __future__ import annotations

import io

import numpy as np
import pytest

from obsdesign.data.clock_columns import ClockColumns
from obsdesign.data.layout import Layout
from obsdesign.data.records import read_samples
from obsdesign.errors import InputError

ONE, TWO = Layout(1, u=1), Layout(1, u=2)
LATE = Layout(1, u=1, clocks=ClockColumns({}, {"probe": 1}, lag=1.0))


def inputs(text: str, layout: Layout) -> list[list[float] | None]:
    samples = read_samples(io.StringIO(text), layout, "data.csv")
    return [None if each.u is None else np.asarray(each.u).tolist() for each in samples]


def test_an_empty_input_keeps_the_last() -> None:
    assert inputs("t,y1,u1\n0,1,5\n1,1,\n2,1,6\n", ONE) == [[5.0], None, [6.0]]
    late = "t,probe,u1\n1,1,\n0,1,5\n"  # the first in time is not the first line
    assert inputs(late, LATE) == [[5.0], None]


@pytest.mark.parametrize(
    ("text", "layout", "refusal"),
    [
        ("t,y1,u1\n0,1,\n1,1,5\n", ONE, "data.csv line 2: u1 is required in the first row"),
        ("t,y1,u1,u2\n0,1,5,\n", TWO, "data.csv line 2: u1…u2 is required in the first row"),
        ("t,probe,u1\n1,1,5\n0,1,\n", LATE, "u1 is required in the first row, that of t = 0"),
    ],
)  # fmt: skip
def test_a_first_row_without_inputs_is_refused(text: str, layout: Layout, refusal: str) -> None:
    with pytest.raises(InputError) as error:
        inputs(text, layout)
    assert refusal in str(error.value)
