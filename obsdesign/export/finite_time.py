"""Programs of kind `finite_time`: the window is carried, a step shifts it by a sample.

Carried are x, w and the residuals r of the window: y_j less the output of w, the response to known
inputs, as at run time. Where the window is full, w is replaced by the estimate at every instant.
"""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Entries, Matrix
from obsdesign.equations.finite_time.gains import FiniteTimeGains
from obsdesign.errors import InputError
from obsdesign.export.precision import Precision
from obsdesign.export.program import FLOWS, Product, Program, Rules, Sizes, Tables
from obsdesign.export.timing import Steps, timing_of
from obsdesign.runtime.finite_time.constants import WindowConstants

# numbers that are carried: a product of each of them
_MOST_CARRIED = 200


def finite_time_program(entries: Entries, target: Precision, steps: Steps) -> Program:
    """The program of a design's gains.

    InputError for steps beside the period, long windows, and the method (14) as it is printed.
    """
    gains = FiniteTimeGains.from_document(entries)
    timing = timing_of(steps, (0.0, np.inf), None, period=gains.period)
    window = _Window(gains)
    _refuse(window, timing.lengths)
    sizes, tables = window.sizes, Tables(target)
    first, some, full = (
        {name: tables.place(window.step(has_y, *way)) for name, has_y in _HAS_Y.items()}
        for way in ((False, False), (True, False), (True, True))
    )
    jumps: tuple[tuple[int, int], ...] = ()
    if gains.G is not None:
        without, after = (tables.place(window.jump(has_y)) for has_y in (False, True))
        jumps = ((without, after),)
    rules = Rules(gains.jump_measurement, True, samples=gains.samples, bridges_gaps=False)
    return Program(
        "finite_time", target, sizes, tuple(tables.products), (first, some), jumps, None, None,
        timing, rules, full=full,
    )  # fmt: skip


_HAS_Y = {name: name in ("end", "both") for name in FLOWS}


def _refuse(window: _Window, lengths: tuple[float, ...]) -> None:
    gains = window.gains
    if lengths != (gains.period,):
        raise InputError(f"--steps: rows of this design come every {gains.period!r}, no others.")
    if window.constants.inputs is not None:
        raise InputError(
            "half_sample_correction = false cannot be exported to C; design with it, or with "
            "another method."
        )
    if window.sizes.ends > _MOST_CARRIED:
        raise InputError(
            f"a window of {gains.samples} samples carries {window.sizes.ends} numbers; at most "
            f"{_MOST_CARRIED} are exported. Design with a shorter window."
        )


class _Window:
    """Rows of [x; w; r] in [x; w; r; y0; y1; u; 1]."""

    def __init__(self, gains: FiniteTimeGains) -> None:
        self.gains, self.constants = gains, WindowConstants(gains)
        n, p, columns = gains.n, gains.p, gains.columns
        ends = 2 * n + gains.samples * p
        self.sizes = Sizes(n, p, int(columns["u"]), int(columns["w"]), ends)
        unit = np.eye(self.sizes.middle)
        self.x, self.w, self.r = unit[:n], unit[n : 2 * n], unit[2 * n : ends]
        self.y = unit[ends + p : ends + 2 * p].copy()
        if gains.noise_centre is not None:
            self.y[:, -1] = -gains.noise_centre
        self.known, self.constant = unit[ends + 2 * p : -1], unit[-1:]

    def step(self, has_y: bool, has_flow: bool, is_full: bool) -> Product:
        """A period, or none; is_full: with the estimate from a full window at its end."""
        x, w, r = self.x, self.w, self.r
        if has_flow:
            maps, gains = self.constants.period_maps, self.gains
            forced = gains.flow_drift[:, None] * self.constant
            if gains.B is not None:
                forced = forced + gains.B @ self.known[: gains.m]
            x, w = (maps.flow @ each + maps.once @ forced for each in (x, w))
        if is_full:
            x, w, r = self._estimated(w)
        if has_flow or has_y:  # a first row without a sample is no instant
            r = self._pushed(r, w, has_y)
        return Product(np.vstack([x, w, r]))

    def _estimated(self, w: Matrix) -> tuple[Matrix, Matrix, Matrix]:
        constants, r = self.constants, self.r
        x = constants.reproduced_state @ w + constants.gain @ r
        if not constants.is_driven:
            return x, w, r
        if constants.start_gain is None:
            change, shifted = x - w, x
        else:
            change = constants.start_gain @ r
            shifted = w + constants.last @ change
        return x, shifted, r - constants.rows @ change

    def _pushed(self, r: Matrix, w: Matrix, has_y: bool) -> Matrix:
        newest = self.y - self.gains.C @ w if has_y else 0.0 * self.y
        return np.vstack([r[self.gains.p :], newest])

    def jump(self, has_y: bool) -> Product:
        """A jump, after which the window is empty, but for a measurement after it."""
        gains = self.gains
        x = gains.jump_matrix @ self.x + gains.jump_drift[:, None] * self.constant
        if gains.E is not None:
            x = x + gains.E @ self.known[: gains.E.shape[1]]
        r = 0.0 * self.r
        if has_y and gains.jump_measurement == "after":
            r = self._pushed(r, 0.0 * self.w, True)
        return Product(np.vstack([x, 0.0 * self.w, r]))
