"""The matrices of one step, and of one jump, of the interval observer: enclosed, then stacked.

Derivation in `obsdesign.runtime.interval`. A `StepMap` is

    centre+ = P [centre; y; u; 1]
    radius+ = R radius + E |[centre; y; u; 1]| + g

with P in floating point, E a bound of everything P and the arithmetic may be off by, and R, g
rounded up, so that |x - centre+| <= radius+ in exact arithmetic.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from lmi.enclosure import UNIT, Enclosure, Matrix, expm, raised, stack
from obsdesign.equations import interval as equations

exactly = Enclosure.exactly


@dataclass(frozen=True, slots=True)
class StepMap:
    """P: (n, n + p + m + 1) or without y; radius_map = [R, E, g] acting on [radius; |v|; 1]."""

    centre_map: Matrix
    radius_map: Matrix
    measured: bool

    def apply(
        self, centre: Matrix, radius: Matrix, y: Matrix | None, u: Matrix
    ) -> tuple[Matrix, Matrix]:
        """Centre and radius after the step, for inputs held over it; y if the map uses one."""
        parts = (centre, y, u, _ONE) if self.measured else (centre, u, _ONE)
        known = np.concatenate(parts)  # type: ignore[arg-type]
        with np.errstate(over="ignore", invalid="ignore"):
            moved = self.centre_map @ known
            spread = self.radius_map @ np.concatenate((radius, np.abs(known)))
        return moved, spread


_ONE = np.ones(1)
_ONE.setflags(write=False)


def midpoint(lower: Matrix, upper: Matrix) -> tuple[Matrix, Matrix]:
    """Centre and radius of a box; the radius is rounded up so that the box is contained."""
    centre = lower + (0.5 * upper - 0.5 * lower)
    radius = np.maximum(upper - centre, centre - lower)
    return centre, np.where(lower == upper, 0.0, np.nextafter(radius, np.inf))


def step_maps(gains: Mapping[str, Any], h: float, h_error: float) -> dict[str, StepMap]:
    """Maps over a step of length h +- h_error: with y at its start, at its end, or without.

    Overflow shows as infinite radii, not as warnings.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        return _step_maps(gains, h, h_error)


def _step_maps(gains: Mapping[str, Any], h: float, h_error: float) -> dict[str, StepMap]:
    A, C, L = (exactly(gains[name]) for name in ("A", "C", "L"))
    b_mid, b_rad = midpoint(gains["flow_lower"], gains["flow_upper"])
    F = A - L @ C
    inputs = gains.get("B", np.zeros((len(b_mid), 0)))
    Phi, forced = _driven(A, exactly(np.column_stack([inputs, b_mid])), h, h_error)
    K = _driven(F, L, h, h_error)[1]
    outer = exactly(np.eye(len(b_mid))) - K @ C
    spread = _spread(gains, F, b_rad, h, h_error)
    return {
        "start": _map([Phi - K @ C, K, forced], *spread["start"]),
        "end": _map([outer @ Phi, K, outer @ forced], *spread["end"]),
        "none": _map([Phi, forced], *spread["none"], measured=False),
    }


def jump_maps(gains: Mapping[str, Any]) -> dict[bool, StepMap]:
    """Maps over a jump: with its measurement (True) and without one (False)."""
    G, M, C, V = (gains[name] for name in ("G", "M", "C", "noise_bound"))
    n, when = len(G), gains["jump_measurement"]
    c_mid, c_rad = midpoint(gains["jump_lower"], gains["jump_upper"])
    known = exactly(np.column_stack([gains.get("E", np.zeros((n, 0))), c_mid]))
    plain = _map([exactly(G), known], np.abs(G), np.abs(c_rad), measured=False)
    if when == "none":
        return {False: plain, True: plain}
    through = exactly(np.eye(n))
    H = exactly(G) - exactly(M) @ exactly(C)
    if when == "after":
        through = through - exactly(M) @ exactly(C)
        H = through @ exactly(G)
    N = _completed(H, gains["Gp"], gains["Gn"])
    noise = raised(np.abs(M) @ V + through.magnitude @ c_rad, 2 * (n + len(V)))
    return {False: plain, True: _map([H, exactly(M), through @ known], N, noise)}


def width_matrix(gains: Mapping[str, Any], F: Enclosure) -> Matrix:
    """Upper bound of W = D0 + D1 for the exact F."""
    return _completed(F, gains["D0"], gains["D1"])


def _completed(X: Enclosure, plus: Matrix, minus: Matrix) -> Matrix:
    """Upper bound of plus + minus + |plus - minus - X|: `equations.completed_split`, summed."""
    remainder = (exactly(plus) - exactly(minus) - X).magnitude
    return raised_signed((exactly(plus) + exactly(minus)).upper + remainder)


def raised_signed(values: Matrix) -> Matrix:
    """An upper bound where the last addition was rounded, for entries of any sign."""
    return np.nextafter(values, np.inf)


def _driven(A: Enclosure, B: Enclosure, h: float, error: float) -> tuple[Enclosure, Enclosure]:
    """e^{A h} and int_0^h e^{A s} ds B, from one block exponential."""
    n, m = B.mid.shape
    rows = [[A, B], [exactly(np.zeros((m, n))), exactly(np.zeros((m, m)))]]
    whole = expm(stack(rows).scaled(h, error))
    return _block(whole, slice(n), slice(n)), _block(whole, slice(n), slice(n, n + m))


def _block(whole: Enclosure, rows: slice, columns: slice) -> Enclosure:
    return Enclosure(whole.mid[rows, columns], whole.rad[rows, columns])


def _spread(
    gains: Mapping[str, Any], F: Enclosure, b_rad: Matrix, h: float, h_error: float
) -> dict[str, tuple[Matrix, Matrix]]:
    """(R, g) of the three maps, from the comparison system [q; rho; sig; 1; 1]."""
    A, C, L, V = (gains[name] for name in ("A", "C", "L", "noise_bound"))
    n, p = len(A), len(C)
    noise = raised(np.abs(L) @ V + b_rad, 2 * p)
    slope, drift = (exactly(C) @ exactly(A)).magnitude, raised(np.abs(C) @ b_rad, 2 * n)
    q, rho, sig = slice(n), slice(n, 2 * n), slice(2 * n, 2 * n + p)
    system = np.zeros((2 * n + p + 2, 2 * n + p + 2))
    system[q, q], system[q, sig], system[q, -2] = width_matrix(gains, F), np.abs(L), noise
    system[rho, rho], system[rho, -1] = equations.absolute_metzler(A), b_rad
    system[sig, rho], system[sig, -1] = slope, drift
    whole = expm(exactly(system).scaled(h, h_error))
    part = {
        name: _block(whole, rows, columns)
        for name, rows, columns in (
            ("qq", q, q), ("q_rho", q, rho), ("q_sig", q, sig), ("q_1", q, slice(-2, -1)),
            ("q_2", q, slice(-1, None)), ("rho", rho, rho), ("rho_2", rho, slice(-1, None)),
            ("sig_rho", sig, rho), ("sig_2", sig, slice(-1, None)),
        )
    }  # fmt: skip
    return {
        "start": _bounds(part["qq"] + part["q_rho"], part["q_1"] + part["q_2"]),
        "end": _bounds(
            part["qq"] + (part["q_sig"] @ part["sig_rho"] - part["q_rho"]),
            part["q_1"] + (part["q_sig"] @ part["sig_2"] - part["q_2"]),
        ),
        "none": _bounds(part["rho"], part["rho_2"]),
    }


def _bounds(R: Enclosure, g: Enclosure) -> tuple[Matrix, Matrix]:
    """Upper bounds; both are nonnegative in exact arithmetic."""
    return np.maximum(R.upper, 0.0), np.maximum(g.upper, 0.0).reshape(-1)


def _map(parts: list[Enclosure], R: Matrix, g: Matrix, measured: bool = True) -> StepMap:
    """Stack [m; y; u; 1] columns; the last column of the last part multiplies the constant."""
    whole = stack([parts])
    terms = whole.mid.shape[1] + 2
    error = raised(whole.rad + terms * UNIT * np.abs(whole.mid), 4)
    error[:, -1] = raised(error[:, -1] + g, 1)
    radius_map = raised(np.hstack([R, error]), 2 * (len(R) + terms))
    for array in (whole.mid, radius_map):
        array.setflags(write=False)
    return StepMap(whole.mid, radius_map, measured)
