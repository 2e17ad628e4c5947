"""Graphs of modes: published minimum dwell times, beaten and refuted, and laws of the proof."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lmi.arithmetic.exponential import expm
from lmi.decide.mode_stability import decide_modes
from lmi.decide.stability import decide
from lmi.find.mode_search import find_modes
from lmi.modes import Modes
from lmi.prove.modes_proof import prove_modes
from lmi.refute.stays import refute_stays
from tests.lmi.modes_examples import FLOWS, switched, unstable_second

PROVED = [
    switched("W48", 2.7078),
    switched("W49", 0.6085),
    switched("W50", 1.8956),
    *(unstable_second(*ends) for ends in ((1, 1.28463), (2, 2.54701), (5, 6.21573), (7, 8.58029))),
]
REFUTED = [
    (switched("W48", 2.707749), ((0, 2.707749), (1, 3.042820))),
    (switched("W49", 0.607296), ((0, 0.882089), (1, 0.607296))),
    (switched("W50", 1.895191), ((0, 1.895191), (1, 2.553216))),
    *(
        (unstable_second(*ends), ((0, ends[0]), (1, ends[1])))
        # the last but one is a published value, which a cycle refutes
        for ends in ((1.0, 1.284732), (2.0, 2.54712), (2.0, 2.5473), (7.0, 8.580395))
    ),
]


@pytest.mark.parametrize("modes", PROVED)
def test_one_matrix_for_each_mode_beats_the_published_dwell_times(modes: Modes) -> None:
    verdict = decide_modes(modes)
    assert verdict.outcome == "proved"
    assert len(verdict.evidence["cells"]) == 2
    assert prove_modes(modes, verdict.evidence).outcome == "proved"
    assert prove_modes(modes, verdict.evidence, method="chords").outcome == "proved"


@pytest.mark.parametrize(("modes", "word"), REFUTED)
def test_a_cycle_of_stays_refutes_what_lies_just_beyond(
    modes: Modes, word: tuple[tuple[int, float], ...]
) -> None:
    assert refute_stays(modes, word).outcome == "refuted"
    longer = tuple((i, 1.5 * theta) for i, theta in word)
    assert refute_stays(modes, longer).outcome == "undecided"


def test_cycles_are_searched_on_a_grid_and_polished() -> None:
    verdict = decide_modes(switched("W50", 1.895191))
    assert verdict.outcome == "refuted"
    assert verdict.witness["spectral_radius"] == pytest.approx(1, abs=1e-5)
    (first, shortest), (second, stay) = sorted(verdict.witness["stays"])
    assert (first, second) == ("1", "2")
    assert shortest == 1.895191
    assert stay == pytest.approx(2.553216, abs=1e-5)


def test_history_cells_reach_further_than_one_matrix_for_each_mode() -> None:
    modes = switched("W49", 0.6078)
    assert find_modes(modes, most_cells=2).verdict.outcome == "undecided"
    several = find_modes(modes)
    assert several.verdict.outcome == "proved"
    assert len(several.cells) == 4
    assert prove_modes(modes, several.verdict.evidence).outcome == "proved"


def test_a_certificate_for_some_stays_is_none_for_shorter_ones() -> None:
    evidence = decide_modes(switched("W48", 2.7078)).evidence
    assert prove_modes(switched("W48", 2.7), evidence).outcome == "undecided"
    assert prove_modes(switched("W48", 2.8), evidence).outcome == "proved"


def test_cells_that_leave_out_stays_or_modes_prove_nothing() -> None:
    modes = switched("W49", 0.6078)
    cells = find_modes(modes).verdict.evidence["cells"]
    for k in range(len(cells)):
        fewer = {"cells": [cell for i, cell in enumerate(cells) if i != k]}
        assert "leave out stays" in prove_modes(modes, fewer).reason
    one = {"cells": [cell for cell in cells if cell["mode"] == 0]}
    assert "no cell is of mode 2" in prove_modes(modes, one).reason
    shifted = [{**cell, "stay": [cell["stay"][0] + 1e-9, cell["stay"][1]]} for cell in cells]
    assert "leave out stays" in prove_modes(modes, {"cells": shifted}).reason


@pytest.mark.parametrize(
    "certificate",
    [
        {},
        {"cells": []},
        {"cells": [{"mode": 0}]},
        {"cells": [{"mode": 5, "P": [[1, 0], [0, 1]]}]},
        {"cells": [{"mode": True, "P": [[1, 0], [0, 1]]}]},
        {"cells": [{"mode": k, "P": [[1, 2], [0, 1]]} for k in (0, 1)]},
        {"cells": [{"mode": k, "P": [[math.nan, 0], [0, 1]]} for k in (0, 1)]},
        {"cells": [{"mode": k, "P": [[-1, 0], [0, -1]]} for k in (0, 1)]},
    ],
)
def test_certificates_that_are_none_are_undecided(certificate: dict[str, object]) -> None:
    assert prove_modes(switched("W48", 2.7078), certificate).outcome == "undecided"


def test_a_mode_that_may_last_must_be_stable() -> None:
    flows = FLOWS["W60"]
    lasting = Modes.from_flows(flows, [(1, 2), (0.001, math.inf)], names=("cool", "heat"))
    verdict = decide_modes(lasting)
    assert verdict.outcome == "refuted"
    assert verdict.witness["mode"] == "heat"
    final = Modes.from_flows([flows[1], flows[0]], [(0.1, 1), (0, math.inf)], [[1], []])
    assert decide_modes(final).outcome == "proved"  # once in the stable mode, for ever
    assert decide_modes(final.with_stays([(0.1, math.inf), (0, math.inf)])).outcome == "refuted"


def test_two_modes_of_one_flow_with_an_entry_map_are_a_plant_with_jumps() -> None:
    A, G = [[-1, 0], [1, -2]], [[2, 1], [1, 3]]
    for low, expected in ((1.5, "proved"), (0.9, "refuted")):
        modes = Modes.from_flows([A, A], [(low, math.inf)] * 2, entry=[G, G])
        assert decide_modes(modes).outcome == expected == decide(A, G, low, math.inf).outcome


def test_paths_of_proved_modes_decay() -> None:
    rng = np.random.default_rng(5)
    names, flows = (0, 1, 2), [rng.normal(size=(3, 3)) - 2.2 * np.eye(3) for _ in range(3)]
    modes = Modes.from_flows(flows, [(0.6, 3)] * 3, [[1], [0, 2], [0]])
    verdict = decide_modes(modes)
    assert verdict.outcome == "proved"
    P = {cell["mode"]: np.array(cell["P"]) for cell in verdict.evidence["cells"]}
    assert set(P) == set(names)
    for _ in range(20):
        mode, x = int(rng.integers(3)), rng.normal(size=3)
        for _ in range(8):
            following = int(rng.choice(modes.following[mode]))
            y = expm(flows[mode] * rng.uniform(0.6, 3)) @ x
            assert y @ P[following] @ y < x @ P[mode] @ x
            mode, x = following, y


def test_stays_of_no_length_are_refuted() -> None:
    both = Modes.from_flows(FLOWS["W48"], [(0, 3)] * 2)
    assert decide_modes(both).outcome == "refuted"


@pytest.mark.parametrize("stays", [[(2, 1), (1, 2)], [(-1, 1), (1, 2)], [(math.inf, math.inf)] * 2])
def test_ranges_that_are_none_are_refused(stays: list[tuple[float, float]]) -> None:
    with pytest.raises(ValueError, match="low <= high"):
        Modes.from_flows(FLOWS["W48"], stays)
    with pytest.raises(ValueError, match="none follows"):
        Modes.from_flows(FLOWS["W48"], [(1, 2)] * 2, [[1], []])
