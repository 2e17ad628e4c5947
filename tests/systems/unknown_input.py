"""Random plants with unknown inputs, and existence by an independent test."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.linalg import eig

import obsdesign

Matrix = np.ndarray


def unknown_input_problem(
    A: Any, C: Any, D: Any, B: Any = None, **observer: Any
) -> obsdesign.Problem:
    flow = {"A": A, "D": D} | ({} if B is None else {"B": B})
    return obsdesign.Problem(
        flow=flow, output={"C": C}, observer={"kind": "unknown_input"} | observer
    )


def random_plant(rng: np.random.Generator, n: int, p: int, q: int) -> tuple[Matrix, Matrix, Matrix]:
    """A stable-ish A, generic C and D: square plants have n - q zeros, others none."""
    A = rng.standard_normal((n, n)) / np.sqrt(n)
    return A, rng.standard_normal((p, n)), rng.standard_normal((n, q))


def random_problem(seed: int = 0, n: int = 5, p: int = 3, q: int = 2) -> obsdesign.Problem:
    """A random plant with two known inputs, to be observed."""
    rng = np.random.default_rng(seed)
    A, C, D = random_plant(rng, n, p, q)
    return unknown_input_problem(A - np.eye(n), C, D, rng.standard_normal((n, 2)))


def plant_with_zeros(
    rng: np.random.Generator, n: int, p: int, q: int, zeros: Matrix
) -> tuple[Matrix, Matrix, Matrix]:
    """A plant whose invariant zeros are exactly the eigenvalues of `zeros`, in random coordinates.

    In [x_hidden, x_seen, x_d]: the hidden part flows by `zeros` and only x_d, which the unknown
    input drives, could make it show.
    """
    h = len(zeros)
    A = rng.standard_normal((n, n)) / np.sqrt(n)
    A[:h, :h] = zeros
    A[h : n - q, :h] = 0
    C = rng.standard_normal((p, n))
    C[:, :h] = 0
    D = np.vstack([np.zeros((n - q, q)), np.eye(q)])
    # C = W [0 I] and a part that d does not drive is seen: generic unless p = q and h < n - q
    S = rng.standard_normal((n, n))
    return S @ A @ np.linalg.inv(S), C @ np.linalg.inv(S), S @ D


def pencil_zeros(A: Matrix, C: Matrix, D: Matrix) -> Matrix:
    """Invariant zeros by the Rosenbrock pencil alone: finite eigenvalues of two random squarings.

    A squaring keeps the zeros and adds others, which differ from one to the next.
    """
    n, q = D.shape
    zeros = []
    for seed in (1, 2):
        mix = np.random.default_rng(seed).standard_normal((q, len(C))) if len(C) > q else np.eye(q)
        M = np.block([[A, D], [mix @ C, np.zeros((q, q))]])
        E = np.block([[np.eye(n), np.zeros((n, q))], [np.zeros((q, n + q))]])
        values = eig(M, E, right=False)
        zeros.append(values[np.isfinite(values) & (abs(values) < 1e6)])
    return np.array([s for s in zeros[0] if pencil_margin(A, C, D, s) < 1e-9])


def pencil_margin(A: Matrix, C: Matrix, D: Matrix, s: complex) -> float:
    """Smallest singular value of [[sI - A, -D], [C, 0]], relative to its largest."""
    n, q = D.shape
    pencil = np.block([[s * np.eye(n) - A, -D], [C, np.zeros((len(C), q))]])
    values = np.linalg.svd(pencil, compute_uv=False)
    return float(values[-1] / values[0])
