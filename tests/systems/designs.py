"""Designs that several tests of a file look at: made once in a process, since they are frozen."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

import numpy as np

import obsdesign
from obsdesign.document import Design


def designed(body: dict[str, Any], *, allow_undecided: bool = False) -> Design:
    """The design of a problem, `obsdesign.design`; equal problems share one."""
    return _designed(json.dumps(body, default=np.ndarray.tolist), allow_undecided)


@cache
def _designed(text: str, allow_undecided: bool) -> Design:
    problem = obsdesign.Problem.from_dict(json.loads(text))
    return obsdesign.design(problem, allow_undecided=allow_undecided)
