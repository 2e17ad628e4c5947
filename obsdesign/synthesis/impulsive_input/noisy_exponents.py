"""Exponents for records with noise: those that leave times and weights least uncertain.

With `gls` every further kernel leaves more of the record in the features, with the plain norm it
adds noise. So IPOPT starts with several numbers of exponents (`exponent_program`), from those of
the rule and from spread ones, with the slowest exponent of the rule as a limit, hence its ratio.
The smallest number within 2 % of the best is taken, if it is better than the rule by 2 % and worse
in neither time nor weight; for its claims, as for all others, a proof is due.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.time_budget import TimeBudget, remark_end
from obsdesign.equations.impulsive_input.deviations import Deviations, NoisyImpulses
from obsdesign.equations.impulsive_input.features import neglected_ratio
from obsdesign.equations.impulsive_input.sampling import MAX_EXPONENT_PERIOD
from obsdesign.synthesis.impulsive_input.exponent_program import ExponentProgram
from obsdesign.synthesis.impulsive_input.exponents import (
    ExponentChoice,
    largest_ratio,
    rule_choices,
    rule_or_none,
)
from obsdesign.synthesis.impulsive_input.integral_window import IntegralWindow

_LEAST_GAIN = 0.98  # deviation against the rule's, from which another choice counts
_SAME = 1.02  # deviation against the best one's, up to which fewer exponents are preferred
_CONFIRMED = 1.001  # deviation against IPOPT's, up to which evenly spaced exponents are kept
_FASTEST = 6.0  # exponents may be this much faster than the slowest
_BITS = 20  # of exponents from IPOPT


@dataclass(frozen=True)
class _Rated:
    """Exponents (m,), and the deviations of an impulse of weight 1."""

    exponents: Matrix
    deviations: Deviations


def exponent_choices(integral: IntegralWindow, budget: TimeBudget) -> Iterator[ExponentChoice]:
    """Yield exponents in order of preference: better ones in noise, then those of the rule."""
    first, *others = rule_choices(integral)
    search = _Search.from_rule(integral, first)
    yield from [first] if search is None else search.choices(budget)
    yield from others


@dataclass(frozen=True)
class _Search:
    """Exponents beside those of a rule, of the same rule of evaluation and ratio.

    impulses: with the exponents of the rule; neglected: what (15) may neglect; fastest: limit of
    the exponents.
    """

    integral: IntegralWindow
    rule: ExponentChoice
    impulses: NoisyImpulses
    neglected: float
    fastest: float

    @classmethod
    def from_rule(cls, integral: IntegralWindow, rule: ExponentChoice) -> _Search | None:
        """None where there is no noise to rate exponents by, or a threshold evaluates impulses."""
        if rule.rule == "threshold":
            return None
        gains = integral.gains(rule.exponents, rule.rule)
        impulses = NoisyImpulses.from_gains(integral.D, gains)
        if impulses is None:
            return None
        ratio, _ = neglected_ratio(integral.features(rule.exponents))
        slowest, fastest = float(rule.exponents[0]), float(rule.exponents[-1])
        steepest = _FASTEST * slowest
        if gains.period is not None:
            steepest = max(steepest, -MAX_EXPONENT_PERIOD / gains.period)
        return cls(
            integral, rule, impulses, max(ratio, largest_ratio(integral)) * (1 + 1e-6),
            min(fastest, steepest),
        )  # fmt: skip

    def choices(self, budget: TimeBudget) -> Iterator[ExponentChoice]:
        """Yield what is better than the rule, if anything is; then the rule."""
        own = self._rated(self.rule.exponents)
        if own is None or budget.remaining() <= 0:
            yield replace(self.rule, remarks=remark_end("exponents", budget.ended()))
            return
        rated = [best for count in self._counts() if (best := self._best(count, budget))]
        remarks = remark_end("exponents", budget.ended())
        rule = replace(self.rule, solvers=("IPOPT",))
        chosen = self._chosen(own, rated)
        if chosen is not None:
            label = (
                f"{len(chosen.exponents)} exponents{self._gain(chosen.deviations, own.deviations)}"
            )
            yield replace(rule, label=label, exponents=chosen.exponents, remarks=remarks)
            remarks = ()
        else:
            result = ", confirmed by IPOPT" if rated else "; IPOPT did not converge"
            rule = replace(rule, label=f"{rule.label}{result}")
        yield replace(rule, remarks=remarks)

    def _counts(self) -> tuple[int, ...]:
        """Increasing numbers of exponents: floats tell all kernels but one apart."""
        n = self.integral.problem.plant.n
        if self.integral.weighting != "gls":
            return (2,) if n == 1 else (n + 1, 2 * n)
        more = [2 * n + 2, 2 * n + 4]
        sets = (self.rule.family(count) for count in more)
        distinct = [self.impulses.with_exponents(even).distinct_kernels() for even in sets]
        return (2 * n, *(m for m, r in zip(more, distinct, strict=True) if r >= m - 1))

    @staticmethod
    def _chosen(own: _Rated, rated: list[_Rated]) -> _Rated | None:
        """The smallest number within 2 % of the best, if it is better than the rule."""
        least = min((each.deviations.size for each in rated), default=np.inf)
        for each in rated:
            if each.deviations.size <= _SAME * least:
                better = each.deviations.size <= _LEAST_GAIN * own.deviations.size
                return each if better and each.deviations.at_most(own.deviations) else None
        return None

    def _best(self, count: int, budget: TimeBudget) -> _Rated | None:
        """The best exponents of a number; None where IPOPT comes to none."""
        even = self.rule.family(count)
        start = self._rated(even)
        if start is None:
            return None
        impulses = self.impulses.with_exponents(even)
        age = impulses.age()
        program = ExponentProgram(impulses, age, impulses.limit(age)[1], self.fastest)
        solutions = [
            self._rated(np.minimum(_rounded(exponents), even[0]))
            for exponents in program.solutions(self._starts(even), budget)
        ]
        if not solutions:
            return None
        best = min(
            (each for each in solutions if each is not None),
            key=lambda each: each.deviations.size, default=start,
        )  # fmt: skip
        is_even = start.deviations.size <= _CONFIRMED * best.deviations.size
        return start if is_even else best

    def _starts(self, even: Matrix) -> list[Matrix]:
        """Exponents next to the rule's, and half of them spread up to the fastest."""
        near = np.maximum(1.05 * even, self.fastest)
        half = len(even) // 2
        spread = np.geomspace(even[half - 1], 0.9 * self.fastest, len(even) - half + 1)
        return [near, np.concatenate([even[:half], spread[1:]])]

    def _rated(self, exponents: Matrix) -> _Rated | None:
        """Exponents with their deviations; None where they do not do what the rule's do."""
        if exponents[-1] < self.fastest or rule_or_none(self.integral, exponents) != self.rule.rule:
            return None
        if neglected_ratio(self.integral.features(exponents))[0] > self.neglected:
            return None
        try:
            deviations = self.impulses.with_exponents(exponents).deviations()
        except ValueError:  # floats cannot follow the features
            return None
        return _Rated(exponents, deviations) if np.isfinite(deviations.size) else None

    def _gain(self, chosen: Deviations, own: Deviations) -> str:
        """Deviations against those of the rule, as a clause of the label."""
        if self.integral.problem.plant.output.measured != "periodic":
            time, weight = chosen.time / own.time, chosen.weight / own.weight
            return f": times {time:.3g} and weights {weight:.3g} times as uncertain as by rule"
        return (
            f": deviation of time {chosen.time:.3g} instead of {own.time:.3g}, of weight "
            f"{chosen.weight:.3g} instead of {own.weight:.3g} (impulses of weight 1 at the "
            "shortest dwell time)"
        )


def _rounded(exponents: Matrix) -> Matrix:
    """Exponents with the bits that matter, in any unit: other machines come to the same."""
    parts, powers = np.frexp(exponents)
    return np.asarray(np.ldexp(np.round(np.ldexp(parts, _BITS)), powers - _BITS))
