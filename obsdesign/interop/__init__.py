"""Models, gains and estimates of other packages: scipy.signal, control, pandas, MATLAB.

`from_state_space` builds a Problem from a model, `save_mat` and `control_estimator` take a design
elsewhere, `to_frame` makes a table of estimates. Importing this imports none of those packages.
"""

from __future__ import annotations

from obsdesign.interop.export import control_estimator, save_mat
from obsdesign.interop.frames import to_columns, to_frame
from obsdesign.interop.state_space import from_state_space

__all__ = ["control_estimator", "from_state_space", "save_mat", "to_columns", "to_frame"]
