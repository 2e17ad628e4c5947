"""Blocks of the error that decay without correction; the quadratic strategy."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Entries, EntriesByClaim, Matrix
from lmi.arithmetic.balls import Exact, exact, number, rational, to_float
from lmi.bounds.largest_norm import identity_like, norm_of, norm_over
from lmi.prove.common_matrix import prove_common
from lmi.rank.hidden_mode import check_hiding
from lmi.rank.witness import MARGIN
from lmi.verdict import Verdict, proved, refuted, undecided
from obsdesign.analysis.hidden_modes import hidden_part, refuted_in_time
from obsdesign.document import Claim
from obsdesign.equations.impulsive.formulas import Core, uncorrected_factor
from obsdesign.equations.impulsive.gains import ImpulsiveGains
from obsdesign.problem.problem import Problem
from obsdesign.verification.dwell import Dwell, dwell_stability
from obsdesign.verification.impulsive.rate import Bound, in_balls, quadratic_bound
from obsdesign.verification.proposal import matrix_of

_CASCADE = "linear time-varying cascade: what C does not see follows what it sees"
_SOURCES = {
    "hidden": _CASCADE,
    "rest": "Medina, Lawrence, section IV: the part that nothing drives",
}


@dataclass(frozen=True)
class BlockDecay:
    """V = x'P x of a block falls by factor^2 per impulse."""

    P: Matrix
    factor: float

    @classmethod
    def from_evidence(cls, evidence: Entries) -> BlockDecay | None:
        """From the evidence of a claim that a block decays; None without a P."""
        if "P" not in evidence:
            return None
        return cls(np.asarray(evidence["P"], dtype=np.float64), evidence["factor"])


@dataclass(frozen=True)
class Contraction:
    """V = x'P x of the error after an impulse falls by gamma^2 to the next; P symmetric."""

    P: Matrix
    gamma: float

    @classmethod
    def from_evidence(cls, evidence: Entries, n: int) -> Contraction | None:
        """From a certificate or the evidence of claim `contracting`; None where it has none."""
        P, gamma = _symmetric(evidence.get("P"), n), evidence.get("gamma")
        if P is None or not isinstance(gamma, float) or not 0 < gamma < 1:
            return None
        return cls(P, gamma)


def block_decay(
    name: str,
    pair: tuple[Exact, Exact],
    dwell: Dwell,
    certificate: Entries,
    *,
    paranoid: bool,
    rate: float,
) -> Claim:
    """Claim that the block "hidden" or "rest" decays for all spacings, with a margin."""
    F, H = pair
    factor = uncorrected_factor(rate, dwell.high)
    smaller = certificate.get("factor")
    if isinstance(smaller, float) and 0 < smaller < factor:
        factor = smaller
    verdict = dwell_stability(F, H / rational(factor), dwell, certificate, paranoid)
    if verdict.outcome == "refuted":
        verdict = _without_margin(verdict, F, H, dwell)
    verdict = Verdict(verdict.outcome, {**verdict.evidence, "factor": factor})
    what = "that no measurement sees" if name == "hidden" else "that nothing corrects"
    return Claim.from_verdict(
        f"{name}_decays",
        f"the part of the error {what} ({len(F)} of the coordinates of basis) shrinks to "
        f"{factor:.9g} or less per impulse, in the norm of one P, for all spacings in "
        f"{dwell}",
        _SOURCES[name],
        verdict,
    )


def _without_margin(verdict: Verdict, F: Exact, H: Exact, dwell: Dwell) -> Verdict:
    """Refute only by a witness against decay itself; one against the margin leaves it open."""
    plain = dwell_stability(F, H, dwell, {}, False)
    if at_once := plain.outcome == "refuted" and dwell.low == 0:
        plain = refuted_in_time(F, H, dwell.low, dwell.high)
    if plain.outcome == "refuted":
        modes = np.linalg.eigvals(to_float(F))
        worst = modes[np.argmax(modes.real)]
        text = f"{plain.reason}; its flow has the mode {worst:.6g}"
        return refuted({**plain.witness, "reason": f"it does not decay by itself: {text}"})
    reason = plain.reason if at_once else "it decays too slowly, if at all"
    return undecided(reason, **verdict.evidence)


def quadratic_claims(
    problem: Problem, gains: ImpulsiveGains, certificates: EntriesByClaim, paranoid: bool
) -> tuple[list[Claim], Bound | None]:
    """Claims of one P for all spacings, gains by cells of the last one; and their bound."""
    dwell, ends = Dwell.from_problem(problem), problem.require_dwell_time()
    plant = Core.from_gains(gains, exact)
    certificate = certificates.get("contracting", {})
    norm = Contraction.from_evidence(certificate, problem.plant.n)
    if norm is None:
        verdict = undecided("no P was found for which a gain contracts at every spacing")
    else:
        verdict = _contracting(plant, gains, norm, ends)
    claims = [Claim.from_verdict(
        "contracting",
        "in the norm of one P the error after an impulse is at most gamma of that after the "
        f"impulse before, for all spacings in {dwell}, with the gain of table for "
        "the cell that the spacing is in",
        "quadratic detectability: P and one gain for each cell of spacings",
        verdict,
    )]  # fmt: skip
    if verdict.outcome == "proved" and norm is not None:
        return claims, _bound(plant, gains, norm, ends)
    # no gain at all helps against these
    return [*_obstructions(plant, dwell, certificates, paranoid), *claims], None


def _obstructions(
    plant: Core, dwell: Dwell, certificates: EntriesByClaim, paranoid: bool
) -> list[Claim]:
    """Claims whose refutation refutes every observer: undetectable modes."""
    claims = []
    hidden = hidden_part([plant.A, plant.J], plant.C)
    if hidden is not None:
        flow, jump = hidden.maps
        certificate = certificates.get("hidden_decays", {})
        verdict = dwell_stability(flow, jump, dwell, certificate, paranoid)
        if verdict.outcome == "refuted":
            verdict = _without_margin(verdict, flow, jump, dwell)
        claims.append(Claim.from_verdict(
            "hidden_decays",
            f"what no measurement ever sees of the state (dimension {len(flow)}) decays",
            _CASCADE, verdict,
        ))  # fmt: skip
    hiding = certificates.get("detectable", {}).get("witness", {}).get("thetas")
    if not isinstance(hiding, list) or len(hiding) != 1:
        return claims
    theta = float(hiding[0])
    if dwell.low <= theta <= dwell.high:
        verdict = _hiding(plant, theta)
        claims.append(Claim.from_verdict(
            "detectable",
            "at no constant spacing does C miss a mode of the impulses and the flow between them "
            f"that has modulus 1 or more (residuals below {MARGIN:g} of their terms)",
            _CASCADE, verdict,
        ))  # fmt: skip
    return claims


def _hiding(plant: Core, theta: float) -> Verdict:
    """Refuted if C misses a mode at a constant spacing that does not decay as time passes."""
    verdict = check_hiding(plant.A, plant.J, plant.C, theta)
    if verdict.outcome != "refuted" or theta > 0:
        return verdict
    mode = verdict.witness["mode"]
    if math.hypot(mode["real"], mode["imag"]) > 1 + MARGIN:
        return verdict
    return undecided(f"{verdict.reason}; no time passes between impulses at once")


def _contracting(
    plant: Core, gains: ImpulsiveGains, norm: Contraction, ends: tuple[float, float]
) -> Verdict:
    P, gamma = norm.P, norm.gamma
    cells, table = gains.gain_table
    is_single = len(cells) == 2 and cells[0] == cells[1] == ends[0] == ends[1]
    is_rising = bool(np.all(np.diff(cells) > 0))
    if not is_single and not (is_rising and cells[0] <= ends[0] and cells[-1] >= ends[1]):
        return refuted({"entry": "gains.cells", "reason": "the cells do not cover the range"})
    boxes = 0
    for (start, end), L in zip(itertools.pairwise(cells.tolist()), table, strict=True):
        H = plant.J + exact(L) @ plant.C
        sides = max(start, ends[0]), min(end, ends[1])
        verdict = prove_common(plant.A, H, P, *sides, form="after_jump", gamma=gamma)
        if verdict.outcome != "proved":
            return verdict
        boxes += int(verdict.evidence.get("boxes", 0))
    return proved(P=P.tolist(), gamma=gamma, cells=len(table), boxes=boxes)


def _bound(
    plant: Core, gains: ImpulsiveGains, norm: Contraction, ends: tuple[float, float]
) -> Bound:
    """From the error after an impulse to the error before the next, and back."""
    unit = identity_like(plant.A)
    with in_balls():
        flow = norm_over(unit, plant.A, unit, *ends)
        gain = norm_of(plant.J)
        for L in gains.gain_table[1]:
            gain = gain.max(norm_of(plant.J + exact(L) @ plant.C))
        bound = quadratic_bound(norm.P, norm.gamma).scaled(flow * gain / number(norm.gamma))
        return Bound(bound.constant.max(number(1.0)), bound.factor)


def _symmetric(values: object, n: int) -> Matrix | None:
    """A symmetric matrix of a certificate, (n, n); None if it is not one."""
    P = matrix_of(values, n)
    return P if P is not None and np.isfinite(P).all() and np.array_equal(P, P.T) else None
