"""The matrix R(tau) of the time since a jump: proved exactly, and no changed number passes."""

from __future__ import annotations

import copy
import math

import numpy as np
import pytest

from lmi.arithmetic.arrays import NewEntries
from lmi.find.clock_matrix import find_clock_matrix, nodes_of
from lmi.parameters import AffineFamily
from lmi.prove.clock_matrix import prove_clock_matrix
from lmi.prove.parameter_cells import DEEPEST, prove_cells
from tests.lmi.parameter_examples import from_ranges, oscillator, sampled


def scalar(low: float, high: float, jump: float) -> AffineFamily:
    """x' = a x, a in [low, high]; x+ = jump x."""
    return from_ranges([[0]], [[jump]], [([[1]], [[0]])], [(low, high)])


# R rises from 1 to 2.5: R' = 1.5 < 2 R, and 2.5 > 1.5^2
BY_HAND = {"nodes": [0.0, 1.0], "R": [[[1.0]], [[2.5]]]}


def test_a_certificate_by_hand() -> None:
    verdict = prove_clock_matrix(scalar(-2, -1, 1.5), 1.0, math.inf, BY_HAND)
    assert verdict.outcome == "proved"
    # R_0, one of (b), two of (a) at two vertices, (c) at two
    assert verdict.evidence["matrices"] == 1 + 1 + 2 * 2 + 2


@pytest.mark.parametrize(
    ("family", "low", "high", "condition"),
    [
        (scalar(-2, -0.75, 1.5), 1.0, math.inf, "a"),  # R' = 2 * 0.75: not strict
        (scalar(-2, -1, 1.6), 1.0, math.inf, "b"),
        (scalar(-2, -1, 1.5), 0.0, math.inf, "b"),  # at the start R is too small for jumps
        (scalar(-2, -1, 1.5), 0.0, 1.0, "b"),
    ],
)  # fmt: skip
def test_each_condition_is_needed(
    family: AffineFamily, low: float, high: float, condition: str
) -> None:
    verdict = prove_clock_matrix(family, low, high, BY_HAND)
    assert verdict.outcome == "undecided"
    assert verdict.evidence["condition"] == condition


def test_a_form_that_waits_has_to_decay() -> None:
    """(c): the same certificate proves the one dwell time 1, and no longer ones."""
    falling = {"nodes": [0.0, 1.0], "R": [[[4.0]], [[1.0]]]}
    growing = scalar(0.1, 0.2, 0.4)
    assert prove_clock_matrix(growing, 1.0, 1.0, falling).outcome == "proved"
    verdict = prove_clock_matrix(growing, 1.0, 1.5, falling)
    assert verdict.evidence["condition"] == "c"


def test_without_time_jumps_alone_count() -> None:
    constant = {"nodes": [0.0], "R": [[[1.0]]]}
    assert prove_clock_matrix(scalar(3, 4, 0.9), 0.0, 0.0, constant).outcome == "proved"
    assert prove_clock_matrix(scalar(-2, -1, 0.9), 0.0, math.inf, constant).outcome == "proved"
    assert prove_clock_matrix(scalar(3, 4, 1.0), 0.0, 0.0, constant).outcome == "undecided"
    assert prove_clock_matrix(scalar(3, 4, 0.9), 0.0, 0.1, constant).outcome == "undecided"


@pytest.mark.parametrize(
    "changed",
    [
        {},
        {"nodes": [0.0, 1.0]},
        {"nodes": [], "R": []},
        {"nodes": [0.0, 1.0], "R": [[[1.0]]]},
        {"nodes": [0.0, 0.5, 1.0], "R": [[[1.0]]] * 4},
        {"nodes": [0.0, 1.0], "R": [[[1.0]], [[math.nan]]]},
        {"nodes": [0.0, math.inf], "R": [[[1.0]], [[2.5]]]},
        {"nodes": [1.0, 0.0], "R": [[[1.0]], [[2.5]]]},
        {"nodes": [0.0, 1.0, 1.0], "R": [[[1.0]], [[2.5]], [[2.5]]]},
        {"nodes": [0.1, 1.0], "R": [[[1.0]], [[2.5]]]},
        {"nodes": [0.0, 0.9], "R": [[[1.0]], [[2.5]]]},
        {"nodes": [0.0, 1.0], "R": [[1.0], [2.5]]},
        {"nodes": "no", "R": None},
    ],
)  # fmt: skip
def test_what_is_no_certificate_proves_nothing(changed: NewEntries) -> None:
    family = scalar(-2, -1, 1.5)
    assert prove_clock_matrix(family, 1.0, math.inf, changed).outcome == "undecided"
    assert prove_cells(family, 1.0, math.inf, changed).outcome == "undecided"


@pytest.fixture(scope="module")
def certificate() -> NewEntries:
    """Of the oscillator with +- 0.1, dwell times [1, 3]."""
    verdict = find_clock_matrix(oscillator(0.1), 1.0, 3.0)
    assert verdict.outcome == "proved"
    return {key: verdict.evidence[key] for key in ("nodes", "R")}


def test_numbers_of_a_file_prove_what_they_did(certificate: NewEntries) -> None:
    assert prove_cells(oscillator(0.1), 1.0, 3.0, certificate).outcome == "proved"


def test_forms_in_between_fall(certificate: NewEntries) -> None:
    """The proof looks at Bernstein coefficients: the polynomial itself, by de Casteljau, agrees."""
    nodes, R = np.array(certificate["nodes"]), np.array(certificate["R"])
    degree = (len(R) - 1) // (len(nodes) - 1)
    rng, family = np.random.default_rng(1), oscillator(0.1)

    def value(k: int, s: float) -> np.ndarray:
        points = R[k * degree : (k + 1) * degree + 1]
        while len(points) > 1:
            points = (1 - s) * points[:-1] + s * points[1:]
        return points[0]

    for k in range(len(nodes) - 1):
        h = nodes[k + 1] - nodes[k]
        for s in rng.uniform(0.01, 0.99, 4):
            A = np.array(family.flow([float(rng.uniform(-1, 1))]), dtype=float)
            slope = (value(k, s + 1e-5) - value(k, s - 1e-5)) / (2e-5 * h)
            form = A.T @ value(k, s) + value(k, s) @ A + slope
            assert np.linalg.eigvalsh(form)[-1] < 1e-8
            if nodes[k] >= 1:
                G = np.diag([1, 0.8])
                assert np.linalg.eigvalsh(value(k, s) - G @ R[0] @ G)[0] > -1e-12


def test_a_changed_coefficient_proves_nothing(certificate: NewEntries) -> None:
    for place in range(0, len(certificate["R"]), 5):
        changed = copy.deepcopy(certificate)
        changed["R"][place][0][0] *= 1.2
        assert prove_clock_matrix(oscillator(0.1), 1.0, 3.0, changed).outcome == "undecided"
    changed = copy.deepcopy(certificate)
    changed["R"][3][0][1] += 1e-9  # no longer symmetric
    assert prove_clock_matrix(oscillator(0.1), 1.0, 3.0, changed).outcome == "undecided"


def test_a_changed_node_proves_nothing(certificate: NewEntries) -> None:
    """A node moved far, or low that is none, or the end beyond the range."""
    nodes = certificate["nodes"]
    low = nodes.index(1.0)
    for place, node in ((2, 0.5 * (nodes[1] + nodes[2]) - 0.2), (low, 1.001), (-1, 3.001)):
        changed = copy.deepcopy(certificate)
        changed["nodes"][place] = node
        assert prove_clock_matrix(oscillator(0.1), 1.0, 3.0, changed).outcome == "undecided"


def test_the_problem_decides_what_is_proved(certificate: NewEntries) -> None:
    """Nothing of the vertices, ranges or dwell times is read from the certificate."""
    for family, low, high in (
        (oscillator(0.3), 1.0, 3.0), (oscillator(0.1), 1.0, 4.0), (oscillator(0.1), 0.5, 3.0),
    ):  # fmt: skip
        assert prove_clock_matrix(family, low, high, certificate).outcome == "undecided"
    # one end of the range alone would be proved: both are needed
    corner = oscillator(0.0)
    nominal = find_clock_matrix(corner, 1.0, 3.0).evidence
    assert prove_clock_matrix(corner, 1.0, 3.0, nominal).outcome == "proved"
    assert prove_clock_matrix(oscillator(0.3), 1.0, 3.0, nominal).outcome == "undecided"


def test_middle_and_half_are_not_the_same() -> None:
    """The twin of a range is the one with its middle and its half swapped."""
    family = from_ranges(
        [[0, 1], [0, -0.1]], np.diag([1, 0.8]), [([[0, 0], [-1, 0]], np.zeros((2, 2)))],
        [(0.9, 1.1)],
    )  # fmt: skip
    swapped = AffineFamily(family.A[[1, 0]], family.G, family.is_constant)
    verdict = find_clock_matrix(family, 1.0, 3.0)
    assert verdict.outcome == "proved"
    assert prove_cells(swapped, 1.0, 3.0, verdict.evidence).outcome == "undecided"


def test_cells_are_halves_of_constant_parameters(certificate: NewEntries) -> None:
    tree = {"parameter": 0, "halves": [certificate, certificate]}
    constant = oscillator(0.1, is_constant=True)
    verdict = prove_cells(constant, 1.0, 3.0, tree)
    assert verdict.outcome == "proved"
    assert verdict.evidence["cells"] == 2
    for changed in (
        {**tree, "halves": [certificate]}, {**tree, "parameter": 1}, {**tree, "parameter": -1},
        {**tree, "halves": None}, {**tree, "halves": [certificate, None]}, {"halves": []},
    ):  # fmt: skip
        assert prove_cells(constant, 1.0, 3.0, changed).outcome == "undecided"
    # a parameter that varies does not stay in its cell
    assert prove_cells(oscillator(0.1), 1.0, 3.0, tree).outcome == "undecided"


def test_a_certificate_proves_its_own_cell_alone() -> None:
    """Of four cells of a wide range, each certificate fails in the place of another."""
    family = oscillator(0.5, is_constant=True)
    certificates = []
    for half in family.halves(0):
        for quarter in half.halves(0):
            own = find_clock_matrix(quarter, 1.0, 3.0)
            certificates.append(own.evidence)
    a, b, c, d = certificates
    pair = [{"parameter": 0, "halves": [a, b]}, {"parameter": 0, "halves": [c, d]}]
    outcomes = [
        prove_cells(family, 1.0, 3.0, {"parameter": 0, "halves": halves}).outcome
        for halves in (pair, pair[::-1], [pair[0], pair[0]])
    ]
    assert outcomes[1:] == ["undecided"] * 2


def test_trees_have_an_end(certificate: NewEntries) -> None:
    tree = certificate
    for _ in range(DEEPEST + 1):
        tree = {"parameter": 0, "halves": [tree, certificate]}
    verdict = prove_cells(oscillator(0.1, is_constant=True), 1.0, 3.0, tree)
    assert verdict.outcome == "undecided"


@pytest.mark.parametrize(
    ("low", "high"), [(1.0, 3.0), (0.0, 2.0), (1.0, math.inf), (0.1, 0.1), (0.001, 1.0), (2.9, 3.0)]
)  # fmt: skip
@pytest.mark.parametrize("segments", [1, 8, 24])
def test_nodes_rise_from_zero_and_have_the_ends(low: float, high: float, segments: int) -> None:
    nodes = nodes_of(low, high, segments)
    assert nodes[0] == 0
    assert (np.diff(nodes) > 0).all()
    assert low in nodes
    assert nodes[-1] == (low if math.isinf(high) else high)


def test_a_short_shortest_dwell_time_needs_no_luck() -> None:
    """Jumps may follow each other soon: the margin of (b) falls with the dwell time."""
    assert find_clock_matrix(sampled(0.05), 0.001, 1.6).outcome == "proved"
