"""Units far from one, and numbers that floats cannot square: the same answer, or a line."""

from __future__ import annotations

import copy
import warnings
from typing import Any

import numpy as np
import pytest

import obsdesign
from tests.systems.impulsive_input import CHAIN, observer_of, record

TRAIN = [(20.03, 1.0), (50.06, 2.0), (80.08, -3.0)]


@pytest.fixture(autouse=True)
def no_warnings() -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def changed(block: str, name: str, value: Any, noise: float = 0.0) -> dict[str, Any]:
    body = copy.deepcopy(CHAIN)
    body["output"] |= {"period": 0.1, "noise_std": [noise]}
    body[block] |= {name: value}
    return body


@pytest.mark.parametrize("sizes", [(1e-8, 1.0, 1e8), (1e-12, 1.0, 1e12), (1e3, 1e-5, 1e2)])
def test_units_of_the_states_do_not_matter(sizes: tuple[float, ...]) -> None:
    S, back = np.diag(sizes), np.diag(1 / np.array(sizes))
    A, H, C = (np.array(CHAIN[b][k]) for b, k in (("flow", "A"), ("jump", "H"), ("output", "C")))
    body = changed("flow", "A", (S @ A @ back).tolist())
    body["jump"]["H"], body["output"]["C"] = (S @ H).tolist(), (C @ back).tolist()
    observer, t = observer_of(body), 0.1 * np.arange(1200)
    x = record(A, H, TRAIN, t, np.zeros(3))
    batch = observer.run_batch(t, x @ C.T)
    for event, (onset, weight) in zip(batch.events, TRAIN, strict=True):
        assert event.status == "ok"
        assert event.t == pytest.approx(onset, abs=1e-4)
        assert event.weights[0] == pytest.approx(weight, abs=1e-4)
    assert batch.x is not None
    # the last window is not decided
    np.testing.assert_allclose(batch.x[:990] @ back, x[:990], atol=1e-2)


@pytest.mark.parametrize(
    ("block", "name", "value", "line"),
    [
        ("output", "noise_std", [1e120], "output.noise_std must be 0, or between 1e-100 and 1e\\+100"),
        ("output", "noise_std", [1e-120], "output.noise_std must be 0, or between"),
        ("output", "C", [[0, 0, 1e120]], "output.C must be at most 1e\\+100 in size"),
        ("output", "C", [[0, 0, 1e50]], "are the units of flow.A and output.C what they should be"),
        ("output", "C", [[0, 0, 1e-99]], "output.C must be 0, or at least 1e-70 in size"),
        ("jump", "H", [[1e120], [0], [0]], "jump.H must be at most 1e\\+100 in size"),
    ],
)  # fmt: skip
def test_what_floats_cannot_follow_is_refused(block: str, name: str, value: Any, line: str) -> None:
    with pytest.raises(obsdesign.InputError, match=line):
        obsdesign.investigate(obsdesign.Problem.from_dict(changed(block, name, value)))


@pytest.mark.parametrize("noise", [0.0, 3.0])
@pytest.mark.parametrize("outlier", [1e6, 1e30, 1e99])
def test_an_outlier_leaves_every_row_finite(noise: float, outlier: float) -> None:
    observer, t = (
        observer_of(changed("jump", "dwell_time", [25, "inf"], noise)),
        0.1 * np.arange(900),
    )
    y = np.ones((900, 1))
    y[500] = outlier
    batch = observer.run_batch(t, y)
    assert batch.x is not None
    assert np.isfinite(batch.x).all()
    near = [status for status, at in zip(batch.status, t, strict=True) if 48 < at < 50]
    assert all(status != "ok" for status in near)


@pytest.mark.parametrize("noise", [0.0, 3.0])
def test_a_number_that_cannot_be_squared_is_refused(noise: float) -> None:
    observer = observer_of(changed("jump", "dwell_time", [25, "inf"], noise))
    t, y = 0.1 * np.arange(10), np.ones((10, 1))
    y[4] = -1e300
    with pytest.raises(obsdesign.InputError, match=r"y1 must be at most 1e.100 in size.*t = 0.4"):
        observer.run_batch(t, y)
    with pytest.raises(obsdesign.InputError, match=r"x2 must be at most 1e.100 in size"):
        observer.init(0.0, x=[0.0, 1e300, 0.0])
    with pytest.raises(ValueError, match="x must be finite"):
        observer.init(0.0, x=[0.0, np.nan, 0.0])
