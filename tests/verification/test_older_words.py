"""Designs with sentences of earlier releases verify as those in the words of today."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

import obsdesign
from obsdesign.document import Design
from obsdesign.problem.problem import Problem
from obsdesign.verification.same_evidence import current_statement

RATE = {
    "flow": {"A": [[0.5]]},
    "output": {"C": [[1]], "noise_bound": 0.1},
    "observer": {"kind": "luenberger", "decay_rate": 0.75},
}
JUMPS = {
    "flow": {
        "A": [[-1, 0.2], [1, -2]],
        "disturbance": {"lower": [-0.1, -0.1], "upper": [0.1, 0.1]},
    },
    "jump": {"G": [[0.5, 0], [0, 0.5]], "dwell_time": [0.5, 1.0]},
    "output": {"C": [[0, 1]], "noise_bound": 0.1},
    "observer": {"kind": "set_membership", "window": 4},
}
UNSTABLE = {
    "flow": {"A": [[-0.5]]},
    "parameter": [{"name": "k", "range": [0.0, 1.0], "A": [[1.0]]}],
    "output": {"C": [[1]]},
    "observer": {"kind": "luenberger"},
}
# today's words, those of before, and words that are false
WORDS = [
    (RATE, "decay_rate = 0.75 is required", "the rate 0.75 was asked for",
     "the rate 0.95 was asked for"),
    (JUMPS, "the state is observable along flow and jumps: the samples of a window determine it, "
     "except at spacings at which modes alias",
     "along flow and jumps no part of the state stays unseen: samples of a window determine the "
     "state, spacings apart at which modes alias",
     "along flow and jumps no part of the state stays unseen: samples of a window determine the "
     "state"),
    (UNSTABLE, "is not stable for all its parameters, so that the estimation error need not tend "
     "to zero:", "does not tend to zero for all its parameters, nor need the estimation error then:",
     "tends to zero for all its parameters, and the estimation error too:"),
]  # fmt: skip
OTHERS = [
    ("the window's start. The samples do not bound all of that, modes that die within a period: "
     "the bounds that run are infinite.",
     "the window's start. The samples do not bound modes that decay within one period, so that "
     "the bounds at run time are infinite."),
    ("It is not proved that the plant by itself tends to zero for all its parameters, on which it "
     "depends whether the estimation error does.",
     "The plant by itself is not proved stable for all its parameters; where it is not, the "
     "estimation error need not tend to zero."),
    ("While tick may have happened or not, the bounds contain both.",
     "While tick may have happened or not, the bounds contain the states of both cases."),
    ("larger ones evaluated too early: the evidence of `uniqueness` tells the weights)",
     "larger ones evaluated too early: the evidence of `uniqueness` states the weights)"),
    ("Negative weights are not looked for. ", "Negative weights are excluded. "),
]  # fmt: skip


def _reworded(design: Design, now: str, before: str) -> Design:
    claims = tuple(replace(x, statement=x.statement.replace(now, before)) for x in design.claims)
    guarantees = tuple(
        replace(x, statement=x.statement.replace(now, before)) for x in design.guarantees
    )
    warnings = tuple(x.replace(now, before) for x in design.warnings or ())
    return replace(design, claims=claims, guarantees=guarantees, warnings=warnings)


@pytest.mark.parametrize(("body", "now", "before", "false"), WORDS)
def test_a_design_in_words_of_before_is_proved(
    body: dict[str, Any], now: str, before: str, false: str
) -> None:
    design = obsdesign.investigate(Problem.from_dict(body)).design
    assert design is not None
    verdict = obsdesign.verify(design).verdict
    older, forged = (_reworded(design, now, words) for words in (before, false))
    assert older != design
    assert obsdesign.verify(older).verdict == verdict != "refuted"
    # the twin: words that no release had for it
    assert obsdesign.verify(forged).verdict == "refuted"


@pytest.mark.parametrize(("before", "now"), OTHERS)
def test_sentences_of_before_are_those_of_today(before: str, now: str) -> None:
    assert current_statement(before) == now == current_statement(now)
