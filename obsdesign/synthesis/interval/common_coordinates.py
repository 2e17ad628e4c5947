"""Coordinates in which a nominal plant and effects of parameters are nearly diagonal.

Where A and all A_i have common eigenvectors S, the radius of z, x = S z, sees |S^-1 A_i S| without
entries off the diagonal: an exchange between rooms adds nothing to their sum. They are eigenvectors
of a sum of all matrices with weights that have no relation to each other; where there are none, the
eigenvectors of one effect alone serve.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.analysis.balancing import BalancedPlant
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.equations.parameters import NormalForm
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.interval.coordinates import eigenbasis
from obsdesign.synthesis.interval.descent import best_gains, solvers_of_gains
from obsdesign.synthesis.interval.forms import gains_of_form
from obsdesign.synthesis.interval.sourced_width import SourcedSearch, as_floats
from obsdesign.synthesis.interval.task import GainSearch

# golden ratio: no small integers relate its powers
_GOLDEN = 0.5 * (1 + math.sqrt(5))
# of the nominal matrix and of C'C beside effects: they settle which eigenvectors of an eigenvalue
# that is repeated are taken, such that C misses as many as it can
_SMALL, _SMALLER = 2.0**-20, 2.0**-32


def common_bases(
    nominal: Matrix, effects: Sequence[Matrix], units: BalancedPlant
) -> Iterator[Matrix]:
    """Yield bases S of eigenvectors of all matrices and of single ones, without repetition."""
    own, others = _unit(units.map(nominal)), _directions(units.map(X) for X in effects)
    if not others:
        return
    weighed = [X * _GOLDEN**-k for k, X in enumerate(others)]
    sums = [share * own + sum(weighed) for share in (1.0, 0.125, _SMALL)]
    yielded: list[Matrix] = []
    unseen = _SMALLER * _unit(units.C.T @ units.C)
    for X in (*sums, *(_SMALL * own + each for each in others)):
        S = eigenbasis(X + unseen)
        if S is not None and not any(np.allclose(S, other) for other in yielded):
            yielded.append(S)
            yield units.sizes[:, None] * S


@dataclass(frozen=True)
class CommonCoordinates:
    """The search for such coordinates.

    completed: gains with the parameters of the plant; sourced: what is claimed of them.
    """

    completed: Callable[[IntervalGains], IntervalGains]
    sourced: SourcedSearch

    def candidates(self, search: GainSearch) -> Iterator[Candidate]:
        """Yield that of the basis with the least width that is claimed; none without a limit."""
        plant, best, least = search.problem.plant, None, math.inf
        form = NormalForm.from_plant(self.sourced.stated.plant, as_floats)
        bases = list(common_bases(plant.flow.A, form.on("A"), search.units))
        if plant.jump is not None:
            bases += common_bases(plant.jump.G, form.on("G"), search.units)
        for S in bases:
            task = search.task(False, S)
            (_, L, M), remarks = best_gains(task, search.objective, search.budget)
            own = dict(zip(("L", "M"), task.gains(L, M), strict=True)) | dict(search.given)
            gains = gains_of_form(search.problem, "coordinates", own["L"], own["M"], {"S": S})
            gains = self.sourced.chosen(self.completed(gains))
            if (width := self.sourced.claimed_width(gains)) < least:
                least = width
                best = Candidate(
                    "coordinates", gains, searched=True, remarks=remarks,
                    solvers=solvers_of_gains(task),
                )  # fmt: skip
        if best is not None:
            yield best


def _directions(effects: Iterable[Matrix]) -> list[Matrix]:
    """Effects without their sizes and signs, each once, in an order that is theirs."""
    listed: dict[tuple[float, ...], Matrix] = {}
    for X in map(_unit, effects):
        if X.any():
            X = np.round(X * 2.0**40) / 2.0**40 * np.sign(X.flat[np.flatnonzero(X)[0]])
            listed.setdefault(tuple(X.ravel().tolist()), X)
    return [listed[key] for key in sorted(listed)]


def _unit(X: Matrix) -> Matrix:
    size = float(np.abs(X).max(initial=0.0))
    return X / size if size > 0 else X
