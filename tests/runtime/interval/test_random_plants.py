"""A fixed sample of tests/long/random_interval_forms.py: bounds hold, proved widths are not exceeded."""

from __future__ import annotations

import pytest

from tests.systems.interval import FORMS, ROUNDING, trial


@pytest.mark.parametrize("form", FORMS)
def test_random_plants_keep_what_was_proved(form: str) -> None:
    found = [trial(form, seed) for seed in range(2)]
    assert max(one.beyond for one in found) <= ROUNDING
    assert any(one.verdict == "proved" for one in found)
    widths = [one.wider for one in found if one.wider is not None]
    assert widths
    assert max(widths) <= ROUNDING
