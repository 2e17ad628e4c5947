"""Degue, Efimov, Richard, Interval Observers for Linear Impulsive Systems, NOLCOS 2016.

Every number printed in the paper, or ours where the print is wrong (docs/papers.md).
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import obsdesign
from docs.figures import degue as degue_figures
from lmi.decide.stability import decide
from lmi.prove.common_matrix import prove_common
from lmi.prove.hurwitz import prove_hurwitz
from lmi.refute.spectral import refute_spectral
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.equations.interval.width import WidthSystem, periodic_width
from obsdesign.runtime.interval.maps import jump_maps, step_maps
from obsdesign.runtime.interval.observer import IntervalObserver

EXAMPLES = Path(__file__).parents[2] / "examples"

A1, G1, C = np.array([[-1.0, 0], [1, -2]]), np.array([[2.0, 1], [1, 3]]), np.array([[0.0, 1]])
L1, M1 = np.array([[0.0], [1]]), np.array([[1.0], [2.8]])
BETA, DELTA, V = 0.1, 0.3, 0.03

# Example 4.2 as printed
PRINTED_S1 = np.array([[-0.7071, -0.4472], [-0.7071, -0.8944]])
PRINTED_S2 = np.array([[0.0, 0.9594], [1.0, 0.2822]])
PRINTED_R, PRINTED_T = np.diag([-2.0, -1.0]), np.diag([-0.8, 0.9])

HALF_LAST_DIGIT = 5e-7  # numbers below are given to six decimals
TABLE_DIGITS = 1e-5


def investigate(name: str, **changes: object) -> obsdesign.Outcome:
    """The verdict on an example, with some entries of the file replaced."""
    return investigate_with(
        obsdesign.load_problem(EXAMPLES / f"{name}.toml").to_dict()["observer"], name, **changes
    )


def investigate_with(observer: dict, name: str, **changes: object) -> obsdesign.Outcome:
    """The verdict on the plant of an example with another [observer]."""
    document = obsdesign.load_problem(EXAMPLES / f"{name}.toml").to_dict() | {"observer": observer}
    for path, value in changes.items():
        block, key = path.split("__")
        document[block][key] = value
    return obsdesign.investigate(obsdesign.Problem.from_dict(document))


def claim(outcome: obsdesign.Outcome, name: str) -> obsdesign.Claim:
    return next(c for c in outcome.claims if c.id == name)


def radius(F: np.ndarray, H: np.ndarray, theta: float) -> float:
    return float(max(abs(np.linalg.eigvals(expm(F * theta) @ H))))


def designed(name: str) -> obsdesign.Design:
    return obsdesign.design(obsdesign.load_problem(EXAMPLES / f"{name}.toml"))


def pair(name: str) -> tuple[np.ndarray, np.ndarray]:
    """(W, N) of an example."""
    gains = designed(name).gains
    return gains["D0"] + gains["D1"], gains["Gp"] + gains["Gn"]


def inputs(design: obsdesign.Design) -> tuple[np.ndarray, np.ndarray]:
    """(f, h) of the width system."""
    system = WidthSystem.from_gains(IntervalGains.from_document(design.gains))
    return system.f, system.h


# --- Example 4.1 ------------------------------------------------------------------------------


def test_example_41_hypotheses() -> None:
    F, H = A1 - L1 @ C, G1 - M1 @ C
    np.testing.assert_allclose(F, [[-1, 0], [1, -3]], atol=1e-15)
    np.testing.assert_allclose(H, [[2, 0], [1, 0.2]], atol=1e-15)
    assert max(abs(np.linalg.eigvals(H))) > 1  # "not Schur stable"
    outcome = investigate("degue_4_1")
    assert {c.id: c.verdict for c in outcome.claims} == {
        "consistent": "proved",
        "flow_positive": "proved",
        "jump_positive": "proved",
        "hurwitz": "proved",
        "dwell_stability": "proved",
        "rates": "proved",
        "width": "proved",
        "sampled_width": "proved",
    }


@pytest.mark.parametrize("shortest", [0.70, 0.6932])
def test_example_41_is_proved_above_ln_2(shortest: float) -> None:
    assert investigate("degue_4_1", jump__dwell_time=[shortest, "inf"]).verdict == "proved"


@pytest.mark.parametrize("shortest", [0.6580, 0.6931])
def test_example_41_printed_dwell_time_is_refuted(shortest: float) -> None:
    outcome = investigate("degue_4_1", jump__dwell_time=[shortest, "inf"])
    assert outcome.verdict == "refuted"
    witness = claim(outcome, "dwell_stability").evidence["witness"]
    theta = witness["theta"]
    # the witness, seen by other means: an admissible dwell time at which the width does not shrink
    assert theta >= shortest
    assert radius(A1 - L1 @ C, G1 - M1 @ C, theta) >= 1


def test_example_41_spectral_radii() -> None:
    assert radius(A1 - L1 @ C, G1 - M1 @ C, 0.6580) == pytest.approx(1.035772, abs=HALF_LAST_DIGIT)
    assert radius(A1 - L1 @ C, G1 - M1 @ C, math.log(2)) == pytest.approx(1.0, abs=1e-14)


@pytest.mark.parametrize("form", ["cooperative", "split"])
def test_no_gain_beats_ln_2_in_these_coordinates(form: str) -> None:
    """C never sees the first column: entry (1, 1) of e^(F t) H is at least 2 e^(-t)."""
    observer = {"kind": "interval", "form": form}
    outcome = investigate_with(observer, "degue_4_1", jump__dwell_time=[0.69, "inf"])
    witness = claim(outcome, "attainable").evidence["witness"]
    assert (outcome.verdict, witness["of_all_gains"]) == ("refuted", True)
    # the twin: a little longer, gains are chosen and proved
    assert (
        investigate_with(observer, "degue_4_1", jump__dwell_time=[0.70, "inf"]).verdict == "proved"
    )


@pytest.mark.parametrize(
    ("dwell", "before", "after", "mean"),
    [
        (5, (0.20587379, 0.15627036), (1.07174758, 1.00512786), (0.37317476, 0.26764875)),
        (2, (0.35958268, 0.23419427), (1.37916535, 1.17442153), (0.70979134, 0.47996832)),
        (1, (1.39730162, 0.77889131), (3.45460325, 2.32107989), (2.25730162, 1.35316340)),
    ],
)
def test_example_41_widths(dwell: float, before: tuple, after: tuple, mean: tuple) -> None:
    design = designed("degue_4_1")
    W, N = pair("degue_4_1")
    widths = periodic_width(W, N, *inputs(design), dwell)
    for ours, known in zip(widths, (before, after, mean), strict=True):
        np.testing.assert_allclose(ours, known, atol=TABLE_DIGITS)


def test_width_before_and_after_the_first_jump() -> None:
    # w(0) = (2, 2), jump at 5; with samples every 1e-3 the slope scheme is within its O(h) excess,
    # and what is reported is cut with prediction and strip: never wider
    observer = obsdesign.runtime.from_design(designed("degue_4_1"))
    t = np.round(np.arange(5001) * 1e-3, 3)
    batch = observer.run_batch(t, np.zeros((5001, 1)), jump=t == 5.0, lower=[-1, -1], upper=[1, 1])
    widths = dict(zip(t.tolist(), batch.upper - batch.lower, strict=True))
    model, radius, scheme = observer.kernels.model, np.ones(2), {}
    step = step_maps(model, 1e-3, 0.0, is_periodic=False)["start"]
    jump = jump_maps(model, observer.gains)[True]
    for instant in t[1:].tolist():
        radius = step.R @ radius + step.g
        if instant == 5.0:
            radius = jump.R @ radius + jump.g
        scheme[instant] = 2 * radius
    continuous = {4.99: (0.21225, 0.159459), 5.0: (1.084257, 1.012008)}
    for instant, known in continuous.items():
        assert np.all(scheme[instant] > np.array(known) - TABLE_DIGITS)
        assert np.all(scheme[instant] < np.array(known) + 5e-4)
        assert np.all(widths[instant] <= scheme[instant] + 1e-9)
    assert widths[4.99][1] <= 2 * 0.03 + 1e-12 < scheme[4.99][1]


# --- Measurement timing -----------------------------------------------------------------------


def _extreme_run(h: float) -> tuple[np.ndarray, np.ndarray]:
    """(t, x) of example 4.1 with b = -beta, v = +V, from (10, 10), until 5."""
    drive = expm(np.block([[A1, -BETA * np.ones((2, 1))], [np.zeros((1, 3))]]) * h)
    x, path = np.array([10.0, 10.0]), []
    t = np.round(np.arange(round(4.9 / h) + 1) * h, 6)
    for _ in t:
        path.append(x)
        x = drive[:2, :2] @ x + drive[:2, 2]
    return t, np.array(path)


@pytest.mark.parametrize(("h", "margin", "when"), [(0.1, -0.10354, 0.6), (0.05, -0.05024, 0.55)])
def test_zero_order_hold_breaks_the_enclosure(h: float, margin: float, when: float) -> None:
    t, x = _extreme_run(h)
    y = x[:, 1] + V
    F = A1 - L1 @ C
    step = expm(np.block([[F, np.eye(2)], [np.zeros((2, 4))]]) * h)
    lower = np.array([10.0, 10.0])
    margins = []
    for k in range(len(t)):
        margins.append(float(np.min(x[k] - lower)))
        held = L1[:, 0] * y[k] - np.abs(L1[:, 0]) * V - BETA
        lower = step[:2, :2] @ lower + step[:2, 2:] @ held
    worst = int(np.argmin(margins))
    assert margins[worst] == pytest.approx(margin, abs=1e-4)
    assert t[worst] == pytest.approx(when)


@pytest.mark.parametrize("h", [0.1, 0.05, 0.01])
@pytest.mark.parametrize("initial_radius", [0.0, 0.1])
def test_our_bounds_hold_with_the_same_inputs(h: float, initial_radius: float) -> None:
    t, x = _extreme_run(h)
    observer = obsdesign.runtime.from_design(designed("degue_4_1"))
    start = np.array([10.0, 10.0])
    batch = observer.run_batch(
        t, x[:, 1:] + V, lower=start - initial_radius, upper=start + initial_radius
    )
    assert np.all(batch.lower <= x)
    assert np.all(x <= batch.upper)
    assert set(batch.status) == {"ok"}


def _continuous_run(jump_measurement: str) -> float:
    """Smallest margin of observer (6) with continuous y and the paper's sine signals, jumps at 5, 10.

    Plant, both bounds and the oscillator in one linear system: exact.
    """
    F, H = A1 - L1 @ C, G1 - M1 @ C
    Z, column, noise = np.zeros((2, 2)), np.ones((2, 1)), np.abs(L1) * V
    S = np.hstack([column, 0 * column])  # picks sin
    LV = L1 @ np.array([[V, 0.0]])
    system = np.block(
        [
            [A1, Z, Z, BETA * S, np.zeros((2, 1))],
            [L1 @ C, F, Z, LV, -BETA * column - noise],
            [L1 @ C, Z, F, LV, BETA * column + noise],
            [np.zeros((1, 6)), np.array([[0.0, 1.0]]), np.zeros((1, 1))],
            [np.zeros((1, 6)), np.array([[-1.0, 0.0]]), np.zeros((1, 1))],
            [np.zeros((1, 9))],
        ]
    )
    step = expm(system * 0.01)
    z = np.array([1, 1, 0, 0, 2, 2, 0, 1, 1.0])
    worst = math.inf
    for k in range(1, 1501):
        z = step @ z
        if k in (500, 1000):
            x, low, high, sine = z[:2].copy(), z[2:4].copy(), z[4:6].copy(), z[6]
            after = G1 @ x + DELTA * sine
            y = C @ (x if jump_measurement == "before" else after) + V * sine
            spread = np.abs(M1[:, 0]) * V + DELTA
            z[:2], z[2:4] = after, H @ low + M1 @ y - spread
            z[4:6] = H @ high + M1 @ y + spread
        worst = min(worst, float(np.min(z[:2] - z[2:4])), float(np.min(z[4:6] - z[:2])))
    return worst


def test_a_post_jump_measurement_breaks_the_printed_observer() -> None:
    assert _continuous_run("before") == pytest.approx(0.03334, abs=1e-4)
    assert _continuous_run("after") == pytest.approx(-0.48559, abs=5e-3)


# --- Example 4.2: the bouncing ball -----------------------------------------------------------


def test_bouncing_ball() -> None:
    assert investigate("degue_4_2").verdict == "proved"
    endless = investigate("degue_4_2", jump__dwell_time=[0, "inf"])
    assert endless.verdict == "refuted"
    assert claim(endless, "hurwitz").verdict == "refuted"


def test_example_42_printed_T_is_not_nonnegative() -> None:
    gains = {
        "L": [[3], [2]], "M": [[0.1], [-0.5]], "S": PRINTED_S1.tolist(), "S2": PRINTED_S2.tolist(),
        "T": PRINTED_T.tolist(),
    }  # fmt: skip
    observer = {"kind": "interval", "form": "two_coordinates", "gains": gains}
    outcome = investigate_with(observer, "degue_4_2")
    witness = claim(outcome, "jump_positive").evidence["witness"]
    assert outcome.verdict == "refuted"
    assert witness["reason"] == "T is not nonnegative: entry (1, 1) is -0.8"
    # and no gain can move the eigenvalue -0.8 away: C does not see the velocity
    G, C_ball = np.diag([1.0, -0.8]), np.array([[1.0, 0.0]])
    for M in np.random.default_rng(1).standard_normal((50, 2, 1)):
        eigenvalues = np.linalg.eigvals(G - M @ C_ball)
        assert np.min(np.abs(eigenvalues + 0.8)) < 1e-12


def test_bouncing_ball_recovered_gains() -> None:
    """L = (3, 2), M = (0.1, -0.5) and the restitution 0.8 are not printed; R, S1, T, S2 are."""
    A, C_ball, G = np.array([[0.0, 1], [0, 0]]), np.array([[1.0, 0]]), np.diag([1, -0.8])
    flow = PRINTED_S1 @ PRINTED_R @ np.linalg.inv(PRINTED_S1)
    jump = PRINTED_S2 @ PRINTED_T @ np.linalg.inv(PRINTED_S2)
    np.testing.assert_allclose(flow, A - np.array([[3.0], [2.0]]) @ C_ball, atol=1e-4)
    np.testing.assert_allclose(jump, G - np.array([[0.1], [-0.5]]) @ C_ball, atol=1e-4)


def test_printed_disturbances_let_the_ball_fall_through_the_floor() -> None:
    """beta = delta = 0.5 act on the position too: at the fourth contact it goes below the floor.

    g and x(0) are not printed: 9.81 and (5, 0).
    """

    def flow(t: float, x: np.ndarray) -> list[float]:
        return [x[1] + 0.5 * math.sin(t), -9.81 + 0.5 * math.sin(t)]

    def height(t: float, x: np.ndarray) -> float:
        return float(x[0])

    height.terminal = True  # type: ignore[attr-defined]
    t, x, contacts = 0.0, np.array([5.0, 0.0]), []
    while len(contacts) < 10:
        begin = 1e-9 if contacts else 0.0  # off the surface
        x = x + begin * np.array(flow(t, x))
        run = solve_ivp(flow, (t + begin, 20.0), x, events=height, rtol=1e-10, atol=1e-12)
        t, x = float(run.t[-1]), run.y[:, -1]
        if run.status != 1:
            break
        contacts.append(t)
        x = np.diag([1.0, -0.8]) @ x + 0.5 * math.sin(t)
    assert contacts == pytest.approx([1.043, 2.972, 4.516, 4.623], abs=5e-4)
    assert x[0] < -1000


# --- Example 4.3 ------------------------------------------------------------------------------


def test_example_43_paper_split() -> None:
    outcome = investigate("degue_4_3")
    assert outcome.verdict == "proved"
    gains = outcome.design.gains
    np.testing.assert_allclose(gains["D0"] - gains["D1"], [[-2, 0], [-4, -1]])
    H = gains["Gp"] - gains["Gn"]
    np.testing.assert_allclose(H, [[2, 1], [1, -3]])
    assert (H < 0).sum() == 1  # "G - MC is negative": only one entry is


def test_example_43_printed_dwell_time_is_refuted() -> None:
    outcome = investigate("degue_4_3", jump__dwell_time=[2.7579, "inf"])
    assert outcome.verdict == "refuted"
    W, N = pair("degue_4_3")
    assert radius(W, N, 2.7579) == pytest.approx(1.0495642, abs=1e-6)


def test_example_43_minimal_split() -> None:
    document = obsdesign.load_problem(EXAMPLES / "degue_4_3.toml").to_dict()
    for name in ("D0", "D1", "Gp", "Gn"):
        del document["observer"]["gains"][name]
    for shortest, verdict in ((1.885, "proved"), (1.884, "refuted")):
        document["jump"]["dwell_time"] = [shortest, "inf"]
        problem = obsdesign.Problem.from_dict(document)
        assert obsdesign.investigate(problem).verdict == verdict


def test_the_large_system_and_the_width_pair_have_one_threshold() -> None:
    D0, D1 = np.array([[-1.5, 0], [0, -1]]), np.array([[0.5, 0], [4, 0]])
    p, n = np.array([[2.5, 1], [1, 0]]), np.array([[0.5, 0], [0, 3]])
    U = np.block([[D0, D1], [D1, D0]])
    for J in (np.block([[p, n], [n, p]]), np.block([[p, n], [p, n]])):  # corrected, printed
        assert decide(U, J, 2.823, math.inf).outcome == "proved"
        assert refute_spectral(U, J, 2.7579, math.inf).outcome == "refuted"
    for theta in (2.7579, 2.8221351564360697, 4.0):
        assert radius(U, J, theta) == pytest.approx(radius(D0 + D1, p + n, theta), rel=1e-9)
    assert radius(D0 + D1, p + n, 2.8221351564360697) == pytest.approx(1.0, abs=1e-12)


def test_no_gain_makes_the_flow_of_43_metzler() -> None:
    outcome = investigate_with({"kind": "interval", "form": "cooperative"}, "degue_4_3")
    witness = claim(outcome, "attainable").evidence["witness"]
    assert outcome.verdict == "refuted"
    assert witness["of_all_gains"]
    assert witness["reason"] == "entry (2, 1) of A - L C is -4, and no gain can touch it"
    # the twin: where C sees that entry, a gain can
    output = {"C": [[1, 0], [0, 1]], "noise_bound": [0, 0]}
    document = obsdesign.load_problem(EXAMPLES / "degue_4_3.toml").to_dict()
    document |= {"output": output, "observer": {"kind": "interval", "form": "cooperative"}}
    assert obsdesign.investigate(obsdesign.Problem.from_dict(document)).verdict == "proved"


# --- Corollary 4 ------------------------------------------------------------------------------


def test_corollary_4_needs_a_hurwitz_flow() -> None:
    F, H = np.diag([1.0, -1.0]), np.diag([0.0, 0.5])
    # (4) holds for every theta with P = I ...
    for theta in (0.0, 1.0, 50.0):
        M = expm(F * theta) @ H
        assert np.linalg.eigvalsh(np.eye(2) - M.T @ M).min() > 0
    # ... and still an input of 1 makes x1 grow like e^t between jumps: no proof is given
    reach = expm(np.block([[F, np.array([[1.0], [0.0]])], [np.zeros((1, 3))]]) * 50)[0, 2]
    assert reach == pytest.approx(math.expm1(50))
    assert prove_hurwitz(F).outcome == "refuted"
    assert prove_common(F, H, np.eye(2), 0.0, math.inf).outcome != "proved"
    assert prove_common(F, H, np.eye(2), 0.0, 50.0).outcome == "proved"


def test_the_runtime_of_an_example_is_loadable() -> None:
    design = designed("degue_4_2")
    assert isinstance(obsdesign.runtime.from_design(design), IntervalObserver)


# --- Figures 1 and 3 --------------------------------------------------------------------------


def system_widths(name: str, t: np.ndarray, jumps: tuple[float, ...]) -> np.ndarray:
    """Widths of observer (6) or (11) from (4, 4) on, by the width system; after jumps."""
    (W, N), (f, h) = pair(name), inputs(designed(name))
    step = expm(np.block([[W, f[:, None]], [np.zeros((1, 3))]]) * (t[1] - t[0]))[:2]
    widths = [np.array([4.0, 4.0])]
    for now in t[1:]:
        w = step @ [*widths[-1], 1.0]
        widths.append(N @ w + h if now in jumps else w)
    return np.array(widths)


@pytest.mark.parametrize(("number", "strip", "decay"), [(1, 0.06, 1.0), (3, 0.0, 2.0)])
def test_figures_1_and_3_show_the_state_inside_its_bounds(
    number: int, strip: float, decay: float
) -> None:
    """Signals, gains and jump times are the paper's; the initial bounds are not printed."""
    run = degue_figures.simulated(number)
    for lower, upper in (run.printed, run.sampled):
        assert (lower <= run.x).all()
        assert (run.x <= upper).all()
    # measurements cut the bounds: never wider than those of the printed observer
    assert (run.printed[0] <= run.sampled[0] + 1e-9).all()
    assert (run.sampled[1] <= run.printed[1] + 1e-9).all()
    printed, sampled = (upper - lower for lower, upper in (run.printed, run.sampled))
    known = system_widths(f"degue_4_{number}", run.t, degue_figures.JUMPS)
    np.testing.assert_allclose(printed, known, rtol=1e-7)
    # x2 is measured: with noise of 2 V in all; no gain touches x1, which forgets like e^(-decay t)
    row = int(np.searchsorted(run.t, 10.0)) - 1
    assert sampled[row, 1] == pytest.approx(strip, abs=1e-9)
    assert 0.2 / decay < sampled[row, 0] < 0.2 / decay + 1.2 * math.exp(-4.99 * decay)


@pytest.mark.parametrize("number", [1, 3])
def test_the_page_states_the_widths_that_the_script_prints(number: int) -> None:
    page = (EXAMPLES.parent / "docs" / "papers.md").read_text(encoding="utf-8")
    row = next(line for line in page.splitlines() if f"(degue_{number}.png)" in line)
    when, text = degue_figures.widths(degue_figures.simulated(number))
    assert f"at t = {when:g}" in row
    assert text in row
