"""The maps of a jump of a plant with parameters, as `maps.jump_maps`.

x+ = G(p) x- + E(p) w + c. With T_i any gains on y - C m, S_i = G_i - T_i C, and c0 >= sum |C_i x|,

    r+ = (N + sum |S_i|) r + sum |G_i m + T_i (y - C m) + E_i w|
         + (|M| + sum |T_i|) (V + c0) + c_rad

with a measurement before the jump, T = M = 0 without any, and with X = I - M C after it

    r+ = (|X G| + sum |X G_i|) r + sum |X (G_i m + E_i w)| + |M| (V + c0) + |X c|
"""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import Enclosure, raised, stack
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.runtime.interval.drives import Drives, Radius
from obsdesign.runtime.interval.effects import Effects, total
from obsdesign.runtime.interval.maps import BoxMap, jump_maps
from obsdesign.runtime.interval.model import Model, exactly, size
from obsdesign.runtime.interval.parametric_steps import (
    innovation,
    output_effect,
    sample_error,
    unmoved,
    with_radius,
)
from obsdesign.runtime.interval.predicted_path import active_rows


def parametric_jump_maps(
    model: Model, effects: Effects, gains: IntervalGains
) -> dict[bool, BoxMap]:
    """Return the maps of a jump: without its measurement (False) and with it, if there is one."""
    base = jump_maps(model, gains)
    plain = base[False]
    n, columns = plain.X.mid.shape
    identity = exactly(np.eye(n))
    before = stack([[identity, exactly(np.zeros((n, columns - n)))]])
    driven = _effect_drives(effects, before, identity, None)
    radius = Radius(plain.R, plain.g, driven)._replace(R=_sum(plain.R, effects.of_jump))
    after = output_effect(effects, plain.X, radius)
    maps = {False: with_radius(plain, radius, sample_error(model, after))}
    if True not in base:
        return maps
    corrected, M = base[True], model.inward(exactly(gains.M))
    if gains.jump_measurement == "after":
        X = identity - M @ model.C
        remaining, effect = total((X @ each.state for each in effects.jump), (n, n)), after
        driven = _effect_drives(effects, before, X, None)
    else:
        remaining = effects.remaining(effects.jump)
        effect = output_effect(effects, before, unmoved(model, columns))
        driven = _effect_drives(effects, before, identity, innovation(model, before, at_end=True))
    # |M| V is in g already
    own = Radius(_sum(corrected.R, remaining), corrected.g, driven).plus(effect.times(size(M)))
    error = sample_error(model, effect)
    if gains.jump_measurement == "before" and effects.jump:
        own = own.plus(error.times(effects.gains(effects.jump)))
    return maps | {True: with_radius(corrected, own, error)}


def _sum(R: Matrix, added: Matrix) -> Matrix:
    return np.where(added > 0, raised(R + added, 1), R)


def _effect_drives(
    effects: Effects, before: Enclosure, left: Enclosure, shown: Enclosure | None
) -> Drives:
    """sum |X (G_i m + E_i w) + T_i nu|, X = left, without the last part where T_i is not used."""
    n, columns = before.mid.shape
    driven = Drives.none(n, columns)
    for effect in effects.jump:
        unused = exactly(np.zeros((n, columns - effect.known.mid.shape[1])))
        forms = left @ (effect.state @ before + stack([[unused, effect.known]]))
        rows = active_rows(left @ effect.state, left @ effect.known)
        if shown is not None:
            forms = forms + effect.gain @ shown
            rows = active_rows(effect.state, effect.known, effect.gain)
        own = Drives(Enclosure(forms.mid[rows], forms.rad[rows]), np.eye(n)[:, rows])
        driven = driven.plus(own)
    return driven
