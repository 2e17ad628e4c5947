"""Error bounds of observer (14) with given gains: Theorem 1's constants, and the error identity.

Source: F. Mazenc, S. Ahmed, MICNON 2018, Theorem 1 with the errata of docs/papers.md. Everything
is enclosed in balls, whose exponents do not overflow.

The identity needs no condition on the period:

    xhat(t_i) - x(t_i) = M_T^{-1} int e^{F (t_i - T - m)} mu(m) x(m) dm,
    mu(m) = L C (e^{A (phi(m) - m)} - I),

so that |error| <= factor * max |x| over the window, factor = int_0^T |M_T^{-1} e^{-F tau} mu| dtau.

The error of observer (14), exactly, and the factor on max |x| that bounds it for any period.

xhat(t_i) - x(t_i) = M_T^{-1} int e^{F (t_i - T - m)} mu(m) x(m) dm
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from lmi.arithmetic.balls import entries, exact, identity, number, rational, scalar, solve_entries
from lmi.arithmetic.norms import float_above, float_below, spectral_norm
from lmi.verdict import proved
from obsdesign.analysis.finite_time.enclosed_gains import (
    Sampled,
    difference_matrix,
    exponential,
    gain_scale,
)
from obsdesign.document import Claim
from obsdesign.equations.finite_time import condition_13 as equations

# pieces of the error integral: their number decides how far the bound is above the factor
_PIECES, _FEWEST = 1920, 2


def identity_claim(factor: float) -> Claim:
    """A bound without (13), for a finite factor."""
    verdict = proved(factor=factor)
    return Claim(
        "error_identity",
        "|xhat - x| <= factor times the largest |x| in the window, without disturbance and noise; "
        "for any period",
        f"{PAPER}, (14): exact error, docs/finite_time.md",
        verdict.outcome,
        verdict.evidence,
    )


def error_factor(sampled: Sampled, L: Any, inverse: Any) -> Any:
    """Ball above int_0^T |M_T^{-1} e^{-F tau} mu(tau)| dtau, spectral norm.

    Over a piece of length h the integrand is below the straight line between its end values plus
    h^2/8 max |f''|, so that the integral is below h (|f_0| + |f_1|)/2 + h^3/12 max |f''|.
    """
    LC, n = exact(L) @ sampled.C, len(sampled.A)
    F = sampled.A + LC
    m = max(_FEWEST, _PIECES // sampled.k)
    part, unit = rational(1.0) / m, entries(identity(n))
    step_F = exponential(-F * part, sampled.period)
    step_A = exponential(-sampled.A * part, sampled.period)
    h = scalar(rational(sampled.period) * part)
    seen = [0 * unit]  # L C (e^{-A s} - I) at the ends of the pieces of one period
    moved = unit
    for _ in range(m):
        moved = moved @ step_A
        seen.append(LC @ (moved - unit))
    f, a, c = (_frobenius(X) for X in (F, sampled.A, LC))
    grown = np.exp(a * scalar(rational(sampled.period)))
    bend = np.exp(f * h) * c * ((f * f + 2 * f * a + a * a) * grown)
    total, weight = scalar(0), inverse
    for _ in range(sampled.k):
        start = scalar(0)
        for j in range(m):
            curved = _frobenius(weight) * bend
            weight = weight @ step_F
            end = spectral_norm(weight @ seen[j + 1])
            total = total + h * (start + end) / 2 + h * h * h * curved / 12
            start = end
    return total


def _frobenius(X: Any) -> Any:
    return scalar(sum(x * x for x in X.flat)).sqrt()


PAPER = "Mazenc, Ahmed, MICNON 2018"


@dataclass(frozen=True)
class Sizes:
    """Norms that Theorem 1 is made of, as balls: a = |e^{-F T}|, m = |M_T^{-1}|, f = |F|."""

    a: Any
    m: Any
    f: Any
    size_A: Any
    size_LC: Any
    T: Any
    inverse: Any

    @staticmethod
    def of(sampled: Sampled, L: Any, S: Any = None) -> Sizes | None:
        """None if M_T is not certainly invertible. S: in coordinates S x, hence for |S x|."""
        M, back = difference_matrix(sampled, L)
        inverse = solve_entries(M, entries(identity(len(M))))
        if inverse is None:
            return None
        inverse = inverse / gain_scale(sampled, L)
        LC = exact(L) @ sampled.C
        matrices = [_balls(X) for X in (sampled.A + LC, sampled.A, LC)]
        if S is not None:
            back_S = solve_entries(_balls(exact(S)), entries(identity(len(M))))
            if back_S is None:
                return None
            inverse, back = (exact(S) @ X @ back_S for X in (inverse, back))
            matrices = [exact(S) @ X @ back_S for X in matrices]
        f, size_A, size_LC = (spectral_norm(X) for X in matrices)
        T = scalar(rational(sampled.period) * sampled.k)
        a, m = spectral_norm(back), spectral_norm(inverse)
        return Sizes(a, m, f, size_A, size_LC, T, inverse)

    def constants(self, period: float, tighter: bool = False) -> equations.Constants:
        """(10)-(13) for a period (T stays); tighter: with `tighter_sigma` in place of Sigma."""
        s = self.size_LC * np.expm1(number(period) * self.size_A)
        sigma = equations.tighter_sigma if tighter else equations.sigma
        return equations.constants(self.a, self.m, sigma(self.T, self.f, s))

    def longest_period(self, tighter: bool = False) -> Any:
        """Ball around the period below which (13) holds; None if A = 0: it always does."""
        if not self.size_A > 0:
            return None
        sizes = (self.size_A, self.size_LC)
        if tighter:
            return equations.enclosed_tighter_period(self.a, self.m, self.f, sizes, self.T)
        return equations.enclosed_longest_period(self.a, self.m, self.f, sizes, self.T)

    def condition(self, period: float, tighter: bool = False) -> bool | None:
        """(13) at a period: certainly true, certainly false, or None."""
        s = self.size_LC * np.expm1(number(period) * self.size_A)
        if s == 0:
            return True
        room = np.log(equations.largest_sigma(self.a, self.m))
        log_of = equations.log_tighter_sigma if tighter else equations.log_sigma
        log_sigma = log_of(self.T, self.f, s)
        if log_sigma < room:
            return True
        return False if log_sigma > room else None


def bound_claims(sampled: Sampled, gains: Mapping[str, Any], S: Any = None) -> Iterator[Claim]:
    """Theorem 1's numbers where M_T is invertible; for (14), the factor of the error identity.

    S, (n, n): coordinates of a certificate, for the same numbers in the norm |S x|.
    """
    sizes = Sizes.of(sampled, gains["L"])
    if sizes is None:
        return
    yield _numbers(sizes, sampled.period)
    yield _tighter(sizes, sampled.period)
    moved = None if S is None else Sizes.of(sampled, gains["L"], S)
    if moved is not None:
        yield _in_coordinates(moved, sampled.period, S)
    if gains["method"] == "approximate" and gains["half_sample"] == "printed":
        # nothing is said where the bound is beyond any number: no hypothesis, only a promise
        factor = float_above(error_factor(sampled, gains["L"], sizes.inverse))
        if np.isfinite(factor):
            yield identity_claim(factor)


def _numbers(sizes: Sizes, period: float) -> Claim:
    """The constants, as intervals of floats; not a hypothesis of anything but Theorem 1."""
    verdict = proved(**_constants(sizes, period))
    return Claim(
        "theorem_1_numbers",
        "the constants of (10)-(13) lie in the stated intervals; (13) is true, false or open as "
        "stated",
        f"{PAPER}, Theorem 1, (10)-(13), as corrected",
        verdict.outcome,
        verdict.evidence,
    )


def _tighter(sizes: Sizes, period: float) -> Claim:
    """The same with a tighter Lemma 2, which is no part of the paper's (13)."""
    verdict = proved(**_constants(sizes, period, tighter=True))
    return Claim(
        "theorem_1_tighter",
        "with e^(|F| T) (e^(s T) - 1), s = |L C| (e^(|A| nu) - 1), in place of Sigma, the "
        "constants of (10)-(13) lie in the stated intervals; (13) is true, false or open as stated",
        f"{PAPER}, Theorem 1, as corrected, with the Dyson series in place of Lemma 2",
        verdict.outcome,
        verdict.evidence,
    )


def _in_coordinates(sizes: Sizes, period: float, S: Any) -> Claim:
    """The same for S A S^-1, C S^-1, S L: Theorem 1 then speaks of |S x|."""
    back: Any = solve_entries(_balls(exact(S)), entries(identity(len(S))))
    verdict = proved(**_constants(sizes, period), S=S, norm_of_back=_interval(spectral_norm(back)))
    return Claim(
        "theorem_1_coordinates",
        "in the coordinates S x the constants of (10)-(13) lie in the stated intervals, |S^-1| in "
        "norm_of_back; (13) is true, false or open as stated",
        f"{PAPER}, Theorem 1, (10)-(13), as corrected, for S A S^-1, C S^-1, S L",
        verdict.outcome,
        verdict.evidence,
    )


def _constants(sizes: Sizes, period: float, tighter: bool = False) -> dict[str, Any]:
    found, holds = sizes.constants(period, tighter), sizes.condition(period, tighter)
    longest = sizes.longest_period(tighter)
    words: dict[bool | None, str] = {True: "true", False: "false", None: "open"}
    evidence: dict[str, Any] = {"condition_13": words[holds]}
    evidence["longest_period"] = "inf" if longest is None else float_below(longest)
    evidence |= {"norm_of_exp": _interval(sizes.a), "norm_of_inverse": _interval(sizes.m)}
    names = ("sigma", "gbar", "alpha", "beta", "gamma", "first", "second")
    shown = names if holds else ("sigma", "first")
    evidence |= {name: _interval(getattr(found, name)) for name in shown}
    return evidence


def _interval(x: Any) -> list[float]:
    return [float_below(x), float_above(x)]


def _balls(X: Any) -> Any:
    values = np.empty(X.size, dtype=object)
    values[:] = [scalar(x) for x in X.flat]
    return values.reshape(X.shape)
