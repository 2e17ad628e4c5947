"""Impulses that |R| hardly shows: a likelihood ratio over onsets, by all that they leave.

|R| weighs features by their size; of closely spaced kernels most of it is noise that they share.
What an impulse of an age leaves in white features is a known direction, so that twice the logarithm
of its likelihood against none is the square of the part of the features along it: the generalised
likelihood ratio of jumps in linear systems (A. S. Willsky and H. L. Jones, IEEE Trans. Automat.
Contr. 21, 108, 1976), over onsets that the dwell time admits. What the impulse leaves is tested:
the leftovers of a plant that is off are mostly no impulse.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from lmi.arithmetic.arrays import Array, Matrix
from obsdesign.equations.impulsive_input.evaluation_rule import EVALUATED_AGE_SHARE
from obsdesign.runtime.impulsive_input.whitening import chi_squared_limit
from obsdesign.runtime.state_marks import Axes

# ages of the curve for each that is compared: an impulse between two loses 0.2 % of its deviations
_STRIDE = 4


@dataclass(frozen=True, slots=True)
class MatchedFilter:
    """Directions (G, r) that impulses of ages (G,) leave in white features, one direction H.

    whitening (r, p m): white features from raw ones; old (G,): ages from which on an impulse is
    evaluated, at which it is past its peak in |R|.
    """

    whitening: Annotated[Matrix, Axes("white raw")]
    ages: Annotated[Matrix, Axes("ages")]
    directions: Annotated[Matrix, Axes("ages white")]
    old: Annotated[Array, Axes("ages")]
    nonnegative: bool

    @classmethod
    def from_curve(
        cls, whitening: Matrix, ages: Matrix, b: Matrix, nonnegative: bool
    ) -> MatchedFilter:
        """From b (G, p m, 1) at increasing ages above zero, the last one the oldest searched."""
        shown = (whitening @ b)[:, :, 0]
        directions = shown / np.linalg.norm(shown, axis=1)[:, None]
        return cls(whitening, ages, directions, ages >= EVALUATED_AGE_SHARE * ages[-1], nonnegative)

    @staticmethod
    def compared(ages: Matrix, oldest: float) -> Matrix:
        """Those of increasing ages that are compared, up to the oldest."""
        return ages[ages <= oldest][::-1][::_STRIDE][::-1]

    def deviations(self, R: Matrix, oldest: Matrix) -> Matrix:
        """By how many deviations an impulse stands out of the noise, (k,) for R (k, p m).

        oldest (k,): ages that the dwell time admits. Zero where the likeliest age is young, or
        where it leaves more of the features than noise does.
        """
        white = R @ self.whitening.T
        onto = white @ self.directions.T
        onto = np.maximum(onto, 0.0) if self.nonnegative else np.abs(onto)
        onto[self.ages > oldest[:, None]] = 0.0
        best = np.argmax(onto, axis=1)
        most = onto[np.arange(len(R)), best]
        left = (white * white).sum(axis=1) - most**2
        is_alike = left <= chi_squared_limit(white.shape[1] - 2)
        return np.where(self.old[best] & is_alike, most, 0.0)
