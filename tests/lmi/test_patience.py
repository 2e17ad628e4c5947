"""Budgets nest, searches end with them, and proofs do not notice."""

from __future__ import annotations

import math
import time

import numpy as np

from lmi.decide import decide
from lmi.patience import at_most, hurried, left, until
from lmi.proof import prove_common
from tests.lmi.systems import SAMPLED


def test_the_least_of_nested_budgets_counts() -> None:
    assert until(math.inf) == math.inf
    with at_most(10.0):
        assert 9.0 < left() <= 10.0
        with at_most(100.0):
            assert left() <= 10.0
        with at_most(1.0):
            assert left() <= 1.0
        assert left() > 1.0
        assert left(0.5) <= 0.5
    assert left() == math.inf


def test_a_search_without_time_is_undecided_and_short_and_a_proof_is_a_proof() -> None:
    F, H = SAMPLED
    slow = decide(F, H, 0.4, 1.87)
    assert slow.outcome == "proved"
    began = time.process_time()
    with at_most(0.0):
        quick = decide(F, H, 0.4, 1.87)  # needs windows, which take a search
        easy = prove_common(-np.eye(2), np.eye(2) / 2, np.eye(2), 0.1, math.inf)
    assert quick.outcome == "undecided"
    assert easy.outcome == "proved"
    assert time.process_time() - began < 5.0


def test_only_who_waits_is_hurried() -> None:
    assert not hurried()
    with at_most(10.0):
        assert hurried()
    assert not hurried()
