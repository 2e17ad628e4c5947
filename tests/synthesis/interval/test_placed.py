"""Many states: real poles and one linear program give gains that are proved within a second."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import obsdesign
from lmi.arithmetic.exponential import expm
from lmi.time_budget import UNLIMITED
from lmi.verdict import overall
from obsdesign.synthesis.interval.candidates import synthesize
from obsdesign.synthesis.interval.goals import growth
from obsdesign.synthesis.interval.placed import placed_choice
from obsdesign.synthesis.interval.task import GainSearch
from obsdesign.verification.interval.claims import claims


def plant(n: int, p: int, shift: float, **observer: Any) -> obsdesign.Problem:
    """A random plant whose fastest growing mode has the rate `shift`, and mild jumps."""
    rng = np.random.default_rng([n, p])
    A = rng.standard_normal((n, n)) / np.sqrt(n)
    A += (shift - np.linalg.eigvals(A).real.max()) * np.eye(n)
    G = 0.9 * (np.eye(n) + 0.1 * rng.standard_normal((n, n)) / np.sqrt(n))
    body = {
        "flow": {"A": A.tolist(), "disturbance": {"lower": [-0.1] * n, "upper": [0.1] * n}},
        "jump": {"G": G.tolist(), "dwell_time": [0.5, 1.0]},
        "output": {"C": rng.standard_normal((p, n)).tolist(), "noise_bound": [0.05] * p},
        "observer": {"kind": "interval", **observer},
    }
    return obsdesign.Problem.from_dict(body)


@pytest.mark.parametrize(("n", "shift"), [(8, -0.3), (12, 0.05)])
def test_the_first_candidate_is_proved(n: int, shift: float) -> None:
    problem = plant(n, 4, shift)
    first = next(synthesize(problem))
    answers = claims(problem, first.document(), first.certificates)
    assert (first.label, overall(claim.verdict for claim in answers)) == ("coordinates", "proved")
    assert first.goes_on  # wider ones are only the first answer


def test_the_width_contracts_at_every_dwell_time_of_the_range() -> None:
    search = GainSearch(plant(10, 4, 0.05), {}, UNLIMITED)
    choice = placed_choice(search)
    assert choice is not None
    task = search.task(False, choice.S)
    L, M = task.inward(choice.L, choice.M)
    assert growth(task, L, M) < 1
    system = task.system(L, M)
    off = system.W - np.diag(np.diag(system.W))
    assert np.abs(off).max() <= 1e-6 * np.abs(system.W).max()
    for theta in (0.5, 0.6, 0.8, 1.0):
        assert np.abs(np.linalg.eigvals(expm(system.W * theta) @ system.at_jumps[0])).max() < 1


def test_given_and_limited_gains_are_kept() -> None:
    free = placed_choice(GainSearch(plant(8, 4, 0.05), {}, UNLIMITED))
    assert free is not None
    assert np.abs(free.L).max() > 0.2
    assert placed_choice(GainSearch(plant(8, 4, 0.05, gain_limit=0.01), {}, UNLIMITED)) is None
    given = {"M": np.zeros((8, 4))}
    kept = placed_choice(GainSearch(plant(8, 4, -0.3, gains={"M": given["M"]}), given, UNLIMITED))
    assert kept is not None
    assert not kept.M.any()
    assert placed_choice(GainSearch(plant(8, 4, 0.05), {"L": np.zeros((8, 4))}, UNLIMITED)) is None


def test_the_twin_with_jumps_that_grow_has_none() -> None:
    body = plant(8, 2, 0.05).to_dict()
    body["jump"]["G"] = (40 * np.array(body["jump"]["G"])).tolist()
    assert placed_choice(GainSearch(obsdesign.Problem.from_dict(body), {}, UNLIMITED)) is None
