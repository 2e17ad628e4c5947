"""Shared fixtures: one proved design, made once per worker."""

from __future__ import annotations

from pathlib import Path

import pytest

import obsdesign

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="session")
def academic_design(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Design file of example 4.1."""
    path = tmp_path_factory.mktemp("design") / "academic.json"
    problem = obsdesign.load_problem(ROOT / "examples" / "degue_4_1.toml")
    obsdesign.design(problem).save(path)
    return path
