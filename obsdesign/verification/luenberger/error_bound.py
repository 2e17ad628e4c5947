"""Bounds of the estimation error as time goes on: the claim `error_bound`, and its sentence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Array, Entries, NewEntries, Value
from lmi.bounds.driven_jumps import Radius
from lmi.bounds.tube import Tube
from lmi.verdict import proved, undecided
from obsdesign.analysis.luenberger.driven_error import DrivenError
from obsdesign.analysis.luenberger.error_bounds import (
    Contraction,
    ErrorBounds,
    bounds_with_jumps,
    bounds_without_jumps,
    contraction_radius,
    is_tube,
)
from obsdesign.document import Claim
from obsdesign.verification.dwell import Dwell
from obsdesign.verification.proposal import Proposal, matrix_of, vectors
from obsdesign.verification.rates import shown

ID = "error_bound"
_TUBE = ("tube", "after_jump", "before_jump", "always")
_SOURCE = "variation of constants"
_SOURCE_WITH_JUMPS = f"{_SOURCE}; tube, and contraction from jump to jump"


@dataclass(frozen=True)
class ErrorCertificate(Proposal):
    """always, before_jump (n,): the bounds; tube: of |e|; T (n, n), per_jump: a contraction."""

    always: Value = None
    before_jump: Value = None
    tube: Value = None
    T: Value = None
    per_jump: Value = None

    def stated(self) -> NewEntries:
        """The entries that are there."""
        return {name: value for name, value in vars(self).items() if value is not None}


def error_bound_claim(
    error: DrivenError, dwell: Dwell | None, proposed: Entries, drive: str
) -> tuple[Claim, ...]:
    """Claim of the proposed bounds of |e|; no claim where there is no proposal.

    dwell: None without jumps; drive: what may act, in words. The proposal is checked here.
    """
    names = ("always",) if dwell is None else ("always", "before_jump")
    bounds = vectors(proposed, names, len(error.F))
    if bounds is None:
        return ()
    certificate = ErrorCertificate.from_document(proposed)
    verdict = undecided("the proposed bounds are smaller than those that are proved")
    proof = _proof(error, dwell, certificate)
    if proof is None:
        verdict = undecided("the certificate proves no bounds, or a part of it is not proved")
    elif _are_above(bounds, proof):
        verdict = proved(**certificate.stated())
    statement, source = f"`always` is an ultimate bound of |x - x_hat|: {drive}", _SOURCE
    if dwell is not None:
        source = _SOURCE_WITH_JUMPS
        statement = (
            f"for every sequence of dwell times in {dwell} ultimate bounds of |x - x_hat| are "
            f"`always`, and before_jump just before jumps: {drive}"
        )
    return (Claim.from_verdict(ID, statement, source, verdict),)


def _are_above(bounds: tuple[Array, ...], proof: ErrorBounds) -> bool:
    pairs = zip(bounds, (proof.always, proof.before_jump), strict=False)
    return all(bool((stated >= least).all()) for stated, least in pairs)


def _proof(
    error: DrivenError, dwell: Dwell | None, certificate: ErrorCertificate
) -> ErrorBounds | None:
    if dwell is None:
        return bounds_without_jumps(error)
    ends = (dwell.low, dwell.high)
    try:
        tube = _tube(error, ends, certificate)
        around = _radius(error, ends, certificate)
    except _NotProved:
        return None
    return bounds_with_jumps(error, ends, tube, around)


class _NotProved(Exception):
    """A part of the certificate is not proved: whether a bound needs it does not matter."""


def _tube(
    error: DrivenError, ends: tuple[float, float], certificate: ErrorCertificate
) -> Tube | None:
    """The stated tube, None where none is stated; _NotProved."""
    if certificate.tube is None:
        return None
    stated = certificate.tube if isinstance(certificate.tube, dict) else {}
    entries = vectors(stated, _TUBE, len(error.F))
    if entries is None or not is_tube(error, ends, tube := Tube(*entries)):
        raise _NotProved
    return tube


def _radius(
    error: DrivenError, ends: tuple[float, float], certificate: ErrorCertificate
) -> Radius | None:
    """What the stated contraction leaves, None where none is stated; _NotProved."""
    T, per_jump = matrix_of(certificate.T, len(error.F)), certificate.per_jump
    if certificate.T is None and per_jump is None:
        return None
    radius = None
    if T is not None and np.isfinite(T).all() and isinstance(per_jump, float):
        radius = contraction_radius(error, ends, Contraction(T, per_jump))
    if radius is None:
        raise _NotProved
    return radius


def bound_sentence(
    claims: tuple[Claim, ...], measured: str, is_noisy: bool
) -> list[tuple[str, list[str]]]:
    """The guarantee of a proved bound of the error, and the claims that it rests on."""
    evidence = [c.evidence for c in claims if c.id == ID and c.verdict == "proved"]
    if not evidence:
        return []
    always, before = evidence[0]["always"], evidence[0].get("before_jump")
    noise = "" if is_noisy else " without noise"
    text = f"{measured}{noise}, the ultimate bound of the estimation error is {shown(always)}"
    if before is not None:
        text += f", just before jumps {shown(before)}"
    return [(f"{text}.", [ID])]
