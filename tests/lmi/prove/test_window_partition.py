"""Windows of dwell times: what divides all sequences is read, with exactly its edges."""

from __future__ import annotations

import copy
import math
from typing import Any

import pytest

from lmi.prove.window_partition import Unreadable, read_certificate

ENDS = (1.0, 2.0)
THIRDS = [[1.0, 1.25], [1.25, 1.75], [1.75, 2.0]]


def certificate(intervals: list[list[float]], edges: list[list[float]]) -> dict[str, Any]:
    """Windows of the present dwell time alone; P of one state."""
    windows = [{"dwell": {"0": pair}, "P": [[1.0 + k]]} for k, pair in enumerate(intervals)]
    return {"windows": windows, "edges": edges}


def all_edges(intervals: list[list[float]], without: tuple[tuple[int, int], ...] = ()) -> list:
    count = range(len(intervals))
    return [[s, t, *intervals[s]] for s in count for t in count if (s, t) not in without]


def reason_against(
    content: dict[str, Any], n: int = 1, jitter: float = math.inf, ends: Any = ENDS
) -> str:
    try:
        read_certificate(content, n, ends, jitter)
    except Unreadable as error:
        return str(error)
    return ""


def test_a_partition_is_read_with_its_edges() -> None:
    read = read_certificate(certificate(THIRDS, all_edges(THIRDS)), 2, ENDS, math.inf)
    assert [box[0] for box in read.boxes] == [tuple(pair) for pair in THIRDS]
    assert read.P.tolist() == [[[1.0]], [[2.0]], [[3.0]]]
    assert sorted(read.edges) == [tuple(edge) for edge in all_edges(THIRDS)]
    assert read.reduced  # P of one state where there are two
    assert not read_certificate(certificate(THIRDS, all_edges(THIRDS)), 1, ENDS, math.inf).reduced


@pytest.mark.parametrize(
    ("jitter", "without"),
    [
        (0.6, ()),
        (0.51, ()),
        (0.5, ((0, 2), (2, 0))),  # from 1.25 to 1.75 alone: one point is no inside
        (0.1, ((0, 2), (2, 0))),
        (1e-9, ((0, 2), (2, 0))),
    ],
)
def test_steps_of_at_most_the_jitter_leave_out_edges(jitter: float, without: Any) -> None:
    assert reason_against(certificate(THIRDS, all_edges(THIRDS, without)), jitter=jitter) == ""
    one_less = certificate(THIRDS, all_edges(THIRDS, (*without, (1, 1))))
    assert "do not list" in reason_against(one_less, jitter=jitter)
    every = reason_against(certificate(THIRDS, all_edges(THIRDS)), jitter=jitter)
    assert every == ("the edges list windows 1 and 3 as they do not follow" if without else "")


def two_offsets() -> dict[str, Any]:
    """Three windows: the last dwell time splits the present one's upper half."""
    dwells = [
        {"0": [1.0, 1.5]},
        {"0": [1.5, 2.0], "-1": [1.0, 1.5]},
        {"0": [1.5, 2.0], "-1": [1.5, 2.0]},
    ]
    return {
        "windows": [{"dwell": dwell, "P": [[1.0]]} for dwell in dwells],
        "edges": [
            [0, 0, 1.0, 1.5], [0, 1, 1.0, 1.5],
            [1, 0, 1.5, 2.0], [1, 2, 1.5, 2.0],
            [2, 0, 1.5, 2.0], [2, 2, 1.5, 2.0],
        ],
    }  # fmt: skip


def test_windows_of_two_dwell_times() -> None:
    assert reason_against(two_offsets()) == ""
    # twins: the same windows with another edge, or one less
    for change in ([0, 2, 1.0, 1.5], [1, 1, 1.5, 2.0]):
        content = two_offsets()
        content["edges"].append(change)
        assert "as they do not follow" in reason_against(content)
    for k in range(6):
        content = two_offsets()
        s, t = content["edges"].pop(k)[:2]
        assert f"window {t + 1} can follow window {s + 1}" in reason_against(content)


@pytest.mark.parametrize(
    "intervals",
    [
        [[1.0, 1.5]],
        [[1.0, 1.5], [1.5, 1.9]],
        [[1.1, 1.5], [1.5, 2.0]],
        [[1.0, 1.4], [1.5, 2.0]],
        [[1.0, 1.6], [1.5, 2.0]],
        [[1.0, 1.5], [1.5, 2.0], [1.25, 1.75]],
        [[1.0, 1.5], [1.5, 2.0], [1.5, 2.0]],
        [[1.0, 2.0], [1.0, 2.0]],
    ],
)
def test_windows_with_gaps_or_overlaps_are_refused(intervals: list) -> None:
    reason = reason_against(certificate(intervals, all_edges(intervals)))
    assert reason == "the windows do not divide all sequences of dwell times"


SPOILT: list[tuple[str, Any, str]] = [
    ("windows", [], "holds no windows"),
    ("windows", None, "holds no windows"),
    ("P", [[1.0, 0.0]], "square and of one size"),
    ("P", [], "square and of one size"),
    ("P", [[1.0, 0.0], [0.0, 1.0]], "square and of one size"),  # of more states than there are
    ("P", [[math.nan]], "not finite and symmetric"),
    ("P", [[math.inf]], "not finite and symmetric"),
    ("P", "P", "as they should be"),
    ("dwell", {"0": [0.5, 2.0]}, "as they should be"),
    ("dwell", {"0": [1.0, 2.5]}, "as they should be"),
    ("dwell", {"0": [2.0, 1.0]}, "as they should be"),
    ("dwell", {"0": [1.0, 1.0]}, "as they should be"),
    ("dwell", {"00": [1.0, 2.0]}, "as they should be"),
    ("dwell", {"1000000": [1.0, 2.0]}, "as they should be"),
    ("dwell", {"0": [True, 2.0]}, "as they should be"),
    ("dwell", {"0": ["1", 2.0]}, "as they should be"),
    ("dwell", {"0": [1.0, math.nan]}, "as they should be"),
    ("edges", [[0, 0, 1.0, 2.0]] * 2, "listed twice"),
    ("edges", [[0.0, 0, 1.0, 2.0]], "as they should be"),
    ("edges", [[True, 0, 1.0, 2.0]], "as they should be"),
    ("edges", [[0, 0, 1.0]], "as they should be"),
    ("edges", [[0, 0, 1.0, "2"]], "as they should be"),
]


@pytest.mark.parametrize(("name", "value", "reason"), SPOILT)
def test_what_is_no_certificate_is_refused(name: str, value: Any, reason: str) -> None:
    whole = [[1.0, 2.0]]
    content = certificate(whole, all_edges(whole))
    assert reason_against(content) == ""
    spoilt = copy.deepcopy(content)
    if name in ("P", "dwell"):
        spoilt["windows"][0][name] = value
    else:
        spoilt[name] = value
    assert reason in reason_against(spoilt)


def test_matrices_of_two_states_are_symmetric() -> None:
    whole = [[1.0, 2.0]]
    content = certificate(whole, all_edges(whole))
    content["windows"][0]["P"] = [[1.0, 0.5], [0.5, 1.0]]
    assert reason_against(content, n=2) == ""
    content["windows"][0]["P"] = [[1.0, 0.5], [0.4, 1.0]]
    assert "symmetric" in reason_against(content, n=2)
    content["windows"][0]["P"] = [[1.0, 0.5]]
    assert "square" in reason_against(content, n=2)


def test_a_range_without_end() -> None:
    intervals: list[list[Any]] = [[1.0, 3.0], [3.0, "inf"]]
    content = certificate(intervals, all_edges(intervals))
    assert reason_against(content, ends=(1.0, math.inf)) == ""
    assert reason_against(content, ends=(1.0, math.inf), jitter=0.5) == ""
    assert reason_against(content) != ""
