"""Gains L for e' = (A - L C) e: by Riccati equation, or with poles at given places."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import (
    Exact,
    ball,
    entries,
    exact,
    number,
    precision,
    solve_entries,
    to_float,
)
from obsdesign.analysis.balancing import BalancedPlant, balancing_units
from obsdesign.analysis.hidden_modes import Mode, approx_unobservable_modes, hidden_part
from obsdesign.analysis.riccati import riccati_shift
from obsdesign.analysis.stated_poles import (
    LARGEST_GAP,
    ROUNDING,
    TOLERANCE,
    complex_text,
    gap,
    real_factors,
    with_conjugates,
)
from obsdesign.entries import LARGEST
from obsdesign.errors import InputError
from obsdesign.problem.options import Pole

# bits that an ill-conditioned plant may need, raised in turn
_PRECISIONS = (256, 1024, 4096, 16384)
# widths of an entry of L: relative to itself, and to the largest entry
_NARROW, _ZERO = 2.0**-60, 2.0**-110


def riccati_gain(
    A: Matrix, C: Matrix, weights: Mapping[str, Sequence[float]] | None = None, rate: float = 0.0,
    *, pace: float = 1.0,
) -> Matrix:  # fmt: skip
    """Steady-state Kalman gain, (n, p), of A + rate I.

    weights: {"state": n, "output": p} positive variances of process and measurement noise; by
    default ones, in `BalancedPlant`; pace: then of an A without cycles. Unobservable modes that do
    not decay at `rate` are left as they are; all others of A - L C then decay faster than `rate`.
    numpy.linalg.LinAlgError if the equation has no finite solution in floats.
    """
    n, p = len(A), len(C)
    if not weights:
        plant = BalancedPlant.from_matrices(A, C, own_pace=pace)
        faster = 1.0 + rate / plant.pace
        unit_weights = {"state": [1.0] * n, "output": [1.0] * p}
        L = riccati_gain(plant.A / faster, plant.C, unit_weights, rate / plant.pace / faster)
        return plant.flow_gain(faster * L)
    state = np.array(weights.get("state", [1.0] * n))
    deviations = np.sqrt(np.array(weights.get("output", [1.0] * p)))
    shifted = A + riccati_shift(A, C, rate) * np.eye(n)
    with np.errstate(all="ignore"):  # overflow in there shows in the result
        L = kalman_gain(shifted, C / deviations[:, None], np.diag(state)) / deviations
    return np.asarray(L, dtype=np.float64)


def kalman_gain(A: Matrix, C: Matrix, W: Matrix) -> Matrix:
    """L = S C', (n, p), with A S + S A' - S C'C S + W = 0, in units that balance all its terms.

    W (n, n): covariance of the process noise, that of the outputs is the identity.
    numpy.linalg.LinAlgError where floats hold no solution.
    """
    from scipy.linalg import solve_continuous_are

    n, p = len(A), len(C)
    sizes, pace = balancing_units(A, C, np.zeros((n, 0)))
    flow, output = A * sizes / sizes[:, None] / pace, C * sizes
    noise = W / sizes / sizes[:, None] / pace
    # S = unit D S_z D makes the quadratic term and the noise of one size
    unit = np.sqrt(np.abs(noise).max() * pace) / (np.linalg.norm(output, 2) or 1.0)
    scaled = output * np.sqrt(unit / pace)
    try:
        S = solve_continuous_are(flow.T, scaled.T, noise / unit, np.eye(p))
    except ValueError as error:  # of floats that overflow or do not resolve the equation
        raise np.linalg.LinAlgError(str(error)) from None
    L: Matrix = unit * sizes[:, None] * (S @ output.T)
    if not np.isfinite(L).all():
        raise np.linalg.LinAlgError("the Riccati equation has no finite solution in floats")
    return L


def no_kalman_gain(gain: str) -> InputError:
    """What to say where no gain of stated weights is known."""
    return InputError(
        f"observer.weights: the Riccati equation for {gain} has no finite solution in floats; is "
        "some state hardly observable, or are the weights of very different sizes?"
    )


def placed_gain(A: Matrix, C: Matrix, poles: Sequence[Pole]) -> Matrix:
    """L, (n, p), with the eigenvalues of A - L C at `poles`: numbers or pairs [real, imaginary].

    With one output there is one such L, computed in balls and rounded once. With several a robust
    one is chosen in floats, in units that balance the plant, and then corrected likewise; without
    a robust one, they are combined into one. InputError when the number of poles is wrong, a
    complex one lacks its conjugate, a mode is unobservable (no gain moves its eigenvalue), or
    rounding L to floats leaves the poles elsewhere.
    """
    wanted = with_conjugates(poles)
    _refuse_unplaceable(A, C, len(wanted))
    plant = _Placement(A, C, poles)
    L, miss = None, math.inf
    for other, enough in plant.gains(wanted):
        distance = plant.miss(other)
        if L is None or distance < miss:
            L, miss = other, distance
        if miss <= enough:
            break
    if L is None:
        raise InputError(
            "observer.poles cannot be placed: floats do not resolve how output.C sees the plant; "
            "are the units right?"
        )
    if not np.abs(L).max() <= LARGEST:
        raise InputError(
            f"observer.poles need a gain with an entry of {np.abs(L).max():.3g}, and at most "
            f"{LARGEST:g} is admissible: poles nearer to those of flow.A, or another unit of time."
        )
    if miss > LARGEST_GAP:
        raise InputError(
            f"observer.poles cannot be placed: rounding the gain to floats moves a coefficient of "
            f"their polynomial by {miss:.2g} times its size, and at most {LARGEST_GAP:g} counts as "
            f"placed; {plant.likely_cause()}."
        )
    return L


def _refuse_unplaceable(A: Matrix, C: Matrix, count: int) -> None:
    """InputError where this is not the number of poles, or a mode of A is exactly unobservable."""
    if count != len(A):
        raise InputError(
            f"observer.poles must give {len(A)} poles, one per state (a pair [re, im] counts with "
            f"its conjugate); got {count}."
        )
    hidden = hidden_part([A], C)
    if hidden is None:
        return
    modes = np.linalg.eigvals(to_float(hidden.maps[0])).tolist()
    mode = complex_text(max(modes, key=lambda value: float(value.real)))
    raise InputError(
        f"observer.poles: the mode {mode} of flow.A cannot be moved, since output.C does not see "
        "it; leave poles out."
    )


@dataclass(frozen=True)
class _Placement:
    """A plant A (n, n), C (p, n), poles to place, and the plant in balanced units."""

    A: Matrix
    C: Matrix
    poles: Sequence[Pole]

    @cached_property
    def balanced(self) -> BalancedPlant:
        """The plant in the units that robust gains and hidden modes are computed in."""
        return BalancedPlant.from_matrices(self.A, self.C)

    def gains(self, wanted: NDArray[np.complex128]) -> Iterator[tuple[Matrix, float]]:
        """Yield gains in order of preference, and with each the `miss` that needs no other one.

        wanted (n,): the poles. A repeated one and a flow with several eigenvectors to an eigenvalue
        need the last of them: no combination of the outputs sees that flow A, but one sees
        A - L0 C for every L0 outside a set of measure zero (Heymann's lemma).
        """
        starts = [np.zeros((len(self.A), len(self.C)))]
        if len(self.C) > 1:
            plant, random = self.balanced, np.random.default_rng(0)
            robust = None if self.hidden else robust_gain(plant.A, plant.C, wanted / plant.pace)
            if robust is not None:
                starts.insert(0, plant.flow_gain(robust))
                yield starts[0], ROUNDING
            starts.append(plant.flow_gain(random.uniform(-1.0, 1.0, starts[0].shape)))
        for start in starts:
            L = self.corrected(start)
            if L is not None:
                yield L, TOLERANCE

    @cached_property
    def hidden(self) -> list[Mode]:
        """Modes that are unobservable, or nearly."""
        return approx_unobservable_modes(self.balanced.A, self.balanced.C)

    def corrected(self, L: Matrix) -> Matrix | None:
        """L + l w' with the poles exactly but for rounding, w' C one output; None: unobservable."""
        w = np.exp2(-np.arange(len(self.C)) / 2)
        if len(w) > 1:  # the gain of one output is rounded once
            w = w / self.balanced.rows
        flow = exact(self.A) - exact(L) @ exact(self.C)
        column = _unique_gain(flow, exact(w[None]) @ exact(self.C), self.poles, self.balanced.sizes)
        return None if column is None else L + column * w

    def miss(self, L: Matrix) -> float:
        """How far A - L C is from the poles, as `gap` measures it; inf where L is inadmissible."""
        if not np.abs(L).max() <= LARGEST:
            return math.inf
        flow = exact(self.A)
        return gap(flow - exact(L) @ exact(self.C), self.poles, flow=flow).relative

    def likely_cause(self) -> str:
        """Why rounding a gain takes the poles elsewhere, and what may help."""
        if self.hidden:
            mode, margin = self.hidden[0].eigenvalue * self.balanced.pace, self.hidden[0].margin
            text = f"output.C hardly sees the mode {complex_text(mode)} of flow.A"
            return f"{text} (relative {margin:.2g}): leave poles out"
        return "the poles are far from those of flow.A, or output.C hardly sees some mode of it"


def _unique_gain(A: Exact, c: Exact, poles: Sequence[Pole], sizes: Matrix) -> Matrix | None:
    """L (n, 1) for one output c (1, n), by Ackermann's formula p(A) O^-1 e_n.

    p: the polynomial of the poles, O: the observability matrix. In balls, until every entry is
    known beyond binary64, against the others in the sizes of the states; None where no precision
    shows that (A, c) is observable.
    """
    n, factors = len(A), real_factors(poles)
    usual = _usual_gain(to_float(A), to_float(c), sizes)
    for bits in _PRECISIONS:
        with precision(bits):
            flow, rows = entries(ball(A)), [entries(ball(c))[0]]
            for _ in range(n - 1):
                rows.append(rows[-1] @ flow)
            last = exact(np.eye(n)[:, -1:])
            column = solve_entries(np.array(rows), last)
            if column is None:
                continue
            for factor in factors:
                powers = [column]
                for _ in factor[1:]:
                    powers.append(flow @ powers[-1])
                column = sum(k * power for k, power in zip(factor, powers, strict=True))
            L = _rounded(column, sizes, usual)
        if L is not None:
            return L
    return None


def _usual_gain(A: Matrix, c: Matrix, sizes: Matrix) -> float:
    """What changes A (n, n) by its own size, in the sizes of the states; 0 without an output."""
    output = float(np.abs(c * sizes).max())
    return float(np.abs(A * sizes / sizes[:, None]).max()) / output if output else 0.0


def _rounded(column: Exact, sizes: Matrix, usual: float) -> Matrix | None:
    """Nearest floats of balls (n, 1); None unless all are narrow, against zero in the sizes.

    usual: size of a gain in the sizes of the states.
    """
    balls = column[:, 0].tolist()
    largest = max(abs(x.mid()) / number(size) for x, size in zip(balls, sizes, strict=True))
    largest = max(largest, number(usual))
    for x, size in zip(balls, sizes.tolist(), strict=True):
        if not x.rad() <= max(abs(x.mid()) * _NARROW, largest * number(size) * _ZERO):
            return None
    middles = [float(x.mid()) if abs(x.mid()) > x.rad() else 0.0 for x in balls]
    return np.array(middles, dtype=np.float64)[:, None]


def robust_gain(
    A: Matrix, C: Matrix, poles: NDArray[np.inexact], rtol: float = 1e-3
) -> Matrix | None:
    """L (n, p) with A - L C of about these poles, robust to changes of A and C; None elsewhere.

    The method wants independent outputs, and no pole more often than there are outputs.
    """
    from scipy.signal import place_poles  # slow to import, and rarely needed

    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")  # of poles that are missed: who needs them exactly looks
        try:
            L: Matrix = place_poles(A.T, C.T, poles, rtol=rtol).gain_matrix.T
        except (ValueError, np.linalg.LinAlgError):
            return None
    return np.asarray(L, dtype=np.float64) if np.isfinite(L).all() else None
