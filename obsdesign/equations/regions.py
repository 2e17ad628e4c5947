"""Regions of eigenvalues as matrix inequalities.

PF = P F is affine in P and the product of P with the gain: P A - Z C for the flow, P G - Z output
at jumps. If one of these holds with P > 0, the eigenvalues of F lie in the region.
Source: M. Chilali and P. Gahinet, IEEE Trans. Automatic Control 41 (1996), Theorem 2.2, for F'.
"""

from __future__ import annotations

import math

import numpy as np

from lmi.arithmetic.arrays import Array


def half_plane_inequality(PF: Array, P: Array, decay: float) -> Array:
    """-(P F + F'P) - 2 decay P > 0, (n, n): real parts below -decay."""
    return -(PF + PF.T) - 2 * decay * P


def disc_inequality(PF: Array, P: Array, centre: float, radius: float) -> Array:
    """[[P, (P F - centre P)'/radius], [*, P]] > 0, (2n, 2n): |s - centre| < radius."""
    away = (PF - centre * P) / radius
    return np.block([[P, away.T], [away, P]])


def sector_inequality(PF: Array, half_angle: float) -> Array:
    """Within half_angle of the negative real axis, (2n, 2n).

    -[[sin (P F + F'P), cos (P F - F'P)], [cos (F'P - P F), sin (P F + F'P)]] > 0.
    """
    sine, cosine = math.sin(half_angle), math.cos(half_angle)
    even, odd = sine * (PF + PF.T), cosine * (PF - PF.T)
    return -np.block([[even, odd], [-odd, even]])
