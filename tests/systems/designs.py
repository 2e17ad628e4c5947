"""Outcomes that several tests look at: made once in a process, since they are frozen."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import obsdesign
from obsdesign.document import Design
from obsdesign.workflow import NotProved, Outcome


def designed(body: dict[str, Any], *, allow_undecided: bool = False) -> Design:
    """The design of a problem, as `obsdesign.design` has it; equal problems share one."""
    outcome = investigated(body)
    accepted = ("proved", "undecided") if allow_undecided else ("proved",)
    if outcome.verdict not in accepted or outcome.design is None:
        raise NotProved(outcome)
    return outcome.design


def investigated(body: dict[str, Any]) -> Outcome:
    """The outcome of a problem, `obsdesign.investigate`; equal problems share one."""
    return _investigated(json.dumps(body, default=np.ndarray.tolist))


@cache
def _investigated(text: str) -> Outcome:
    return obsdesign.investigate(obsdesign.Problem.from_dict(json.loads(text)))


@cache
def investigated_file(path: Path) -> Outcome:
    """The outcome of a problem file."""
    return obsdesign.investigate(obsdesign.load_problem(path))


@cache
def paranoid_verdict(path: Path) -> str:
    """What the paranoid verification says of the design of a problem file."""
    design = investigated_file(path).design
    assert design is not None
    return obsdesign.verify(design, paranoid=True).verdict
