"""Shared fixtures: one proved design, made once per worker."""

from __future__ import annotations

import os
from pathlib import Path

# before numpy is imported: workers share the processors, and matrices are small
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import pytest  # noqa: E402

import obsdesign  # noqa: E402

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="session")
def academic_design(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Design file of example 4.1."""
    path = tmp_path_factory.mktemp("design") / "academic.json"
    problem = obsdesign.load_problem(ROOT / "examples" / "degue_4_1.toml")
    obsdesign.design(problem).save(path)
    return path
