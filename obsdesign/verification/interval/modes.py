"""Interval observers of plants with modes: enclosure, stability, width at entry into modes.

The width obeys w' = W_i w + f_i in mode i, w+ = |G_j| w on entry into mode j, and w+ = |G| w + h at
an event; its tube is that of `mode_width`.
"""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Entries, EntriesByClaim, NewEntries
from lmi.arithmetic.balls import exact, inverse
from lmi.modes import Modes
from lmi.time_budget import UNLIMITED, TimeBudget
from obsdesign.analysis.interval.mode_graph import ModeSystem
from obsdesign.analysis.modes import FORMS, graph_of_spans, stays_text
from obsdesign.document import Claim, Guarantee
from obsdesign.equations.gains import plant_data
from obsdesign.equations.interval.gains import IntervalGains, shaped_data
from obsdesign.equations.interval.width import WidthSystem
from obsdesign.equations.modes import SwitchedGains
from obsdesign.problem.options import IntervalOptions
from obsdesign.problem.problem import Problem
from obsdesign.verification.interval.claims import sign_claims
from obsdesign.verification.interval.mode_width import (
    WIDTH,
    stability_of_modes,
    width_claim,
    width_text,
)
from obsdesign.verification.modes import STABILITY, consistent_modes, in_all_modes
from obsdesign.verification.same_evidence import ROUNDED_WIDTHS
from obsdesign.verification.state_widths import StateWidths, widths_of_claim

_NO_WIDTH = (
    "No width of the bounds is proved: no tube was found on a graph of entries and events. Longer "
    "times between events, or fewer of them, leave smaller graphs; the bounds of each row hold."
)
_ENCLOSURE = (
    "The bounds contain the state at every instant, if they contain it at the start, b and v stay "
    "inside their bounds and changes of mode are reported at their times; this holds for samples "
    "at any spacing, missing ones included, and for any stays."
)


def claims(
    problem: Problem,
    stored: Entries,
    certificates: EntriesByClaim,
    *,
    paranoid: bool = False,
    budget: TimeBudget = UNLIMITED,
) -> tuple[Claim, ...]:
    """All hypotheses of the design, each with its verdict.

    certificates: {"mode_stability": cells with their P, "mode_width": {"entry": ..., "always":
    ...}}; they are checked.
    """
    del budget  # proofs end by their number of boxes
    agreement, gains = consistent_modes(problem, stored, expected_gains, IntervalGains)
    if gains is None:
        return (agreement,)
    signs = [sign_claims(own) for own in gains.gains]
    listed = [agreement]
    for name in ("flow_positive", "jump_positive"):
        own = [(k, claim) for k, each in enumerate(signs) for claim in each if claim.id == name]
        if own:
            names = [gains.names[k] for k, _ in own]
            listed.append(in_all_modes(names, [claim for _, claim in own]))
    system = mode_system(gains)
    listed.append(stability_of_modes(system, certificates.get(STABILITY, {}), paranoid))
    return (*listed, *width_claim(system, certificates.get(WIDTH, {})))


def error_modes(problem: Problem, stored: Entries) -> Modes:
    """The graph of modes whose paths are claimed to tend to zero: the width's."""
    del problem
    return width_modes(mode_system(SwitchedGains.from_document(stored, IntervalGains)))


def mode_system(gains: SwitchedGains[IntervalGains]) -> ModeSystem:
    """The width systems of all modes, exact."""
    return ModeSystem(
        gains, tuple(WidthSystem.from_gains(own, exact, inverse) for own in gains.gains)
    )  # fmt: skip


def width_modes(system: ModeSystem) -> Modes:
    """The graph of modes that the width takes, without events."""
    widths = system.widths
    return graph_of_spans(
        system.gains.spans, [own.W for own in widths], [own.N for own in widths]
    )  # fmt: skip


def expected_gains(problem: Problem, place: int, stored: Entries) -> Entries:
    """Entries of the stored gains of a mode: the value that the problem fixes, or its shape."""
    plant, n, p = problem.plant.in_mode(place, entered=True), problem.plant.n, problem.plant.p
    form = problem.options_as(IntervalOptions).form
    expected: NewEntries = {"form": set(FORMS) if form == "auto" else {form}}
    expected |= plant_data(plant) | {"L": (n, p), "M": np.zeros((n, p)), "D0": (n, n), "D1": (n, n)}
    expected |= {} if plant.jump is None else {"Gp": (n, n), "Gn": (n, n)}
    expected |= {name: value for name, value in shaped_data(plant).items() if name in stored}
    return expected | dict(problem.in_modes[place].gains)


def guarantees(problem: Problem, claims: tuple[Claim, ...]) -> tuple[Guarantee, ...]:
    """The sentences a user may rely on, and those that were required and not proved."""
    verdicts = {claim.id: claim.verdict for claim in claims}
    names: tuple[str, ...] = ("consistent", "flow_positive", "jump_positive")
    enclosing = [name for name in names if name in verdicts]
    measured, stays = "With y measured continuously", stays_text(problem)
    when = f"for all sequences of modes with stays {stays}"
    sentences: list[tuple[str, list[str]]] = [
        (_ENCLOSURE, enclosing),
        (
            f"{measured}, the width of the bounds stays bounded {when}, and without disturbance "
            "and noise it tends to zero as modes change.",
            [*enclosing, STABILITY],
        ),
    ]
    for claim in claims:
        if claim.id == WIDTH and claim.verdict == "proved":
            text = width_text([mode.name for mode in problem.plant.modes], claim)
            ids = [*enclosing, WIDTH]
            sentences.append((f"{measured}, asymptotically the width is at most {text}.", ids))
    entries = [Guarantee.from_verdicts(text, ids, verdicts) for text, ids in sentences]
    return (*entries, Guarantee.from_verdicts(ROUNDED_WIDTHS, enclosing, verdicts))


def states(problem: Problem, claims: tuple[Claim, ...]) -> tuple[StateWidths, ...]:
    """Sensor strip and proved width of each state, the largest of all modes."""
    return widths_of_claim(problem, claims, WIDTH)


def warnings(problem: Problem, claims: tuple[Claim, ...]) -> tuple[str, ...]:
    """A sentence where the bounds are stable and no width of them is proved."""
    del problem
    verdicts = {claim.id: claim.verdict for claim in claims}
    return () if verdicts.get(STABILITY) != "proved" or WIDTH in verdicts else (_NO_WIDTH,)
