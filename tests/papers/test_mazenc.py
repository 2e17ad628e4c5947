"""Mazenc, Ahmed, Finite Time Estimation via Piecewise Constant Measurements (MICNON 2018)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

import obsdesign
from lmi.arithmetic.balls import entries, identity, precision, solve_entries
from lmi.arithmetic.exponential import expm as expms
from lmi.arithmetic.norms import float_above, float_below, middles
from lmi.time_budget import UNLIMITED
from obsdesign.analysis.finite_time.enclosed_gains import (
    Sampled,
    approximate_gain,
    difference_matrix,
    gain_scale,
    injection,
)
from obsdesign.equations.finite_time import condition_13 as bounds
from obsdesign.equations.finite_time.gains import NEED_L
from obsdesign.equations.finite_time.rows import least_squares_gain, sample_rows
from obsdesign.runtime import from_design
from obsdesign.synthesis.finite_time.injection import EFFORT, best_injection
from obsdesign.synthesis.finite_time.period_problem import PeriodProblem
from obsdesign.verification.finite_time.theorem_1 import Norms

A = np.array([[0.0, 0.15], [-0.15, 0.0]])
C = np.array([[0.3, 0.0]])
L = np.array([[0.0], [0.1]])
T, PERIOD, K = 6.0, 0.05, 120
# numbers recomputed with 200 bits, given to that many digits
RELATIVE = 1e-7


def problem(method: str, *, period: float = PERIOD, window: float = T, **observer: Any) -> Any:
    options = {"kind": "finite_time", "method": method, "window": window, **observer}
    if method in NEED_L:
        options["gains"] = {"L": L}
    return obsdesign.Problem(
        flow={"A": A, "B": [[1], [0]]}, observer=options,
        output={"C": C, "measured": "periodic", "period": period},
    )  # fmt: skip


def theorem_norms(period: float = PERIOD, k: int = K) -> Norms:
    norms = Norms.from_sampled(Sampled.from_plant(A, C, period, k), L)
    assert norms is not None
    return norms


def motion(period: float, rows: int, change: float | None = 0.0) -> tuple[Any, Any, Any]:
    """t, d held from each row on, and x from (0, 2): a unit step of height 0.5 at `change`."""
    t = np.round(period * np.arange(rows), 10)
    d = np.zeros(rows) if change is None else np.where(t >= change - 1e-12, 0.5, 0.0)
    big = np.zeros((3, 3))
    big[:2, :2], big[0, 2] = A, 1.0
    step = expm(big * period)
    x = [np.array([0.0, 2.0])]
    for value in d[:-1]:
        x.append((step @ np.append(x[-1], value))[:2])
    return t, d, np.array(x)


def errors(method: str, period: float, rows: int, change: float | None = 0.0, **kw: Any) -> Any:
    t, d, x = motion(period, rows, change)
    observer: Any = from_design(obsdesign.design(problem(method, period=period, **kw)))
    batch = observer.run_batch(t, x @ C.T, d)
    full = np.array([status == "ok" for status in batch.status])
    return t, x, batch.x, np.where(full, np.linalg.norm(batch.x - x, axis=1), np.nan)


# --- printed numbers ----------------------------------------------------------------------------

PRINTED = [
    ("a", 1.0838, 4), ("m", 86.9858, 4), ("sigma", 0.0094, 4), ("gbar", 0.0111, 4),
]  # fmt: skip


@pytest.mark.parametrize(("name", "printed", "digits"), PRINTED)
def test_printed_constants(name: str, printed: float, digits: int) -> None:
    with precision(160):
        norms = theorem_norms()
        value = getattr(norms, name) if name in "am" else getattr(norms.constants(PERIOD), name)
        low, high = float_below(value), float_above(value)
    assert printed - 0.5 * 10**-digits <= low <= high <= printed + 0.5 * 10**-digits


def test_printed_matrices() -> None:
    with precision(160):
        sampled = Sampled.from_plant(A, C, PERIOD, K)
        M = difference_matrix(sampled, L)[0] * gain_scale(sampled, L)
        inverse = middles(solve_entries(M, entries(identity(2))))
        M = middles(M)
    assert np.abs(M - [[-0.0715, 0.0226], [0.1386, -0.0715]]).max() <= 0.5e-4
    assert np.abs(inverse - [[-36.0244, -11.3718], [-69.8228, -36.0244]]).max() <= 0.5e-4
    assert np.linalg.det(M) == pytest.approx(0.0020, abs=0.5e-4)
    # (2) by the difference of exponentials, which is good enough at this size of L
    assert np.abs(M - (expm(-A * T) - expm(-(A + L @ C) * T))).max() < 1e-14


# --- recomputed constants, enclosed ---------------------------------------------------------------

CERTIFIED = {
    "sigma": 0.0093857274256207, "gbar": 0.011138650490006, "alpha": 2710.3745943482,
    "beta": 2968.7501874998, "gamma": 3063.0281929665, "first": 0.010172553979856,
    "second": 0.96890433133563,
}  # fmt: skip


def test_constants_of_theorem_1_are_enclosed() -> None:
    with precision(160):
        norms = theorem_norms()
        constants = norms.constants(PERIOD)
        values = {name: getattr(constants, name) for name in CERTIFIED}
        values |= {"a": norms.a, "m": norms.m}
        ends = {name: (float_below(x), float_above(x)) for name, x in values.items()}
        assert norms.condition(PERIOD) == "proved"
    for name, number in (CERTIFIED | {"a": 1.0838322400124, "m": 86.985791699358}).items():
        low, high = ends[name]
        rounding = 0.5 * 10.0 ** (np.floor(np.log10(number)) - 13)
        assert low - rounding <= number <= high + rounding, name
        assert high - low <= 1e-9 * number, name


def test_the_proof_of_theorem_1_has_a_factor_too_many() -> None:
    # beta with the printed extra nu is 2940.0698, and smaller than what the proof gives
    with precision(160):
        norms = theorem_norms()
        c = norms.constants(PERIOD)
        printed = norms.a * c.alpha + (norms.m + c.alpha * PERIOD) * c.gbar
        assert float_above(printed) == pytest.approx(2940.0698, rel=RELATIVE)
        assert printed < c.beta


def test_condition_13_needs_the_norm_of_the_exponential() -> None:
    # after (20): e^{-|F| T} Sigma is smaller than |e^{-F T}| Sigma and is not Lemma 1's hypothesis
    with precision(160):
        norms = theorem_norms()
        printed = (-(norms.f * norms.T)).exp() * norms.constants(PERIOD).sigma
        assert float_above(printed) == pytest.approx(0.0038160, rel=1e-4)
        assert printed < norms.constants(PERIOD).first


def test_32_as_supplied_is_not_the_exponential() -> None:
    x = np.sqrt(35) * T / 50
    supplied = np.array([[np.cos(x), -np.sqrt(5) / 2 * np.sin(x)], [np.sin(x), np.cos(x)]])
    assert np.linalg.norm(supplied, 2) == pytest.approx(1.0639526, rel=1e-6)
    x = 3 * np.sqrt(5) * T / 50
    right = np.array([
        [np.cos(x), -np.sqrt(5) / 2 * np.sin(x)], [2 / np.sqrt(5) * np.sin(x), np.cos(x)],
    ])  # fmt: skip
    assert np.abs(right - expm(-(A + L @ C) * T)).max() < 1e-14


# --- the estimates --------------------------------------------------------------------------------


def test_step_from_the_start() -> None:
    t, x, xhat, error = errors("approximate", PERIOD, 601)
    assert x[K] == pytest.approx([4.177743518, -0.018080169], rel=RELATIVE)
    assert xhat[K] == pytest.approx([4.176886731, -0.008132991], rel=RELATIVE)
    assert error[K] == pytest.approx(0.009984010, rel=RELATIVE)
    assert np.nanmax(error) == pytest.approx(0.032935875, rel=RELATIVE)
    assert t[np.nanargmax(error)] == pytest.approx(23.65)
    assert x[240] == pytest.approx([5.1938540314, -4.5450778384], rel=RELATIVE)
    assert xhat[240] == pytest.approx([5.2100749146, -4.5310774645], rel=RELATIVE)
    assert np.isnan(error[: K - 1]).all()


@pytest.mark.parametrize(
    ("change", "first", "largest"),
    [(None, 0.007447953, 0.007567691), (10.02, 0.007447953, 0.027934529)],
)
def test_no_step_and_a_step_between_samples(
    change: float | None, first: float, largest: float
) -> None:
    # a finer grid carries the step at 10.02; y is there every 0.05 only
    fine = 0.01
    t, d, x = motion(fine, 3001, change)
    y = np.where((np.arange(3001) % 5 == 0)[:, None], x @ C.T, np.nan)
    observer: Any = from_design(obsdesign.design(problem("approximate")))
    batch = observer.run_batch(t, y, d)
    error = np.linalg.norm(batch.x - x, axis=1)[::5][K:]
    assert set(batch.status[5 * K :]) == {"ok"}
    assert error[0] == pytest.approx(first, rel=RELATIVE)
    assert error.max() == pytest.approx(largest, rel=RELATIVE)


def test_exact_and_least_squares_have_no_error() -> None:
    for method in ("exact", "least_squares"):
        for change in (None, 0.0):
            assert np.nanmax(errors(method, PERIOD, 601, change)[3]) < 1e-12


@pytest.mark.parametrize(
    ("period", "window", "approximate"),
    [
        (0.05, 6.0, None),
        (0.5, 6.0, None),
        (3.0, 6.0, 1.458),
        (10.0, 20.0, 5.43),
        (15.0, 45.0, 5.54),
    ],
)
def test_exact_at_any_period(period: float, window: float, approximate: float | None) -> None:
    k = round(window / period)
    for method in ("exact", "least_squares"):
        assert np.nanmax(errors(method, period, 3 * k, window=window)[3]) < 1e-10
    if approximate is not None:
        error = errors("approximate", period, 3 * k, window=window)[3]
        assert error[2 * k] == pytest.approx(approximate, abs=0.5e-2)


def test_the_bias_is_half_a_sample() -> None:
    with precision(160):
        sampled = Sampled.from_plant(A, C, PERIOD, K)
        E = middles(approximate_gain(sampled, L) @ sampled.rows) - np.eye(2)
    expected = [[-1.78252347e-5, -3.77640625e-3], [3.72333851e-3, -5.96138451e-5]]
    assert np.abs(E - expected).max() < 1e-11
    assert np.linalg.norm(E, 2) == pytest.approx(0.00378384532, rel=RELATIVE)
    assert np.linalg.norm(E + PERIOD / 2 * A, 2) == pytest.approx(7.24928e-5, rel=1e-5)
    corrected = expm(A * PERIOD / 2) @ (np.eye(2) + E) - np.eye(2)
    assert np.linalg.norm(corrected, 2) == pytest.approx(6.54616e-5, rel=1e-5)


@pytest.mark.parametrize(
    ("period", "size"),
    [(0.005, "3.75338e-4"), (0.01, "7.51351e-4"), (0.1, "7.63567e-3"), (0.5, "0.0409509"),
     (1.0, "0.0891097"), (2.0, "0.209030"), (3.0, "0.364125")],
)  # fmt: skip
def test_bias_against_the_period(period: float, size: str) -> None:
    with precision(160):
        sampled = Sampled.from_plant(A, C, period, round(T / period))
        E = middles(approximate_gain(sampled, L) @ sampled.rows) - np.eye(2)
    mantissa, _, exponent = size.partition("e")
    unit = 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
    assert np.linalg.norm(E, 2) == pytest.approx(float(size), abs=0.51 * unit)


def test_half_sample_correction() -> None:
    plain = errors("approximate", PERIOD, 601)[3]
    better = errors("approximate", PERIOD, 601, half_sample_correction=True)[3]
    _, _, x = motion(PERIOD, 601)
    bound = 6.55e-5 * np.linalg.norm(x, axis=1).max()
    assert np.nanmax(better) < bound * 1.01 < np.nanmax(plain) / 10


# --- one period -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("period", "P", "det"),
    [
        (0.05, [[0.9999775, 0.00749993], [-0.005999947, 0.999971875]], 0.9999943750421872),
        (1.0, [[0.99101602, 0.149438132], [-0.11957294, 0.988771078]], 0.9977567354742954),
    ],
)
def test_phi_over_one_period(period: float, P: Any, det: float) -> None:
    with precision(160):
        sampled = Sampled.from_plant(A, C, period, 2)
        K_d = sampled.forward @ injection(sampled, L)
        enclosed = middles(sampled.forward + K_d @ sampled.C)
        gain = middles(K_d)
    assert enclosed == pytest.approx(np.array(P), rel=1e-6)
    assert np.linalg.det(enclosed) == pytest.approx(det, rel=1e-13)
    if period == PERIOD:
        assert gain.ravel() == pytest.approx([1.874989453e-5, 4.99994375e-3], rel=RELATIVE)


# --- noise gains and bounds -----------------------------------------------------------------------

GAINS = [  # period, method, |G|_2, row sums
    (0.05, "approximate", 1.19516, (5.45015, 10.29393)),
    (0.05, "exact", 1.19524, (5.48291, 10.27694)),
    (0.05, "least_squares", 1.19523, (5.49054, 10.28424)),
    (0.5, "approximate", 3.76668, (5.44869, 10.23739)),
    (0.5, "exact", 3.79151, (5.79550, 10.11100)),
    (0.5, "least_squares", 3.7915, (5.80469, 10.11760)),
    (2.0, "approximate", 7.13521, (5.44869, 9.59798)),
    (2.0, "exact", 7.97587, (7.32735, 9.98563)),
    (2.0, "least_squares", 7.97584, (7.34264, 9.97558)),
    (3.0, "exact", 10.5646, None),
    (3.0, "least_squares", 10.5646, None),
]


@pytest.mark.parametrize(("period", "method", "norm", "sums"), GAINS)
def test_noise_gains(period: float, method: str, norm: float, sums: Any) -> None:
    G = obsdesign.design(problem(method, period=period)).gains["window_gain"]
    assert np.linalg.norm(G, 2) == pytest.approx(norm, rel=1e-5)
    if sums:
        assert np.abs(G).sum(axis=1) == pytest.approx(sums, rel=1e-5)


def bounded(method: str, noise: float, size: tuple[float, float]) -> Any:
    body = problem(method).to_dict()
    body["output"]["noise_bound"] = [noise]
    body["flow"]["disturbance"] = {"lower": [-s for s in size], "upper": list(size)}
    return obsdesign.design(obsdesign.Problem.from_dict(body)).gains


@pytest.mark.parametrize(
    ("method", "noise", "size", "radius"),
    [
        ("exact", 1.0, (0, 0), (5.48291332, 10.27693947)),
        ("exact", 0.0, (1, 0), (1.85790, 6.66667)),
        ("exact", 0.0, (0, 1), (0.47215, 3.02092)),
        ("least_squares", 0.0, (1, 0), (1.86279, 6.66667)),
        ("least_squares", 0.0, (0, 1), (0.47337, 3.02040)),
        ("exact", 1.0, (1, 1), (7.81296, 19.96452)),
    ],
)
def test_robust_bounds(method: str, noise: float, size: Any, radius: Any) -> None:
    assert bounded(method, noise, size)["radius"] == pytest.approx(radius, abs=0.51e-5)


@pytest.mark.parametrize(
    ("period", "norm", "sums"),
    [
        (0.05, 1.18085, (5.42384, 10.22248)),
        (0.5, 3.37267, (5.15936, 9.61065)),
        (2.0, 5.12485, (4.64082, 8.29248)),
        (3.0, 5.41887, None),
    ],
)
def test_noise_gains_with_the_last_sample(period: float, norm: float, sums: Any) -> None:
    # y_i as well: not what the paper's window holds, but what its samples could give
    k = round(T / period)
    rows = np.vstack([sample_rows(A, C, period, k).reshape(-1, 2), C])
    G = least_squares_gain(rows, np.ones(k + 1))
    assert np.linalg.norm(G, 2) == pytest.approx(norm, rel=1e-5)
    if sums:
        assert np.abs(G).sum(axis=1) == pytest.approx(sums, rel=1e-5)


@pytest.mark.parametrize(
    ("period", "sums"),
    [(0.05, (3.38549, 6.94192)), (0.5, (3.89472, 7.34601)), (2.0, (6.36891, 9.30941))],
)
def test_minimax_rows_for_noise_alone(period: float, sums: Any) -> None:
    body = problem("minimax", period=period).to_dict()
    body["output"]["noise_bound"] = [1.0]
    gains = obsdesign.design(obsdesign.Problem.from_dict(body)).gains
    assert gains["radius"] == pytest.approx(sums, rel=2e-6)
    assert np.abs(gains["window_gain"]).sum(axis=1) == pytest.approx(sums, rel=2e-6)


@pytest.mark.parametrize(
    ("period", "size", "sums"),
    [(0.05, 0, (3.33333, 6.90052)), (0.5, 0, (3.33333, 6.90052)), (2.0, 0, (3.33333, 6.90052)),
     (0.05, 1, (3.33333, 16.78756))],
)  # fmt: skip
def test_least_rows_with_the_last_sample(period: float, size: float, sums: Any) -> None:
    """y_i beside the window: a program over the k + 1 samples, by another solver."""
    from scipy.optimize import linprog

    k = round(T / period)
    rows = np.vstack([sample_rows(A, C, period, k).reshape(-1, 2), C])
    back, half = expm(-A * period), expm(-A * period / 2)
    # R_l of a unit gain at sample j is C back^(l - j); y_i acts on no interval of the window
    R = np.zeros((k, 2, k + 1))
    for j in range(k):
        R[j:, :, j] = [(C @ np.linalg.matrix_power(back, m) @ half)[0] for m in range(k - j)]
    effects = np.vstack([np.eye(k + 1), size * period * R.reshape(2 * k, k + 1)])
    m = len(effects)
    costs = []
    for unit in np.eye(2):
        cost = np.concatenate([np.zeros(k + 1), np.ones(m)])
        above = np.block([[effects, -np.eye(m)], [-effects, -np.eye(m)]])
        equal = np.hstack([rows.T, np.zeros((2, m))])
        free = [(None, None)] * (k + 1) + [(0, None)] * m
        costs.append(linprog(cost, above, np.zeros(2 * m), equal, unit, free).fun)
    assert costs == pytest.approx(sums, rel=2e-6)


def test_near_pathological_sampling() -> None:
    # both eigenvalues look alike to samples pi / 0.15 = 20.94 apart: close to that gains grow
    design = obsdesign.design(problem("least_squares", period=20.0, window=40.0))
    assert np.linalg.norm(design.gains["window_gain"], 2) == pytest.approx(33.3208, rel=1e-5)


@pytest.mark.parametrize(
    ("gain", "ratio"), [([-3, 0], 1.195), ([-5, -5], 1.496), ([-10, -10], 2.066)]
)
def test_large_gains_of_the_exact_observer(gain: list[float], ratio: float) -> None:
    body = problem("exact").to_dict()
    body["observer"]["gains"] = {"L": [[x] for x in gain]}
    lengths = [
        np.linalg.norm(obsdesign.design(case).gains["window_gain"], 2)
        for case in (obsdesign.Problem.from_dict(body), problem("least_squares"))
    ]
    assert lengths[0] / lengths[1] == pytest.approx(ratio, abs=0.51e-3)


def test_a_gain_whose_matrix_has_lost_all_digits() -> None:
    # L = [-20, -50]: condition 3e14, and 7e-3 accurate in floats; rounded once from balls it is not
    body = problem("exact").to_dict()
    body["observer"]["gains"] = {"L": [[-20], [-50]]}
    design = obsdesign.design(obsdesign.Problem.from_dict(body))
    gain = design.gains["window_gain"]
    fitted = obsdesign.design(problem("least_squares")).gains["window_gain"]
    assert np.linalg.norm(gain, 2) / np.linalg.norm(fitted, 2) == pytest.approx(3.68, rel=7e-3)
    rows = sample_rows(A, C, PERIOD, K).reshape(-1, 2)
    assert np.abs(gain @ rows - np.eye(2)).max() < 1e-12


def test_a_square_wave() -> None:
    t = np.round(PERIOD * np.arange(601), 10)
    d = np.where(np.floor(t / 5 + 1e-9) % 2 == 0, 0.5, -0.5)
    big = np.zeros((3, 3))
    big[:2, :2], big[0, 2] = A, 1.0
    step, x = expm(big * PERIOD), [np.array([0.0, 2.0])]
    for value in d[:-1]:
        x.append((step @ np.append(x[-1], value))[:2])
    truth = np.array(x)
    assert truth[K] == pytest.approx([3.181489302, 0.056779311], rel=RELATIVE)
    batch = from_design(obsdesign.design(problem("approximate"))).run_batch(t, truth @ C.T, d)
    assert batch.x[K] == pytest.approx([3.180577880, 0.066647976], rel=RELATIVE)
    error = np.linalg.norm(batch.x - truth, axis=1)[K:]
    assert error[0] == pytest.approx(0.009910662, rel=RELATIVE)
    assert error.max() == pytest.approx(0.011667379, rel=RELATIVE)
    assert t[K + int(np.argmax(error))] == pytest.approx(8.05)
    exact = from_design(obsdesign.design(problem("exact"))).run_batch(t, truth @ C.T, d)
    assert np.linalg.norm(exact.x - truth, axis=1)[K:].max() < 1e-12


def test_the_improved_lemma_2() -> None:
    # |phi - e^{A t}| <= e^{|A| t} (e^{|E| t} - 1): tighter than Sigma, and no part of (13)
    with precision(160):
        norms = theorem_norms()
        better, printed = norms.constants(PERIOD, tighter=True), norms.constants(PERIOD)
        names = ("sigma", "gbar", "second", "alpha", "beta", "gamma")
        values = [float_above(getattr(better, name)) for name in names]
        assert better.sigma < printed.sigma
    expected = [0.0033352063, 0.0039320549, 0.34203291, 45.218072, 49.528637, 143.80664]
    assert values == pytest.approx(expected, rel=RELATIVE)


@pytest.mark.parametrize(("window", "longest"), [(6.0, 0.1439677351), (10.18999, 0.1822966154)])
def test_longest_period_of_the_improved_lemma(window: float, longest: float) -> None:
    value = bounds.approx_log_longest_period(A, C, L, window, tighter=True)
    assert np.exp(value) == pytest.approx(longest, rel=RELATIVE)
    with precision(160):
        norms = theorem_norms(window, 1)
        ball = norms.longest_period(tighter=True)
        low, high = float_below(ball), float_above(ball)
        assert norms.condition(low, tighter=True) == "proved"
        assert norms.condition(high, tighter=True) == "refuted"
        assert norms.condition(low) == "refuted"
    assert low * (1 - RELATIVE) <= longest <= high * (1 + RELATIVE)


@pytest.mark.parametrize(
    ("known", "longest"),
    [
        ({"window": 6.0}, 0.1734128),
        ({}, 0.2490231),
        ({"window": 6.0, "coordinates": True}, 0.175406),
    ],
)
def test_longest_period_that_the_improved_lemma_allows(known: Any, longest: float) -> None:
    problem = PeriodProblem(A, C, tighter=True, **known)
    best = best_injection(problem, UNLIMITED, effort=EFFORT.times(3))
    assert np.exp(best.log_period) >= longest * (1 - 1e-5)


def test_the_design_tells_the_better_bound() -> None:
    """At 0.1 the printed (13) is false, and the theorem holds all the same; at 0.2 neither."""
    entries = {}
    for period in (0.05, 0.1, 0.2):
        design = obsdesign.design(problem("approximate", period=period))
        entries[period] = [
            (entry.given, entry.statement[:12])
            for entry in design.guarantees
            if "Theorem 1" in entry.statement
        ]
    tighter = (True, "With a tight")
    assert entries[0.05] == [(True, "Theorem 1 fo"), tighter]
    assert entries[0.1] == [(False, "The bound of"), tighter]
    assert entries[0.2] == [(False, "The bound of")]


def test_minimax_is_least() -> None:
    radius = bounded("minimax", 1.0, (1, 1))["radius"]
    assert (radius <= np.array([3.50960, 16.84809]) + 0.5e-5).all()
    assert radius == pytest.approx([3.50960, 16.84809], rel=1e-5)


def test_the_robust_bound_is_attained() -> None:
    gains = bounded("exact", 0.01, (0.02, 0.02))
    G, n = gains["window_gain"], 2
    back, R = expm(-A * PERIOD), np.zeros((2, 2))
    fine = 200
    step = expm(-A * PERIOD / fine)
    attained = 0.01 * np.abs(G).sum(axis=1)
    for j in range(K):
        R = R @ back + G[:, j : j + 1] @ C
        weight = R @ expm(-A * PERIOD / fine / 2)
        for _ in range(fine):
            attained = attained + 0.02 * np.abs(weight) @ np.ones(n) * PERIOD / fine
            weight = weight @ step
    assert attained == pytest.approx([0.10143011, 0.29652106], rel=RELATIVE)
    assert (gains["radius"] >= attained * (1 - 1e-9)).all()


def test_error_identity_factor() -> None:
    """Norm inside: 0.0137101261; separated: 0.0612942696; attained by no motion beyond |E|."""
    M = expm(-A * T) - expm(-(A + L @ C) * T)
    fine = 40
    tau = (np.arange(K * fine) + 0.5) * PERIOD / fine
    mu = L @ C @ (expms(-A * (tau % PERIOD)[:, None, None]) - np.eye(2))
    inner = np.linalg.inv(M) @ expms(-(A + L @ C) * tau[:, None, None]) @ mu
    total = np.linalg.norm(inner, 2, axis=(1, 2)).sum() * PERIOD / fine
    assert total == pytest.approx(0.0137101261, rel=1e-6)
    claims = {c.id: c for c in obsdesign.design(problem("approximate")).claims}
    assert total <= claims["error_identity"].evidence["factor"] <= total * 1.001


# --- the longest period -------------------------------------------------------------------------

LONGEST = {
    1: 0.0089327683, 2: 0.025251143, 3: 0.039745412, 4: 0.048967029, 5: 0.052561054, 6: 0.0515755343,
    7: 0.047480155, 8: 0.041659692, 10: 0.028857975, 12: 0.018067572, 15: 0.0078752565,
}  # fmt: skip


@pytest.mark.parametrize(("window", "longest"), LONGEST.items())
def test_longest_period_of_13(window: float, longest: float) -> None:
    assert np.exp(bounds.approx_log_longest_period(A, C, L, window)) == pytest.approx(
        longest, rel=1e-7
    )
    with precision(160):
        norms = theorem_norms(window, 1)
        ball = norms.longest_period()
        low, high = float_below(ball), float_above(ball)
        assert norms.condition(low) == "proved"
        assert norms.condition(high) == "refuted"
    assert low <= longest * (1 + 1e-7)
    assert high >= longest * (1 - 1e-7)
    assert high / low - 1 < 1e-9


def theorem_bounds(change: float | None, rows: int = 601) -> Any:
    """The bound of Theorem 1 at every t_i >= T, its integrals by Gauss-Legendre on each period."""
    _, d, x = motion(PERIOD, rows, change)
    with precision(160):
        c = theorem_norms().constants(PERIOD)
        alpha, beta, last = (float(v.mid()) for v in (c.alpha, c.beta, c.gamma * c.sigma))
    F = A + L @ C
    nodes, weights = np.polynomial.legendre.leggauss(6)
    s, weights = (nodes + 1) * PERIOD / 2, weights * PERIOD / 2
    # the inner integral of (15) runs backwards, from s to 0
    block = np.zeros((3, 3))
    block[:2, :2], block[0, 2] = -A, 1.0
    inner = expms(block * s[:, None, None])[:, :2, 2]
    value = (
        d[:, None, None] * (np.array([1.0, 0]) - inner @ (L @ C).T)
        - (x @ C.T @ L.T)[:, None, :]
    )  # fmt: skip
    size = np.linalg.norm(value, axis=2) @ weights
    onwards = expms(F * (PERIOD - s)[:, None, None])
    pieces = np.einsum("q,qij,kqj->ki", weights, onwards, value)
    back = np.einsum("q,qij->ij", weights, expms(-A * s[:, None, None]))[:, 0]
    values = []
    for i in range(K, rows):
        ages = (np.arange(K - 1, -1, -1) * PERIOD)[:, None, None]
        inner_T = (expms(F * ages) @ pieces[i - K : i, :, None]).sum(axis=0)
        times = (np.arange(K) * PERIOD)[:, None, None]
        forced = (expms(-A * times) @ (d[i - K : i, None] * back)[:, :, None]).sum(axis=0)
        values.append(
            alpha * np.linalg.norm(forced) + beta * np.linalg.norm(inner_T)
            + last * size[i - K : i].sum()
        )  # fmt: skip
    return np.array(values)


@pytest.mark.parametrize(
    ("change", "first", "low", "high"),
    [(0.0, 16630.732, 16274.77, 16802.80), (None, 446.15131, 70.5477, 1035.268)],
)
def test_the_bound_of_theorem_1_is_empty(
    change: float | None, first: float, low: float, high: float
) -> None:
    bound = theorem_bounds(change)
    assert bound[0] == pytest.approx(first, rel=1e-6)
    assert (bound.min(), bound.max()) == (
        pytest.approx(low, rel=1e-6),
        pytest.approx(high, rel=1e-6),
    )
    error = errors("approximate", PERIOD, 601, change)[3][K:]
    x = np.linalg.norm(motion(PERIOD, 601, change)[2], axis=1)
    assert (error <= bound).all()
    # to answer zero would always be closer than the bound promises; the identity says something
    assert (x[K:] < bound).all()
    windows = np.array([x[i - K : i + 1].max() for i in range(K, 601)])
    assert (error <= 0.0137102 * windows).all()


def test_the_sentence_of_theorem_1_states_its_constants() -> None:
    guarantees = obsdesign.design(problem("approximate")).guarantees
    sentence = next(one for one in guarantees if one.claims == ("theorem_1_numbers",))
    assert sentence.given
    # alpha = 2710.3745943, beta = 2968.7501875
    assert "2710.37 |int e^(A (t_i - m - T)) delta dm| + 2968.75 |T~|" in sentence.statement
    assert "true; it holds for periods below 0.0515755343" in sentence.statement
    longer = obsdesign.design(problem("approximate", period=0.06)).guarantees
    assert not any("2710" in one.statement for one in longer)
