"""A fixed sample of tests/long/random_interval_forms.py: bounds hold, proved widths are not exceeded."""

from __future__ import annotations

import pytest

from tests.systems.interval import FORMS, ROUNDING, trial


@pytest.mark.parametrize("form", FORMS)
def test_random_plants_keep_what_was_proved(form: str) -> None:
    trials = [trial(form, seed) for seed in range(2)]
    assert max(each.beyond for each in trials) <= ROUNDING
    assert any(each.verdict == "proved" for each in trials)
    widths = [each.wider for each in trials if each.wider is not None]
    assert widths
    assert max(widths) <= ROUNDING
