"""Unknown inputs in C: after a gap the estimate comes back to the runtime's; what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from obsdesign import InputError
from obsdesign.export.manifest import Options
from obsdesign.export.record import wandering_rows
from obsdesign.export.timing import Steps
from obsdesign.runtime import Sample, from_design
from tests.export.plants import UNKNOWN
from tests.systems.compiled import Library
from tests.systems.designs import designed

MISSING, UNCERTIFIED = 1, 4
H = 0.1


def differences(folder: Path, gaps: set[int], count: int) -> tuple[list[float], list[int]]:
    """Largest differences from the runtime, and statuses, of rows without some samples."""
    design = designed(UNKNOWN)
    library = Library(folder, design, Options("double", Steps((H,))))
    observer, n = from_design(design), library.program.sizes.n
    library.start(np.zeros(n))
    state, off, statuses = observer.start(0.0, [0.0] * n), [], []
    for k, row in enumerate(wandering_rows(library.program, np.random.default_rng(1), count)):
        each = row._replace(y=None) if k in gaps else row
        ends, status = library.step(each)
        state, estimate = observer.step(state, Sample(k * H, each.y, each.u))
        assert estimate.x is not None
        assert estimate.d is not None
        wanted = np.concatenate([estimate.x, np.nan_to_num(estimate.d)])
        off.append(float(np.abs(ends - wanted).max()))
        statuses.append(status)
    return off, statuses


def test_without_gaps_numbers_are_those_of_the_runtime(tmp_path: Path) -> None:
    off, statuses = differences(tmp_path, set(), 200)
    assert max(off) < 1e-12
    assert statuses == [0] * 200


def test_a_gap_is_forgotten(tmp_path: Path) -> None:
    off, statuses = differences(tmp_path, {10, 50, 51}, 200)
    assert max(off[:10]) < 1e-12
    assert max(off) < 1.0
    assert off[-1] < 1e-6
    assert [k for k, status in enumerate(statuses) if status == MISSING] == [10, 50, 51]
    assert [k for k, status in enumerate(statuses) if status == UNCERTIFIED] == [11, 52]


@pytest.mark.parametrize(
    ("observer", "step", "part"),
    [
        ({"differentiator": "damped"}, H, "'damped' cannot be exported"),
        ({"poles": [-1.0, -30.0]}, 0.1, "2/|f|"),
    ],
)
def test_refusals(observer: dict[str, Any], step: float, part: str) -> None:
    body = UNKNOWN | {"observer": UNKNOWN["observer"] | observer}
    with pytest.raises(InputError) as refusal:
        Options("double", Steps((step,))).program(designed(body))
    assert part in str(refusal.value)
