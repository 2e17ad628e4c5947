"""Medina, Lawrence, State Estimation for Linear Impulsive Systems: what is printed, what is true.

Section IV simulates a spline whose points are not printed; `docs/figures/spline_data.py` holds points
that give all printed numbers.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

import obsdesign
from docs.figures import spline_data
from lmi.arithmetic.exponential import expm as flow_of
from obsdesign.analysis.impulsive_noise import simulated
from obsdesign.design_file import from_dict
from obsdesign.document import digest
from obsdesign.equations.impulsive.formulas import Core, window_gains, window_matrix
from obsdesign.equations.impulsive.gains import ImpulsiveGains
from obsdesign.runtime import Sample, from_design
from tests.systems.checks import check_kind
from tests.systems.impulsive import DOUBLE, SPLINE, chain, claim, first, impulsive_problem, rebased

ROOT = Path(__file__).parent.parent.parent
KNOTS = [0.1, 0.5, 0.9, 1.0, 1.1, 1.2, 2.0, 2.8, 2.9, 3.0, 3.1, 3.5, 3.9]
PRINTED_W = [
    -58.0338, 34.3681, -400.6792, 423.1681, -91.9931, 1.1499, -1.1499, 91.9931, -423.1681,
    400.6792, -34.3681, 58.0338, 58.0338,
]  # fmt: skip
PRINTED_X0 = [0, -0.9836, 21.6068, -58.0338]
HALF_A_DIGIT = 5e-5
# L[3] .. L[13], first three entries
GAINS = [
    (1, 3.75, 6.25), (1, 12, 40), (1, 15, 100), (1, 15, 100), (1, 2.3611111, 2.7777778),
    (1, 1.875, 1.5625), (1, 11.1111111, 22.2222222), (1, 15, 100), (1, 15, 100), (1, 4.5, 10),
    (1, 3.75, 6.25),
]  # fmt: skip


def literal_gain(A: Any, G: Any, C: Any, spacings: Any, alpha: float) -> tuple[Any, float]:
    """(12) as it is printed, spacings from tau_(k-l) on, and the condition number it inverts."""
    X = expm(A * spacings[0])
    products = [X]
    for delta in spacings[1:]:
        X = expm(A * delta) @ G @ X
        products.append(X)
    M = sum(alpha ** (2 * j) * P.T @ C.T @ C @ P for j, P in enumerate(products))
    power = alpha ** (2 * (len(spacings) - 1))
    return -power * G @ X @ np.linalg.inv(M) @ X.T @ C.T, float(np.linalg.cond(M))


def gain(A: Any, G: Any, C: Any, spacings: Any, alpha: float) -> Any:
    flows = flow_of(np.asarray(A) * np.asarray(spacings)[1:, None, None])
    return window_gains(Core(A, C, G), flows, alpha)


@pytest.mark.parametrize(
    ("n", "p", "window"), [(2, 1, 2), (3, 1, 3), (3, 1, 5), (4, 2, 3), (3, 2, 2), (2, 1, 6)]
)
@pytest.mark.parametrize("singular", [False, True])
def test_gain_12_by_qr_is_the_printed_one(n: int, p: int, window: int, singular: bool) -> None:
    rng = np.random.default_rng(n + 10 * p + 100 * window)
    for _ in range(5):
        A, G, C = (
            rng.standard_normal((n, n)),
            rng.standard_normal((n, n)),
            rng.standard_normal((p, n)),
        )
        if singular:
            G[:, 0] = G[:, 1]
        spacings = rng.uniform(0.3, 0.8, window)
        printed, condition = literal_gain(A, G, C, spacings, 1.4)
        computed = gain(A, G, C, spacings, 1.4)
        # the printed form inverts a Gramian: that is what the difference is made of
        assert np.abs(computed - printed).max() <= 1e-14 * condition * np.abs(printed).max()


def test_p1_the_spline_gain_in_closed_form() -> None:
    rng = np.random.default_rng(1)
    for alpha in (1.0001, 1.5, 5.0):
        for _ in range(60):
            spacings = rng.uniform(0.1, 0.8, 3)
            a, b = spacings[2], spacings[1] + spacings[2]
            closed = -np.array([[1], [(a + b) / (a * b)], [2 / (a * b)]])
            computed = gain(chain(3), np.eye(3), first(3), spacings, alpha)
            np.testing.assert_allclose(computed, closed, rtol=1e-8)


def test_a_square_window_does_not_know_alpha() -> None:
    rng = np.random.default_rng(2)
    A, G, C = rng.standard_normal((4, 4)), rng.standard_normal((4, 4)), rng.standard_normal((2, 4))
    spacings = rng.uniform(0.3, 0.8, 2)
    np.testing.assert_allclose(
        gain(A, G, C, spacings, 1.01), gain(A, G, C, spacings, 9.0), rtol=1e-9
    )
    # the twin: one more measurement, and it does
    spacings = rng.uniform(0.3, 0.8, 3)
    assert not np.allclose(gain(A, G, C, spacings, 1.01), gain(A, G, C, spacings, 9.0), rtol=1e-3)


def test_p2_determinant_of_the_window() -> None:
    rng = np.random.default_rng(3)
    for _ in range(50):
        a, b = rng.uniform(0.1, 0.8, 2)
        flows = np.array([expm(chain(3) * a), expm(chain(3) * b)])
        rows, _ = window_matrix(Core(chain(3), first(3), np.eye(3)), flows)
        assert np.linalg.det(rows) == pytest.approx((a + b) * a * b / 2, rel=1e-12)
        assert np.linalg.det(rows) >= min(a, b) ** 3 * (1 - 1e-12)  # printed: half of it


def test_p3_p4_the_printed_inputs_come_from_a_not_a_knot_spline() -> None:
    curve = spline_data.spline()
    np.testing.assert_allclose(curve(KNOTS, 3), PRINTED_W, atol=HALF_A_DIGIT)
    np.testing.assert_allclose([curve(0, k) for k in range(4)], PRINTED_X0, atol=HALF_A_DIGIT)


@pytest.mark.parametrize("strategy", ["auto", "compressed", "subspace"])
def test_p5_p6_the_example_is_dead_beat(strategy: str) -> None:
    body = obsdesign.load_problem(ROOT / "examples" / "medina_spline.toml").to_dict()
    body["observer"]["strategy"] = strategy
    design = obsdesign.design(obsdesign.Problem.from_dict(body))
    t, estimate, true = spline_data.estimates(design)
    error = estimate - true
    assert np.abs(error[t < 0.1, 3]) == pytest.approx(158.0338, abs=1e-4)
    # the true x4 of the table is the spline's, rounded: 400 * 1e-15
    assert np.abs(error[t >= 0.1, 3]).max() < 1e-12
    assert np.abs(error[t >= 0.9, :3]).max() < 1e-9
    # not before: the second and third state are free until the third impulse
    assert np.abs(error[(t > 0.5) & (t < 0.9), 2]).max() > 1e-3


def test_the_printed_gains() -> None:
    design = obsdesign.design(obsdesign.load_problem(ROOT / "examples" / "medina_spline.toml"))
    observer: Any = from_design(design)
    state = observer.init(t=0.0)
    for k, t in enumerate(KNOTS):
        state, _ = observer.step(state, Sample(t, y=[0.0], w=[0.0], jump=True))
        if k >= 2:
            L, trouble = observer._gain(state)
            assert trouble is None
            np.testing.assert_allclose(L[:3, 0], -np.array(GAINS[k - 2]), atol=1e-7)
            assert L[3, 0] == 0.0


@pytest.mark.parametrize("seed", range(6))
def test_random_bases_have_the_same_verdicts_and_are_dead_beat(seed: int) -> None:
    A, G, C = rebased(SPLINE, seed)
    refused = obsdesign.investigate(impulsive_problem((A, G, C), [0.1, 0.8], strategy="full"))
    assert refused.verdict == "refuted"
    outcome = obsdesign.investigate(impulsive_problem((A, G, C), [0.1, 0.8]))
    assert (outcome.verdict, outcome.result["form"]) == ("proved", "compressed")
    # the rounding of the basis is not overlooked: it is absorbed
    assert claim(outcome, "image").evidence["exact"] is False
    design: Any = outcome.design
    assert design.gains["window"] == 3
    if seed < 3:
        part = obsdesign.investigate(impulsive_problem((A, G, C), [0.1, 0.8], strategy="subspace"))
        assert part.verdict == "proved"
        assert part.design.gains["core_place"].tolist() == [0, 3]
    observer: Any = from_design(design)
    rng = np.random.default_rng(seed)
    x, t = rng.standard_normal(4), 0.0
    state = observer.init(t=0.0)
    for k, now in enumerate(KNOTS[:6]):
        x, t = expm(A * (now - t)) @ x, now
        state, estimate = observer.step(state, Sample(t, y=C @ x, jump=True))
        x = G @ x
        if k >= 2:
            assert np.abs(estimate.x - x).max() < 1e-7 * np.linalg.cond(A + G) * max(
                1, np.abs(x).max()
            )


def test_p7_the_spline_is_not_strongly_observable() -> None:
    outcome = obsdesign.investigate(impulsive_problem(SPLINE, [0.1, 0.8], strategy="full"))
    assert outcome.verdict == "refuted"
    witness = claim(outcome, "strongly_observable").evidence["witness"]
    assert witness["null_vector"] == [0.0, 0.0, 0.0, 1.0]
    for strategy in ("compressed", "subspace"):
        problem = impulsive_problem(SPLINE, [0.1, 0.8], strategy=strategy)
        assert obsdesign.investigate(problem).verdict == "proved"


def test_p8_the_restricted_spline_is_certified() -> None:
    outcome = obsdesign.investigate(impulsive_problem((chain(3), np.eye(3), first(3)), [0.1, 0.8]))
    evidence = claim(outcome, "strongly_observable").evidence
    assert (outcome.verdict, outcome.design.gains["window"]) == ("proved", 3)
    assert evidence["approx_sigma_min"] == pytest.approx(0.0040622001, rel=1e-7)
    assert 0.5 * 0.0040622001 < evidence["sigma_min"] <= 0.0040622001


def test_the_example_states_the_window_of_the_states_after_an_impulse() -> None:
    """The numbers of the page: one spacing more than the subsystem, which has no image."""
    evidence = {}
    for name in ("medina_spline", "medina_subsystem"):
        outcome = obsdesign.investigate(obsdesign.load_problem(ROOT / "examples" / f"{name}.toml"))
        assert outcome.verdict == "proved"
        evidence[name] = claim(outcome, "strongly_observable").evidence
    spline, part = evidence["medina_spline"], evidence["medina_subsystem"]
    assert (len(spline["approx_worst"]), len(part["approx_worst"])) == (3, 2)
    # over a grid, with its corners: the worst place in the coordinates of the proof is another one
    U, ends = np.eye(4, 3), np.linspace(0.1, 0.8, 8)
    spacings = np.stack(np.meshgrid(ends, ends, ends, indexing="ij"), axis=-1).reshape(-1, 3)
    core = Core(chain(4), first(4), U @ U.T, U, U.T)
    rows, _ = window_matrix(core, flow_of(chain(4) * spacings[..., None, None]))
    least = np.linalg.svd(rows, compute_uv=False)[:, -1]
    assert spacings[least.argmin()].tolist() == pytest.approx([0.8, 0.1, 0.1])
    assert least.min() == pytest.approx(0.0029072, abs=1e-7)
    assert 0.0027 < spline["sigma_min"] <= least.min() <= spline["approx_sigma_min"]
    assert 0.0036 < part["sigma_min"] <= part["approx_sigma_min"]


def test_lemma_26_bounds_the_gramian_up_to_the_impulse_before() -> None:
    """M_alpha(tau_(k-l)^-, tau_(k-1)) has l terms, and M_alpha(tau_(k-l)^-, tau_k) one more."""
    A, C, alpha, window, ends = chain(3), first(3), 1.3, 3, np.linspace(0.1, 0.8, 8)

    def eigenvalues(terms: int, spacings: Any) -> Any:
        X, total = np.eye(3), C.T @ C
        for j, delta in enumerate(spacings[: terms - 1], start=1):
            X = expm(A * delta) @ X
            total = total + alpha ** (2 * j) * X.T @ C.T @ C @ X
        return np.linalg.eigvalsh(total)

    over_the_box = np.array([eigenvalues(window, (a, b)) for a in ends for b in ends])
    least, largest = over_the_box.min(), over_the_box.max()
    for spacings in np.random.default_rng(5).uniform(0.1, 0.8, (20, window)):
        values = eigenvalues(window, spacings)
        assert least <= values[0]
        assert values[-1] <= largest
    assert eigenvalues(window + 1, [0.8] * window)[-1] > 2 * largest


def test_the_response_counts_an_impulse_at_the_end_of_its_interval() -> None:
    """x(tau_k) by Phi of (2) over (t0, tau_k]: without the impulse at tau_k it is x(tau_k^-)."""
    A, G, C = REGULAR
    E = np.array([[0.5], [-1.0], [2.0]])
    rng = np.random.default_rng(6)
    problem = impulsive_problem(REGULAR, RANGE, window=3, jump={"E": E.tolist()})
    observer: Any = from_design(obsdesign.design(problem))
    x, x0 = np.array([1.0, -2.0, 0.5]), np.array([1.0, -2.0, 0.5])
    state = observer.init(t=0.0, x=x0)
    times, w = np.cumsum(rng.uniform(0.3, 0.7, 5)), rng.standard_normal(5)

    def phi(end: float, start: float, closed: bool) -> Any:
        inside = [t for t in times if start < t < end or (closed and start < t == end)]
        X, now = np.eye(3), start
        for t in inside:
            X, now = G @ expm(A * (t - now)) @ X, t
        return expm(A * (end - now)) @ X

    for k, t in enumerate(times):
        before = expm(A * (t - (times[k - 1] if k else 0.0))) @ x
        state, estimate = observer.step(state, Sample(t, y=C @ before, w=w[k : k + 1], jump=True))
        x = estimate.x  # of an observer that starts from the true state
        response = phi(t, 0.0, closed=True) @ x0
        for j in range(k + 1):
            response = response + phi(t, times[j], closed=True) @ E[:, 0] * w[j]
        np.testing.assert_allclose(x, response, rtol=1e-9, atol=1e-9)
        assert np.abs(phi(t, 0.0, closed=False) - phi(t, 0.0, closed=True)).max() > 1e-3


def test_the_printed_sum_of_p_before_the_impulse_has_one_term_too_many() -> None:
    """P(tau_k^-): with j up to k - 1 the identity for A_I' P A_I holds, with k it does not."""
    rng = np.random.default_rng(4)
    A, G, C = rng.standard_normal((3, 3)), rng.standard_normal((3, 3)), rng.standard_normal((1, 3))
    window, alpha, spacings = 4, 1.3, rng.uniform(0.2, 0.7, 4)
    before = [np.eye(3)]  # Phi(tau_j^-, tau_(k-l)^-), j = k-l .. k
    for delta in spacings:
        before.append(expm(A * delta) @ G @ before[-1])
    information = [X.T @ C.T @ C @ X for X in before]
    after = sum(alpha ** (2 * i) * M for i, M in enumerate(information[1:]))  # A_I' P(tau_k) A_I
    last = alpha ** (2 * (window - 1)) * information[-1]
    for terms, holds in ((window, True), (window + 1, False)):
        P = sum(alpha ** (2 * i) * M for i, M in enumerate(information[:terms]))
        right = alpha**-2 * P - alpha**-2 * C.T @ C + last
        assert np.allclose(after, right, rtol=1e-12) == holds


@pytest.mark.parametrize(
    ("window", "alpha", "rate", "position", "velocity"),
    [
        (2, 1.3, 0.0, 1.000, 2.667), (3, 1.02, 0.392, 0.756, 0.385), (3, 1.3, 0.303, 0.836, 0.535),
        (3, 2.0, 0.172, 0.937, 0.917), (3, 5.0, 0.037, 0.996, 1.972), (4, 1.02, 0.537, 0.604, 0.127),
        (4, 1.3, 0.407, 0.735, 0.229), (4, 2.0, 0.218, 0.905, 0.601), (6, 1.3, 0.505, 0.625, 0.090),
        (8, 1.02, 0.750, 0.337, 0.0125),
    ],
)  # fmt: skip
def test_noise_against_speed(
    window: int, alpha: float, rate: float, position: float, velocity: float
) -> None:
    """Double integrator, spacings uniform on [0.5, 1.5]; a square window: E 2/delta^2 = 8/3."""
    A, G, C = DOUBLE
    plant = impulsive_problem((A, G, C), [0.5, 1.5]).plant
    gains = ImpulsiveGains.from_plant(plant, strategy="full", window=window, alpha=alpha)
    estimate = simulated(gains, np.ones(1), sequences=300, impulses=100)
    assert estimate.per_impulse == pytest.approx(rate, abs=0.006)
    assert estimate.std[0] ** 2 == pytest.approx(position, abs=0.002)
    assert estimate.std[1] ** 2 == pytest.approx(velocity, rel=0.015)


# --- Theorem 2.2: P(t) = M_alpha(rho_l(t), t) --------------------------------------------------------

ALPHA, LENGTH, RANGE = 1.3, 4, [0.3, 0.7]
REGULAR = (
    np.array([[0.1, 1.0, 0.0], [-1.0, 0.0, 0.3], [0.2, 0.0, -0.3]]),
    np.array([[0.9, 0.1, 0.0], [0.0, 1.0, 0.2], [0.1, 0.0, 1.1]]),
    np.array([[1.0, 0.0, 0.0]]),
)


def lyapunov_outcome(**options: Any) -> Any:
    problem = impulsive_problem(REGULAR, RANGE, window=LENGTH, alpha=ALPHA, **options)
    return obsdesign.investigate(problem)


def gramian(spacings: Any, passed: float) -> Any:
    """M_alpha(rho, t) as printed, of l impulses: their l - 1 spacings, and the time to the first."""
    A, G, C = REGULAR
    X, total = expm(A * passed), np.zeros((3, 3))
    for j in range(LENGTH):
        total += ALPHA ** (2 * j) * X.T @ C.T @ C @ X
        X = expm(A * spacings[j]) @ G @ X if j < LENGTH - 1 else X
    return total


def conditions_of_theorem_22(
    change: float, seed: int
) -> tuple[list[Any], list[float], list[float]]:
    """P(t) at times along random spacings; residuals of (7), and largest eigenvalues in (8).

    change: of the design's gains L[k], by a factor.
    """
    A, G, C = REGULAR
    rng = np.random.default_rng(seed)
    delta = rng.uniform(*RANGE, 40)  # delta[k] follows impulse k
    delta[:8] = RANGE[0]
    P, sevenths, eighths = [], [], []
    for k in range(LENGTH + 1, len(delta)):
        # after impulse k rho_l runs through the interval after impulse k - l
        old, new = delta[k - LENGTH], delta[k]
        inside = delta[k - LENGTH + 1 : k]
        at = [gramian(inside, (1 - share) * old) for share in (0.0, 0.4, 1.0)]
        P += at
        slow = A * old / new  # of (15)
        moved = expm(slow * 0.4 * new)
        sevenths.append(np.abs(moved.T @ at[1] @ moved - at[0]).max())
        # (8) at impulse k + 1, with P before it at[2], and after it
        after = gramian(delta[k - LENGTH + 2 : k + 1], delta[k - LENGTH + 1])
        flows = flow_of(A * delta[k - LENGTH + 2 : k + 1, None, None])
        L = change * window_gains(Core(A, C, G), flows, ALPHA)
        phi = np.eye(3)  # Phi(tau_(k+1), tau_(k+1-l)), jumps included at its end
        for spacing in delta[k - LENGTH + 1 : k + 1]:
            phi = G @ expm(A * spacing) @ phi
        N = -np.linalg.solve(phi, L)
        error = G + -N @ C @ np.linalg.solve(G, phi) @ G  # A_I hat of (15)
        Q = (1 - ALPHA**-2) * at[2]
        scale = np.linalg.norm(at[2], 2)
        eighths.append(np.linalg.eigvalsh(error.T @ after @ error - at[2] + Q).max() / scale)
    return P, sevenths, eighths


@pytest.mark.parametrize("seed", range(3))
def test_theorem_22_holds_with_the_numbers_of_the_design(seed: int) -> None:
    outcome = lyapunov_outcome()
    assert outcome.verdict == "proved"
    stated = claim(outcome, "rate").evidence["theorem_2_2"]
    P, sevenths, eighths = conditions_of_theorem_22(1.0, seed)
    values = np.linalg.eigvalsh(P)
    assert stated["eta"] <= values.min() <= 100 * stated["eta"]  # (6), and not for want of a number
    assert values.max() <= stated["rho"] <= 100 * values.max()
    assert max(sevenths) < 1e-12 * values.max()  # (7) with Q_C = 0
    assert max(eighths) < 1e-9  # (8) with Q_I = (1 - alpha^-2) P(tau_k^-)


@pytest.mark.parametrize("change", [0.0, 0.5, 1.5, -1.0])
def test_other_gains_violate_8(change: float) -> None:
    """The twin: the same P, and gains that are not (12)."""
    assert max(conditions_of_theorem_22(change, 0)[2]) > 1e-3


def test_check_states_theorem_22() -> None:
    problem = impulsive_problem(REGULAR, RANGE, window=LENGTH, alpha=ALPHA)
    text = check_kind(problem, "impulsive").next_step
    assert "Theorem 2.2 holds with P(t) = M_alpha(rho_l(t), t): (6) with eta = 0." in text
    other = check_kind(problem.for_kind("luenberger")[0], "luenberger")
    assert other.verdict == "proved"
    assert "Theorem 2.2" not in other.next_step


def test_designs_without_the_numbers_of_theorem_22_verify_and_too_good_ones_do_not() -> None:
    stored = lyapunov_outcome().design.to_dict()
    rate = next(entry for entry in stored["claims"] if entry["id"] == "rate")
    theorem = rate["evidence"].pop("theorem_2_2")
    assert obsdesign.verify(from_dict(signed(stored))).verdict == "proved"
    for changed, verdict in (
        ({"eta": theorem["eta"] / 2, "rho": 2 * theorem["rho"]}, "proved"),
        ({"eta": 2 * theorem["eta"]}, "refuted"),
        ({"rho": theorem["rho"] / 2}, "refuted"),
        ({"Q_I": "P(tau_k^-)"}, "refuted"),
    ):
        rate["evidence"]["theorem_2_2"] = theorem | changed
        assert obsdesign.verify(from_dict(signed(stored))).verdict == verdict


def signed(body: Any) -> Any:
    return body | {"digest": digest(body)}


# --- Lemma 3.2: (13) and (14) are stable together ----------------------------------------------------

IMPULSES, WINDOW = 16, 5  # longer than n: a window of n impulses is dead-beat


def errors_of_13_and_14(seed: int, singular: bool) -> tuple[Any, ...]:
    """Phi, N_k C, the errors of (13) before and after impulses, and z of (14), for one start.

    delta_k follows impulse k; Phi(j, k) carries a state from tau_j to tau_k, jump included;
    (12) is L[k] = -Phi(k - l, k) N_k.
    """
    rng = np.random.default_rng(seed)
    n, alpha = 3, 1.3
    A, G, C = rng.standard_normal((n, n)), rng.standard_normal((n, n)), rng.standard_normal((1, n))
    if singular:
        G[:, 0] = G[:, 1]
    flows = {k: expm(A * delta) for k, delta in enumerate(rng.uniform(0.3, 0.7, 25), start=-8)}

    def phi(start: int, end: int) -> Any:
        product = np.eye(n)
        for j in range(start, end):
            product = G @ flows[j] @ product
        return product

    N = {}
    for k in range(1, IMPULSES + 1):
        X = [flows[j - 1] @ phi(k - WINDOW, j - 1) for j in range(k - WINDOW + 1, k + 1)]
        M = sum(alpha ** (2 * i) * P.T @ C.T @ C @ P for i, P in enumerate(X))
        N[k] = alpha ** (2 * (WINDOW - 1)) * np.linalg.solve(M, X[-1].T @ C.T) @ C
    x, before = {0: rng.standard_normal(n)}, {}
    for k in range(1, IMPULSES + 1):  # (13)
        before[k] = flows[k - 1] @ x[k - 1]
        x[k] = G @ before[k] - phi(k - WINDOW, k) @ N[k] @ before[k]
    # what the first window takes off, carried back to tau_0
    taken = [phi(j - WINDOW, 0) @ N[j] @ before[j] for j in range(1, WINDOW + 1)]
    z = {WINDOW: x[0] - sum(taken)}
    for k in range(WINDOW + 1, IMPULSES + 1):  # (14) and (15)
        late = flows[k - 1 - WINDOW] @ z[k - 1]
        z[k] = G @ late - N[k] @ flows[k - 1] @ phi(k - 1 - WINDOW, k - 1) @ z[k - 1]
    return phi, N, before, x, z


@pytest.mark.parametrize("singular", [False, True])
@pytest.mark.parametrize("seed", range(5))
def test_lemma_32_where_14_decays_13_does(seed: int, singular: bool) -> None:
    """Whatever the start, from impulse l on the error of (13) is Phi(t, rho_l(t)) z(t)."""
    phi, _, _, x, z = errors_of_13_and_14(seed, singular)
    for k in range(WINDOW, IMPULSES + 1):
        error = phi(k - WINDOW, k) @ z[k] - x[k]  # M_alpha is inverted as printed: digits are lost
        assert np.abs(error).max() <= 1e-4 * np.abs(x[k]).max()


def test_maps_rho_compose_and_carry_z_to_the_error() -> None:
    """Before (14): rho_(i+j) = rho_i rho_j; Phi(t, rho_l(t)) makes z of (14) the error of (13)."""
    rng = np.random.default_rng(7)
    delta = rng.uniform(0.3, 0.7, 30)
    times = np.concatenate([[0.0], np.cumsum(delta)])

    def place(t: float) -> tuple[int, float]:
        """k and the time since tau_k."""
        k = int(np.searchsorted(times, t, side="right")) - 1
        return k, t - times[k]

    def rho(back: int, t: float) -> float:
        k, passed = place(t)
        return float(times[k - back] + delta[k - back] / delta[k] * passed)

    def shifted(back: int, t: float) -> float:
        """The twin: the same time since an impulse, not the same share of the interval."""
        k, passed = place(t)
        return float(times[k - back] + passed)

    for t in rng.uniform(times[10], times[20], 20):
        for i, j in ((2, 3), (-4, 1), (3, -3), (0, 2)):
            assert rho(i, rho(j, t)) == pytest.approx(rho(i + j, t), abs=1e-12)
            assert rho(j, rho(i, t)) == pytest.approx(rho(i + j, t), abs=1e-12)
    gaps = [
        shifted(2, shifted(3, t)) - shifted(5, t) for t in rng.uniform(times[10], times[20], 20)
    ]
    assert np.abs(gaps).max() > 0.1

    A, G = rng.standard_normal((3, 3)), rng.standard_normal((3, 3))
    G[:, 0] = G[:, 1]

    def phi(end: float, start: float) -> Any:
        X, now = np.eye(3), start
        for tau in times[(times > start) & (times <= end)]:
            X, now = G @ expm(A * (tau - now)) @ X, tau
        return expm(A * (end - now)) @ X

    z = rng.standard_normal(3)
    for share in (0.2, 0.9):
        k, t = 12, times[12] + share * delta[12]
        slow = expm(delta[k - WINDOW] / delta[k] * A * (t - times[k]))  # of (15)
        error = expm(A * (t - times[k])) @ phi(times[k], times[k - WINDOW]) @ z  # of (13)
        np.testing.assert_allclose(phi(t, rho(WINDOW, t)) @ slow @ z, error, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("singular", [False, True])
@pytest.mark.parametrize("seed", range(5))
def test_lemma_32_where_13_decays_14_does(seed: int, singular: bool) -> None:
    """l impulses later z is the error of (13), less l bounded maps of it: no inverse of Phi."""
    phi, N, before, x, z = errors_of_13_and_14(seed, singular)
    for k in range(WINDOW, IMPULSES + 1 - WINDOW):
        taken = [phi(j - WINDOW, k) @ N[j] @ before[j] for j in range(k + 1, k + WINDOW + 1)]
        error = x[k] - sum(taken) - z[k + WINDOW]
        assert np.abs(error).max() <= 1e-4 * max(np.abs(x[k]).max(), np.abs(z[k + WINDOW]).max())
