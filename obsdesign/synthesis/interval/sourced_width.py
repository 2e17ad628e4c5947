"""Gains and certificates of a plant with parameters whose state has no known bounds."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lmi.arithmetic.arrays import Array, Entries, Matrix
from lmi.arithmetic.balls import exact, inverse
from lmi.solvers import merged
from lmi.time_budget import TimeBudget
from obsdesign.analysis.interval.requirements import objective_of
from obsdesign.column_names import numbered
from obsdesign.equations.interval.gains import CORRECTIONS, IntervalGains
from obsdesign.equations.interval.sourced_width import sourced_width
from obsdesign.equations.parameters import NormalForm
from obsdesign.problem.options import IntervalOptions
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate, Certificates
from obsdesign.synthesis.convex_gain import UserConstraints, convex_gains
from obsdesign.synthesis.dwell import dwell_certificates, stability_options
from obsdesign.synthesis.interval.corrections import corrections
from obsdesign.synthesis.interval.forms import gains_of_form
from obsdesign.synthesis.interval.signal_sizes import SignalSizes
from obsdesign.synthesis.interval.task import width_weights
from obsdesign.synthesis.tube import (
    nearest,
    propose_limit,
    propose_width,
    proved_width,
    solvers_of_tube,
)

# parts of a gain that was chosen for the nominal plant: parameters on C make large ones costly
_PARTS = (0.5, 0.2, 0.0)


@dataclass(frozen=True)
class SourcedSearch:
    """What is known of a plant without a box of its state; user: constraints on open gains.

    stated: the problem with parameters; nominal: without them.
    """

    stated: Problem
    nominal: Problem
    budget: TimeBudget
    user: UserConstraints | None = None

    def completed(self, candidate: Candidate, gains: IntervalGains) -> Candidate:
        """The candidate with these gains, or parts of them, and certificates of its radius.

        cost: where the narrowest bounds are the objective, `claimed_width`.
        """
        gains = self.chosen(gains)
        width = sourced_width(gains, self._form, exact, inverse)
        low, high = gains.dwell_ends
        certificates = Certificates()
        if width.N is not None:
            certificates = dwell_certificates(
                width.W, width.N, low, high, **stability_options(self.stated, self.budget)
            )
        tubes: dict[str, Entries] = {}
        for source, system in width.systems.items():
            if self.budget.remaining() > 0:
                tube = proved_width(system, low, high, vanishing=True)
                tubes |= {} if tube is None else {source: tube}
        if len(tubes) == len(width.systems):
            solvers = solvers_of_tube(next(iter(width.systems.values())).N is not None)
            certificates = certificates.joined(Certificates({"source_width": tubes}, solvers))
        corrected = any(getattr(gains, name) is not None for name in CORRECTIONS)
        is_compared = objective_of(self.nominal) == "narrowest"
        return replace(
            candidate, gains=replace(gains, step_limit=None), certificates=certificates.evidence,
            searched=candidate.searched or corrected,
            cost=self.claimed_width(gains) if is_compared else None,
            solvers=merged(candidate.solvers, certificates.solvers),
        )  # fmt: skip

    def chosen(self, gains: IntervalGains) -> IntervalGains:
        """The gains, or with parts of open ones, of the least width that is claimed.

        Without gains on the measured part of effects too, whose own share of y may cost more; and
        with all of it taken from y, whatever its noise, without which there may be no limit.
        """
        best, least = gains, self.claimed_width(gains)
        plain = replace(gains, flow_correction=None, jump_correction=None)
        measured, x = self.nominal.plant.output.measured, self._signals.x
        whole = replace(plain, **corrections(gains, measured, x, 0 * gains.noise_bound))
        for own in (plain, whole):
            if (width := self.claimed_width(own)) < least:
                best, least = own, width
        for names in self._open(gains):
            for own in [self._with_part(best, names, part) for part in _PARTS]:
                if (width := self.claimed_width(own)) < least:
                    best, least = own, width
        return best

    def claimed_width(self, gains: IntervalGains) -> float:
        """The width, weighed as the problem says, for signals of `_sizes`; inf without a limit.

        In floats: what is claimed is proved afterwards.
        """
        try:
            width = sourced_width(gains, self._floats, as_floats, _float_inverse)
        except np.linalg.LinAlgError:
            return math.inf
        listed = [nearest(system) for system in width.systems.values()]
        sizes = np.array([self._sizes.get(source, 1.0) for source in width.systems])
        whole = replace(listed[0], f=sizes @ np.array([each.f for each in listed]))
        if whole.N is None:
            bounds = propose_limit(whole, vanishing=True)
        else:
            kicks = sizes @ np.array([each.at_jumps[1] for each in listed])
            bounds = propose_width(replace(whole, h=kicks), *gains.dwell_ends, vanishing=True)
        if bounds is None:
            return math.inf
        before = self.nominal.options_as(IntervalOptions).width == "pre_jump"
        widths = bounds["before_jump" if before and whole.N is not None else "always"]
        return float(width_weights(self.nominal) @ np.array(widths[gains.n :]))

    def _open(self, gains: IntervalGains) -> Iterator[tuple[str, ...]]:
        """Gains that are open and free, to be made smaller: both together, and each alone."""
        if gains.form == "cooperative":
            return
        entries = convex_gains(self.nominal.options_as(IntervalOptions), self.user).items()
        free = tuple(
            name
            for name, entry in entries
            if name not in self.nominal.gains and entry.is_free() and getattr(gains, name).any()
        )
        yield from dict.fromkeys([free, *((name,) for name in free)])

    def _with_part(
        self, gains: IntervalGains, names: tuple[str, ...], part: float
    ) -> IntervalGains:
        """The gains with a part of L or M, or of both, and the splits that these have."""
        L, M = (part * K if name in names else K for name, K in (("L", gains.L), ("M", gains.M)))
        frame = {} if gains.S is None else {"S": gains.S}
        own = gains_of_form(self.nominal, gains.form, L, M, frame)
        return replace(gains, L=L, M=M, D0=own.D0, D1=own.D1, Gp=own.Gp, Gn=own.Gn)

    @cached_property
    def _sizes(self) -> dict[str, float]:
        """Magnitudes of y, u and w by their names, for which the width is weighed."""
        sizes = self._signals
        return {
            name: float(value)
            for letter, values in (("y", sizes.y), ("u", sizes.u), ("w", sizes.w))
            for name, value in zip(numbered(letter, len(values)), values, strict=True)
        }

    @cached_property
    def _signals(self) -> SignalSizes:
        return SignalSizes.from_problem(self.stated, self.nominal)

    @cached_property
    def _form(self) -> NormalForm:
        return NormalForm.from_plant(self.stated.plant, exact)

    @cached_property
    def _floats(self) -> NormalForm:
        return NormalForm.from_plant(self.stated.plant, as_floats)


def as_floats(values: Array) -> Matrix:
    """Numbers as binary64 ones, each rounded once."""
    return np.asarray(values, np.float64)


def _float_inverse(S: Array) -> Matrix:
    return np.asarray(np.linalg.inv(as_floats(S)))
