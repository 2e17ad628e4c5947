"""Random plants and random spacings against what was certified: a sample of the long script."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[3]


def script() -> Any:
    spec = importlib.util.spec_from_file_location(
        "random_spacings", ROOT / "tests" / "long" / "random_spacings.py"
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


SCRIPT = script()


@pytest.mark.parametrize("seed", range(8))
def test_random_spacings_never_contradict(seed: int) -> None:
    _, what = SCRIPT.contradiction(seed)
    assert what is None


def test_the_script_can_find_a_contradiction(monkeypatch: pytest.MonkeyPatch) -> None:
    # the twin: a bound that is asked to hold by far too much
    monkeypatch.setattr(SCRIPT, "ROUNDING", -10.0)
    assert any(SCRIPT.contradiction(seed)[1] is not None for seed in range(4))
