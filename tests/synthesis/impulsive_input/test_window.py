"""How long a window of operator `samples` is where a problem leaves it open."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.systems.designs import investigated

RATES = [1.0, 1.4, 0.9, 1.1, 1.9]
OSCILLATOR = [[0.0, 1.0], [-6.29, -0.4]]


def samples_of(body: dict[str, Any]) -> int:
    """Samples of the window of the design."""
    outcome = investigated(body)
    assert outcome.verdict == "proved"
    assert outcome.design is not None
    return round(outcome.design.gains["window"] / body["output"]["period"])


def plant(A: Any, H: Any, C: Any, period: float = 0.03, **observer: Any) -> dict[str, Any]:
    return {
        "flow": {"A": np.asarray(A).tolist()}, "jump": {"H": H, "dwell_time": [3.2, "inf"]},
        "output": {
            "C": C, "measured": "periodic", "period": period, "noise_std": [1e-3] * len(C),
        },
        "observer": {"kind": "impulsive_input", "operator": "samples", **observer},
    }  # fmt: skip


def chain(states: int, period: float = 0.03, **observer: Any) -> dict[str, Any]:
    rates, unit = RATES[:states], np.eye(states)
    A = np.diag([-rate for rate in rates]) + np.diag(rates[:-1], -1)
    return plant(A, unit[:, :1].tolist(), unit[-1:].tolist(), period, **observer)


@pytest.mark.parametrize(("states", "least", "most"), [(3, 32, 64), (4, 64, 64), (5, 85, 85)])
def test_a_window_is_as_long_as_a_weight_requires(states: int, least: int, most: int) -> None:
    """At most 0.8 of the shortest dwell time, 106 periods."""
    assert least <= samples_of(chain(states)) <= most
    assert samples_of(chain(states, window=0.24)) == 8  # a stated window is kept


def test_units_do_not_change_a_window() -> None:
    body = chain(4)
    body["output"] |= {"C": [[0.0, 0.0, 0.0, 1e3]], "noise_std": [1.0]}
    assert samples_of(body) == samples_of(chain(4))
    body["jump"]["H"] = [[1e-3], [0.0], [0.0], [0.0]]
    assert samples_of(body) == samples_of(chain(4))


def test_an_output_next_to_the_impulse_shortens_a_window() -> None:
    body = chain(4)
    body["output"] |= {"C": [[0.0, 0.0, 0.0, 1.0], [0.0, 1.0, 0.0, 0.0]], "noise_std": [1e-3] * 2}
    assert samples_of(body) < samples_of(chain(4))


def test_a_window_stays_short_where_it_shows_the_weight_or_none_does() -> None:
    assert samples_of(plant(OSCILLATOR, [[1.0], [0.0]], [[1.0, 0.0]], period=0.25)) == 4
    # an onset and a weight leave the same but for the samples before the onset
    assert samples_of(plant([[-0.3]], [[1.0]], [[1.0]])) == 4
