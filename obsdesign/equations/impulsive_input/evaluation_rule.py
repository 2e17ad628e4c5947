"""When an impulse can be evaluated: rules, and exponents and margins that leave nothing."""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Array
from obsdesign.equations.impulsive_input.curve import ImpulseCurve
from obsdesign.equations.impulsive_input.features import (
    FeatureWindow,
    feature_scales,
    filtered_system,
    impulse_responses,
)
from obsdesign.equations.impulsive_input.gains import MAX_GROWTH_EXPONENT
from obsdesign.equations.plant import Output

# rule "position": age from which an impulse is evaluated, of the window
EVALUATED_AGE_SHARE = 0.7
# rule "peak": where the peak of |b| must lie, of the window, and how far |b| must fall to its end
_MAX_PEAK_AGE_SHARE, _MAX_END_SHARE = 0.9, 0.98
# share of smallest_weight max |b| that the threshold is: rounding hides no impulse of that weight
_THRESHOLD_SHARE = 1 - 1e-9
# kernels of growing exponents weigh the beginning of a window alone: beyond this lambda tau an
# impulse in the rest of it leaves less in a feature than rounding makes of what was there before
_MAX_WINDOW_GROWTH = 6.0


def has_peak(F: Array, H: Array, tau: float, margin: float, count: int = 400) -> bool:
    """Decide on a grid whether |b(age)| has one maximum in (margin, tau) and no other.

    Then an impulse is evaluated at the maximum of |R|, whatever its weight (Section IV). It
    must have come and gone before the impulse leaves the window, when |R| may rise again.
    """
    if H.shape[1] > 1:
        return False  # where the maximum is depends on the weights
    size = np.linalg.norm(impulse_responses(F, H, tau / count, count + 1)[:, len(H) :, 0], axis=1)
    top = int(np.argmax(size))
    rising, falling = np.diff(size[: top + 1]), np.diff(size[top:])
    inside = (
        margin < top * tau / count <= _MAX_PEAK_AGE_SHARE * tau
        and size[-1] < _MAX_END_SHARE * size[top]
    )
    return bool(inside and (rising > 0).all() and (falling < 0).all())


def reason_against_exponents(exponents: Array, n: int, p: int, window: float) -> str | None:
    """Return why these exponents cannot be executed in binary64, one sentence, or None."""
    growth = np.asarray(exponents, float) * window
    largest = float(growth.max(initial=0.0))
    if largest > MAX_GROWTH_EXPONENT:
        return (
            f"observer.exponents times the window must be at most {MAX_GROWTH_EXPONENT:g}; "
            f"got {largest:.6g}."
        )
    enough = int((growth <= _MAX_WINDOW_GROWTH).sum())
    if enough * p < n <= len(growth) * p:
        return (
            f"observer.exponents must hold {-(-n // p)} that are at most "
            f"{_MAX_WINDOW_GROWTH:g} / window = {_MAX_WINDOW_GROWTH / window:.6g}; got {enough}. "
            "Kernels that grow faster see the beginning of a window alone."
        )
    return None


def has_noise(output: Output) -> bool:
    """Whether outputs have noise: all of them or none."""
    return bool(((output.noise_std > 0) | (output.noise_cv > 0)).all())


def evaluation_rule(window: FeatureWindow, *, noisy: bool) -> tuple[str, float]:
    """(`peak` where every impulse makes one in |R|, else `position`; oldest age searched).

    noisy: outputs have noise. With several of them it is `position`, of whitened features: through
    K the noise of one output is in the residuals of all, and |R| may hold little else. Floats: a
    choice to make, no proof. ValueError where the features cannot be followed.
    """
    curve = impulse_curve(window)
    alone = not noisy or len(window.C) == 1
    is_peak = alone and has_peak(curve.F, window.H, window.tau, window.margin)
    return "peak" if is_peak else "position", curve.oldest


def impulse_curve(window: FeatureWindow) -> ImpulseCurve:
    """The curve b(age) of a window, D, C, H in floats, features scaled as at run time.

    ValueError where the features cannot be followed.
    """
    scales = feature_scales(window.exponents, window.tau)
    F = filtered_system(window.D, window.C, window.exponents, scales)
    return ImpulseCurve.from_system(F, window.H, window.tau)


def threshold_for(window: FeatureWindow, smallest_weight: float) -> float:
    """Eta that the features of every weight from `smallest_weight` on exceed (Section III-C).

    smallest_weight max |b(age)|, by (16), a little less for rounding; one direction H. Floats;
    ValueError where the features cannot be followed.
    """
    n = len(window.D)
    size = np.linalg.norm(impulse_curve(window).states[:, n:, 0], axis=1)
    return smallest_weight * float(size.max()) * _THRESHOLD_SHARE


def reason_against_margin(oldest: float, window: float, margin: float) -> str | None:
    """Return why ages from `margin` on cannot be searched, or None."""
    if margin < oldest:
        return None
    return (
        f"observer.margin must be below {oldest:.2g}, where less than a thousandth of an impulse "
        f"is left in the features; got {margin!r}. Is observer.window = {window!r} too long for "
        "the plant, or the exponents too fast?"
    )
