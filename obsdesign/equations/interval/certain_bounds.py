"""Gains without the effects of parameters in their bounds, or without a box of x."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lmi.arithmetic.arrays import Array, NewEntries
from obsdesign.equations.interval.gains import IntervalGains

# roundings of a bound that an effect was added to, and is taken from
_ROUNDING = 8 * 2.0**-53


def without_effects(gains: IntervalGains) -> IntervalGains:
    """The gains with bounds of b, c and v alone, rounded outward."""
    entries: NewEntries = {}
    if gains.flow_effect is not None:
        entries |= _narrowed(gains, "", "flow", gains.flow_effect)
    if gains.jump_effect is not None:
        entries |= _narrowed(gains, "jump_", "jump", gains.jump_effect)
    if gains.output_effect is not None:
        bound = _less(gains.noise_bound, gains.output_effect)
        entries["noise_bound"] = np.maximum(bound, 0.0)
    return replace(gains, **entries)


def without_state_bounds(gains: IntervalGains) -> IntervalGains:
    """The gains as if nothing were known of x: parameters act on the estimate alone."""
    return replace(
        without_effects(gains), flow_effect=None, jump_effect=None, output_effect=None,
        state_lower=None, state_upper=None, pre_jump_lower=None, pre_jump_upper=None,
        state_tube=None,
    )  # fmt: skip


def _narrowed(gains: IntervalGains, prefix: str, block: str, effect: Array) -> NewEntries:
    """Entries of one disturbance; with a matrix its last columns are those of the effect."""
    columns = getattr(gains, f"{prefix}disturbance_matrix")
    if columns is not None:
        own = columns.shape[1] - np.count_nonzero(effect)
        names = [f"{prefix}disturbance_{end}" for end in ("lower", "upper")]
        return {f"{prefix}disturbance_matrix": columns[:, :own]} | {
            name: getattr(gains, name)[:own] for name in names
        }
    lower, upper = (getattr(gains, f"{block}_{end}") for end in ("lower", "upper"))
    return {f"{block}_lower": -_less(-lower, effect), f"{block}_upper": _less(upper, effect)}


def _less(bound: Array, effect: Array) -> Array:
    """An upper bound of what the effect was added to."""
    rounding = _ROUNDING * (np.abs(bound) + effect)
    return np.where(effect > 0, bound - effect + rounding, bound)
