"""Windows that are too much work are refused before anything is built, by every program."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import obsdesign
from lmi.memory import OversizeError
from obsdesign.equations.finite_time.gains import MOST_SAMPLES, most_samples, require_window
from obsdesign.problem.problem import Problem


def problem(n: int, samples: int | None = None) -> Problem:
    A = -np.diag(np.linspace(0.5, 2, n)) + 0.3 * np.eye(n, k=-1)
    observer: dict[str, Any] = {"kind": "finite_time"}
    if samples is not None:
        observer["window"] = samples / 16
    output = {"C": [[1.0] * n], "noise_bound": 0.01, "measured": "periodic", "period": 1 / 16}
    return Problem.from_dict({"flow": {"A": A.tolist()}, "output": output, "observer": observer})


@pytest.mark.parametrize(("n", "samples"), [(150, None), (150, 12), (20, 5001), (60, 186)])
def test_too_much_work_is_refused_at_once(n: int, samples: int | None) -> None:
    with pytest.raises(
        obsdesign.InputError, match=r"^a window of \d+ samples and \d+ states takes"
    ):
        obsdesign.investigate(problem(n, samples))


def test_the_budget_itself_is_allowed() -> None:
    for n in (1, 4, 12, 20, 60, 150):
        most = most_samples(n)
        require_window(n, most)
        assert most == MOST_SAMPLES or 20 * n**3 * (most + 1) / 4e7 > 19
        if most < MOST_SAMPLES:
            with pytest.raises(OversizeError, match="takes about 20 s, and the budget is 20 s"):
                require_window(n, most + 1)
            words = f"takes about {20 * n**3 * 10 * most / 4e7:.0f} s.* 20 s, {most} samples: a"
            with pytest.raises(OversizeError, match=words):
                require_window(n, 10 * most)


def test_a_design_file_with_such_a_window_is_refused_too(monkeypatch: pytest.MonkeyPatch) -> None:
    design = obsdesign.design(problem(2, 8))
    assert obsdesign.verify(design).verdict == "proved"
    monkeypatch.setattr("obsdesign.equations.finite_time.gains._MOST_WORK", 60)
    with pytest.raises(obsdesign.InputError, match="a window of 8 samples and 2 states"):
        obsdesign.verify(replace(design))
