"""Events that the estimate would trigger are refused with what they do to the error."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from obsdesign.equations.saltation import Impact, Radii
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem

FLIGHT, SPEED, GRAVITY = 2.0673, -10.0995, np.array([0.0, -9.8])
BALL = Impact(
    np.array([[0.0, 1.0], [0.0, 0.0]]), GRAVITY, np.diag([1.0, -1.0]), np.zeros(2),
    np.array([1.0, 0.0]), np.array([0.0, SPEED]),
)  # fmt: skip


@pytest.mark.parametrize(
    ("L", "M", "radii"),
    [
        ([0, 0], [1, -0.392], (0.1896, 1.4142, 2.2016)),
        ([0.8, 0.6], [0.1, 0.1], (0.7841, 0.7546, 0.9465)),
        ([0.1, 0.25], [0.1, 0.1], (1.0478, 0.9458, 1.8887)),
    ],
)
def test_radii_of_three_observers_of_a_ball(L: Any, M: Any, radii: tuple[float, ...]) -> None:
    columns = (np.array(values, float)[:, None] for values in (L, M))
    assert Radii.from_gains(BALL, np.array([[1.0, 0]]), *columns, FLIGHT) == pytest.approx(
        radii, abs=1e-3 * max(radii)
    )


def test_the_matrix_is_that_of_two_nearby_flights() -> None:
    """Finite differences: two states cross the surface at their own times."""

    def after(x: np.ndarray, time: float = 0.1) -> np.ndarray:
        fall = (-x[1] - np.sqrt(x[1] ** 2 - 2 * GRAVITY[1] * x[0])) / GRAVITY[1]
        speed, rest = -(x[1] + GRAVITY[1] * fall), time - fall
        return np.array([speed * rest + GRAVITY[1] * rest**2 / 2, speed + GRAVITY[1] * rest])

    start = np.array([0.3, SPEED])
    fall = (-start[1] - np.sqrt(start[1] ** 2 - 2 * GRAVITY[1] * start[0])) / GRAVITY[1]
    impact = BALL._replace(state=np.array([0.0, start[1] + GRAVITY[1] * fall]))
    flows = [np.array([[1.0, t], [0.0, 1.0]]) for t in (fall, 0.1 - fall)]
    step = 1e-6
    columns = [(after(start + step * e) - after(start - step * e)) / (2 * step) for e in np.eye(2)]
    assert np.allclose(np.column_stack(columns), flows[1] @ impact.saltation @ flows[0], atol=1e-5)


def test_a_trigger_is_refused_with_the_radius() -> None:
    body: dict[str, Any] = {
        "flow": {"A": BALL.A, "disturbance": {"lower": GRAVITY, "upper": GRAVITY}},
        "event": [
            {
                "name": "bounce", "G": BALL.G, "every": FLIGHT,
                "trigger": {"surface": [1, 0], "state": [0, SPEED]},
            }
        ],
        "sensor": [{"name": "y", "C": [[1, 0]], "every": "continuous"}],
        "observer": {"kind": "luenberger", "gains": {"M": [[1], [-0.392]]}},
    }  # fmt: skip
    words = r"event\.bounce\.trigger: .* 1\.4142 where the observer .*, 2\.2016 .* \(0\.1896"
    with pytest.raises(InputError, match=words):
        Problem(**body)
    body["event"][0]["trigger"]["state"] = [0, 0, 0]
    with pytest.raises(InputError, match=r"trigger\.state must have 2 entries; got 3"):
        Problem(**body)
    body["event"][0]["trigger"] = "estimate"
    with pytest.raises(InputError, match=r"trigger must be a table \{ surface"):
        Problem(**body)
    del body["event"][0]["trigger"]  # the twin: reported
    assert Problem(**body).plant.n == 2
