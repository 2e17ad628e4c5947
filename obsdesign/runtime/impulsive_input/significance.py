"""From when on an impulse counts: thresholds against noise, and against rounding.

Gains are twice the logarithm of a likelihood against none: the part of chi-squared that an impulse
explains, a number of deviations squared.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from lmi.arithmetic.arrays import Matrix

# |R| at a peak that is evaluated, in deviations of its worst direction, mostly the impulse's own.
# Whether an impulse counts its fit decides; errors of the plant make lower maxima, and what they
# hide of weaker impulses a matched filter shows
LEAST_PEAK_DEVIATIONS = 6.0
# deviations that an impulse must explain, by its position, its direction in white features or its
# fit: at an age that is given noise does so in 2 of 1e9 windows, and a record has many windows with
# many ages each
LEAST_DEVIATIONS = 6.0
# of an impulse that an unknown state leaves where the two are told apart: the deviation of its
# weight is then four to five times as large
LEAST_SHARE_OF_GAIN = 0.05
# without noise, |R|: of what the output itself leaves in it, by interpolation and rounding, and of
# what impulses before it made of it, since their fitted values are added
_OF_OUTPUT, _OF_IMPULSES = 1e-7, 3e-6
# operator `samples`: least gain of an impulse in a window of four samples; at a given onset noise
# makes it in 5 of 1e4, and each doubling of the onsets that noise may choose from adds 2 ln 2
_LEAST_RATIO, _REFERENCE_SAMPLES = 12.0, 4
# operator `samples`: deviations that a weight must be worth, its onset unknown; where samples
# determine onset and weight, the least gain leaves about three
LEAST_WEIGHT_DEVIATIONS = 2.0
# what a steady input must leave more than impulses do: what they must be worth against nothing
LEAST_ADVANTAGE = _LEAST_RATIO


class Explanation(Protocol):
    """An impulse, or its posterior, with its gain over none."""

    @property
    def gain(self) -> float:
        """By how much the impulse reduces chi-squared of white features."""


def is_significant(explanation: Explanation | None) -> bool:
    """Whether white features of a window show an impulse; None: no impulse explains them."""
    return explanation is not None and explanation.gain > LEAST_DEVIATIONS**2


def exact_floor(own: float, added: float) -> float:
    """Least |R| that shows an impulse where there is no noise.

    own: |R| of the output alone; added: the largest |R| of impulses before.
    """
    return max(_OF_OUTPUT * own, _OF_IMPULSES * added)


def least_ratio(samples: float) -> float:
    """Least gain of an impulse in a window of so many samples, operator `samples`."""
    return _LEAST_RATIO + 2 * math.log(max(samples / _REFERENCE_SAMPLES, 1.0))


def is_weight_significant(weights: Matrix, deviations: Matrix) -> bool:
    """Whether weights (q,) are known well enough to count, by their deviations (q,)."""
    return bool((np.abs(weights) > LEAST_WEIGHT_DEVIATIONS * deviations).all())
