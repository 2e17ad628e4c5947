"""Claims about samples: stability and width where they are events, limits of the step else."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lmi.arithmetic.arrays import Array, Entries
from lmi.arithmetic.balls import exact, inverse, to_float, upper_ends
from lmi.bounds.interleaved import Bounds, prove_interleaved
from lmi.bounds.sampled_flow import sampled_flow
from lmi.prove.hurwitz import prove_hurwitz
from lmi.refute.spectral import refute_spectral
from lmi.verdict import Verdict, undecided
from obsdesign.analysis.interval.interleaved import interleaved
from obsdesign.document import Claim
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.equations.interval.width import SAMPLED_MAPS, WidthSystem, slope_scheme
from obsdesign.verification.dwell import Dwell
from obsdesign.verification.interval.width import (
    limit_claim,
    raised_product,
    width_claim,
)
from obsdesign.verification.proposal import vectors
from obsdesign.verification.rates import shown

_MAPS_IN_WORDS = (
    "w+ = |X e^(A s)| w + what f adds over a time s, with X = I between events, X = I - L C (k is "
    "added) at samples and X = G (h is added) at jumps,"
)
_COMPARISON_IN_WORDS = "w' = W w + f, w+ = K w + k at samples and w+ = N w + h at jumps"


def samples_claim(
    system: WidthSystem, gains: IntervalGains, proposed: Entries, source: str
) -> Claim:
    """Claim for samples as events: bounded width for every sequence of jumps between them.

    proposed: "tube", "sampled", "always" and, with jumps, "jumped"; checked. "maps":
    `SAMPLED_MAPS`; without it, as in designs of earlier versions, the claim is about the wider
    comparison system.
    """
    assert gains.period is not None
    is_merged = proposed.get("maps") == SAMPLED_MAPS
    system = system if is_merged else system.comparison()
    names = ("tube", "sampled", "always") + (() if system.N is None else ("jumped",))
    bounds = vectors(proposed, names, len(system.f))
    verdict = undecided("no tube was given or found for samples and jumps between them")
    if bounds is not None:
        verdict = _proof(system, gains, _bounds(bounds))
    if verdict.outcome == "proved" and bounds is not None:
        widths = {name: to_float(v).tolist() for name, v in zip(names, bounds, strict=True)}
        tube = _bounds(bounds)
        if tube.jumped is not None:
            widths |= {"after_jump": raised_product(system.out, tube.jumped)}
        widths |= {"after_sample": raised_product(system.out, tube.sampled)}
        verdict = Verdict("proved", {**widths, **verdict.evidence})
    elif math.isinf(gains.dwell_ends[1]):
        refutation = _refutation(system, gains.period)
        verdict = refutation if refutation.outcome == "refuted" else verdict
    maps = {"maps": SAMPLED_MAPS} if is_merged else {}
    statement, evidence = _samples_statement(gains, is_merged), {**maps, **verdict.evidence}
    return Claim("sampled_stability", statement, source, verdict.outcome, evidence)


def _samples_statement(gains: IntervalGains, is_merged: bool) -> str:
    jumps = "" if gains.G is None else f" and jumps with dwell times in {Dwell(*gains.dwell_range)}"
    spared = " (none is needed at the time of a jump)" if gains.skips_jumps else ""
    system = _MAPS_IN_WORDS if is_merged else _COMPARISON_IN_WORDS
    return (
        f"with a sample every {gains.period!r}{spared}{jumps}, the width stays bounded: a tube "
        f"that {system} do not leave and are drawn to"
    )


def _refutation(system: WidthSystem, period: float) -> Verdict:
    """Refute by the map from sample to sample of the error, or by its absolute value."""
    assert system.A is not None
    assert system.K is not None
    refutation = refute_spectral(system.A, system.K, period, period)
    if refutation.outcome == "refuted":
        return refutation
    sample = interleaved(system, period, math.inf, math.inf).over_period()
    below = np.maximum(-upper_ends(-sample), 0.0)[:-1, :-1]
    if not np.isfinite(below).all():
        return undecided("the map from sample to sample overflows")
    return refute_spectral(0 * below, below, period, period)


def _proof(system: WidthSystem, gains: IntervalGains, bounds: Bounds) -> Verdict:
    assert gains.period is not None
    question = interleaved(system, gains.period, *gains.dwell_ends, gains.skips_jumps)
    return prove_interleaved(question, exact(system.out), bounds)


def _bounds(vectors: tuple[Array, ...]) -> Bounds:
    """From tube, sampled, always and, with jumps, jumped."""
    tube, sampled, always, *jumped = vectors
    return Bounds(tube, sampled, jumped[0] if jumped else None, always)


def spacing_claim(
    system: WidthSystem,
    gains: IntervalGains,
    proposed: Entries,
    source: str,
) -> tuple[Claim, ...]:
    """Claim of the width for samples of a continuous y at all spacings up to a limit."""
    limit = proposed.get("step_limit")
    if gains.step_limit is not None and limit != gains.step_limit:
        nothing = undecided("the step limit of the gains is not the one to be proved")
        return (Claim.from_verdict("sampled_width", "the width", source, nothing),)
    if not isinstance(limit, float) or not 0 < limit < math.inf:
        return ()
    L, CA, A, C, b = slope_scheme(gains, exact, inverse)
    added = sampled_flow(exact(system.W), L, CA=CA, A=A, C=C, b=b, h=limit)
    if added is None:
        return ()
    spaced = replace(system, W=system.W + added[0], f=system.f + added[1])
    if system.N is None:
        claims = limit_claim(spaced, proposed, source)
    else:
        claims = width_claim(spaced, gains.dwell_ends, proposed, source)
    flow = prove_hurwitz(spaced.W) if math.isinf(gains.dwell_ends[1]) else None
    return tuple(_spaced(claim, limit, flow, gains.skips_jumps) for claim in claims)


def at_any_spacing(claim: Claim) -> Claim:
    """The claim about the width of a design with L = 0: between jumps no sample is used."""
    evidence = {"step_limit": math.inf, **claim.evidence}
    evidence.pop("constant_dwell", None)
    statement = f"with samples at any spacing, since L = 0: {claim.statement}"
    return Claim("sampled_width", statement, claim.source, claim.verdict, evidence)


def _spaced(claim: Claim, limit: float, flow: Verdict | None, skips: bool) -> Claim:
    """The claim about a width as one about samples.

    skips: no sample is taken at jumps, so that two in a row would leave a step without any.
    """
    evidence = {"step_limit": limit, **claim.evidence}
    verdict = claim.verdict
    if verdict == "proved" and flow is not None and flow.outcome != "proved":
        verdict, evidence = "undecided", {**evidence, "reason": "the flow does not decay"}
    evidence.pop("constant_dwell", None)
    where = "at every step" if not skips else "at one end at least of every step"
    statement = f"with a sample {where} of at most {limit!r}: {claim.statement}"
    return Claim("sampled_width", statement, claim.source, verdict, evidence)


def in_every_period(skips: bool) -> str:
    """Condition on periodic samples; skips: none is taken at the time of a jump."""
    spared = ", save where one falls on a jump," if skips else ""
    return f"With samples a period apart{spared} and any others besides"


@dataclass(frozen=True)
class SampledWidth:
    """Bounds of the width of x in a proved claim about samples.

    after_sample: None for a continuous y; step_limit: None for samples as events.
    """

    always: Sequence[float]
    after_sample: Sequence[float] | None
    step_limit: float | None

    @classmethod
    def from_evidence(cls, evidence: Entries) -> SampledWidth:
        """Those of a proved claim; KeyError where a document's evidence has neither of the two."""
        after = evidence.get("after_sample")
        limit = float(evidence["step_limit"]) if after is None else None
        return cls(evidence["always"], after, limit)

    def sentence(self, skips: bool) -> str:
        """Guarantee of the width; skips: no sample is taken at the time of a jump."""
        always = shown(self.always)
        if self.after_sample is not None:
            return (
                f"{in_every_period(skips)}, the ultimate bound of the width is "
                f"{shown(self.after_sample)} after samples and {always} at any time."
            )
        assert self.step_limit is not None
        apart = f"at most {self.step_limit:.6g} apart, at jumps and irregular ones too,"
        if skips:
            apart = (
                f"at most {self.step_limit:.6g} apart, irregular ones too, save where one falls on "
                "a jump, and a sample between any two jumps,"
            )
        if math.isinf(self.step_limit):
            apart = "at any spacing, and at jumps if M is not zero,"
        return f"With samples {apart} the ultimate bound of the width is {always}."


def sampled_sentences(claims: tuple[Claim, ...], skips: bool) -> list[tuple[str, list[str]]]:
    """The guarantees of proved claims about samples, each with the claims that it rests on."""
    return [
        (SampledWidth.from_evidence(claim.evidence).sentence(skips), [claim.id])
        for claim in claims
        if claim.verdict == "proved" and claim.id in ("sampled_stability", "sampled_width")
    ]


def no_spacing() -> str:
    """Sentence where no step limit is proved."""
    return (
        "A bounded width for samples at a given spacing is not claimed: no limit of the spacing "
        "was proved. Unless L = 0, it must be small against 1/(|L||CA|)."
    )
