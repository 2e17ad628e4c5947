"""Proposals of widths: limits of systems without jumps."""

from __future__ import annotations

import numpy as np
import pytest

from obsdesign.equations.interval.width import WidthSystem
from obsdesign.synthesis.tube import propose_limit


def system(W: list[list[float]]) -> WidthSystem:
    n = len(W)
    return WidthSystem(
        W=np.array(W), f=np.ones(n), N=None, h=None, K=None, k=None, out=np.eye(n)
    )  # fmt: skip


@pytest.mark.parametrize("pace", [1.0, 1e3, 1e150])
def test_what_grows_has_no_limit_and_overflows_nothing(pace: float) -> None:
    assert propose_limit(system([[pace, 0], [1, -1]])) is None


@pytest.mark.parametrize("pace", [1.0, 1e3])
def test_what_decays_has_one(pace: float) -> None:
    limit = propose_limit(system([[-pace, 0], [1, -1]]))
    assert limit is not None
    assert limit["always"] == pytest.approx([1 / pace, 1 + 1 / pace], rel=2e-3)
