"""Exact decisions on gains and spectra: a norm, a half plane, a disc, a sector.

Source of the regions: M. Chilali and P. Gahinet, H-infinity design with pole placement constraints,
IEEE Trans. Automatic Control 41 (1996); each is decided by Routh's test on an exact matrix.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from lmi.arithmetic.balls import (
    Exact,
    characteristic_polynomial,
    exact,
    number,
    precision,
    rational,
    to_float,
)
from lmi.prove.hurwitz import exactly_schur, prove_hurwitz
from lmi.verdict import Verdict, proved, refuted, undecided

_BITS = 128


def prove_norm(X: Exact, bound: float) -> Verdict:
    """Decide whether the spectral norm of X (n, p) is at most `bound`.

    S = bound^2 I - X'X is positive semidefinite if and only if the coefficients of det(s I + S) are
    not negative: S is symmetric, so that its eigenvalues are real.
    """
    limit, gram = rational(bound) ** 2, X.T @ X
    missing = exact(np.eye(len(gram))) * limit - gram
    if all(coefficient >= 0 for coefficient in characteristic_polynomial(-missing)):
        return proved(approx_norm=float(np.linalg.norm(to_float(X), 2)))
    # rounding cannot spoil a direction that is clearly enlarged; where it does, the matrix decides
    direction = np.linalg.svd(to_float(X))[2][0]
    v = exact(direction)
    norm = float(np.linalg.norm(to_float(X), 2))
    reason = f"the spectral norm is {norm:.9g}, more than {bound!r}"
    witness = {"approx_norm": norm, "reason": reason}
    if v @ gram @ v > limit * (v @ v):
        return refuted({**witness, "direction": direction.tolist()})
    return refuted({**witness, "method": "exact characteristic polynomial"})


def prove_half_plane(F: Exact, decay: float) -> Verdict:
    """Decide whether every eigenvalue of F has a real part below -decay."""
    shifted = F + exact(np.eye(len(F))) * rational(decay)
    if prove_hurwitz(shifted).outcome == "proved":
        return proved(**_spectrum(F))
    return _outside(F, f"has a real part of at least {-decay + 0.0!r}", lambda z: z.real)


def prove_disc(F: Exact, centre: float, radius: float) -> Verdict:
    """Decide whether every eigenvalue of F lies strictly inside a disc around a real centre."""
    unit = exact(np.eye(len(F)))
    if exactly_schur((F - unit * rational(centre)) * (1 / rational(radius))):
        return proved(**_spectrum(F))
    where = f"is outside the disc of radius {radius!r} around {centre!r}"
    return _outside(F, where, lambda z: abs(z - centre))


def prove_sector(F: Exact, half_angle: float) -> Verdict:
    """Decide whether every eigenvalue of F lies within an angle of the negative real axis.

    half_angle: radians, in (0, pi/2). That is [[F, c F], [-c F, F]] Hurwitz, c its cotangent, which
    lies between two neighbouring floats.
    """
    with precision(_BITS):
        cotangent = number(half_angle).cot()
        low = math.nextafter(float(cotangent.lower()), 0.0)
        high = math.nextafter(float(cotangent.upper()), math.inf)
    if prove_hurwitz(_rotated(F, high)).outcome == "proved":
        return proved(**_spectrum(F))
    if prove_hurwitz(_rotated(F, low)).outcome == "proved":
        return undecided("an eigenvalue is too close to the border of the sector", **_spectrum(F))
    where = f"is more than {half_angle!r} rad from the negative real axis"
    return _outside(F, where, lambda z: abs(math.atan2(z.imag, -z.real)))


def _rotated(F: Exact, cotangent: float) -> Exact:
    turned = F * rational(cotangent)
    return np.block([[F, turned], [-turned, F]])


def _spectrum(F: Exact) -> dict[str, list[list[float]]]:
    """Eigenvalues in floats, [real, imaginary], rightmost first."""
    values = np.linalg.eigvals(to_float(F))
    order = sorted(values.tolist(), key=lambda z: (-z.real, z.imag))
    return {"approx_eigenvalues": [[complex(z).real, complex(z).imag] for z in order]}


def _outside(F: Exact, where: str, distance: Callable[[complex], float]) -> Verdict:
    """Refuted, with the eigenvalue that is farthest out in floats."""
    values = [complex(z) for z in np.linalg.eigvals(to_float(F))]
    worst = max(values, key=distance)
    sign = f" +- {abs(worst.imag):.6g}i" if worst.imag else ""
    return refuted(
        {
            "approx_eigenvalue": {"real": worst.real, "imag": abs(worst.imag)},
            "reason": f"the eigenvalue {worst.real:.6g}{sign} {where}",
        }
    )
