"""Gains on the measured part of uncertain effects: chosen by a design, of any values."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.problem.problem import Problem
from obsdesign.runtime import from_design
from obsdesign.workflow import verify
from tests.systems.parameters import rooms, spring


@pytest.fixture(scope="module")
def design() -> obsdesign.Design:
    return obsdesign.design(Problem.from_dict(spring()))


def _changed(design: obsdesign.Design, **gains: Any) -> obsdesign.Design:
    return obsdesign.Design(**{**vars(design), "gains": {**design.gains, **gains}})


def test_what_the_sensor_shows_is_taken_from_it(design: obsdesign.Design) -> None:
    """The stiffness acts on the measured position: nothing is left of its effect."""
    np.testing.assert_allclose(design.gains["flow_correction"], [[[0], [-0.2]]], atol=1e-12)
    assert "jump_correction" not in design.gains
    assert from_design(design).gains.is_uncertain


def test_door_and_wall_between_rooms() -> None:
    gains = obsdesign.design(Problem.from_dict(rooms())).gains
    effects = gains["effects"]
    for name, key in (("flow_correction", "A"), ("jump_correction", "G")):
        for effect, own in zip(effects, gains[name], strict=True):
            if key in effect:
                left = np.asarray(effect[key]) - own @ gains["C"]
                np.testing.assert_allclose(left[:, 0], 0, atol=1e-12)


@pytest.mark.parametrize("factor", [-3.0, 0.5])
def test_other_gains_are_as_sound(design: obsdesign.Design, factor: float) -> None:
    other = _changed(design, flow_correction=factor * design.gains["flow_correction"])
    claims = {claim.id: claim.verdict for claim in verify(other).claims}
    assert claims["consistent"] == "proved"


def test_gains_of_another_shape_are_refuted(design: obsdesign.Design) -> None:
    outcome = verify(_changed(design, flow_correction=np.zeros((2, 2, 1))))
    assert outcome.verdict == "refuted"
