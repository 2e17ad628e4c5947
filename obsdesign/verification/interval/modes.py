"""Interval observers of plants with modes: enclosure, stability, width at entry into modes.

The width obeys w' = W_i w + f_i in mode i and w+ = |G_j| w on entry into mode j; its tube is that
of `lmi.bounds.mode_tube`.
"""

from __future__ import annotations

from dataclasses import replace
from decimal import ROUND_CEILING

import numpy as np

from lmi.arithmetic.arrays import Entries, EntriesByClaim, NewEntries
from lmi.arithmetic.balls import exact, inverse
from lmi.bounds.mode_tube import prove_mode_tube
from lmi.modes import Modes
from lmi.time_budget import UNLIMITED, TimeBudget
from obsdesign.analysis.modes import FORMS, graph_of_spans, stays_text
from obsdesign.document import Claim, Guarantee
from obsdesign.equations.gains import plant_data
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.equations.interval.width import WidthSystem
from obsdesign.equations.modes import SwitchedGains
from obsdesign.problem.options import IntervalOptions
from obsdesign.problem.problem import Problem
from obsdesign.verification.interval.claims import sign_claims
from obsdesign.verification.modes import (
    STABILITY,
    consistent_modes,
    in_all_modes,
    stability_claim,
)
from obsdesign.verification.rates import six_digits
from obsdesign.verification.same_evidence import ROUNDED_WIDTHS

WIDTH = "mode_width"
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
    systems = width_systems(gains)
    modes = width_modes(gains, systems)
    what = "the width w, w' = W w with W = D0 + D1 in each mode,"
    listed.append(stability_claim(modes, certificates.get(STABILITY, {}), what, paranoid))
    return (*listed, *width_claim(modes, systems, certificates.get(WIDTH, {})))


def error_modes(problem: Problem, stored: Entries) -> Modes:
    """The graph of modes whose paths are claimed to tend to zero: the width's."""
    del problem
    gains = SwitchedGains.from_document(stored, IntervalGains)
    return width_modes(gains, width_systems(gains))


def width_systems(gains: SwitchedGains[IntervalGains]) -> list[WidthSystem]:
    """The width system of each mode, exact."""
    return [WidthSystem.from_gains(own, exact, inverse) for own in gains.gains]


def width_modes(gains: SwitchedGains[IntervalGains], systems: list[WidthSystem]) -> Modes:
    """The graph of modes that the width takes."""
    return graph_of_spans(
        gains.spans, [system.W for system in systems], [system.N for system in systems]
    )


def width_claim(
    modes: Modes, systems: list[WidthSystem], proposed: Entries
) -> tuple[Claim, ...]:  # fmt: skip
    """Claim of proposed widths at entry into each mode, and at all times; none without any."""
    bounds = [proposed.get(name) for name in ("entry", "always")]
    shape = (len(modes), len(modes.flows[0]))
    try:
        entry, always = (np.array(values, dtype=np.float64) for values in bounds)
    except (TypeError, ValueError):
        return ()
    if any(x.shape != shape or not np.isfinite(x).all() for x in (entry, always)):
        return ()
    inputs = [system.f for system in systems]
    verdict = prove_mode_tube(modes, inputs, entry=exact(entry), always=exact(always))
    evidence: NewEntries = {"entry": entry.tolist(), "always": always.tolist()}
    verdict = replace(verdict, evidence={**evidence, **verdict.evidence})
    statement = (
        f"the width of the bounds comes to at most entry on entry into each mode "
        f"({', '.join(modes.names)}), and always at any time in it: a tube that the width system "
        "w' = W w + f, w+ = |G| w does not leave and is drawn to"
    )
    return (Claim.from_verdict(WIDTH, statement, "tube on the graph of modes", verdict),)


def expected_gains(problem: Problem, place: int, stored: Entries) -> Entries:
    """Entries of the stored gains of a mode: the value that the problem fixes, or its shape."""
    del stored
    plant, n, p = problem.plant.in_mode(place, entered=True), problem.plant.n, problem.plant.p
    form = problem.options_as(IntervalOptions).form
    expected: NewEntries = {"form": set(FORMS) if form == "auto" else {form}}
    expected |= plant_data(plant) | {"L": (n, p), "M": np.zeros((n, p)), "D0": (n, n), "D1": (n, n)}
    expected |= {} if plant.jump is None else {"Gp": (n, n), "Gn": (n, n)}
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
            text = _width_text([mode.name for mode in problem.plant.modes], claim)
            ids = [*enclosing, WIDTH]
            sentences.append((f"{measured}, asymptotically the width is at most {text}.", ids))
    entries = [Guarantee.from_verdicts(text, ids, verdicts) for text, ids in sentences]
    return (*entries, Guarantee.from_verdicts(ROUNDED_WIDTHS, enclosing, verdicts))


def _width_text(names: list[str], claim: Claim) -> str:
    """Widths of all modes in words, (0.6, 0.03) on entry into open."""
    entry, always = claim.evidence["entry"], claim.evidence["always"]
    words = [
        f"({', '.join(map(_six_digits, at))}) on entry into {name} and "
        f"({', '.join(map(_six_digits, ever))}) at any time in it"
        for name, at, ever in zip(names, entry, always, strict=True)
    ]
    return "; ".join(words)


def _six_digits(value: float) -> str:
    """A width with six digits, rounded up."""
    return six_digits(value, ROUND_CEILING)
