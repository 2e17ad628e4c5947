"""Evidence of finite-time claims that guarantees read again."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from typing import Self

from lmi.arithmetic.arrays import Entries, NewEntries, Value
from obsdesign.document import Claim
from obsdesign.equations.finite_time.rows import END, START

# ends of an enclosure, rounded outwards
Interval = list[float]


@dataclass(frozen=True)
class TheoremEvidence:
    """Constants of (10)-(13) in intervals; those that only (13) defines are None where it fails.

    condition_13: true, false or open; longest_period: of (13), "inf" without an end;
    norm_of_exp: |e^{-F T}|; norm_of_inverse: |M_T^{-1}|; S, norm_of_back: coordinates and |S^-1|.
    """

    condition_13: str
    longest_period: float | str
    norm_of_exp: Interval
    norm_of_inverse: Interval
    sigma: Interval
    gbar: Interval | None = None
    alpha: Interval | None = None
    beta: Interval | None = None
    gamma: Interval | None = None
    first: Interval | None = None
    second: Interval | None = None
    S: Value = None
    norm_of_back: Interval | None = None

    @classmethod
    def from_evidence(cls, evidence: Entries) -> Self:
        """The constants that a claim states."""
        names = {entry.name for entry in fields(cls)}
        return cls(**{name: value for name, value in evidence.items() if name in names})

    def to_evidence(self) -> NewEntries:
        """Entries of a claim, without those that are None."""
        entries = {entry.name: getattr(self, entry.name) for entry in fields(self)}
        return {name: value for name, value in entries.items() if value is not None}

    @property
    def is_applicable(self) -> bool:
        """Is (13) proved, so that the theorem holds?"""
        return self.condition_13 == "true"

    @property
    def factors(self) -> tuple[float, float, float]:
        """Upper ends of alpha, beta and gamma Sigma."""
        alpha, beta, gamma = (
            math.inf if x is None else x[1] for x in (self.alpha, self.beta, self.gamma)
        )
        return alpha, beta, gamma * self.sigma[1]


@dataclass(frozen=True)
class BiasEvidence:
    """Bias of unbiased gains: amplification of rounding, size of the bias, its reference."""

    amplification: float
    error: float
    reference: str = END

    def to_evidence(self) -> NewEntries:
        """Entries of a claim; the reference is stated where it is START."""
        entries: NewEntries = {"amplification": self.amplification, "error": self.error}
        return entries | ({"reference": START} if self.reference == START else {})

    @classmethod
    def from_evidence(cls, evidence: Entries) -> Self:
        """The entries of a claim, if it has them."""
        return cls(
            evidence.get("amplification", 1.0), evidence.get("error", 0.0),
            evidence.get("reference", END),
        )  # fmt: skip


@dataclass(frozen=True)
class DesignEvidence:
    """Entries of all claims of a design that its guarantees depend on; None without the claim.

    has_decayed_modes: the samples leave modes undetermined, which decay in the window; row_ratio:
    smallest singular value of the window's scaled rows, relative to their norm; error_factor: of
    the error identity; largest_error (n,): of unbiased gains.
    """

    verdicts: Mapping[str, str]
    bias: BiasEvidence | None
    has_decayed_modes: bool
    row_ratio: float
    error_factor: float | None
    largest_error: list[float] | None
    theorem: TheoremEvidence | None
    tighter: TheoremEvidence | None
    transformed: TheoremEvidence | None

    @classmethod
    def from_claims(cls, claims: Iterable[Claim]) -> Self:
        """The evidence of the claims of a design."""
        claims = tuple(claims)
        evidence = {claim.id: claim.evidence for claim in claims}
        window = evidence.get("window_long_enough", {})
        identity, radius = evidence.get("error_identity"), evidence.get("error_radius")

        def constants(name: str) -> TheoremEvidence | None:
            return TheoremEvidence.from_evidence(evidence[name]) if name in evidence else None

        bias = evidence.get("unbiased")
        return cls(
            verdicts={claim.id: claim.verdict for claim in claims},
            bias=None if bias is None else BiasEvidence.from_evidence(bias),
            has_decayed_modes=bool(window.get("died_out")),
            row_ratio=window.get("approx_ratio", 1.0),
            error_factor=None if identity is None else identity.get("factor", math.inf),
            largest_error=None if radius is None else radius.get("largest_error", []),
            theorem=constants("theorem_1_numbers"),
            tighter=constants("theorem_1_tighter"),
            transformed=constants("theorem_1_coordinates"),
        )
