"""What the equations read of a plant; `obsdesign.Plant`, above this layer, has it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from lmi.arithmetic.arrays import Matrix


class Disturbed(Protocol):
    """Bounds of b or c, or of w where b = Bw w, c = W w."""

    @property
    def disturbance_matrix(self) -> Matrix | None:
        """(n, k), None where the bounds are those of b or c itself."""

    @property
    def lower(self) -> Matrix:
        """Lower bound (n,), or of w (k,)."""

    @property
    def upper(self) -> Matrix:
        """Upper bound (n,), or of w (k,)."""

    @property
    def shaped_disturbance(self) -> tuple[Matrix, Matrix, Matrix]:
        """(columns (n, k), lower, upper (k,)), with D d where d is bounded."""


class InputBounds(Protocol):
    """Bounds of an unknown input."""

    @property
    def lower(self) -> Matrix:
        """(q,)."""

    @property
    def upper(self) -> Matrix:
        """(q,)."""

    @property
    def rate(self) -> Matrix | None:
        """Bounds of its rate of change (q,), None for any."""


class Flow(Disturbed, Protocol):
    """Numbers of x' = A x + B u + b."""

    @property
    def A(self) -> Matrix:
        """(n, n)."""

    @property
    def B(self) -> Matrix | None:
        """(n, m), None without a known input."""

    @property
    def input_bound(self) -> Matrix | None:
        """Bound of |u| of each known input (m,), None where none is stated."""

    @property
    def D(self) -> Matrix | None:
        """(n, q), None without an unknown input."""

    @property
    def d_bounds(self) -> InputBounds | None:
        """Bounds of the unknown input, None without any."""

    @property
    def A_radius(self) -> Matrix | None:
        """Half-widths of the entries of A (n, n), None where A is known."""

    @property
    def dt(self) -> float | None:
        """Step of discrete time, None for a flow."""

    @property
    def b_bounds(self) -> tuple[Matrix, Matrix]:
        """(lower, upper) bounds of b, (n,) each, of b + D d where d is bounded."""

    def disturbance_box(self) -> tuple[Matrix, Matrix]:
        """(lower, upper) bounds of b alone, (n,) each."""


class Jump(Disturbed, Protocol):
    """Numbers of x+ = G x + E w + H g + c."""

    @property
    def name(self) -> str:
        """Name of the event."""

    @property
    def G(self) -> Matrix:
        """(n, n)."""

    @property
    def E(self) -> Matrix | None:
        """(n, l), None without a known jump input."""

    @property
    def H(self) -> Matrix | None:
        """(n, r), None without unknown impulses."""

    @property
    def G_radius(self) -> Matrix | None:
        """Half-widths of the entries of G (n, n), None where G is known."""

    @property
    def stamp_error(self) -> float:
        """Largest time between it and its stamp."""

    @property
    def input_bound(self) -> Matrix | None:
        """Bound of |w| of each known input (l,), None where none is stated."""

    @property
    def modes(self) -> tuple[str, ...] | None:
        """Names of the modes in which alone it happens, None for any."""

    @property
    def c_bounds(self) -> tuple[Matrix, Matrix]:
        """(lower, upper) bounds of c, (n,) each."""

    @property
    def dwell_time(self) -> tuple[float, float] | None:
        """(shortest, longest), None where every dwell time is allowed."""

    @property
    def dwell_jitter(self) -> float:
        """Largest change from one dwell time to the next, maybe infinite."""


class Output(Protocol):
    """Numbers of y = C x + v."""

    @property
    def name(self) -> str:
        """Name of the sensor."""

    @property
    def gap(self) -> float:
        """Longest time between two samples, maybe infinite."""

    @property
    def sends_on_change(self) -> Matrix | None:
        """Changes (p,) at which it sends a sample too, None where it does not."""

    @property
    def event(self) -> str | None:
        """Name of the event at which alone it is read, None for a clock of its own."""

    @property
    def C(self) -> Matrix:
        """(p, n)."""

    @property
    def C_radius(self) -> Matrix | None:
        """Half-widths of the entries of C (p, n), None where C is known."""

    @property
    def noise_bound(self) -> Matrix | None:
        """(p,) or (p, 2), None where there is none."""

    @property
    def noise_radius(self) -> Matrix | None:
        """Half-widths of the bounds of v (p,)."""

    @property
    def noise_centre(self) -> Matrix | None:
        """Middle of the bounds of v (p,), None where all are symmetric."""

    @property
    def noise_std(self) -> Matrix:
        """(p,)."""

    @property
    def noise_cv(self) -> Matrix:
        """(p,)."""

    @property
    def measured(self) -> str:
        """When y is measured."""

    @property
    def period(self) -> float | None:
        """Time between samples, None where it is not fixed."""

    @property
    def jump_measurement(self) -> str:
        """At a jump: before, after or none."""


class Timing(Protocol):
    """What the clocks of events have in common."""

    @property
    def spacing(self) -> float:
        """Least time between two events of different names."""


class Parameter(Protocol):
    """A number that is known up to a range, and what one unit of it adds to the matrices."""

    @property
    def name(self) -> str:
        """Name of the parameter."""

    @property
    def entry(self) -> str:
        """What messages call it."""

    @property
    def range(self) -> tuple[float, float]:
        """(lowest, highest)."""

    @property
    def constant(self) -> bool:
        """Is it one unknown number for ever?"""

    @property
    def effects(self) -> Mapping[str, Matrix]:
        """What one unit adds to A, B, G, E, C, of those to which it adds."""

    def check_sizes(self, nominal: Mapping[str, Matrix | None], /) -> None:
        """An error unless each effect has the shape of what it adds to."""


class StateBox(Protocol):
    """A box in which the state is stated to stay."""

    @property
    def lower(self) -> Matrix:
        """(n,)."""

    @property
    def upper(self) -> Matrix:
        """(n,)."""

    def check_sizes(self, n: int, /) -> None:
        """An error unless it bounds n states."""


class Plant(Protocol):
    """A flow, its events if it has any, and its sensors."""

    @property
    def events(self) -> Sequence[Jump]:
        """All named jumps."""

    @property
    def sensors(self) -> Sequence[Output]:
        """All sensors."""

    @property
    def outputs(self) -> Output:
        """Outputs of all sensors together."""

    @property
    def timing(self) -> Timing:
        """What clocks have in common."""

    @property
    def has_tables(self) -> bool:
        """Is it of [[event]] and [[sensor]] in a file?"""

    @property
    def modes(self) -> Sequence[object]:
        """Flows that take turns."""

    @property
    def parameters(self) -> Sequence[Parameter]:
        """Numbers that are known up to a range."""

    @property
    def state(self) -> StateBox | None:
        """Box in which the state is stated to stay, None where none is."""

    @property
    def has_one_clock(self) -> bool:
        """Are `jump` and `output` all that there is?"""

    @property
    def flow(self) -> Flow:
        """Between jumps."""

    @property
    def jump(self) -> Jump | None:
        """The one event, None without any; an error where there are several."""

    @property
    def output(self) -> Output:
        """The one sensor; an error where there are several."""
