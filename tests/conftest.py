"""Shared fixtures: designs that are made once per worker."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from unittest.mock import patch

import pytest
from hypothesis import settings

import obsdesign
from obsdesign import workflow
from tests.systems.shared_outcomes import SharedOutcomes

# the same examples in every run; other ones are drawn by tests/long
settings.register_profile("repeatable", derandomize=True)
settings.load_profile("repeatable")

ROOT = Path(__file__).parent.parent
OUTCOMES = SharedOutcomes()


@pytest.fixture(autouse=True)
def shared_outcomes(request: pytest.FixtureRequest) -> Iterator[None]:
    """Equal problems are designed once, but for tests that replace what designs them."""
    if "monkeypatch" in request.fixturenames:
        yield
        return
    OUTCOMES.begin_test()
    with patch.object(workflow, "_attempted", OUTCOMES.around(workflow._attempted)):
        yield


@pytest.fixture(scope="session")
def academic_design(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Design file of example 4.1."""
    path = tmp_path_factory.mktemp("design") / "academic.json"
    problem = obsdesign.load_problem(ROOT / "examples" / "degue_4_1.toml")
    obsdesign.design(problem).save(path)
    return path
