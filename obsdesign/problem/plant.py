"""A linear plant that may jump: frozen values, validated once, arrays read-only.

    x'(t) = A x + B u(t) + D d(t) + b(t)      between jumps,  lower <= b <= upper
    x(t)  = G x(t-) + E w[k] + H g[k] + c[k]  at jump times,  lower <= c <= upper
                      with a disturbance_matrix Bw: b = Bw w,  lower <= w <= upper, likewise c
    y     = C x + v,  |v_i| <= noise_bound_i, or lower_i <= v_i <= upper_i where that is a pair;
                      standard deviation noise_std_i + noise_cv_i |y_i|

Every InputError names the entry as it stands in a problem file. Fields take anything numpy can read
as an array and hold float64 arrays; None leaves an optional one out, or takes its default.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from lmi.arithmetic.arrays import Matrix, Value
from obsdesign.entries import (
    matrix,
    positive,
    real,
    require_shape,
    shown,
    size_text,
)
from obsdesign.equations.noise_bounds import noise_box
from obsdesign.errors import InputError
from obsdesign.problem.blocks import Block, DisturbedBlock, set_fields
from obsdesign.problem.noise import noise_numbers, noise_pairs
from obsdesign.problem.schema import DWELL_RANGE, POSITIVE, file_entry, one_of, ref

MEASURED = ("continuous", "periodic", "at_jumps")
JUMP_MEASUREMENTS = ("before", "after", "none")
# what is left out: __post_init__ fills it in, and for a jump the plant, which knows the sizes
_DEFAULT: Value = None
_DISTURBANCE = "Bounds of {}, or of w where there is a disturbance_matrix; default 0."


@dataclass(frozen=True, eq=False)
class Flow(DisturbedBlock):
    """The flow x' = A x + B u(t) + D d(t) + b(t), lower <= b(t) <= upper.

    A (n, n); B (n, m): known input; D (n, q): unknown input; lower, upper (n,): zero by default.
    With a disturbance_matrix Bw (n, k), b = Bw w(t) and lower, upper (k,) are bounds of w.
    InputError where sizes do not agree, numbers are not finite or bounds are crossed.
    """

    A: Matrix = file_entry(ref("matrix"), "n x n.")
    B: Matrix | None = file_entry(ref("matrix"), "n x m, known input u.", default=None)
    D: Matrix | None = file_entry(ref("matrix"), "n x q, unknown input d.", default=None)
    lower: Matrix = file_entry(
        ref("bounds"), _DISTURBANCE.format("b(t)"), default=_DEFAULT, name="disturbance"
    )
    upper: Matrix = _DEFAULT
    disturbance_matrix: Matrix | None = file_entry(
        ref("matrix"), "n x k: b = Bw w, and disturbance bounds w.", default=None
    )

    def __post_init__(self) -> None:
        A = matrix(self.A, "flow.A")
        n = A.shape[0]
        if A.shape != (n, n):
            raise InputError(f"flow.A must be square; got {size_text(A)}.")
        names = ("B", "D", "disturbance_matrix")
        set_fields(self, A=A, **self.matrices("flow", names, n, f"flow.A ({size_text(A)})"))
        lower, upper = self.checked_bounds("flow", n)
        set_fields(self, lower=lower, upper=upper)

    @property
    def b_bounds(self) -> tuple[Matrix, Matrix]:
        """(lower, upper) of b, (n,): the box around all Bw w, rounded outward."""
        return self.disturbance_box()


@dataclass(frozen=True, eq=False)
class Jump(DisturbedBlock):
    """The jump x(t) = G x(t-) + E w[k] + H g[k] + c[k], lower <= c[k] <= upper.

    G (n, n): None for the identity; E (n, l): known jump input; H (n, r): directions of impulses of
    unknown weights g; lower, upper (n,): zero by default. With a disturbance_matrix W (n, k),
    c = W w and lower, upper (k,) are bounds of w. dwell_time: (shortest, longest) time between
    jumps, the longest may be infinite; dwell_jitter: largest change from one dwell time to the
    next. Times in the unit of flow.A. InputError as for `Flow`.
    """

    G: Matrix = file_entry(ref("matrix"), "n x n; default identity.", default=_DEFAULT)
    E: Matrix | None = file_entry(ref("matrix"), "Known jump input w.", default=None)
    H: Matrix | None = file_entry(
        ref("matrix"), "Directions of impulses with unknown weights g.", default=None
    )
    lower: Matrix = file_entry(
        ref("bounds"), _DISTURBANCE.format("c[k]"), default=_DEFAULT, name="disturbance"
    )
    upper: Matrix = _DEFAULT
    dwell_time: tuple[float, float] | None = file_entry(
        DWELL_RANGE, "Shortest and longest time between jumps.", default=None
    )
    dwell_jitter: float = file_entry(
        ref("upper_end"), "Largest change from one dwell time to the next.", default=math.inf
    )
    disturbance_matrix: Matrix | None = file_entry(
        ref("matrix"), "n x k: c = W w, and disturbance bounds w.", default=None
    )

    def __post_init__(self) -> None:
        if self.G is not None:
            G = matrix(self.G, "jump.G")
            if G.shape[0] != G.shape[1]:
                raise InputError(f"jump.G must be square; got {size_text(G)}.")
            set_fields(self, G=G)
        jitter = real(self.dwell_jitter, "jump.dwell_jitter")
        if not jitter >= 0:
            raise InputError(f"jump.dwell_jitter must be a number >= 0 or inf; got {jitter!r}.")
        set_fields(self, dwell_time=_dwell_time(self.dwell_time), dwell_jitter=jitter)

    def completed(self, n: int, why: str) -> Jump:
        """The jump of a plant with n states: identity and zero bounds filled in, sizes checked."""
        G = np.eye(n) if self.G is None else self.G
        require_shape(matrix(G, "jump.G"), "jump.G", (n, n), why)
        names = ("E", "H", "disturbance_matrix")
        inputs = self.matrices("jump", names, n, why.removeprefix("one per state of "))
        lower, upper = self.checked_bounds("jump", n)
        result = Jump(G, None, None, lower, upper, self.dwell_time, self.dwell_jitter)
        set_fields(result, lower=lower, upper=upper, **inputs)
        return result

    @property
    def c_bounds(self) -> tuple[Matrix, Matrix]:
        """(lower, upper) of c, (n,): the box around all W w, rounded outward."""
        return self.disturbance_box()


@dataclass(frozen=True, eq=False)
class Output(Block):
    """The output y = C x + v, |v_i| <= noise_bound_i: the noise v, and when y is measured.

    C (p, n); noise_bound (p,), or (p, 2) of pairs [lower, upper], or None: not known, which is not
    zero; noise_std, noise_cv (p,): standard deviation noise_std_i + noise_cv_i |y_i|, zero by
    default. One number serves all outputs; a number among pairs is a pair.

    measured: continuous, periodic (with period, in the unit of time of flow.A) or at_jumps;
    jump_measurement: at a jump y is that of the state before or after it, or there is none.
    InputError as for `Flow`.
    """

    C: Matrix = file_entry(ref("matrix"), "p x n.")
    noise_bound: Matrix | None = file_entry(
        ref("noise_bound"),
        "|v_i| <= noise_bound_i, or lower <= v_i <= upper where that is a pair, at every instant; "
        "required by kinds that guarantee bounds. Absent: not known.",
        default=None,
    )
    noise_std: Matrix = file_entry(
        ref("per_output"), "Standard deviation of v_i.", default=_DEFAULT
    )
    noise_cv: Matrix = file_entry(
        ref("per_output"), "Part of the deviation proportional to |y_i|.", default=_DEFAULT
    )
    measured: str = file_entry(
        one_of(*MEASURED),
        "When y is available: always, every period, or at jump times only; default continuous.",
        default="continuous",
    )
    period: float | None = file_entry(
        POSITIVE, "Time between samples; required when measured is periodic.", default=None
    )
    jump_measurement: str = file_entry(
        one_of(*JUMP_MEASUREMENTS),
        "What a measurement stamped with a jump time saw; default before.",
        default="before",
    )

    def __post_init__(self) -> None:
        C = matrix(self.C, "output.C")
        set_fields(self, C=C)
        if self.noise_bound is not None:
            pairs = noise_pairs(self.noise_bound, C)
            if pairs is None:
                pairs = noise_numbers(self.noise_bound, C, "noise_bound")
            set_fields(self, noise_bound=pairs)
        for name in ("noise_std", "noise_cv"):
            values = getattr(self, name)
            set_fields(self, **{name: noise_numbers(0.0 if values is None else values, C, name)})
        for name, words in (("measured", MEASURED), ("jump_measurement", JUMP_MEASUREMENTS)):
            if getattr(self, name) not in words:
                raise InputError(
                    f"output.{name} must be one of {', '.join(words)}; got {getattr(self, name)!r}."
                )
        if self.measured == "at_jumps" and self.jump_measurement == "none":
            raise InputError(
                "output.jump_measurement must be before or after when measured = 'at_jumps'; "
                "got 'none', which leaves no measurement at all."
            )
        if self.period is not None:
            set_fields(self, period=positive(real(self.period, "output.period"), "output.period"))
        elif self.measured == "periodic":
            raise InputError(_required("output.period", "output.measured = 'periodic'", "it"))

    @property
    def noise_centre(self) -> Matrix | None:
        """Middle of the bounds of v, (p,); None where they are symmetric or not known."""
        return None if self.noise_bound is None else noise_box(self.noise_bound)[0]

    @property
    def noise_radius(self) -> Matrix | None:
        """Half the width of the bounds of v, (p,), rounded up; None where they are not known."""
        return None if self.noise_bound is None else noise_box(self.noise_bound)[1]

    @property
    def sample_period(self) -> float:
        """Time between samples; 1 where none is stated."""
        return 1.0 if self.period is None else self.period

    @property
    def sample_spacing(self) -> float:
        """Time between samples; 0 where none is stated."""
        return 0.0 if self.period is None else self.period


@dataclass(frozen=True)
class Plant:
    """Flow, jump (None: the plant never jumps) and output of n states and p measurements.

    InputError where their sizes differ, or y is measured at jumps and there are none.
    """

    flow: Flow
    jump: Jump | None
    output: Output
    n: int = field(init=False)
    p: int = field(init=False)

    def __post_init__(self) -> None:
        A, C = self.flow.A, self.output.C
        n = len(A)
        require_shape(C, "output.C", (None, n), f"one per state of flow.A ({size_text(A)})")
        if self.jump is not None:
            set_fields(
                self, jump=self.jump.completed(n, f"one per state of flow.A ({size_text(A)})")
            )
        if self.output.measured == "at_jumps" and self.jump is None:
            raise InputError(_required("jump", "output.measured = 'at_jumps'", "it"))
        set_fields(self, n=n, p=len(C))

    def reason_without(self, *entries: str, needed_by: str) -> str | None:
        """Reason against a plant that lacks one of these entries, or None; one sentence.

        entries: optional ones, as "flow.D", "jump", "jump.H"; needed_by: what requires them.
        """
        for entry in entries:
            value: Value = self
            for name in entry.split("."):
                value = getattr(value, name)
                if value is None:
                    absent = "[jump]" if name == "jump" and name != entry else "it"
                    return _required(entry, needed_by, absent, self.p)
        return None


def _required(entry: str, needed_by: str, absent: str, p: int = 1) -> str:
    """The sentence about an entry that is missing; p: number of outputs."""
    written = {"jump": "[jump]", "jump.dwell_time": "jump.dwell_time = [shortest, longest]"}
    hint = ""
    if entry == "output.noise_bound":
        needed_by += ", which guarantees bounds"
        hint = f" If y is free of noise, write noise_bound = [{', '.join(['0.0'] * p)}]."
    return f"{written.get(entry, entry)} is required by {needed_by}; {absent} is missing.{hint}"


def _dwell_time(values: Value) -> tuple[float, float] | None:
    entry = "jump.dwell_time"
    if values is None:
        return None
    if isinstance(values, str) or not hasattr(values, "__len__") or len(values) != 2:
        raise InputError(f"{entry} must be a pair [shortest, longest]; got {shown(values)}.")
    low, high = (real(value, entry) for value in values)
    if math.isnan(low) or math.isnan(high):
        raise InputError(f"{entry} must be numbers; got {shown([low, high])}.")
    if math.isinf(low):
        raise InputError(f"{entry}: the shortest dwell time must be finite; got [{low}, {high}].")
    if low < 0:
        raise InputError(f"{entry}: the shortest dwell time must be >= 0; got [{low:g}, {high:g}].")
    if low > high:
        raise InputError(
            f"{entry} must be [shortest, longest]; got [{low:g}, {high:g}]. Is it reversed?"
        )
    if high == 0:
        raise InputError(f"{entry}: the longest dwell time must be > 0; got [0, 0].")
    return low + 0.0, high
