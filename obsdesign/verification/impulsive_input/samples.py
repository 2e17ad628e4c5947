"""Claims about the samples of a window: the state, an onset and its weight.

With samples t_o + h, ..., t_o + N h, an impulse at t_o + v, 0 <= v < h, leaves
M e^{-A v} H g, M = [C e^{A h}; ...; C e^{A N h}]. If M has rank n and e^{A t} has no other
eigenvectors than A for 0 < t < h (no aliasing), (v, g) is determined if and only if H is not an
eigenvector of A. With A H = mu H every v explains the samples equally well: determined is
e^{-mu v} g, which is the state after the impulse; and, where C H is not zero, the interval, whose
last sample is the first one that differs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Entries, Matrix
from lmi.arithmetic.balls import (
    Ball,
    Exact,
    Rational,
    ball,
    exact,
    exp_times,
    nearest_float,
    rational,
    to_float,
)
from lmi.prove.hurwitz import exactly_schur, prove_hurwitz, real_spectrum
from lmi.verdict import Verdict, proved, refuted, undecided
from obsdesign.document import Claim
from obsdesign.equations.estimation_error import flow_error_matrix
from obsdesign.equations.impulsive_input.gains import IntegralGains, SamplesGains
from obsdesign.equations.impulsive_input.sampling import (
    LONG_TIME_CONSTANTS,
    MAX_EXPONENT_PERIOD,
    fastest_limit,
    longest_period,
    rounded_down,
)
from obsdesign.verification.impulsive_input.rank import Rows, rank_verdict
from obsdesign.verification.impulsive_input.witnesses import TooFewSamples

_FEWEST_CELLS = 3  # of a window: two samples after an onset that is most of the window old
_MOST_ROWS = 64  # of a window in a rank
SOURCE = "Mattsson, Medvedev, ECC 2013, Section III-B, for samples"


@dataclass(frozen=True)
class SpeedsPerPeriod:
    """The fastest mode of A - K C and the largest exponent, times the period; floats."""

    mode: float
    exponent: float

    @classmethod
    def from_evidence(cls, evidence: Entries) -> SpeedsPerPeriod | None:
        """The speeds in the evidence of claim `samples`; None where it has none."""
        if "approx_mode_times_period" not in evidence:
            return None
        return cls(evidence["approx_mode_times_period"], evidence["approx_exponent_times_period"])

    def to_evidence(self) -> dict[str, float]:
        """Entries of the evidence."""
        return {
            "approx_mode_times_period": self.mode,
            "approx_exponent_times_period": self.exponent,
        }


def sampled_claims(gains: SamplesGains, shortest: float) -> tuple[Claim, ...]:
    """Rank of the samples of a window, and uniqueness of an onset in its first interval.

    shortest: the shortest dwell time. Where the samples of a window, and the one before it, are no
    more than the unknown numbers, two impulses may look like one: they must not be so close.
    """
    A, C, H = exact(gains.A), exact(gains.C), exact(gains.H)
    h, count = gains.sample_period, gains.window_samples
    rank = _rank(A, C, h, count, first=1)
    mode = _eigenvalue(A, H)
    if mode is not None:
        onset = _only_interval(C, H, mode)
    elif (count + 1) * gains.p < gains.n + 2 and (count + 1) * rational(h) > rational(shortest):
        onset = undecided(
            f"{count} samples in a window and one before it are as few as {gains.n} states, a time "
            f"and a weight, or fewer, and {count + 1} periods of {h!r} exceed the shortest dwell "
            f"time {shortest!r}: two impulses may look like one at another time; measure more often"
        )
    else:
        onset = _uniqueness(A, H, h)
    known = (
        "time and weight of an impulse in its first interval"
        if mode is None
        else "that an impulse came in its first interval, and its weight for every time in it"
    )
    return (
        Claim.from_verdict(
            "rank",
            f"the {count} samples of a window determine the error of the state",
            SOURCE,
            rank,
        ),
        Claim.from_verdict(
            "uniqueness",
            f"without noise the samples of a window determine {known}",
            SOURCE,
            onset,
        ),
    )


def window_samples(gains: IntegralGains, period: float, shortest: float) -> Claim:
    """Operator `integral`: a window holds samples enough for a state, an onset and its weights.

    And two periods fit between the window and the shortest dwell time: the last sample of a window
    comes up to a period after its end, t_o is a sample too, and an impulse after that must still
    be before its peak when the next search begins. Modes of A - K C and exponents are slow enough
    for the period (`equations.impulsive_input.sampling.longest_period`), exactly.
    """
    D = flow_error_matrix(exact(gains.A), exact(gains.K), exact(gains.C))
    statement = (
        f"the samples of a window show the state, and time and weight of an impulse: {gains.n}"
        f" + {1 + gains.directions} unknown numbers, two samples after the onset, and no sample "
        "of another impulse; they are close enough for A - K C and the exponents"
    )
    verdict = _window_verdict(gains, D, period, shortest)
    evidence = {**verdict.evidence, **_speeds(D, gains.exponents, period).to_evidence()}
    return Claim("samples", statement, SOURCE, verdict.outcome, evidence)


def _window_verdict(gains: IntegralGains, D: Exact, period: float, shortest: float) -> Verdict:
    """Verdict on the number, the end and the spacing of the samples of a window; D exact."""
    window = gains.window
    cells = math.floor(window / period * (1 + 1e-9))
    unknown = gains.n + 1 + gains.directions
    if cells < 2:
        reason = (
            f"output.period = {period!r} leaves {cells + 1} sample{'s' * (cells > 0)} in a window "
            f"of {window!r}: two after an onset are needed"
        )
        return refuted(TooFewSamples(cells + 1, reason).to_dict())
    if (cells + 1) * gains.p < unknown or cells < _FEWEST_CELLS:
        return undecided(
            f"{cells + 1} samples in a window are too few to be certain: {unknown} numbers are "
            f"unknown, and {_FEWEST_CELLS + 1} samples are asked for at least (fewer do where the "
            "state is known from before, which nothing here proves); choose operator 'samples' "
            "(with output.noise_std), or a longer window",
            samples=cells + 1,
        )
    if rational(window) + 2 * rational(period) > rational(shortest):
        return undecided(
            f"the window {window!r} and two periods of {period!r} exceed the shortest dwell time "
            f"{shortest!r}: the sample that ends a window may show the next impulse, which may be "
            "past its peak when its search begins; choose a shorter window",
            samples=cells + 1,
        )
    fast = _too_fast(D, gains, period)
    return _rank(exact(gains.A), exact(gains.C), period, cells) if fast is None else fast


def _speeds(D: Exact, exponents: Matrix, period: float) -> SpeedsPerPeriod:
    modes = np.linalg.eigvals(to_float(D))
    return SpeedsPerPeriod(
        mode=float(np.abs(modes).max()) * period,
        exponent=float(np.abs(exponents).max()) * period,
    )


def _too_fast(D: Exact, gains: IntegralGains, period: float) -> Verdict | None:
    """Undecided where integrals of samples cannot follow, with a period that would do; or None."""
    window, exponents = gains.window, gains.exponents
    # every mode decays by more than LONG time constants within the window
    faster = D + exact(np.eye(len(D))) * (rational(LONG_TIME_CONSTANTS) / rational(window))
    long = prove_hurwitz(faster).outcome == "proved"
    limit = fastest_limit(long)
    speeds, reasons = _speeds(D, exponents, period), []
    if not exactly_schur(D * (rational(period) / rational(limit))):
        which = f" in a window of more than {LONG_TIME_CONSTANTS:g} time constants" if long else ""
        reasons.append(
            f"the fastest mode of A - K C times the period is "
            f"{speeds.mode:.3g}, not below {limit:g}{which}"
        )
    if speeds.exponent > MAX_EXPONENT_PERIOD:
        reasons.append(
            f"the largest exponent times the period is {speeds.exponent:.3g}, above "
            f"{MAX_EXPONENT_PERIOD:g}"
        )
    if not reasons:
        return None
    enough = rounded_down(longest_period(to_float(D), exponents, window))
    return undecided(
        f"{'; '.join(reasons)}: integrals of samples may miss impulses. An output.period of at "
        f"most {enough:g} would do, or operator 'samples' (with output.noise_std)",
        period=enough,
    )


def _rank(A: Exact, C: Exact, period: float, cells: int, first: int = 0) -> Verdict:
    """Of many samples some, evenly spaced, are enough: more do not lower a rank.

    Samples `first` .. `cells` of a window; where some do not do, nothing follows for all.
    """
    every = cells // min(cells, _MOST_ROWS)
    verdict = _rank_of(A, C, period * every, first, min(cells, _MOST_ROWS))
    if (
        verdict.outcome != "proved" and every * _MOST_ROWS < cells
    ):  # they end before the window does
        every += 1
        wider = _rank_of(A, C, period * every, first, cells // every)
        verdict = wider if wider.outcome == "proved" else verdict
    count = min(cells, _MOST_ROWS)
    if verdict.outcome == "refuted" and count < cells:
        return undecided(
            f"{count} of the {cells} samples of a window do not determine the state: change the "
            "window or the period"
        )
    return verdict


def _rank_of(A: Exact, C: Exact, step: float, first: int, count: int) -> Verdict:
    """Rank of samples first .. count, `step` apart."""
    rows = _sampled_rows(A, C, step, first, count)
    sizes = np.tile(np.linalg.norm(to_float(C), axis=1), count + 1 - first)
    return rank_verdict(rows, sizes, len(A), "the samples of a window")


def _sampled_rows(A: Exact, C: Exact, step: float, first: int, count: int) -> Rows:
    """Function of no arguments: rows C e^{A k step}, k = first .. count, as balls."""

    def rows() -> list[list[Ball]]:
        forward = exp_times(A, step)
        at = ball(C)
        table: list[list[Ball]] = []
        for k in range(count + 1):
            if k >= first:
                table += at.tolist()
            at = at * forward
        return table

    return rows


def _eigenvalue(A: Exact, H: Exact) -> Rational | None:
    """mu of A H = mu H, H (n, 1) not zero, exactly; None where there is none."""
    along = A @ H
    k = next((i for i in range(len(H)) if H[i, 0] != 0), None)
    if k is None:
        return None
    mode = along[k, 0] / H[k, 0]
    is_along = all(along[i, 0] == mode * H[i, 0] for i in range(len(H)))
    return mode if is_along else None


def _only_interval(C: Exact, H: Exact, mode: Rational) -> Verdict:
    """Verdict on the interval of an onset, H an eigenvector of A; rank shows the state after it."""
    along = f"jump.H is an eigenvector of flow.A (eigenvalue {nearest_float(mode):.6g})"
    if not (C @ H).any():
        reason = f"{along} that no output shows"
        return refuted({"eigenvalue": nearest_float(mode), "reason": reason, "of_all_gains": True})
    return proved(
        method=f"{along}: impulses at any two times between two samples leave the same samples; "
        "the sample after it is the first that the impulse changes"
    )


def _uniqueness(A: Exact, H: Exact, h: float) -> Verdict:
    """Verdict on time and weight of an onset in an interval, H no eigenvector of A."""
    if not H.any():
        reason = "jump.H is zero: impulses do nothing"
        return refuted({"vector": [0.0] * len(H), "reason": reason, "of_all_gains": True})
    if real_spectrum(A):
        return proved(method="jump.H is no eigenvector of flow.A, whose spectrum is real")
    # all |Im mu| h < pi, so that logarithms are unique: of i A, as a real matrix, no mode grows by
    # pi / h or more, whatever the units of the states
    n, limit = len(A), rational(math.pi) / rational(h)
    turned = np.block([[exact(np.zeros((n, n))), -A], [A, exact(np.zeros((n, n)))]])
    if prove_hurwitz(turned - exact(np.eye(2 * n)) * limit).outcome == "proved":
        return proved(method="jump.H is no eigenvector of flow.A, and no mode turns by pi")
    return undecided("modes of flow.A may turn by more than half a circle between two samples")
