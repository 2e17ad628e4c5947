"""Which Riccati equations the gains of stated weights solve: those of A + a I."""

from __future__ import annotations

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.spectrum import spectral_radius
from obsdesign.analysis.balancing import BalancedPlant
from obsdesign.analysis.hidden_modes import approx_unobservable_modes

# decay rates that are tried in turn, beyond the stated one, in parts of the plant's fastest mode
FASTER = (0.0, 1.0, 4.0)
# left between a hidden mode and a decay that is wanted, in parts of the plant's pace
_MARGIN = 1e-3


def faster_rates(A: Matrix, rate: float) -> tuple[float, ...]:
    """Decay rates, growing, for which gains of A (n, n) are tried."""
    speed = spectral_radius(A)
    return tuple(rate + factor * speed for factor in FASTER)


def riccati_shift(A: Matrix, C: Matrix, rate: float) -> float:
    """a of the equation of A + a I whose gain makes A - L C decay faster than `rate`.

    Less than the rate where an unobservable mode does not decay so fast, which leaves no solution.
    """
    plant = BalancedPlant.from_matrices(A, C)
    pace, modes = plant.pace, approx_unobservable_modes(plant.A, plant.C)
    rates = [
        mode.eigenvalue.real + rate / pace + _MARGIN * (1 + abs(mode.eigenvalue.real))
        for mode in modes
    ]
    return rate - pace * max([0.0, *rates])
