"""Modes that no gain reaches refute all gains; the same plants with modes that decay are proved."""

from __future__ import annotations

from typing import Any

import pytest

import obsdesign
from obsdesign.problem.gain_constraints import Disc, GainConstraints
from obsdesign.verification.gain_constraints import _text


def two_modes(second: float, kept: float | None, high: Any = 2.0) -> obsdesign.Problem:
    """x1 measured; x2' = second x2 hidden, x2+ = kept x2 at jumps (None: no jumps)."""
    body: dict[str, Any] = {
        "flow": {"A": [[-1.0, 0.0], [0.0, second]]},
        "output": {"C": [[1.0, 0.0]]},
        "observer": {"kind": "luenberger"},
    }
    if kept is not None:
        body["jump"] = {"G": [[0.5, 0.0], [0.0, kept]], "dwell_time": [1.0, high]}
        body["output"]["jump_measurement"] = "before"
    return obsdesign.Problem.from_dict(body)


@pytest.mark.parametrize(
    ("second", "kept", "high", "verdict"),
    [
        (0.5, 1.0, 2.0, "refuted"),
        (0.5, 0.4, 2.0, "refuted"),  # e^{.5 2} .4 = 1.09
        (0.5, 0.3, 2.0, "proved"),  # .82
        (-0.5, 1.7, 2.0, "refuted"),  # e^{-.5 1} 1.7 = 1.03
        (-0.5, 1.5, 2.0, "proved"),  # .91
        (0.5, 0.1, "inf", "refuted"),
        (-0.5, 1.5, "inf", "proved"),
        (0.5, None, None, "refuted"),
        (-0.5, None, None, "proved"),
    ],
)
def test_a_mode_that_no_output_shows_decides(
    second: float, kept: float | None, high: Any, verdict: str
) -> None:
    outcome = obsdesign.investigate(two_modes(second, kept, high))
    assert outcome.verdict == verdict


def test_sentences_name_the_wishes_that_are_stated() -> None:
    disc = Disc(centre=-3.0, radius=2.5)
    regions = {
        "have real parts below -1.5": GainConstraints(decay=1.5),
        "lie within 0.8 rad of the negative real axis": GainConstraints(sector=0.8),
        "lie in the open disc of radius 2.5 around -3.0": GainConstraints(disc=disc),
    }
    for text, constraints in regions.items():
        assert _text("region", "L", constraints) == f"all eigenvalues of A - L C {text}"
        assert _text("gain_norm", "L", constraints) == _text("structure", "L", constraints) == ""
    whole = _text("region", "M", GainConstraints(decay=1.5, sector=0.8, disc=disc))
    assert whole == f"all eigenvalues of the error's matrix at jumps {' and '.join(regions)}"
    assert _text("region", "L", GainConstraints(norm=2.0)) == ""
    assert (
        _text("gain_norm", "M", GainConstraints(norm=2.0))
        == "the spectral norm of M is at most 2.0"
    )
    pattern = _text("structure", "L", GainConstraints(pattern=((True, False), (False, True))))
    assert pattern == "L is zero where [[1, 0], [0, 1]] is"
