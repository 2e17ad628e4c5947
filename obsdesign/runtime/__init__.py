"""Run a designed observer: numpy and the standard library only.

from obsdesign.runtime import Sample, load
observer = load("design.json")
state = observer.init(t=0.0, lower=[0, 0], upper=[2, 2])
state, estimate = observer.step(state, Sample(0.1, y=[0.4]))

Known inputs are stated at the time of init, in the first sample, Sample(0.0, u=[5.0]); else they
are zero at first.
"""

from obsdesign.runtime.base import Estimate, Sample
from obsdesign.runtime.bounds import Bounds
from obsdesign.runtime.load import from_design, load
from obsdesign.runtime.replay import Replay

__all__ = ["Bounds", "Estimate", "Replay", "Sample", "from_design", "load"]
