"""A box of the state of an uncertain plant, from a tube of |x|: proposals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Entries
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
