"""Proof of stability for every sequence of dwell times, shared by the kinds with jumps."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Array, Entries, Value
from lmi.prove.common_matrix import prove_common
from lmi.prove.positive import FORMS, SIDES, prove_copositive
from lmi.prove.windows_proof import prove_windows
from lmi.refute.infeasible import prove_no_common
from lmi.refute.spectral import decide_constant, refute_spectral, refute_word, steps_within
from lmi.verdict import Verdict, undecided
from obsdesign.problem.problem import Problem
from obsdesign.verification.proposal import Proposal, matrix_of, numbers_of
from obsdesign.verification.second_proof import confirmed
from obsdesign.verification.tails import proved_tails

_Prover = Callable[[Array, Array, "Dwell", "DwellCertificate", str], Verdict]


def reason_against_problem(problem: Problem) -> str | None:
    """Reason for which no observer with gains L, M serves the problem; None if one can."""
    absent = None if problem.plant.jump is None else problem.reason_without("jump.dwell_time")
    return absent or problem.reason_unless_measured("continuous", "at_jumps")


@dataclass(frozen=True)
class Dwell:
    """The dwell times of a claim: the range, and the largest change from one to the next."""

    low: float
    high: float
    jitter: float = math.inf

    @staticmethod
    def from_problem(problem: Problem) -> Dwell:
        """Dwell times of a problem with jumps."""
        assert problem.plant.jump is not None
        return Dwell(*problem.require_dwell_time(), problem.plant.jump.dwell_jitter)

    def __str__(self) -> str:
        """In words that round-trip: [0.7, inf)."""
        ends = f"[{self.low!r}, inf)" if math.isinf(self.high) else f"[{self.low!r}, {self.high!r}]"
        if math.isinf(self.jitter):
            return ends
        return f"{ends} that change by at most {self.jitter!r} from one to the next"


@dataclass(frozen=True)
class DwellCertificate(Proposal):
    """Stability for all dwell times.

    P; or windows and edges; or a vector with its side and form; a witness; no_common_P: dwell
    times and multipliers; tails: matrices that fall along the flow.
    """

    P: Value = None
    windows: Value = None
    edges: Value = None
    vector: Value = None
    side: Value = None
    form: Value = None
    witness: Value = None
    no_common_P: Value = None
    tails: Value = None

    @property
    def has_matrices(self) -> bool:
        """Is there a P, or one for each window?"""
        return self.P is not None or self.windows is not None

    def matrices(self) -> Entries:
        """P, or windows and edges, as `lmi.prove.rates` and `lmi.prove.windows_proof` read them."""
        entries = {"P": self.P, "windows": self.windows, "edges": self.edges}
        return {name: value for name, value in entries.items() if value is not None}


def dwell_stability(
    F: Array, H: Array, dwell: Dwell, certificate: Entries, paranoid: bool
) -> Verdict:
    """Is x -> e^{F theta} H x stable for every admissible sequence of theta?

    certificate: proposed by a finder: {"P": n x n}, {"windows": ..., "edges": ...},
    {"vector": ...}, {"witness": {"thetas": ...}} or {"no_common_P": ...}; it is checked here, or
    not used. One dwell time alone needs none. Refuted only by a checked witness. Of "tails" only
    those that fall along the flow are in the evidence. paranoid: a
    proof is repeated by the second, independent method.
    """
    low, high = dwell.low, dwell.high
    proposal = DwellCertificate.from_document(certificate)
    attempt = _attempted_proof(F, H, dwell, proposal, paranoid)
    if attempt.outcome == "proved":
        return Verdict("proved", {**attempt.evidence, **proved_tails(F, proposal.tails)})
    counter = refute_spectral(F, H, low, high)
    word = _dwell_times(proposal.witness, low, high)
    if counter.outcome != "refuted" and word and steps_within(word, dwell.jitter):
        counter = refute_word(F, H, word)
    if counter.outcome == "refuted":
        return counter
    if proposal.no_common_P is not None:
        nothing = _no_common(F, H, low, high, proposal.no_common_P)
        attempt = attempt if nothing is None else nothing
    evidence = {**counter.evidence, **attempt.evidence}
    # overflow leaves NaN in place of a number
    return Verdict("undecided", {key: value for key, value in evidence.items() if value == value})


def step_stability(step: Array, paranoid: bool) -> Verdict:
    """Is x -> step x stable: is the spectral radius of an exact map below one?"""
    return dwell_stability(step * 0, step, Dwell(1.0, 1.0), {}, paranoid)


def _attempted_proof(
    F: Array, H: Array, dwell: Dwell, proposal: DwellCertificate, paranoid: bool
) -> Verdict:
    """The first proof by what is proposed, in turn, or the last attempt."""
    attempt = undecided("no certificate P was given or found")
    for value, prover in ((proposal.P, _common), (proposal.windows, _windows)):
        if value is not None:
            attempt = _proof_by(prover, F, H, dwell, proposal, paranoid=paranoid)
            if attempt.outcome == "proved":
                return attempt
    if proposal.vector is not None:
        attempt = _copositive(F, H, dwell.low, dwell.high, proposal)
        if attempt.outcome == "proved":
            return attempt
    return decide_constant(F, H, dwell.low) if dwell.low == dwell.high else attempt


def source_of(verdict: Verdict, paper: str) -> str:
    """The paper, or the proof by windows of dwell times in its place."""
    if verdict.outcome == "proved" and "windows" in verdict.evidence:
        return f"{paper}, with a P for every window of dwell times (docs/windows.md)"
    return paper


def _proof_by(
    prover: _Prover,
    F: Array,
    H: Array,
    dwell: Dwell,
    certificate: DwellCertificate,
    *,
    paranoid: bool,
) -> Verdict:
    """The proof by one P or by windows; if paranoid, repeated by the other method."""
    verdict = prover(F, H, dwell, certificate, "bernstein")
    if verdict.outcome != "proved" or not paranoid:
        return verdict
    return confirmed(
        verdict,
        lambda: prover(F, H, dwell, certificate, "chords"),
        certificate=("P", "windows", "edges"),
    )


def _common(
    F: Array, H: Array, dwell: Dwell, certificate: DwellCertificate, method: str
) -> Verdict:
    P = matrix_of(certificate.P, len(F))
    if P is None:
        return undecided("the certificate P is not a matrix of the right size")
    verdict = prove_common(F, H, P, dwell.low, dwell.high, method=method)
    if verdict.outcome != "proved":
        return verdict
    return Verdict("proved", {"P": certificate.P, **verdict.evidence})


def _windows(
    F: Array, H: Array, dwell: Dwell, certificate: DwellCertificate, method: str
) -> Verdict:
    given = {name: value for name, value in certificate.matrices().items() if name != "P"}
    verdict = prove_windows(F, H, given, dwell.low, dwell.high, jitter=dwell.jitter, method=method)
    if verdict.outcome != "proved":
        return verdict
    return Verdict("proved", {**given, **verdict.evidence})


def _copositive(
    F: Array, H: Array, low: float, high: float, certificate: DwellCertificate
) -> Verdict:
    """The proof by one vector, for positive systems."""
    side, form = certificate.side, certificate.form
    vector = numbers_of(certificate.vector)
    if vector is None or side not in SIDES or form not in FORMS:
        return undecided("the certificate is not a vector with its side and form")
    verdict = prove_copositive(F, H, vector, low, high, side=side, form=form)
    return Verdict(verdict.outcome, {"vector": certificate.vector, **verdict.evidence})


def _dwell_times(witness: object, low: float, high: float) -> list[float]:
    """The sequence of a witness, if all of it is admissible."""
    thetas = witness.get("thetas") if isinstance(witness, Mapping) else None
    if not isinstance(thetas, list) or not all(isinstance(theta, float) for theta in thetas):
        return []
    return thetas if all(low <= theta <= high for theta in thetas) else []


def _no_common(F: Array, H: Array, low: float, high: float, certificate: Entries) -> Verdict | None:
    """Undecided, a common P being proved not to exist; None if the certificate shows nothing."""
    thetas = _dwell_times(certificate, low, high)
    multipliers = numbers_of(certificate.get("multipliers")) if thetas else None
    if multipliers is None or multipliers.dtype != np.float64:
        return None
    if prove_no_common(F, H, thetas, multipliers).outcome != "proved":
        return None
    return undecided(
        f"no common P exists for {len(thetas)} of the dwell times (checked dual certificate), "
        "which is not instability"
    )
