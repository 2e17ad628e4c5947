"""Assumption 4 of Degue et al. (NOLCOS 2016): S and S2 built from R and T."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.errors import InputError

# F = [[-3, 1], [-2, 0]] has the eigenvalues -1, -2; H = [[0.9, 0], [0.5, -0.8]] has 0.9, -0.8
BALL = {"L": [[3], [2]], "M": [[0.1], [-0.5]], "R": [[-2, 0], [0, -1]],
        "T": [[0.05, 0.85], [0.85, 0.05]]}  # fmt: skip


def problem(
    gains: dict[str, Any], form: str = "auto", dwell: Any = (2.5, 3.0)
) -> obsdesign.Problem:
    """Example 4.2 with the gains recovered from the paper's R and S."""
    box = {"lower": [-0.5, -0.5], "upper": [0.5, 0.5]}
    return obsdesign.Problem(
        flow={"A": [[0, 1], [0, 0]], "disturbance": box},
        jump={"G": [[1, 0], [0, -0.8]], "disturbance": box, "dwell_time": list(dwell)},
        output={"C": [[1, 0]], "noise_bound": [0.0]},
        observer={"kind": "interval", "form": form, "gains": gains},
    )


def test_coordinates_are_built_from_r_and_t_and_proved() -> None:
    outcome = obsdesign.investigate(problem(BALL))
    assert outcome.verdict == "proved"
    design = obsdesign.design(problem(BALL))
    S, S2, D0, T = (np.array(design.gains[name]) for name in ("S", "S2", "D0", "T"))
    np.testing.assert_array_equal(D0, BALL["R"])
    np.testing.assert_array_equal(T, BALL["T"])
    F, H = np.array([[-3, 1], [-2, 0]]), np.array([[0.9, 0], [0.5, -0.8]])
    np.testing.assert_allclose(np.linalg.solve(S, F @ S), BALL["R"], atol=1e-13)
    np.testing.assert_allclose(np.linalg.solve(S2, H @ S2), BALL["T"], atol=1e-13)
    assert obsdesign.verify(design).verdict == "proved"


def test_the_twin_another_s_or_r_in_the_file_is_not_proved() -> None:
    design = obsdesign.design(problem(BALL))
    for name in ("S", "S2", "D0"):
        matrix = np.array(design.gains[name])
        matrix[0, 0] *= 1 + 1e-6
        spoilt = replace(design, gains={**design.gains, name: matrix})
        assert obsdesign.verify(spoilt).verdict == "refuted"


@pytest.mark.parametrize("n", [1, 2, 4])
def test_any_similar_matrices_are_found_similar(n: int) -> None:
    rng = np.random.default_rng(n)
    R, T = -np.diag(np.arange(1.0, n + 1)), np.diag(np.arange(1.0, n + 1)) / 16
    base, other = np.eye(n, k=1) + np.eye(n), np.eye(n, k=-1) * 2 + np.eye(n)  # exact inverses
    F, H = (P @ X @ np.linalg.inv(P) for P, X in ((base, R), (other, T)))
    zero = np.zeros((n, 1)).tolist()
    box = {"lower": [-0.1] * n, "upper": [0.1] * n}
    outcome = obsdesign.investigate(
        obsdesign.Problem(
            flow={"A": F.tolist(), "disturbance": box},
            jump={"G": H.tolist(), "disturbance": box, "dwell_time": [9.0, 10.0]},
            output={"C": [rng.integers(1, 4, n).tolist()], "noise_bound": [0.1]},
            observer={"kind": "interval", "gains": {"L": zero, "M": zero, "R": R.tolist(),
                                                    "T": T.tolist()}},
        )
    )  # fmt: skip
    verdicts = {claim.id: claim.verdict for claim in outcome.claims}
    assert verdicts["flow_positive"] == verdicts["jump_positive"] == "proved"


REFUSED = {
    "observer.gains.T is required with R (Assumption 4); it is missing.": {"T": None},
    "observer.gains.S2 is built from R and T; drop S2, or R.": {"S2": [[1, 0], [0, 1]]},
    "observer.gains.S is required by form 'two_coordinates'; it is missing. Give S and S2, or R "
    "and T, from which they are built.": {"R": None, "T": None, "S2": [[1, 0], [0, 1]]},
    "observer.gains.L is required: with R, coordinates are built for given L and M; it is "
    "missing.": {"L": None},
    "observer.gains.R must have the eigenvalues of A - L C, -2+0j, -1+0j; it has -3+0j, -1+0j.": {
        "R": [[-3, 0], [0, -1]]
    },
}


@pytest.mark.parametrize("sentence", REFUSED)
def test_what_is_missing_or_not_similar_is_one_sentence(sentence: str) -> None:
    changed = {**BALL, **REFUSED[sentence]}
    with pytest.raises(InputError) as error:
        obsdesign.investigate(problem({k: v for k, v in changed.items() if v is not None}))
    assert str(error.value) == sentence


def test_the_printed_t_is_refuted_by_its_entry() -> None:
    printed = {**BALL, "T": [[-0.8, 0], [0, 0.9]]}
    outcome = obsdesign.investigate(problem(printed))
    assert next(c for c in outcome.claims if c.id == "jump_positive").verdict == "refuted"
