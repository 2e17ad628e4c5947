"""Ahn, Unknown Inputs Observer Design Via Block Pulse Functions, TCASE 4 (2002).

Every number printed in the paper, or ours where the print is wrong (docs/papers.md). The paper's
tables give |e|_2/m over the cells, not the root mean square. Its simulations: h = 0.1, m = 100,
w(0) = 0, classical Runge-Kutta, x(0) = (-1, -1, 1) in example 1 and (5, -3, 5) in example 2, and a
final time of 10 in both.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from docs.figures import block_pulse
from docs.figures.ahn import (
    FIRST,
    SECOND,
    H,
    M,
    block_pulse_estimates,
    euler,
    gains,
    plant,
    runge_kutta,
    simulink_estimates,
)
from obsdesign.analysis.invariant_zeros import shows_every_input, zeros_decay

EXAMPLES = Path(__file__).parents[2] / "examples"


def errors(estimates: tuple[np.ndarray, ...], d: np.ndarray, first: int = 0) -> list[float]:
    x, x_hat, d_hat = (values[first:] for values in estimates)
    states = np.linalg.norm(x - x_hat, axis=0) / M
    return [*states, *np.linalg.norm(d_hat - d, axis=0) / M]


# --- matrices -----------------------------------------------------------------------------------


def test_example_1_matrices() -> None:
    g = gains("ahn_1")
    expected = {"F": [[-4]], "H": [[0, -3]], "Q": [[2], [-1]], "R": [[2, 5], [0, 0]],
                "N": [[1, 0], [0, 1]]}  # fmt: skip
    for name, value in expected.items():
        np.testing.assert_allclose(g[name], value, atol=1e-12, err_msg=name)
    # (38): W_1 = [0 -0.125] Y_1, factor 2/3
    half = H / 2 * g["F"]
    np.testing.assert_allclose(np.linalg.solve(1 - half, H / 2 * g["H"]), [[0, -0.125]], atol=1e-12)
    np.testing.assert_allclose((1 + half) / (1 - half), 2 / 3, atol=1e-12)


def test_example_2_matrices() -> None:
    g = gains("ahn_2")
    expected = {"F": [[-6, 0], [0, -1]], "H": [[0, 5], [0, 1]], "Q": [[5, 1]], "R": [[1, -5]],
                "N": [[1, 0]]}  # fmt: skip
    for name, value in expected.items():
        np.testing.assert_allclose(g[name], value, atol=1e-12, err_msg=name)
    # (43) prints x1 = -W1 + Y1, x3 = W1
    np.testing.assert_allclose(g["X"], [[-1, 0], [0, 1], [1, 0]], atol=1e-12)
    np.testing.assert_allclose(g["Xy"], [[1, 0], [0, 0], [0, 0]], atol=1e-12)


EXCHANGE = np.eye(3)[::-1]
PRINTED_STEPS: dict[str, dict[str, Any]] = {  # (36), (37), (39) and (41), (42), (44)
    "ahn_1": {
        "T1": [[0, 1, 0], [0, 0, 1], [1, 0, 0]], "T2": np.roll(np.eye(4), 2, axis=1),
        "L": [[1, 1]], "F": [[-4]], "H": [[0, -3]], "Q": [[2], [-1]], "R": [[2, 5], [0, 0]],
        "out": [[0], [0]],
    },
    "ahn_2": {
        "T1": EXCHANGE, "T2": EXCHANGE, "L": [[0, 5], [0, 1]], "F": [[-6, 0], [0, -1]],
        "H": [[0, 5], [0, 1]], "Q": [[5, 1]], "R": [[1, -5]], "out": [[0, 0], [1, 0]],
    },
}  # fmt: skip


@pytest.mark.parametrize("name", PRINTED_STEPS)
def test_the_printed_T2_is_that_of_19_and_gives_the_printed_observer(name: str) -> None:
    printed = {key: np.array(value, dtype=float) for key, value in PRINTED_STEPS[name].items()}
    A, D, C, _ = plant(name, np.zeros(2 if name == "ahn_1" else 1))
    (n, q), m, T1 = D.shape, len(C), printed["T1"]
    r, inverse = n - q, np.linalg.inv(T1)
    np.testing.assert_array_equal(inverse @ D, np.vstack([np.zeros((r, q)), np.eye(q)]))
    A_T1 = inverse @ A @ T1
    A11, A12, A21, A22 = A_T1[:r, :r], A_T1[:r, r:], A_T1[r:, :r], A_T1[r:, r:]
    below = np.hstack([A21, np.zeros((q, q))])
    rows = printed["T2"] @ np.hstack([np.vstack([C @ T1, below]), -np.eye(m + q)])
    np.testing.assert_array_equal(rows[:, r:n], np.vstack([np.zeros((m, q)), np.eye(q)]))  # (19)
    M1, M2, (N1, N2), (N3, N4) = (
        rows[:m, :r], rows[m:, :r], np.split(rows[:m, n:], [m], 1), np.split(rows[m:, n:], [m], 1)
    )  # fmt: skip
    out, Z = M1 + N2 @ A21, M2 + N4 @ A21
    # the outputs of (22) are -N1 C Ta with N1 C D = 0: combinations of p - q ones
    np.testing.assert_array_equal(out, -N1 @ C @ T1[:, :r])
    assert np.linalg.matrix_rank(N1) == m - q
    own = gains(name)["Z"] if m > q else np.zeros((0, m))
    for matrix in (N1 @ C @ D, own @ C @ D, N1 - N1 @ np.linalg.pinv(own) @ own):
        np.testing.assert_allclose(matrix, 0, atol=1e-14)
    F = A11 - A12 @ Z - printed["L"] @ out
    H = -(A12 @ N3 + printed["L"] @ N1)
    got = {"out": out, "F": F, "H": H, "Q": -Z @ F - A21 + A22 @ Z, "R": A22 @ N3 - Z @ H}
    for key, value in got.items():
        np.testing.assert_allclose(value, printed[key], atol=1e-14, err_msg=key)
    # the first column of y~ is not seen: L = [1 1], and the first column of the other L, do nothing
    assert not out[0].any()


def test_the_printed_sign_of_44_contradicts_33() -> None:
    g = gains("ahn_2")
    A, D, C, _ = plant("ahn_2", np.zeros(1))
    # d = N y' + Q x1 + R y must hold for every x and d: the N y' part returns d with a plus sign
    np.testing.assert_allclose(g["N"] @ C @ D, [[1]], atol=1e-12)
    reduced = g["T"] @ np.eye(3)
    np.testing.assert_allclose(g["Q"] @ reduced + g["R"] @ C + g["N"] @ C @ A, 0, atol=1e-12)
    assert np.abs(g["Q"] @ reduced + g["R"] @ C - g["N"] @ C @ A).max() > 1


# --- estimates ----------------------------------------------------------------------------------


def test_example_1_estimates() -> None:
    name, x0, d = FIRST
    _, _, C, f = plant(name, d)
    y = block_pulse.coefficients(runge_kutta(f, x0) @ C.T)
    # (38), corrected: [0 -0.125](Y_{i+1} + Y_i); as printed it ends at half the value
    w, printed = [np.array([0, -0.125]) @ y[0]], [np.array([0, -0.125]) @ y[0]]
    for i in range(1, M):
        w.append(2 / 3 * w[-1] + np.array([0, -0.125]) @ (y[i] + y[i - 1]))
        printed.append(2 / 3 * printed[-1] + np.array([0, -0.125]) @ y[i])
    np.testing.assert_allclose(
        [w[0], w[1], w[-1]], [0.10038672, 0.21948541, -2.99973724], atol=1e-6
    )
    assert printed[-1] == pytest.approx(-1.501, abs=2e-3)
    _, x_hat, d_hat = block_pulse_estimates(FIRST)
    np.testing.assert_allclose(x_hat[:, 2], w, atol=1e-12)  # the runtime runs the same recursion
    np.testing.assert_allclose(d_hat[0], [3.26893802, 3.83773828], atol=1e-6)
    np.testing.assert_allclose(d_hat[-1], [5.0000005, 2.9999999], atol=1e-6)


def test_example_2_estimates() -> None:
    d_hat = block_pulse_estimates(SECOND)[2][:, 0]
    np.testing.assert_allclose(d_hat[[0, 1, -1]], [-13.386547, -4.780341, 3.000136], atol=1e-5)


def truncated(value: float, digits: int) -> float:
    """The printed tables cut digits off, they do not round."""
    return math.floor(value * 10**digits) / 10**digits


def test_table_1() -> None:
    d = FIRST[2]
    rows = {
        "block pulse": errors(block_pulse_estimates(FIRST), d),
        "Runge-Kutta": errors(simulink_estimates(FIRST, runge_kutta), d),
        "Euler": errors(simulink_estimates(FIRST, euler), d),
    }
    printed = {  # x1, x3, d1, d2
        "block pulse": [1.1136, 1.1136, 2.3316, 1.1199],
        "Runge-Kutta": [1.1256, 1.1256, 4.9827, 1.5273],
        "Euler": [1.4158, 1.0216, 5.0072, 1.6683],
    }
    for name, values in printed.items():
        x1, _, x3, d1, d2 = rows[name]
        assert [truncated(100 * value, 4) for value in (x1, x3, d1, d2)] == values, name


def test_table_1_is_decided_by_the_first_sample_of_a_derivative_block() -> None:
    d = FIRST[2]
    ours = errors(block_pulse_estimates(FIRST), d, first=1)
    theirs = errors(simulink_estimates(FIRST, runge_kutta), d, first=1)
    np.testing.assert_allclose(ours[3:], [1.562e-2, 0.743e-2], atol=1e-5)
    np.testing.assert_allclose(theirs[3:], [0.509e-2, 1.029e-2], atol=1e-5)
    assert theirs[3] < ours[3] / 3  # for d1 the ranking reverses


def test_table_2() -> None:
    d = SECOND[2]
    rows = {
        "block pulse": errors(block_pulse_estimates(SECOND, sign=-1.0), d),
        "Runge-Kutta": errors(simulink_estimates(SECOND, runge_kutta, sign=-1.0), d),
        "Euler": errors(simulink_estimates(SECOND, euler, sign=-1.0), d),
    }
    printed = {  # x1, x2, x3, and d with the printed, wrong sign of (44)
        "block pulse": [4.5648, 6.7226, 4.5648, 31.983],
        "Runge-Kutta": [4.6358, 6.7110, 4.6358, 32.719],
        "Euler": [3.8955, 7.0168, 3.8780, 34.957],
    }
    for name, (*states, unknown_input) in printed.items():
        *measured, d_error = (100 * value for value in rows[name])
        assert [truncated(value, 4) for value in measured] == states, name
        assert truncated(d_error, 3) == unknown_input, name


def test_with_the_right_sign_the_ranking_of_table_2_reverses() -> None:
    d = SECOND[2]
    measured = [
        errors(block_pulse_estimates(SECOND), d)[3],
        errors(simulink_estimates(SECOND, runge_kutta), d)[3],
        errors(simulink_estimates(SECOND, euler), d)[3],
    ]
    np.testing.assert_allclose(measured, [0.187687, 0.17122, 0.13548], atol=1e-5)
    assert measured[0] > measured[1] > measured[2]


def test_example_2_was_not_run_until_3() -> None:
    measured = errors(block_pulse_estimates(SECOND, h=3 / M), SECOND[2])
    # the text says tf = 3; the printed table has 4.5648, 6.7226, 4.5648
    np.testing.assert_allclose(measured, [0.083334, 0.122346, 0.083334, 0.34230], atol=1e-5)


# --- existence ----------------------------------------------------------------------------------


def observable(A: np.ndarray, C: np.ndarray) -> bool:
    rows = [C]
    for _ in range(len(A) - 1):
        rows.append(rows[-1] @ A)
    return bool(np.linalg.matrix_rank(np.vstack(rows)) == len(A))


def test_T2_does_not_exist_at_any_time() -> None:
    A, D, C = np.array([[0.0, 1], [0, 0]]), np.array([[0.0], [1]]), np.array([[1.0, 0]])
    assert observable(A, C)  # and p >= q: all that the paper asks for
    verdict = shows_every_input(C, D)
    assert verdict.outcome == "refuted"
    assert "C D = 0" in verdict.evidence["witness"]["reason"]
    # T2 [C1 C2; A21 0] = [M1 0; M2 I] needs C2 = C D of full column rank; here C2 = 0
    np.testing.assert_array_equal(C @ D, 0)


@pytest.mark.parametrize(("case", "zero"), [(FIRST, -4.0), (SECOND, -1.0)])
def test_observable_does_not_make_the_reduced_pair_observable(case: Any, zero: float) -> None:
    A, D, C, _ = plant(case[0], case[2])
    assert observable(A, C)
    g = gains(case[0])
    reduced = g["T"] @ A @ g["X"]
    output = g["Z"] @ C @ g["X"] if "Z" in g else np.zeros((0, len(reduced)))
    k = len(reduced)
    assert np.linalg.matrix_rank(np.vstack([reduced - zero * np.eye(k), output])) < k
    verdict = zeros_decay(A, C, D)
    assert verdict.outcome == "proved"
    np.testing.assert_allclose(verdict.evidence["zeros"], [[zero, 0]], atol=1e-12)


@pytest.mark.parametrize(
    ("A", "D", "C", "zero"),
    [
        ([[1, 0], [1, 0]], [[0], [1]], [[0, 1]], 1.0),
        ([[0, 0], [1, -1]], [[0], [1]], [[0, 1]], 0.0),
        ([[2, 0, 0], [1, -1, 0], [0, 1, -1]], [[0], [1], [0]], [[0, 1, 0], [0, 0, 1]], 2.0),
    ],
)
def test_observable_does_not_make_the_reduced_pair_detectable(
    A: Any, D: Any, C: Any, zero: float
) -> None:
    matrices = [np.array(X, dtype=float) for X in (A, C, D)]
    assert observable(matrices[0], matrices[1])
    assert shows_every_input(matrices[1], matrices[2]).outcome == "proved"
    verdict = zeros_decay(*matrices)
    assert verdict.outcome == "refuted"
    witness = verdict.evidence["witness"]["zero"]
    assert witness == {"real": pytest.approx(zero, abs=1e-12), "imag": 0.0}
    pencil = np.block([[zero * np.eye(len(A)) - matrices[0], -matrices[2]],
                       [matrices[1], np.zeros((len(C), 1))]])  # fmt: skip
    assert np.linalg.matrix_rank(pencil) < len(A) + 1
