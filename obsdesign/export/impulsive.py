"""Programs of kind `impulsive`: a gain for every sequence of spacings in a window.

Spacings are whole numbers of ticks: k admissible ones and the virtual past before the first give a
window of l impulses (k + 1)^l sequences, each with the gain of the runtime.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np

from lmi.arithmetic.arrays import Entries, Matrix
from obsdesign.equations.impulsive.gains import ImpulsiveGains
from obsdesign.errors import InputError
from obsdesign.export.point_jump import jump_product
from obsdesign.export.precision import Precision
from obsdesign.export.program import FLOWS, Product, Program, Rules, Sizes, Tables
from obsdesign.export.timing import Steps, Timing, timing_of
from obsdesign.runtime.flow_cells import free_cells
from obsdesign.runtime.impulsive.observer import ImpulsiveObserver

# sequences of spacings that have a gain of their own
_MOST_SEQUENCES = 4096


def impulsive_program(entries: Entries, target: Precision, steps: Steps) -> Program:
    """The program of a design's gains.

    InputError where dwell times have no longest one, or windows too many sequences of spacings.
    """
    gains = ImpulsiveGains.from_document(entries)
    columns = gains.columns
    sizes = Sizes(gains.n, gains.p, int(columns["u"]), int(columns["w"]), gains.n)
    timing = timing_of(steps, gains.dwell_range, gains.dwell_jitter)
    tables, cells = Tables(target), free_cells(gains)
    flows: list[dict[str, int] | None] = [None]
    for length in timing.lengths:
        place = tables.place(_free(cells.at(length), sizes))
        flows.append(dict.fromkeys(FLOWS, place))
    plain = tables.place(jump_product(gains, None, sizes))
    jumps = [
        (plain, plain if L is None else tables.place(jump_product(gains, -L, sizes)))
        for L in _gains(gains, timing)
    ]
    rules = Rules(gains.jump_measurement, False, window=gains.window_length, bridges_gaps=False)
    return Program(
        "impulsive", target, sizes, tuple(tables.products), tuple(flows), tuple(jumps), None, None,
        timing, rules,
    )  # fmt: skip


def _free(known: Matrix, sizes: Sizes) -> Product:
    """A step of [x; u; 1] as one of [x; y0; y1; u; 1]."""
    n, unused = sizes.n, np.zeros((sizes.n, 2 * sizes.p))
    rows = np.hstack([known[:, :n], unused, known[:, n:]])
    return Product(sizes.widened(rows, sizes.m, has_magnitudes=False))


def _gains(gains: ImpulsiveGains, timing: Timing) -> Iterator[Matrix | None]:
    """The gain of each sequence of spacings, by its number; None where there is none.

    The digits of a number are spacings above the shortest, the newest last; the largest digit is
    the virtual past.
    """
    observer, length = ImpulsiveObserver(gains), gains.window_length
    spacings = timing.spacings
    if spacings is None or (spacings + 1) ** length > _MOST_SEQUENCES:
        count = "no largest one" if spacings is None else f"{spacings} dwell times"
        raise InputError(
            f"a window of {length} impulses with {count} between them in ticks of "
            f"{float(timing.tick):.6g} has too many gains for a table; at most {_MOST_SEQUENCES} "
            "sequences are exported. List longer steps, or narrow jump.dwell_time."
        )
    for digits in product(range(spacings + 1), repeat=length):
        # what is before the virtual past is not in the window
        known = digits[
            max((k + 1 for k, each in enumerate(digits) if each == spacings), default=0) :
        ]
        lengths = [float((timing.shortest + each) * timing.tick) for each in known]
        L, warning = observer.gain_after(lengths)
        if warning is not None:
            raise InputError(f"dwell times {lengths} give an {warning}: nothing to export.")
        yield L
