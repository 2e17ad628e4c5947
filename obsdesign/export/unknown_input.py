"""Programs of kind `unknown_input`: w, x and d are carried, one product for each length.

After a missing sample the code holds measurements, where the runtime makes one step over the gap.
"""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Entries, Matrix
from lmi.arithmetic.spectrum import spectral_radius
from obsdesign.equations.unknown_input.formulas import STEP_LIMIT
from obsdesign.equations.unknown_input.gains import UnknownInputGains
from obsdesign.errors import InputError
from obsdesign.export.precision import Precision
from obsdesign.export.program import Product, Program, Rules, Sizes, Tables
from obsdesign.export.timing import Steps, timing_of
from obsdesign.runtime.unknown_input.steps import Steps as Maps


def unknown_input_program(entries: Entries, target: Precision, steps: Steps) -> Program:
    """The program of a design's gains.

    InputError for a differentiator that is not `cell`, and for steps beyond 2 / |f|.
    """
    gains = UnknownInputGains.from_document(entries)
    if gains.differentiator != "cell":
        raise InputError(
            f"the differentiator {gains.differentiator!r} cannot be exported to C yet; design with "
            "differentiator = 'cell', or run the design with obsdesign.runtime."
        )
    timing = timing_of(steps, (0.0, np.inf), None)
    fastest = spectral_radius(gains.F)
    for length in timing.lengths:
        if length * fastest > STEP_LIMIT:
            raise InputError(f"--steps: {length!r} is above {STEP_LIMIT / fastest:.6g} = 2/|f|.")
    sizes = Sizes(gains.n, gains.p, gains.m, 0, gains.k + gains.n + gains.q)
    tables, maps = Tables(target), Maps(gains)
    flows = [tables.flow(_first(gains, sizes))]
    flows += [tables.flow(_flows(gains, maps.matrix(length), sizes)) for length in timing.lengths]
    initial = tables.place(_initial(gains, sizes))
    return Program(
        "unknown_input", target, sizes, tuple(tables.products), tuple(flows), (), None, initial,
        timing, Rules("none", True, bridges_gaps=False), gains.k, gains.q,
    )  # fmt: skip


def _rows(gains: UnknownInputGains, sizes: Sizes, e: Matrix, y0: Matrix, y1: Matrix,
          known: Matrix) -> Product:  # fmt: skip
    """A product from its parts; measurements less the middle of their noise."""
    known = known.copy()
    if gains.noise_centre is not None:
        known[:, -1] -= (y0 + y1) @ gains.noise_centre
    return Product(np.hstack([e, y0, y1, known]))


def _flows(gains: UnknownInputGains, step: Matrix, sizes: Sizes) -> dict[str, Product]:
    """[w; x; d] from [w; x; d; y0; y1; u; 1]; where a y is not there, the other is held, or C x."""
    k, p = gains.k, gains.p
    w, y0, y1, known = np.split(step, [k, k + p, k + 2 * p], axis=1)
    e, unused = np.hstack([w, np.zeros((len(w), gains.n + gains.q))]), np.zeros_like(y0)
    has_d = np.arange(len(step)) < k + gains.n  # none without two measurements
    held = np.where(has_d[:, None], y0 + y1, 0.0)
    e_held, known_held = (np.where(has_d[:, None], X, 0.0) for X in (e, known))
    e_none = e_held.copy()
    e_none[:, k : k + gains.n] += held @ gains.C
    return {
        "none": _rows(gains, sizes, e_none, unused, unused, known_held),
        "start": _rows(gains, sizes, e_held, held, unused, known_held),
        "end": _rows(gains, sizes, e_held, unused, held, known_held),
        "both": _rows(gains, sizes, e, y0, y1, known),
    }  # fmt: skip


def _first(gains: UnknownInputGains, sizes: Sizes) -> dict[str, Product]:
    """The first row: x from w and y, if it is there."""
    k, n = gains.k, gains.n
    unused, known = np.zeros((sizes.ends, gains.p)), np.zeros((sizes.ends, gains.m + 1))
    stay = np.eye(sizes.ends)
    measured, y = np.zeros_like(stay), unused.copy()
    measured[:k, :k], measured[k : k + n, :k], y[k : k + n] = np.eye(k), gains.X, gains.Xy
    without = _rows(gains, sizes, stay, unused, unused, known)
    with_y = _rows(gains, sizes, measured, unused, y, known)
    return {"none": without, "start": without, "end": with_y, "both": with_y}


def _initial(gains: UnknownInputGains, sizes: Sizes) -> Product:
    """w = T x from a guess of x."""
    k, n = gains.k, gains.n
    e = np.zeros((sizes.ends, sizes.middle))
    e[:k, k : k + n], e[k : k + n, k : k + n] = gains.T, np.eye(n)
    return Product(e)
