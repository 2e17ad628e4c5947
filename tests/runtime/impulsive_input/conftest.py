"""The hormone example, for every file that follows its pulses."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import obsdesign
from obsdesign.runtime import from_design
from tests.systems.designs import designed

EXAMPLES = Path(__file__).parents[3] / "examples"


@pytest.fixture(scope="module")
def body() -> dict[str, Any]:
    return obsdesign.load_problem(EXAMPLES / "luteinizing_hormone.toml").to_dict()


@pytest.fixture(scope="module")
def observer(body: dict[str, Any]) -> Any:
    return from_design(designed(body))
