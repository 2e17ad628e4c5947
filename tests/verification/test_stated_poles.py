"""Stated poles that floats hardly hold: immense gains, equal modes, poles at 0."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import obsdesign
from lmi.arithmetic.balls import exact
from obsdesign.analysis.stated_poles import gap
from obsdesign.synthesis.placement import placed_gain
from obsdesign.verification.stated_poles import poles_claim, rounding_of_gain
from tests.verification.test_stated_gains import ILL, UNITS, luenberger, saved, verdict_of


@pytest.mark.parametrize("base", [2.0, 10.0])
@pytest.mark.parametrize("seed", range(4))
def test_repeated_poles_are_placed_where_modes_are_equal(seed: int, base: float) -> None:
    """In units of powers of 10 equal but for rounding: one output hardly sees both, two do."""
    rng = np.random.default_rng(seed)
    p, m = 2 + seed // 2, int(rng.integers(1, 3))
    block, sizes = rng.normal(size=(m, m)), base ** rng.integers(-6, 7, p * m)
    A = np.kron(np.eye(p), block) * sizes / sizes[:, None]
    C = rng.normal(size=(p, p * m)) * sizes * base ** rng.integers(-6, 7, (p, 1))
    poles = [-2.0] * (p * m)
    F = exact(A) - exact(placed_gain(A, C, poles)) @ exact(C)
    assert gap(F, poles).relative < 1e-9
    for fewer in (C[:1], np.repeat(C[:1], p, axis=0)):
        with pytest.raises(obsdesign.InputError, match=r"does not see it|hardly sees"):
            placed_gain(A, fewer, poles)


ONE_ULP = 2.0**-52
# flow.A, output.C and poles: gains in floats have other poles; and of a plant of the same kind
HARDLY_PLACED: dict[str, tuple[Any, Any, Any, Any]] = {
    "hidden but for rounding": (
        [-0.3, 0.1 * -3], [[0.7, 0.9]], [-1, -2], [-0.3, -0.301],
    ),
    "several outputs": (
        [-1, -1 - ONE_ULP, -1 - 2 * ONE_ULP], [[1 / 3, 1 / 7, 0.3], [1, 0.2, 0.1]],
        [-2.3, -3.1, -4.1], [-1, -1, -1 - 2e-3],
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", HARDLY_PLACED)
def test_poles_that_rounding_takes_elsewhere_are_refused(name: str) -> None:
    modes, C, poles, other = HARDLY_PLACED[name]
    with pytest.raises(obsdesign.InputError, match=r"hardly sees the mode -(0\.3|1) of flow\.A"):
        obsdesign.investigate(luenberger(np.diag(modes).tolist(), C, poles=poles))
    outcome = obsdesign.investigate(luenberger(np.diag(other).tolist(), C, poles=poles))
    assert outcome.verdict == "proved"


def test_poles_far_below_the_rates_of_a_plant_are_refused() -> None:
    """True eigenvalues: -0.0064 to -0.019, for -0.01 to -0.015."""
    A, C, poles = ILL["longer chain"]
    far = [pole / 10 for pole in poles]
    with pytest.raises(obsdesign.InputError, match=r"by 0\.011 times its size.* are far from"):
        placed_gain(np.array(A), np.array(C), far)
    assert gap(exact(A) - exact(placed_gain(np.array(A), np.array(C), poles)) @ exact(C), poles)


def test_immense_gains_do_not_have_every_pole_within_their_rounding() -> None:
    A, C, poles = [[-1, 0], [0, -1 - ONE_ULP]], [[1, 1]], [-2, -3]
    body = saved(luenberger(A, C, poles=poles))  # L = 9e15, exactly
    assert verdict_of(body) == "proved"
    for forged in ([-2.5, -3.5], [-2.1, -2.9], [-2, -3.1]):
        assert verdict_of(body, poles=forged) == "undecided"
    assert verdict_of(body, poles=[-200, -300]) == "refuted"
    changes = rounding_of_gain(np.array(body["gains"]["L"]), np.array(C))
    F = exact(A) - exact(body["gains"]["L"]) @ exact(C)
    assert poles_claim(F, [-2, -3.0001], changes=changes).verdict == "proved"


def stated_measure(statement: str, poles: Any) -> tuple[float, Any]:
    """The part that a proved claim states, and the coefficients it is one of, s^n first."""
    text = statement.split(" polynomial to ")[1]
    part = float(text.split(" of that of ")[0])
    zero = float(text.split(", s + ")[1].split(" for")[0]) if ", s + " in text else 0.0
    return part, np.poly([-(abs(pole) or zero) for pole in poles])


def companion(coefficients: Any) -> Any:
    """The matrix with a polynomial, s^n first."""
    F = np.diag(np.ones(len(coefficients) - 2), 1)
    F[-1] = -coefficients[:0:-1]
    return exact(F)


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("poles", [[0, -1], [0, 0, -1], [0, -1, -3], [0, 0], [-1, -3]])
def test_coefficients_are_within_the_part_that_the_sentence_states(poles: Any, unit: float) -> None:
    places = [pole * unit for pole in poles]
    # poles at 0 alone state no pace of their own
    plant = companion(np.array([1, *[0] * (len(poles) - 1), -(unit ** len(poles))]))
    pace = max(map(abs, places)) or unit
    stated, sizes = np.poly(places), np.poly([-(abs(pole) or pace) for pole in places])
    for power in range(1, len(poles) + 1):
        tolerance = 1e-12 if stated[power] == 0 else 1e-5
        for relative in (0.0, 1e-14, -2e-13, -9e-12, 9e-12, 4e-7, 9e-6, 2e-4):
            coefficients = stated.copy()
            coefficients[power] += relative * sizes[power]
            claim = poles_claim(companion(coefficients), places, flow=plant, rate=None)
            assert claim.verdict == ("proved" if abs(relative) < tolerance else "refuted")
            if claim.verdict == "proved":
                part, measure = stated_measure(claim.statement, places)
                room = part * measure + 1e-15 * sizes  # what the test itself rounds
                assert np.all(np.abs(coefficients - stated) <= room)
