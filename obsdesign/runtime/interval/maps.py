"""The maps of one step, of one sample and of one jump of the interval observer: enclosed.

Observers (6), (9) and (11) of Degue, Efimov, Richard (NOLCOS 2016) are written for a continuous y.
Here y arrives as samples, and holding the last one would break the enclosure. Between two
samples the plant bounds the slope of y (a slope scheme): the path of the centre is known
exactly, and the distance of any path to it is bounded by a comparison system.

State: a centre m and a radius r >= 0 with |z - m| <= r, x = S z (S = I where there are no other
coordinates). Over a step h without jump, with the measurement y = C z(0) + v taken at its start,

    z_c' = A z_c + B u + b_mid                     z_c(0) = m       the centre of the prediction
    rho' = Mz(A) rho + b_rad                       rho(0) = r       |z - z_c| <= rho
    sig' = |C A| rho + |C| b_rad                   sig(0) = 0       |C(z - z_c) - its value at 0|
    q'   = W q + |L| (V + sig) + b_rad             q(0) = r         |z - m+| <= q

    m+ = z_c(h) + K (y - C m),   K = int_0^h e^{(A - L C) s} ds L,

because L C z = L(y + C(z_c - m)) + L(-v + something in [-sig, sig]). With the measurement at the
end of the step instead, sig(h) - sig takes the place of sig and y - C z_c(h) that of y - C m.
Without any, A predicts alone: m+ = z_c(h), r+ = rho(h). For h -> 0 this is the paper's observer.

With `measured = periodic` a sample is an event like a jump: A predicts, then z+ = z + L(y - C z).
Step and sample are one map, of which the absolute value is taken, K = I - L C:

    r+ = |K e^{A h}| r + (bound of int_0^h |K e^{A s}| ds b_rad) + |L| V

(`lmi.arithmetic.exponential.absolute_flow`).

Whatever the samples, the box after a step is cut with those of all maps of the step, A alone among
them, and with |C x - y| <= V (`kernel_rows`). The cut box is what is carried on: all maps here are
monotone, |X| <= R, so that a smaller box stays inside, and so do claimed widths.

Claims about the width are about samples a period apart, and one off the period
(early, or at a jump) may widen. So of such a sample and of its absence the better is kept, as a
box, and the step over the whole period is made besides (`course`): r+ is then at most what
it would be without the rows between.

A `BoxMap` takes a box (centre m, radius r) to

    centre+ = X [m; y at the start; y at the end; u or w; 1]        X known up to an error
    radius+ = R r + g                                               R, g rounded up

so that |z - centre+| <= radius+ in exact arithmetic; the errors of X and of the arithmetic are
added where maps are used (`kernel`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import Enclosure, expm, inverse, powers, raised, stack
from lmi.arithmetic.exponential import FLOW_PIECES
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.runtime.interval.drives import Drives, Radius
from obsdesign.runtime.interval.flow_systems import (
    comparison_blocks,
    comparison_system,
    with_inputs,
)
from obsdesign.runtime.interval.model import (
    Model,
    completed,
    exactly,
    metzler_bound,
    rounded,
    size,
)


@dataclass(frozen=True, slots=True)
class BoxMap:
    """X: (n, n + 2p + m + 1); R: (n, n); g: (n,).

    Of a plant with parameters, drives: what the radius gains besides; sample: bound of
    |y1 - y_mid - C z|, C the nominal output, in place of V.
    """

    X: Enclosure
    R: Matrix
    g: Matrix
    drives: Drives | None = None
    sample: Radius | None = None


def box_map(
    model: Model, m: Enclosure, start: Enclosure | None, end: Enclosure | None, *,
    known: Enclosure, R: Matrix, g: Matrix,
) -> BoxMap:  # fmt: skip
    """Put the blocks of X side by side; a measurement that is not used has zeros."""
    unused = exactly(np.zeros((len(m.mid), len(model.C.mid))))
    known = model.less_middle(known, start, end)
    return BoxMap(stack([[m, start or unused, end or unused, known]]), R, g)


def step_maps(model: Model, h: float, h_error: float, *, is_periodic: bool) -> dict[str, BoxMap]:
    """Return the maps of a step of length h +- h_error by name: those that the samples need."""
    if h > 0.0 and not is_periodic:
        return flow_maps(model, h, h_error)
    free = free_map(model, h, h_error) if h > 0.0 else identity_map(model)
    return {"none": free} | ({"sampled": sampled(model, free, h, h_error)} if is_periodic else {})


def flow_maps(model: Model, h: float, h_error: float) -> dict[str, BoxMap]:
    """Return the maps of a step of length h +- h_error: y at its start, at its end, or none."""
    F = model.A - model.L @ model.C
    n, p = model.L.mid.shape
    free = free_map(model, h, h_error)
    Phi, forced = _columns(free.X, slice(n)), _columns(free.X, slice(n + 2 * p, None))
    K = driven(F, model.L, h, h_error)[1]
    outer = exactly(np.eye(n)) - K @ model.C
    spread = _spread(model, h, h_error)
    start, end = Phi - K @ model.C, outer @ Phi
    (start_R, start_g), (end_R, end_g) = spread["start"], spread["end"]
    return {
        "start": box_map(model, start, K, None, known=forced, R=start_R, g=start_g),
        "end": box_map(model, end, None, K, known=outer @ forced, R=end_R, g=end_g),
        "none": free,
    }


def free_map(model: Model, h: float, h_error: float) -> BoxMap:
    """Return the map of a step of length h +- h_error without any measurement."""
    Phi, forced = driven(model.A, model.inputs, h, h_error)
    g = _on_the_way(model, exactly(np.eye(len(model.b_rad))), h, h_error)
    return box_map(model, Phi, None, None, known=forced, R=size(Phi), g=g)


def _on_the_way(model: Model, left: Enclosure, h: float, h_error: float) -> Matrix:
    """Bound of int_0^h |X e^{A s}| ds b_rad, X = left, rounded up.

    In the pieces of `lmi.arithmetic.exponential.absolute_flow`, which proofs are about.
    """
    step, error = h / FLOW_PIECES, h_error / FLOW_PIECES
    flows = left @ powers(expm(model.A.scaled(step, error)), FLOW_PIECES)
    _, pushed = _comparison(metzler_bound(model.A), model.b_rad, step, error)
    return raised(size(flows).sum(axis=0) @ pushed, 2 * (len(pushed) + FLOW_PIECES))


def identity_map(model: Model) -> BoxMap:
    """Return the map of a step of length zero."""
    n = len(model.width)
    inputs = exactly(np.zeros_like(model.inputs.mid))
    identity = np.eye(n)
    return box_map(model, exactly(identity), None, None, known=inputs, R=identity, g=np.zeros(n))


def sampled(model: Model, before: BoxMap, h: float, h_error: float) -> BoxMap:
    """z+ = z + L (y - C z) at the end of a step of length h +- h_error, y measured there.

    before: the same step without it.
    """
    if not size(model.L).any():
        return before
    n, p = model.L.mid.shape
    K = exactly(np.eye(n)) - model.L @ model.C
    X = K @ before.X
    R = size(_columns(X, slice(n)))
    y_end = slice(n + p, n + 2 * p)  # the step before it does not use this measurement
    X.mid[:, y_end], X.rad[:, y_end] = model.L.mid, model.L.rad
    X = model.less_middle(X, model.L)
    g = _on_the_way(model, K, h, h_error) if h > 0 else np.zeros(n)
    return BoxMap(X, R, raised(g + size(model.L) @ model.V, 2 * (p + 1)))


def jump_maps(model: Model, gains: IntervalGains) -> dict[bool, BoxMap]:
    """Return the maps of a jump: without its measurement (False) and with it, if there is one."""
    M = exactly(gains.M)
    G, C = (rounded(X, model.relative_error) for X in (gains.jump_matrix, gains.C))
    n, when, V = gains.n, gains.jump_measurement, model.V
    known = model.jump_inputs
    # with samples as events the claims are about |G e^{A s}|: no split of the jump is used
    has_split = gains.Gp is not None and not gains.is_periodic
    plain_N = _jump_width(model, G, gains if has_split and when == "none" else None)
    plain = box_map(model, model.similar(G), None, None, known=model.inward(known), R=plain_N,
                    g=model.spread(model.c_rad, model.c_columns))  # fmt: skip
    if when == "none":
        return {False: plain}
    through = exactly(np.eye(n))
    H = G - M @ C
    if when == "after":
        through = through - M @ C
        H = through @ G
    M_z, through_c = model.inward(M), model.inward(_of_w(model, through))
    if gains.S2 is not None and not gains.is_periodic:
        N, g = _by_second_coordinates(model, gains, H, through)
    else:
        N = _jump_width(model, H, gains if has_split else None)
        g = raised(size(M_z) @ V + size(through_c) @ model.c_rad, 2 * (len(model.c_rad) + len(V)))
    corrected = box_map(
        model, model.similar(H), None, M_z, known=model.inward(through @ known), R=N, g=g
    )
    return {False: plain, True: corrected}


def flow_and_jump_spread(
    model: Model, gains: IntervalGains, h: float, h_error: float
) -> tuple[Matrix, Matrix]:
    """(R, g) of a step of length h +- h_error and an uncorrected jump at its end, as one map."""
    G = model.similar(rounded(gains.jump_matrix, model.relative_error))
    Phi = expm(model.A.scaled(h, h_error))
    added = model.spread(model.c_rad, model.c_columns)
    if h > 0:
        added = raised(added + _on_the_way(model, G, h, h_error), 1)
    return size(G @ Phi), added


def _jump_width(model: Model, H: Enclosure, gains: IntervalGains | None) -> Matrix:
    """Upper bound of N: the stored split, completed, or without gains the smallest one."""
    H_z = model.similar(H)
    return size(H_z) if gains is None else completed(H_z, *gains.jump_split)


def _by_second_coordinates(
    model: Model, gains: IntervalGains, H: Enclosure, through: Enclosure
) -> tuple[Matrix, Matrix]:
    """Theorem 7: into the coordinates of S2, there by T >= 0, and back."""
    assert gains.S2 is not None
    assert gains.T is not None
    S2, S2_inverse = exactly(gains.S2), inverse(gains.S2)
    T, M = exactly(gains.T), exactly(gains.M)
    back = size(model.inward(S2))
    forth = size(S2_inverse if model.S is None else S2_inverse @ model.S)
    inner = np.abs(T.mid) + size(T - S2_inverse @ H @ S2)
    n = len(back)
    N = raised(back @ raised(inner @ forth, 2 * n), 2 * n)
    entering = (
        size(S2_inverse @ M) @ model.V + size(S2_inverse @ _of_w(model, through)) @ model.c_rad
    )
    return N, raised(back @ raised(entering, 4 * n), 2 * n)


def _of_w(model: Model, X: Enclosure) -> Enclosure:
    """X c as a map of w where c is columns @ w."""
    return X if model.c_columns is None else X @ model.c_columns


def driven(A: Enclosure, B: Enclosure, h: float, error: float) -> tuple[Enclosure, Enclosure]:
    """e^{A h} and int_0^h e^{A s} ds B, from one block exponential; h is known to +- error."""
    n = len(B.mid)
    whole = expm(with_inputs(A, B).scaled(h, error))
    return _block(whole, slice(n), slice(n)), _block(whole, slice(n), slice(n, None))


def _columns(X: Enclosure, columns: slice) -> Enclosure:
    return Enclosure(X.mid[:, columns], X.rad[:, columns])


def _block(whole: Enclosure, rows: slice, columns: slice) -> Enclosure:
    return Enclosure(whole.mid[rows, columns], whole.rad[rows, columns])


def _comparison(W: Matrix, f: Matrix, h: float, h_error: float) -> tuple[Matrix, Matrix]:
    """(e^{W h}, int_0^h e^{W s} ds f), rounded up."""
    n = len(W)
    system = with_inputs(exactly(W), exactly(f[:, None]))
    whole = expm(system.scaled(h, h_error))
    return _bounds(_block(whole, slice(n), slice(n)), _block(whole, slice(n), slice(n, n + 1)))


def _spread(model: Model, h: float, h_error: float) -> dict[str, tuple[Matrix, Matrix]]:
    """(R, g) of the maps that use y, from the comparison system."""
    n, p = model.L.mid.shape
    whole = expm(exactly(comparison_system(model)).scaled(h, h_error))
    part = {name: _block(whole, *where) for name, where in comparison_blocks(n, p).items()}
    return {
        "start": _bounds(part["qq"] + part["q_rho"], part["q_1"] + part["q_2"]),
        "end": _bounds(
            part["qq"] + (part["q_sig"] @ part["sig_rho"] - part["q_rho"]),
            part["q_1"] + (part["q_sig"] @ part["sig_2"] - part["q_2"]),
        ),
    }


def _bounds(R: Enclosure, g: Enclosure) -> tuple[Matrix, Matrix]:
    """Upper bounds; both are nonnegative in exact arithmetic."""
    return np.maximum(R.upper, 0.0), np.maximum(g.upper, 0.0).reshape(-1)
