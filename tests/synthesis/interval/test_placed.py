"""Many states: placed poles and one linear program give gains that are proved within a second."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import obsdesign
from lmi.arithmetic.exponential import expm
from lmi.time_budget import UNLIMITED
from lmi.verdict import overall
from obsdesign.synthesis.interval import placed
from obsdesign.synthesis.interval.candidates import synthesize
from obsdesign.synthesis.interval.coordinates import CoordinateChoice
from obsdesign.synthesis.interval.goals import growth
from obsdesign.synthesis.interval.placed import _sector_poles, placed_gains
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


def choice_of(problem: obsdesign.Problem, given: Any = None) -> CoordinateChoice | None:
    return placed_gains(GainSearch(problem, given or {}, UNLIMITED)).choice


@pytest.mark.parametrize(("n", "p", "shift"), [(8, 4, -0.3), (12, 4, 0.05), (10, 2, 0.05)])
def test_the_first_candidate_is_proved(n: int, p: int, shift: float) -> None:
    problem = plant(n, p, shift)
    first = next(synthesize(problem))
    answers = claims(problem, first.document(), first.certificates)
    assert (first.label, overall(claim.verdict for claim in answers)) == ("coordinates", "proved")
    assert first.goes_on  # wider ones are only the first answer


def test_the_width_contracts_at_every_dwell_time_of_the_range() -> None:
    search = GainSearch(plant(10, 4, 0.05), {}, UNLIMITED)
    choice = placed_gains(search).choice
    assert choice is not None
    task = search.task(False, choice.S)
    L, M = task.inward(choice.L, choice.M)
    assert growth(task, L, M) < 1
    system = task.system(L, M)
    for theta in (0.5, 0.6, 0.8, 1.0):
        after = expm(system.W * theta * task.pace) @ system.at_jumps[0]
        assert np.abs(np.linalg.eigvals(after)).max() < 1


def test_complex_pairs_are_kept_where_that_is_narrower(monkeypatch: pytest.MonkeyPatch) -> None:
    """Than real poles alone; the twin has no use for pairs."""
    for n, shift, part in ((10, -0.1, 0.95), (10, 0.05, 0.6)):
        problem = plant(n, 2, shift)
        choice = choice_of(problem)
        with monkeypatch.context() as patch:
            patch.setattr(placed, "_MARGINS", ())
            real = choice_of(problem)
        assert choice is not None
        assert real is not None
        assert choice.value < part * real.value
        A, C = problem.plant.flow.A, problem.plant.output.C
        poles = np.linalg.eigvals(A - choice.L @ C)
        assert (np.abs(poles.imag) > 0.01).any()
        assert (poles.real + np.abs(poles.imag) < 0).all()
    problem = plant(12, 3, 0.05)
    choice = choice_of(problem)
    assert choice is not None
    A, C = problem.plant.flow.A, problem.plant.output.C
    assert np.abs(np.linalg.eigvals(A - choice.L @ C).imag).max() < 1e-6


def test_given_and_limited_gains_are_kept() -> None:
    free = choice_of(plant(8, 4, 0.05))
    assert free is not None
    assert np.abs(free.L).max() > 0.2
    assert (
        placed_gains(GainSearch(plant(8, 4, 0.05, gain_limit=0.01), {}, UNLIMITED)).choice is None
    )
    given = {"M": np.zeros((8, 4))}
    kept = choice_of(plant(8, 4, -0.3, gains=given), given)
    assert kept is not None
    assert not kept.M.any()
    assert choice_of(plant(8, 4, 0.05), {"L": np.zeros((8, 4))}) is None


def test_jumps_that_grow_have_no_gains_and_a_remark_says_so() -> None:
    body = plant(8, 2, 0.05).to_dict()
    body["jump"]["G"] = (40 * np.array(body["jump"]["G"])).tolist()
    placed = placed_gains(GainSearch(obsdesign.Problem.from_dict(body), {}, UNLIMITED))
    assert placed.choice is None
    assert placed.growth > 1
    (remark,) = placed.remarks
    assert remark.text.startswith(f"of {placed.sets} sets of placed poles none has gains")
    assert "set_membership needs no such gains" in remark.text
    limited = placed_gains(GainSearch(plant(8, 4, 0.05, gain_limit=0.01), {}, UNLIMITED))
    assert "none could be placed in floats, by gains within" in limited.remarks[0].text
    # the twin
    assert not placed_gains(GainSearch(plant(8, 4, 0.05), {}, UNLIMITED)).remarks


def test_pairs_are_moved_no_farther_than_they_are_wide() -> None:
    A = np.zeros((6, 6))
    A[:2, :2], A[2:4, 2:4] = [[0.1, 0.7], [-0.7, 0.1]], [[-2, 0.5], [-0.5, -2]]
    A[4:, 4:] = np.diag([0.3, 0.3])
    poles = _sector_poles(A, 0.1, 0.05)
    assert np.sort_complex(poles) == pytest.approx(
        np.array([-2 - 0.5j, -2 + 0.5j, -0.8 - 0.7j, -0.8 + 0.7j, -0.15, -0.1])
    )
