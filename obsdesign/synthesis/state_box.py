"""A box of the state of an uncertain plant, from a tube of |x|: proposals."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from lmi.arithmetic.arrays import Entries, EntriesByClaim, Matrix
from lmi.arithmetic.balls import exact
from lmi.solvers import Solvers
from obsdesign.analysis.widened import StateBounds, absolute_plant
from obsdesign.errors import DoesNotApply
from obsdesign.problem.plant import Plant
from obsdesign.synthesis.tube import proved_tube, solvers_of_tube


@dataclass(frozen=True)
class ProposedBox:
    """Bounds of x, the certificate that proves them, and the solvers that it took."""

    bounds: StateBounds
    certificate: Entries
    solvers: Solvers


def proposed_box(plant: Plant) -> ProposedBox:
    """A proved tube of |x|; DoesNotApply, with the reason, where there is none."""
    dwell = (0.0, np.inf)
    if plant.jump is not None and plant.jump.dwell_time is not None:
        dwell = plant.jump.dwell_time
    W, f, N, h = absolute_plant(plant, exact)
    certificate = proved_tube(W, f, N, h, ends=dwell, vanishing=True)
    if certificate is None:
        raise DoesNotApply("its |x| is not proved to stay bounded by itself", "state")
    always = np.array(certificate["always"])
    before = np.array(certificate.get("before_jump", certificate["always"]))
    bounds = StateBounds.proved(np.array(certificate["tube"]), always, before)
    return ProposedBox(bounds, certificate, solvers_of_tube(N is not None))


@dataclass(frozen=True)
class KnownBox:
    """Bounds of x, the certificates that prove them and the solvers that these took."""

    bounds: StateBounds
    certificates: EntriesByClaim = field(default_factory=dict)
    solvers: Solvers = ()

    @property
    def units(self) -> Matrix:
        """Half-widths of the box (n,), in which bounds of the error are added."""
        half: Matrix = (self.bounds.upper - self.bounds.lower) / 2
        return np.where(half > 0, half, half.max(initial=0.0) or 1.0)


def known_state_box(plant: Plant) -> KnownBox | None:
    """The box that effects of parameters are bounded in, stated or proved; None where none is."""
    if (stated := StateBounds.stated(plant)) is not None:
        return KnownBox(stated)
    try:
        box = proposed_box(plant)
    except DoesNotApply:
        return None
    return KnownBox(box.bounds, {"state_box": box.certificate}, box.solvers)
