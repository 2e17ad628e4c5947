"""Programs of interval observers: the kernels of the runtime, on a target."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lmi.arithmetic.arrays import Entries
from lmi.arithmetic.enclosure import Enclosure, stack
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.errors import InputError
from obsdesign.export.precision import Precision
from obsdesign.export.program import FLOWS, Product, Program, Rules, Sizes, Tables
from obsdesign.export.timing import Steps, timing_of
from obsdesign.runtime.clocks.time_stamps import length_error
from obsdesign.runtime.interval.kernel import Kernel
from obsdesign.runtime.interval.kernel_rows import Cuts, Rows, kernel
from obsdesign.runtime.interval.maps import BoxMap, flow_and_jump_spread, jump_maps
from obsdesign.runtime.interval.model import Model, size
from obsdesign.runtime.interval.step_kernels import StepKernels
from obsdesign.runtime.step_cache import shared_length

# kernels of `StepKernels` by flow
_CONTINUOUS = {name: name for name in FLOWS}
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
    has_through = period is not None and gains.G is not None
    sizes = Sizes(n, gains.p, int(columns["u"]), int(columns["w"]), 2 * n, has_through)
    tables = Tables(target)

    still = kernels.still
    first = _STILL if period is None else _PERIODIC
    flows, through = [_flow(still, first, sizes, tables)], list[int | None]([None])
    for length in steps.listed(period):
        enclosed = _enclosed(length, target, steps.error)
        of_step = kernels.built(*enclosed)
        if has_through:
            both = _through_jump(kernels, of_step.box_map("none"), *enclosed)
            through.append(tables.place(_product(both, sizes, sizes.m + sizes.l)))
        flows.append(_flow(of_step, names, sizes, tables))
    jumps = () if gains.G is None else (_jumps(kernels, sizes, tables),)
    again = None
    if period is not None and gains.jump_measurement == "after":
        again = tables.place(_product(still["sampled"], sizes, sizes.m))
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
        timing, rules, through=tuple(through) if has_through else (),
    )  # fmt: skip


def _flow(
    kernels: Mapping[str, Kernel], names: Mapping[str, str], sizes: Sizes, tables: Tables
) -> Entries:
    """Places of the products of a step, for each way in which it is measured."""
    return tables.flow(
        {mode: _product(kernels[name], sizes, sizes.m) for mode, name in names.items()}
    )


def _jumps(kernels: StepKernels, sizes: Sizes, tables: Tables) -> tuple[int, int]:
    """Places of the products of a jump: without a measurement, and with one where it is used."""
    plain = tables.place(_jump_product(kernels.jumps[False], sizes))
    corrected = kernels.jumps.get(True)
    return plain, plain if corrected is None else tables.place(_jump_product(corrected, sizes))


def _enclosed(length: float, target: Precision, relative: float) -> tuple[float, float]:
    """The length that steps share at run time, and its error; with the target's own rounding."""
    shared, half = shared_length(length, length)
    error = half + length_error(shared, length)
    return shared, max(error, (relative * (1.0 + target.unit) + 4.0 * target.unit) * length)


def _through_jump(kernels: StepKernels, free: BoxMap, h: float, h_error: float) -> Kernel:
    """The kernel of a step and of a jump at its end without measurement, inputs [u; w].

    |G e^(A h)| is at most |G| |e^(A h)|: widths are claimed with the first (`interval.course`).
    """
    model, gains = kernels.model, kernels.gains
    first = gains.n + 2 * gains.p
    jump = jump_maps(model, gains)[False].X
    of_z, of_w, of_one = (
        Enclosure(jump.mid[:, columns], jump.rad[:, columns])
        for columns in (slice(gains.n), slice(first, -1), slice(-1, None))
    )
    flow = of_z @ free.X
    known, last = (
        Enclosure(flow.mid[:, columns], flow.rad[:, columns])
        for columns in (slice(-1), slice(-1, None))
    )
    R, g = flow_and_jump_spread(model, gains, h, h_error)
    step = BoxMap(stack([[known, of_w, last + of_one]]), R, g)
    return kernel(model, step, gains.C, Cuts())


def _jump_product(made: Kernel, sizes: Sizes) -> Product:
    return _product(made, sizes, sizes.l, sizes.before_jump_inputs)


def _product(made: Kernel, sizes: Sizes, inputs: int, before: int = 0) -> Product:
    """The product of a kernel; its bounds without cuts are mostly among the candidates."""
    n2, rooms = 2 * made.n, 2 * made.p
    blocks = list(made.rows[rooms + 1 :].reshape(-1, n2, made.width))
    whole: list[int] = []
    for block in made.whole.reshape(-1, n2, made.width):
        same = [place for place, other in enumerate(blocks) if np.array_equal(block, other)]
        whole += same[:1] or [len(blocks)]
        blocks += [] if same else [block]
    rows = np.vstack([made.rows[: rooms + 1], *blocks])
    rows = sizes.widened(rows, inputs, has_magnitudes=True, before=before)
    return Product(rows, rooms, made.candidates, made.inner, (whole[0], whole[-1]))


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
