"""Maps of a step of a plant with parameters, as `maps` has them of one without.

x' = A(p) x + B(p) u + b, y = C(p) x + v, with p known up to a range and free to change at any time
(`effects`). The centre is that of the nominal plant. With nu = y - C m, Q_i any gains,
R_i = A_i - Q_i C, and c0 >= sum |C_i x| at the sample,

    rho' = (Mz(A) + sum |A_i|) rho + sum |A_i x_c + B_i u| + b_rad                     rho(0) = r
    sig' = (|C A| + sum |C A_i|) rho + sum |C (A_i x_c + B_i u)| + |C| b_rad           sig(0) = 0
    q'   = W q + sum |R_i| rho + (|L| + sum |Q_i|) (V + c0 + sig)
                               + sum |A_i x_c + Q_i nu + B_i u| + b_rad                q(0) = r

bound |x - x_c|, |C (x - x_c) - its value at 0| and |x - m+|: A_i x = A_i x_c + R_i (x - x_c)
+ Q_i C (x - x_c), and C (x - x_c) at 0 is nu - v - sum p_i C_i x. With the measurement at the end
of the step, sig(h) - sig takes the place of sig, and nu and c0 are those there. Without any, and
where samples are events, the signs of e^{A s} are kept:

    r+ = |X e^{A h}| r + int_0^h |X e^{A (h - s)}| f ds,
    f = sum |A_i| rho + sum |A_i x_c + B_i u| + b_rad,

with X = I, or X = K = I - L C and |L| (V + c0) added. For h -> 0 the first is

    r' = (Mz(F) + sum |R_i| + (|L| + sum |Q_i|) sum |C_i|) r + sum |A_i m + Q_i nu + B_i u|
         + (|L| + sum |Q_i|) (V + sum |C_i m|) + b_rad
"""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import Enclosure, expm, powers, raised
from lmi.arithmetic.exponential import FLOW_PIECES
from obsdesign.runtime.interval.driven_radius import Forcing, PieceFlow, initial
from obsdesign.runtime.interval.drives import Drives, Radius
from obsdesign.runtime.interval.effects import Effect, Effects
from obsdesign.runtime.interval.maps import (
    BoxMap,
    flow_maps,
    free_map,
    identity_map,
    sampled,
)
from obsdesign.runtime.interval.model import Model, exactly, metzler_bound, size
from obsdesign.runtime.interval.predicted_path import PredictedPath, active_rows, unit_rows


def parametric_step_maps(
    model: Model, effects: Effects, h: float, h_error: float, *, is_periodic: bool
) -> dict[str, BoxMap]:
    """Return the maps of a step of length h +- h_error by name, as `maps.step_maps`."""
    path = PredictedPath.of_step(model, effects, h, h_error)
    if is_periodic or h == 0.0:
        base = free_map(model, h, h_error) if h > 0.0 else identity_map(model)
        free, error = _predicted(path, base)
        if not is_periodic:
            return {"none": free}
        K = exactly(np.eye(len(base.g))) - model.L @ model.C
        corrected = prediction(path, K).plus(error.times(size(model.L)))
        return {
            "none": free,
            "sampled": with_radius(sampled(model, base, h, h_error), corrected, error),
        }
    base_maps = flow_maps(model, h, h_error)
    free, error = _predicted(path, base_maps["none"])
    return {
        "start": with_radius(base_maps["start"], _from_start(path), error),
        "end": with_radius(base_maps["end"], _from_end(path, free.X, error), error),
        "none": free,
    }


def with_radius(step: BoxMap, radius: Radius, sample: Radius) -> BoxMap:
    """The map with this radius in place of its own, and this error of the sample at its end."""
    return BoxMap(step.X, radius.R, radius.g, radius.drives, sample)


def _predicted(path: PredictedPath, base: BoxMap) -> tuple[BoxMap, Radius]:
    """The map without measurement, and the error of a sample at its end."""
    radius = prediction(path, exactly(np.eye(len(base.g))))
    error = sample_error(path.model, output_effect(path.effects, base.X, radius))
    return with_radius(base, radius, error), error


def output_effect(effects: Effects, centre: Enclosure, radius: Radius) -> Radius:
    """Bound of sum |C_i x| for x within a radius of a centre (n, columns)."""
    p, columns = len(effects.C.mid), centre.mid.shape[1]
    own = Drives.none(p, columns)
    for C in effects.output:
        forms, rows = C @ centre, active_rows(C)
        own = own.plus(Drives(Enclosure(forms.mid[rows], forms.rad[rows]), np.eye(p)[:, rows]))
    if not effects.output:
        return Radius(np.zeros_like(effects.C.mid), np.zeros(p), own)
    around = radius.times(effects.of_output)
    return around._replace(drives=around.drives.plus(own))


def sample_error(model: Model, effect: Radius) -> Radius:
    """V + the effect of parameters on the output."""
    g = np.where(effect.g > 0, raised(effect.g + model.V, 1), model.V)
    return effect._replace(g=g)


def unmoved(model: Model, columns: int) -> Radius:
    """The radius itself."""
    n = len(model.A.mid)
    return Radius(np.eye(n), np.zeros(n), Drives.none(n, columns))


def prediction(path: PredictedPath, left: Enclosure) -> Radius:
    """Bound of |X (x - x_c)| at the end of a step, X = left."""
    model, n = path.model, len(path.model.A.mid)
    if path.h == 0.0:
        return Radius(size(left), np.zeros(n), Drives.none(n, path.columns))
    comparison, added = metzler_bound(model.A), path.effects.of_flow
    W = np.block([[comparison, added], [np.zeros((n, n)), widened(comparison, added)]])
    constant = np.zeros((2 * n, n + 1))
    constant[:n, -1] = constant[n:, -1] = model.b_rad
    forcing = path.forcing(2 * n, constant)
    path.drive_states(forcing, [0, n])
    step, error = path.h / FLOW_PIECES, path.h_error / FLOW_PIECES
    piece = PieceFlow.of_system(exactly(W), step, error)
    flows = size(left @ powers(expm(model.A.scaled(step, error)), FLOW_PIECES))
    reach = initial(2 * n, len(forcing.table), [n], n).mid
    total = np.zeros_like(reach[:n])
    for k in range(FLOW_PIECES):
        reach[:n] = 0.0
        ends = [forcing.between(k + j, k, FLOW_PIECES) for j in (0, 1)]
        reach = np.maximum(piece.after(exactly(reach), *ends).upper, 0.0)
        total = total + flows[FLOW_PIECES - 1 - k] @ reach[:n]
    total = raised(total, 2 * (n + FLOW_PIECES))
    total[:, :n] += size(left @ expm(model.A.scaled(path.h, path.h_error)))
    return _radius(raised(total, 1), forcing)


def _from_start(path: PredictedPath) -> Radius:
    """Bound of |x - m+| with the measurement at the start of the step."""
    model, effects = path.model, path.effects
    n, start = len(model.A.mid), path.nodes[0]
    effect = output_effect(effects, start, unmoved(model, path.columns))
    forcing = _flow_forcing(path, innovation(model, start, at_end=False))
    _correct(forcing, sample_error(model, effect).times(_injection(path)))
    return _radius(_final(path, forcing, _system(path))[:n], forcing)


def _from_end(path: PredictedPath, centre: Enclosure, error: Radius) -> Radius:
    """The same with the measurement at its end; error: of that; centre: of the prediction."""
    model = path.model
    n = len(model.A.mid)
    forcing = _flow_forcing(path, innovation(model, centre, at_end=True))
    at_end = error.times(_injection(path))
    forcing.table.places(at_end.drives.forms)  # all forms, before any system is solved
    W = _system(path)
    change = _radius(_final(path, forcing, W)[2 * n :], forcing)
    _correct(forcing, at_end.plus(change.times(_injection(path))))
    W[:n, 2 * n :] *= -1.0
    return _radius(_final(path, forcing, W)[:n], forcing)


def _system(path: PredictedPath) -> Matrix:
    """The matrix of [q; rho; sig]."""
    model, effects = path.model, path.effects
    p, n = model.C.mid.shape
    q, rho, sig = slice(n), slice(n, 2 * n), slice(2 * n, 2 * n + p)
    W = np.zeros((2 * n + p, 2 * n + p))
    W[q, q], W[q, rho] = model.width, effects.remaining(effects.flow)
    W[q, sig] = _injection(path)
    W[rho, rho] = widened(metzler_bound(model.A), effects.of_flow)
    slope = size(model.C @ model.A)
    for effect in effects.flow:
        slope = raised(slope + size(model.C @ effect.state), 1)
    W[sig, rho] = slope
    return W


def _injection(path: PredictedPath) -> Matrix:
    """|L| + sum |Q_i|, (n, p)."""
    L, effects = size(path.model.L), path.effects
    return L if not effects.flow else raised(L + effects.gains(effects.flow), 1)


def widened(comparison: Matrix, added: Matrix) -> Matrix:
    """Mz(A) + sum |A_i|, rounded up."""
    return np.where(added > 0, np.nextafter(comparison + added, np.inf), comparison)


def innovation(model: Model, centre: Enclosure, *, at_end: bool) -> Enclosure:
    """nu = y - y_mid - C x_c, as forms (p, columns)."""
    p, n = model.C.mid.shape
    forms = -(model.C @ centre)
    y = np.zeros_like(forms.mid)
    first = n + p if at_end else n
    y[:, first : first + p] = np.eye(p)
    y[:, -1] = -model.y_mid
    return forms + exactly(y)


def _flow_forcing(path: PredictedPath, innovation: Enclosure) -> Forcing:
    """What drives [q; rho; sig], but for the error of the measurement."""
    model = path.model
    p, n = model.C.mid.shape
    constant = np.zeros((2 * n + p, n + 1))
    constant[:n, -1] = constant[n : 2 * n, -1] = model.b_rad
    constant[2 * n :, -1] = raised(size(model.C) @ model.b_rad, 2 * n)
    forcing = path.forcing(2 * n + p, constant)
    errors = np.zeros((2 * n + p, n))
    for effect in path.effects.flow:
        own = _own_outputs(model, effect)
        for node, listed in enumerate(forcing.at_nodes):
            forms = path.effect_at(effect, node)
            listed += _effect_drives(model, forcing, effect, forms, own)
            listed += _corrected_drives(forcing, effect, forms, innovation)
        errors[2 * n :] += _output_chords(path, effect, own)
    if path.effects.flow:
        errors[:n] = errors[n : 2 * n] = path.chord_error
        path.drive_chords(forcing, raised(errors, len(path.effects.flow)))
    return forcing


def _own_outputs(model: Model, effect: Effect) -> Matrix:
    """Which outputs, (p,), show more than one row of an effect: its forms do not bound C A_i x."""
    shown = size(model.C)[:, active_rows(effect.state, effect.known)] > 0
    return np.asarray(shown.sum(axis=1) > 1)


def _effect_drives(
    model: Model, forcing: Forcing, effect: Effect, forms: Enclosure, own: Matrix
) -> list[tuple[int, Matrix]]:
    """|A_i x_c + B_i u| on rho, and |C (A_i x_c + B_i u)| on sig."""
    n, listed = len(forms.mid), []
    C = size(model.C)
    for k in active_rows(effect.state, effect.known):
        direction = unit_rows(forcing.rows, [n + k])
        direction[2 * n :] = np.where(own, 0.0, C[:, k])
        listed.append((forcing.table.place(forms.mid[k], forms.rad[k]), direction))
    shown = model.C @ forms
    for i in np.flatnonzero(own).tolist():
        place = forcing.table.place(shown.mid[i], shown.rad[i])
        listed.append((place, unit_rows(forcing.rows, [2 * n + i])))
    return listed


def _corrected_drives(
    forcing: Forcing, effect: Effect, forms: Enclosure, innovation: Enclosure
) -> list[tuple[int, Matrix]]:
    """|A_i x_c + Q_i nu + B_i u| on q."""
    corrected = forms + effect.gain @ innovation
    uses = active_rows(effect.gain)
    listed = []
    for k in active_rows(effect.state, effect.known, effect.gain):
        row = corrected if k in uses else forms
        listed.append((forcing.table.place(row.mid[k], row.rad[k]), unit_rows(forcing.rows, [k])))
    return listed


def _output_chords(path: PredictedPath, effect: Effect, own: Matrix) -> Matrix:
    """Bound of |C A_i x_c - its chord| per entry of |x_c'|, (p, n)."""
    model = path.model
    by_rows = raised(size(model.C) @ path.chords.bound(effect.state), 2 * len(model.A.mid))
    return np.where(own[:, None], path.chords.bound(model.C @ effect.state), by_rows)


def _correct(forcing: Forcing, error: Radius) -> None:
    """Add the error of a measurement, as it enters q, at every instant."""
    n = len(error.g)
    forcing.constant[:n, :n] += error.R
    forcing.constant[:n, -1] += error.g
    places = forcing.table.places(error.drives.forms)
    for column, place in enumerate(places):
        direction = np.zeros(forcing.rows)
        direction[:n] = error.drives.weights[:, column]
        for listed in forcing.over_pieces:
            listed.append((place, direction))


def _final(path: PredictedPath, forcing: Forcing, W: Matrix) -> Matrix:
    """Upper bound of [q; rho; sig] at the end, (rows, n + forms + 1)."""
    n, pieces = forcing.n, path.pieces
    piece = PieceFlow.of_system(exactly(W), path.h / pieces, path.h_error / pieces)
    reach = initial(forcing.rows, len(forcing.table), [0, n], n)
    for k in range(pieces):
        reach = piece.after(reach, forcing.at(k, k), forcing.at(k + 1, k))
    return np.maximum(reach.upper, 0.0)


def _radius(bounds: Matrix, forcing: Forcing) -> Radius:
    n = forcing.n
    return Radius(bounds[:, :n], bounds[:, -1], Drives(forcing.table.forms, bounds[:, n:-1]))
