"""Programs of interval observers: the kernels of the runtime, on a target."""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Entries
from lmi.arithmetic.enclosure import Enclosure
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.errors import InputError
from obsdesign.export.precision import Precision
from obsdesign.export.program import Product, Program, Rules, Sizes, Tables
from obsdesign.export.timing import Steps, timing_of
from obsdesign.runtime.clocks.time_stamps import length_error
from obsdesign.runtime.interval.kernel import Kernel
from obsdesign.runtime.interval.kernel_rows import Rows
from obsdesign.runtime.interval.model import Model, size
from obsdesign.runtime.interval.step_kernels import StepKernels
from obsdesign.runtime.step_cache import shared_length

# kernels of `StepKernels` by `program.FLOWS`
_CONTINUOUS = {name: name for name in ("none", "start", "end", "both")}
_PERIODIC = {"none": "none", "start": "none", "end": "sampled", "both": "sampled"}
_STILL = {"none": "none", "start": "none", "end": "end", "both": "end"}


def interval_program(entries: Entries, target: Precision, steps: Steps) -> Program:
    """The program of a design's gains.

    InputError for a plant with parameters, whose radii are not products alone.
    """
    gains = IntervalGains.from_document(entries)
    if gains.is_uncertain:
        raise InputError(
            "a plant with parameters cannot be exported: its radii need products that the code "
            "does not have. Export the design of its nominal plant, with wider disturbances."
        )
    period = gains.period
    kernels = StepKernels(gains)
    n, names = gains.n, _CONTINUOUS if period is None else _PERIODIC
    columns = gains.columns
    sizes = Sizes(n, gains.p, int(columns["u"]), int(columns["w"]), 2 * n)
    tables = Tables(target)

    def product(kernel: Kernel, inputs: int) -> Product:
        return _product(kernel, sizes, inputs)

    still = kernels.still
    first = _STILL if period is None else _PERIODIC
    flows = [tables.flow({mode: product(still[name], sizes.m) for mode, name in first.items()})]
    for length in steps.listed(period):
        of_step = kernels.built(*_enclosed(length, target, steps.error))
        flows.append(
            tables.flow({mode: product(of_step[name], sizes.m) for mode, name in names.items()})
        )
    jumps: tuple[tuple[int, int], ...] = ()
    if gains.G is not None:
        plain = tables.place(product(kernels.jumps[False], sizes.l))
        corrected = kernels.jumps.get(True)
        jumps = (
            (plain, plain if corrected is None else tables.place(product(corrected, sizes.l))),
        )
    again = None
    if period is not None and gains.jump_measurement == "after":
        again = tables.place(product(still["sampled"], sizes.m))
    initial = _initial(kernels.model, sizes)
    place = None if initial is None else tables.place(initial)
    timing = timing_of(
        steps, gains.dwell_range, gains.dwell_jitter, period=period, limit=gains.step_limit
    )
    rules = Rules(
        gains.jump_measurement, bool(np.any(gains.L)), period is not None,
        allows_no_second_jump=period is not None and gains.dwell_range[0] >= period,
    )  # fmt: skip
    return Program(
        "interval", target, sizes, tuple(tables.products), tuple(flows), jumps, again, place,
        timing, rules,
    )  # fmt: skip


def _enclosed(length: float, target: Precision, relative: float) -> tuple[float, float]:
    """The length that steps share at run time, and its error; with the target's own rounding."""
    shared, half = shared_length(length, length)
    error = half + length_error(shared, length)
    return shared, max(error, (relative * (1.0 + target.unit) + 4.0 * target.unit) * length)


def _product(kernel: Kernel, sizes: Sizes, inputs: int) -> Product:
    """The product of a kernel; its bounds without cuts are mostly among the candidates."""
    n2, rooms = 2 * kernel.n, 2 * kernel.p
    blocks = list(kernel.rows[rooms + 1 :].reshape(-1, n2, kernel.width))
    whole: list[int] = []
    for block in kernel.whole.reshape(-1, n2, kernel.width):
        same = [place for place, other in enumerate(blocks) if np.array_equal(block, other)]
        whole += same[:1] or [len(blocks)]
        blocks += [] if same else [block]
    rows = np.vstack([kernel.rows[: rooms + 1], *blocks])
    rows = sizes.widened(rows, inputs, has_magnitudes=True)
    return Product(rows, rooms, kernel.candidates, kernel.inner, (whole[0], whole[-1]))


def _initial(model: Model, sizes: Sizes) -> Product | None:
    """Bounds of z = S^-1 x from those of x; None where z is x."""
    if model.S_inverse is None:
        return None
    n, inverse = sizes.n, model.S_inverse
    known = np.zeros((n, sizes.middle - 2 * n))
    X = Enclosure(np.hstack([inverse.mid, known]), np.hstack([inverse.rad, known]))
    into = Rows(X, size(inverse), np.zeros(n))
    ends = np.vstack([into.lower(), into.lower(-1.0)])
    nothing = np.zeros((2 * sizes.p + 1, ends.shape[1]))
    return Product(np.vstack([nothing, ends, ends]), 2 * sizes.p, inner=1)
