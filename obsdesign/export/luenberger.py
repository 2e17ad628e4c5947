"""Programs of kind `luenberger`: the matrices of a step, of a jump and of its schedule."""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Entries
from obsdesign.equations.luenberger.gains import LuenbergerGains
from obsdesign.export.point_jump import jump_product, noise_centre
from obsdesign.export.precision import Precision
from obsdesign.export.program import Product, Program, Rules, Sizes, Tables
from obsdesign.export.timing import Steps, timing_of
from obsdesign.runtime.luenberger.observer import LuenbergerObserver


def luenberger_program(entries: Entries, target: Precision, steps: Steps) -> Program:
    """The program of a design's gains."""
    gains = LuenbergerGains.from_document(entries)
    observer = LuenbergerObserver(gains)
    columns = gains.columns
    sizes = Sizes(gains.n, gains.p, int(columns["u"]), int(columns["w"]), gains.n)
    tables = Tables(target)
    flows = [None, *(tables.flow(_flows(observer, h, sizes)) for h in steps.listed())]
    timing = timing_of(steps, gains.dwell_range, gains.dwell_jitter, borders=gains.dwell_borders)
    jumps: list[tuple[int, int]] = []
    if gains.G is not None:
        plain = tables.place(jump_product(gains, None, sizes))
        # the first jump gain is that of a jump without a dwell time before it
        of_cells = [gains.M, *([] if gains.M_cells is None else gains.M_cells)]
        jumps = [(plain, tables.place(jump_product(gains, M, sizes))) for M in of_cells]
    rules = Rules(
        gains.jump_measurement, bool(np.any(gains.L)),
        input_bound=gains.input_bound, jump_input_bound=gains.jump_input_bound,
    )  # fmt: skip
    return Program(
        "luenberger", target, sizes, tuple(tables.products), tuple(flows), tuple(jumps), None, None,
        timing, rules,
    )  # fmt: skip


def _flows(observer: LuenbergerObserver, h: float, sizes: Sizes) -> dict[str, Product]:
    """Products of [x; y0; y1; u; 1] from the maps of [x; u; 1] and [x; y; u; 1; slope of y]."""
    gains = observer.gains
    n, p, centre = sizes.n, sizes.p, noise_centre(gains)
    free, measured = observer.free_cells.at(h), observer.measured_cells.at(h)
    kept, driven = measured[:, n : n + p], measured[:, n + p : -p]
    known = driven.copy()
    known[:, -1] -= kept @ centre
    share, unused = measured[:, -p:] / h, np.zeros((n, p))
    columns = {
        "none": [free[:, :n], unused, unused, free[:, n:]],
        "start": [measured[:, :n], kept, unused, known],
        "end": [measured[:, :n], unused, kept, known],
        "both": [measured[:, :n], kept - share, share, known],
    }
    return {
        mode: Product(sizes.widened(np.hstack(blocks), sizes.m, has_magnitudes=False))
        for mode, blocks in columns.items()
    }
