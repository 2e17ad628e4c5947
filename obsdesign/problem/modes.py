"""Modes of a plant: flows that take turns, each for a stay in a range of its own."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from lmi.arithmetic.arrays import Matrix, Value
from obsdesign.entries import is_number, matrix, positive, real, require_shape, shown
from obsdesign.equations.modes import ModeSpan
from obsdesign.errors import InputError
from obsdesign.problem.blocks import Block, set_fields
from obsdesign.problem.names import MODE_NAMES, NAME_SCHEMA, check_name
from obsdesign.problem.schema import file_entry, ref
from obsdesign.problem.time_ranges import time_range

_DEFAULT: Value = None
# what a mode may have of its own; all else it shares with [flow] and the sensor
_GAINS = {
    "type": "object",
    "title": "a table { L = [[...]] }",
    "properties": {"L": ref("gain_matrix")},
    "additionalProperties": False,
}


@dataclass(frozen=True, eq=False, kw_only=True)
class Mode(Block):
    """A mode: what differs from the flow and the sensor, how long it lasts, what follows.

    A (n, n), B (n, m), C (p, n), disturbance: None where they are those of the flow and the sensor.
    every: length of a stay, a number or (shortest, longest), the longest may be infinite. next:
    names of the modes that can follow, None for any other. G (n, n): x+ = G x on entry, None for
    the identity. gains: L (n, p), where it is given. InputError as for `Flow`.
    """

    name: str = file_entry(NAME_SCHEMA, "Name of the mode, as in column mode of data.")
    A: Matrix | None = file_entry(ref("matrix"), "n x n; default that of [flow].", default=None)
    B: Matrix | None = file_entry(ref("matrix"), "n x m; default that of [flow].", default=None)
    C: Matrix | None = file_entry(ref("matrix"), "p x n; default the sensor's.", default=None)
    lower: Matrix | None = file_entry(
        ref("bounds"), "Bounds as in [flow]; default those.", default=_DEFAULT, name="disturbance"
    )
    upper: Matrix | None = _DEFAULT
    every: tuple[float, float] = file_entry(
        ref("every"), "Length of a stay: a number, or [shortest, longest]; the longest may be inf."
    )
    next: tuple[str, ...] | None = file_entry(
        MODE_NAMES, "Modes that can follow; default any other.", default=None
    )
    G: Matrix | None = file_entry(
        ref("matrix"), "n x n: x+ = G x on entry; default identity.", default=None
    )
    gains: Mapping[str, Matrix] = file_entry(
        _GAINS, "Gain L of this mode, kept; default observer.gains.L, else synthesised.",
        default=_DEFAULT,
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_name(self.name, "mode")
        for key in ("A", "B", "C", "G"):
            if (values := getattr(self, key)) is not None:
                set_fields(self, **{key: matrix(values, f"{self.entry}.{key}")})
        entry = f"{self.entry}.every"
        given = self.every
        if is_number(given):
            given = (positive(real(given, entry), entry),) * 2
        ends = time_range(given, entry, "stay")
        if ends is None or not ends[0] > 0:
            raise InputError(f"{entry}: the shortest stay must be > 0; got {shown(given)}.")
        gains = {
            key: matrix(values, f"{self.entry}.gains.{key}")
            for key, values in dict(self.gains or {}).items()
        }
        following = None if self.next is None else tuple(self.next)
        set_fields(self, every=ends, next=following, gains=gains)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Mode) or self.gains.keys() != other.gains.keys():
            return False
        same = all(np.array_equal(values, other.gains[key]) for key, values in self.gains.items())
        return same and super(Mode, replace(self, gains={})).__eq__(replace(other, gains={}))

    @property
    def entry(self) -> str:
        """What messages call it."""
        return f"mode.{self.name}"

    def check_sizes(self, n: int, p: int, m: int, widths: int) -> None:
        """InputError unless matrices are those of n states, p outputs, m known inputs.

        widths: entries of the bounds of a disturbance.
        """
        sizes = {"A": (n, n), "B": (n, m), "C": (p, n), "G": (n, n)}
        for key, shape in sizes.items():
            if (values := getattr(self, key)) is not None:
                require_shape(values, f"{self.entry}.{key}", shape, "as in [flow] and the sensor")
        for key, values in self.gains.items():
            require_shape(values, f"{self.entry}.gains.{key}", (n, p), "n x p")
        for end in (self.lower, self.upper):
            if end is not None and np.shape(end) != (widths,):
                raise InputError(
                    f"{self.entry}.disturbance must have {widths} entries, as flow.disturbance; "
                    f"got {shown(end)}."
                )

    @property
    def entry_map(self) -> Matrix | None:
        """G where it changes the state; None for the identity."""
        if self.G is None or np.array_equal(self.G, np.eye(len(self.G))):
            return None
        return self.G


def check_modes(modes: Sequence[Mode], *, has_jump: bool, has_steps: bool) -> None:
    """InputError where names meet, or a mode names one that is none, or ends without another.

    has_jump: the plant has a [jump]; has_steps: it is in discrete time. It may have neither.
    """
    if has_steps:
        raise InputError("[[mode]] is not available with flow.dt in this version.")
    if has_jump:
        raise InputError(
            "[[mode]] may not be mixed with [jump]; write the jump as [[event]], which may state "
            "its modes, and [output] as [[sensor]]. A map at changes of mode is "
            f"{modes[0].entry}.G."
        )
    names = [mode.name for mode in modes]
    if len(names) < 2:
        raise InputError(
            "[[mode]]: two modes or more are required; got one. Write its A in [flow]."
        )
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"mode.name must differ from mode to mode; got {name!r} twice.")
    for mode in modes:
        for name in mode.next or ():
            if name not in names or name == mode.name:
                others = ", ".join(other for other in names if other != mode.name)
                raise InputError(
                    f"{mode.entry}.next must hold names of other modes ({others}); got {name!r}."
                )
        if mode.next == () and math.isfinite(mode.every[1]):
            raise InputError(
                f"{mode.entry}.next must name a mode, since {mode.entry}.every ends; got none."
            )


class ModalEvent(Protocol):
    """What modes ask of an event."""

    @property
    def entry(self) -> str:
        """What messages call it."""

    @property
    def modes(self) -> tuple[str, ...] | None:
        """Names of the modes in which alone it happens, None for any."""

    @property
    def stamp_error(self) -> float:
        """Largest time between it and its stamp."""


def check_events_of_modes(modes: Sequence[Mode], events: Sequence[ModalEvent]) -> None:
    """InputError for an event in modes that the plant does not have, or in none."""
    names = [mode.name for mode in modes]
    for event in events:
        entry, own = f"{event.entry}.modes", event.modes or ()
        if event.modes is not None and not names:
            raise InputError(f"{entry} requires [[mode]]; there are none.")
        for k, name in enumerate(own):
            if name not in names or name in own[:k]:
                listed = ", ".join(names)
                raise InputError(f"{entry} must name modes ({listed}), once each; got {name!r}.")
        if event.modes == ():
            raise InputError(f"{entry} must name a mode; got none.")
        if names and event.stamp_error:
            raise InputError(f"{event.entry}.time_error is not available with [[mode]].")


def spans_of(modes: Sequence[Mode]) -> tuple[ModeSpan, ...]:
    """Stays and successors of all modes."""
    names = [mode.name for mode in modes]
    return tuple(
        ModeSpan(
            name=mode.name,
            every=np.array(mode.every),
            next="+".join(
                mode.next if mode.next is not None else (x for x in names if x != mode.name)
            ),
        )
        for mode in modes
    )
