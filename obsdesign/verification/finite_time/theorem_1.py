"""Error bounds of observer (14): constants of Theorem 1, and the error identity.

Source: F. Mazenc, S. Ahmed, MICNON 2018, Theorem 1 with the errata of docs/papers.md. Everything
is enclosed in balls, whose exponents do not overflow.

The identity needs no condition on the period:

    xhat(t_i) - x(t_i) = M_T^{-1} int e^{F (t_i - T - m)} mu(m) x(m) dm,
    mu(m) = L C (e^{A (phi(m) - m)} - I),

so that |error| <= factor * max |x| over the window, factor = int_0^T |M_T^{-1} e^{-F tau} mu| dtau.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import (
    Ball,
    Exact,
    entries,
    exact,
    identity,
    number,
    rational,
    scalar,
    solve_entries,
)
from lmi.arithmetic.norms import float_above, float_below, spectral_norm
from lmi.verdict import proved, undecided
from obsdesign.analysis.finite_time.enclosed_gains import (
    Sampled,
    difference_matrix,
    exponential,
    frobenius,
    gain_scale,
)
from obsdesign.document import Claim
from obsdesign.equations.finite_time import condition_13 as equations
from obsdesign.equations.finite_time.gains import PRINTED, FiniteTimeGains
from obsdesign.verification.finite_time.evidence import Interval, TheoremEvidence
from obsdesign.verification.finite_time.window import PAPER

_CONDITION_13 = f"{PAPER}, Theorem 1, (13)"
# verdicts on (13) as design files state them
_WORDS = {"proved": "true", "refuted": "false", "undecided": "open"}
# pieces of the error integral: more of them bring the bound closer to the factor
_PIECES, _FEWEST = 1920, 2


def identity_claim(factor: float) -> Claim:
    """Claim of a bound without (13), for a finite factor."""
    return Claim.from_verdict(
        "error_identity",
        "|xhat - x| <= factor times the largest |x| in the window, without disturbance and noise; "
        "for any period",
        f"{PAPER}, (14): exact error, docs/finite_time.md",
        proved(factor=factor),
    )


def error_factor(sampled: Sampled, L: Matrix, inverse: Exact) -> Ball:
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
    mu = [0 * unit]  # L C (e^{-A s} - I) at the ends of the pieces of one period
    back = unit
    for _ in range(m):
        back = back @ step_A
        mu.append(LC @ (back - unit))
    f, a, c = (frobenius(X) for X in (F, sampled.A, LC))
    grown = (a * scalar(rational(sampled.period))).exp()
    bend = (f * h).exp() * c * ((f * f + 2 * f * a + a * a) * grown)
    total, weight = scalar(0), inverse
    for _ in range(sampled.k):
        start = scalar(0)
        for j in range(m):
            curved = frobenius(weight) * bend
            weight = weight @ step_F
            end = spectral_norm(weight @ mu[j + 1])
            total = total + h * (start + end) / 2 + h * h * h * curved / 12
            start = end
    return total


@dataclass(frozen=True)
class Norms:
    """Norms in Theorem 1 as balls: a = |e^{-F T}|, m = |M_T^{-1}|, f = |F|.

    size_back: |S^-1| in coordinates S x.
    """

    a: Ball
    m: Ball
    f: Ball
    size_A: Ball
    size_LC: Ball
    T: Ball
    inverse: Exact
    size_back: Ball | None = None

    @classmethod
    def from_sampled(cls, sampled: Sampled, L: Matrix, S: Matrix | None = None) -> Norms | None:
        """Norms for L; None if M_T is not certainly invertible. S: in coordinates S x."""
        M, back = difference_matrix(sampled, L)
        inverse = solve_entries(M, entries(identity(len(M))))
        if inverse is None:
            return None
        inverse = inverse / gain_scale(sampled, L)
        LC = exact(L) @ sampled.C
        matrices = [_balls(X) for X in (sampled.A + LC, sampled.A, LC)]
        size_back = None
        if S is not None:
            back_S = solve_entries(_balls(exact(S)), entries(identity(len(M))))
            if back_S is None:
                return None
            inverse, back = (exact(S) @ X @ back_S for X in (inverse, back))
            matrices = [exact(S) @ X @ back_S for X in matrices]
            size_back = spectral_norm(back_S)
        f, size_A, size_LC = (spectral_norm(X) for X in matrices)
        T = scalar(rational(sampled.period) * sampled.k)
        a, m = spectral_norm(back), spectral_norm(inverse)
        return cls(a, m, f, size_A, size_LC, T, inverse, size_back)

    def constants(self, period: float, tighter: bool = False) -> equations.Constants:
        """(10)-(13) for a period (T stays); tighter: with `tighter_sigma` in place of Sigma."""
        s = self.size_LC * (number(period) * self.size_A).expm1()
        sigma = equations.tighter_sigma if tighter else equations.sigma
        return equations.constants(self.a, self.m, sigma(self.T, self.f, s))

    def longest_period(self, tighter: bool = False) -> Ball | None:
        """Ball around the period below which (13) holds; None if A = 0: it always does."""
        if not self.size_A > 0:
            return None
        sizes = (self.size_A, self.size_LC)
        formula = (
            equations.enclosed_tighter_period if tighter else equations.enclosed_longest_period
        )
        longest: Ball = formula(self.a, self.m, self.f, sizes, self.T)
        return longest

    def condition(self, period: float, tighter: bool = False) -> str:
        """Decide (13) at a period: proved, refuted or undecided."""
        s = self.size_LC * (number(period) * self.size_A).expm1()
        if s == 0:
            return "proved"
        room = equations.largest_sigma(self.a, self.m).log()
        formula = equations.log_tighter_sigma if tighter else equations.log_sigma
        log_sigma = formula(self.T, self.f, s)
        if log_sigma < room:
            return "proved"
        return "refuted" if log_sigma > room else "undecided"


# --- condition (13) at a period or window ---------------------------------------------------------


def condition_claim(norms: Norms, period: float, name: str, outcome: str) -> Claim:
    """Claim that (13) is decided in this way at a period: proved, it holds, or refuted."""
    is_shown = norms.condition(period) == outcome
    word = "holds" if outcome == "proved" else "fails"
    verdict = proved() if is_shown else undecided(f"at {period!r} it is too close to call")
    statement = f"(13) {word} at period {period!r}, T = {float_below(norms.T):.9g}"
    return Claim.from_verdict(name, statement, _CONDITION_13, verdict)


def no_period_claim(reason: str) -> Claim:
    """Claim that some period satisfies (13), for lack of one that is known to."""
    statement = "(13) holds for some period"
    return Claim.from_verdict("condition_13", statement, _CONDITION_13, undecided(reason))


def shorter_windows_claim(A: Matrix, C: Matrix, L: Matrix, period: float, counts: range) -> Claim:
    """Claim that (13) is false for every window of so many samples."""
    windows = {k: Norms.from_sampled(Sampled.from_plant(A, C, period, k), L) for k in counts}
    held = [k for k, x in windows.items() if x is not None and x.condition(period) != "refuted"]
    samples = [counts.start, counts.stop - 1]
    verdict = proved(samples=samples)
    if held:
        verdict = undecided(f"(13) may hold with {held[0]} samples", samples=samples)
    return Claim.from_verdict(
        "shorter_windows",
        f"(13) is false at period {period!r} for windows of {counts.start} to {counts.stop - 1} "
        "samples and this L",
        _CONDITION_13,
        verdict,
    )


# --- the constants of Theorem 1 -------------------------------------------------------------------


def bound_claims(
    sampled: Sampled, gains: FiniteTimeGains, S: Matrix | None = None
) -> Iterator[Claim]:
    """Theorem 1's numbers where M_T is invertible; for (14), the factor of the error identity.

    S, (n, n): coordinates of a certificate, for the same numbers in the norm |S x|.
    """
    norms = Norms.from_sampled(sampled, gains.injection)
    if norms is None:
        return
    yield _numbers(norms, sampled.period)
    yield _tighter(norms, sampled.period)
    if S is not None:
        transformed = Norms.from_sampled(sampled, gains.injection, S)
        if transformed is not None:
            yield _in_coordinates(transformed, sampled.period, S)
    if not gains.is_unbiased and gains.half_sample == PRINTED:
        # a factor beyond floats bounds nothing, and no other claim rests on it
        factor = float_above(error_factor(sampled, gains.injection, norms.inverse))
        if np.isfinite(factor):
            yield identity_claim(factor)


def _numbers(norms: Norms, period: float) -> Claim:
    """The constants, as intervals of floats; a hypothesis of Theorem 1 alone."""
    return Claim.from_verdict(
        "theorem_1_numbers",
        "the constants of (10)-(13) lie in the stated intervals; (13) is true, false or open as "
        "stated",
        f"{PAPER}, Theorem 1, (10)-(13), as corrected",
        proved(**_constants(norms, period).to_evidence()),
    )


def _tighter(norms: Norms, period: float) -> Claim:
    """The same with a tighter Lemma 2, which is no part of the paper's (13)."""
    return Claim.from_verdict(
        "theorem_1_tighter",
        "with e^(|F| T) (e^(s T) - 1), s = |L C| (e^(|A| nu) - 1), in place of Sigma, the "
        "constants of (10)-(13) lie in the stated intervals; (13) is true, false or open as stated",
        f"{PAPER}, Theorem 1, as corrected, with the Dyson series in place of Lemma 2",
        proved(**_constants(norms, period, tighter=True).to_evidence()),
    )


def _in_coordinates(norms: Norms, period: float, S: Matrix) -> Claim:
    """The same for S A S^-1, C S^-1, S L: Theorem 1 then bounds |S x|."""
    assert norms.size_back is not None
    constants = replace(_constants(norms, period), S=S, norm_of_back=_interval(norms.size_back))
    return Claim.from_verdict(
        "theorem_1_coordinates",
        "in the coordinates S x the constants of (10)-(13) lie in the stated intervals, |S^-1| in "
        "norm_of_back; (13) is true, false or open as stated",
        f"{PAPER}, Theorem 1, (10)-(13), as corrected, for S A S^-1, C S^-1, S L",
        proved(**constants.to_evidence()),
    )


def _constants(norms: Norms, period: float, tighter: bool = False) -> TheoremEvidence:
    """Enclosures of (10)-(13); all but sigma and first are defined where (13) may hold."""
    enclosed, outcome = norms.constants(period, tighter), norms.condition(period, tighter)
    longest = norms.longest_period(tighter)
    names = ("sigma", "gbar", "alpha", "beta", "gamma", "first", "second")
    stated = names if outcome == "proved" else ("sigma", "first")
    return TheoremEvidence(
        condition_13=_WORDS[outcome],
        longest_period="inf" if longest is None else float_below(longest),
        norm_of_exp=_interval(norms.a),
        norm_of_inverse=_interval(norms.m),
        **{name: _interval(getattr(enclosed, name)) for name in stated},
    )


def _interval(x: Ball) -> Interval:
    return [float_below(x), float_above(x)]


def _balls(X: Exact) -> Exact:
    values = np.empty(X.size, dtype=object)
    values[:] = [scalar(x) for x in X.ravel().tolist()]
    return values.reshape(X.shape)
