"""Published and constructed pairs (F, H), and thresholds known in closed form."""

from __future__ import annotations

import math

import numpy as np

# Degue, Efimov, Richard 2016, example 4.1 with L = [0, 1], M = [1, 2.8]: shortest dwell ln 2
PAPER_41 = (np.array([[-1.0, 0], [1, -3]]), np.array([[2.0, 0], [1, 3 - 2.8]]))
# the same plant without observer (Briat 2013): spectral radius 1 at 1.1405277855
PLANT_41 = (np.array([[-1.0, 0], [1, -2]]), np.array([[2.0, 1], [1, 3]]))
# example 4.3, width pair of the printed split, and of the minimal one
WIDTH_43 = (np.array([[-1.0, 0], [4, -1]]), np.array([[3.0, 1], [1, 3]]))
MINIMAL_43 = (np.array([[-2.0, 0], [4, -1]]), np.array([[2.0, 1], [1, 3]]))
# the bouncing ball with L = [3, 0], M = [1, 0]: a flow that does not decay
BALL = (np.array([[-3.0, 1], [0, 0]]), np.diag([0.0, 0.8]))
# Briat 2013: dwell times in (ln 1.2, ln 2 / 1.2), and at most ln 2 / 1.5
RANGE = (np.array([[-1.0, 0.1], [0, 1.2]]), np.diag([1.2, 0.5]))
LONGEST = (np.array([[1.0, 3], [-1, 2]]), 0.5 * np.eye(2))

# sampled data (Briat 2013): common P to 1.8276 from 0.4, unstable from 1.88893; and 1.7294 from 0.001
SAMPLED = (
    np.array([[0.0, 1, 0], [-2, 0.1, 1], [0, 0, 0]]),
    np.array([[1.0, 0, 0], [0, 1, 0], [1, 0, 0]]),
)
SAMPLED_CONSTANT = (
    np.array([[0.0, 1, 0], [0, -0.1, 0.1], [0, 0, 0]]),
    np.array([[1.0, 0, 0], [0, 1, 0], [-3.75, -11.5, 0]]),
)
# random pairs that a common P proves to a fraction of the possible gain, on ALTERNATING_RANGE
ALTERNATING = (
    np.array([[-0.57, -0.69], [-0.79, 0.58]]),
    np.array([[-0.46, -0.04], [-2.62, -0.82]]),
)
ALTERNATING_RANGE = (0.37, 2.27)
MIXED = (
    np.array([[-0.31, -1.14, -2.13], [0.33, -0.14, -2.63], [-0.32, 0.15, -2.68]]),
    np.array([[-1.31, 0.66, -0.43], [0.46, -0.44, 2.56], [1.18, -0.76, -0.32]]),
)
MIXED_RANGE = (0.3, 0.82)

SHORTEST_41 = math.log(2)
SHORTEST_PLANT_41 = 1.1405277855
SHORTEST_43 = 2.8221351564
SHORTEST_MINIMAL_43 = 1.884128302
RANGE_ENDS = (0.182321556794, 0.577622650467)
LONGEST_END = 0.462098120373


def radius(F: np.ndarray, H: np.ndarray, theta: float) -> float:
    """Spectral radius of e^{F theta} H, by scipy: an evaluation of our own nothing shares."""
    from scipy.linalg import expm

    return float(np.abs(np.linalg.eigvals(expm(np.asarray(F) * theta) @ H)).max())


def random_pair(rng: np.random.Generator, n: int, gain: float) -> tuple[np.ndarray, np.ndarray]:
    """A Hurwitz flow with time constants near one, and a jump of spectral norm `gain`."""
    F = rng.standard_normal((n, n))
    F -= (np.linalg.eigvals(F).real.max() + 0.5) * np.eye(n)
    H = rng.standard_normal((n, n))
    return F, gain * H / np.linalg.norm(H, 2)


def endless_pair() -> tuple[np.ndarray, np.ndarray]:
    """A Hurwitz flow that a common P proves on no [0.2, infinity), though windows do."""
    rng = np.random.default_rng(27)
    rng.integers(2, 4)
    F, H = rng.standard_normal((2, 2, 2))
    F -= (np.linalg.eigvals(F).real.max() + 0.4) * np.eye(2)
    worst = max(radius(F, H, theta) for theta in np.linspace(0.2, 12, 400))
    return F, 0.92 * H / worst


def growth(F: np.ndarray, H: np.ndarray, thetas: np.ndarray) -> float:
    """Norm of the product of the maps at these dwell times, in turn."""
    from scipy.linalg import expm

    product = np.eye(len(F))
    for theta in thetas:
        product = expm(F * theta) @ H @ product
    return float(np.linalg.norm(product, 2))
