"""Multipliers for all directions at once, by a batched interior point method in floats.

    maximise  g_b'xi,   |xi| <= 1,   |residual - H xi| <= V

With s = residual - H xi the unknowns are z = (xi, s), |z| <= w = (1, V), and the multipliers of
H xi + s = residual are those of the strips. Predictor and corrector steps as in S. Mehrotra, On the
implementation of a primal-dual interior point method, SIAM J. Optim. 2 (1992). Whatever comes out
serves: `evaluation` bounds with any multipliers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Indices, Matrix
from lmi.arithmetic.enclosure import TINY

_SIGNS = np.array([[1.0], [-1.0]])  # of z in its distance from its lower and its upper end
_START = 10.0
_TO_BOUNDARY = 0.99
_SMALLEST_NOISE = 1e-7  # of a scaled row: strips of no width keep an interior
# duality gap, in parts of the width that the best multipliers give, at which a direction is done
_CONVERGED = 8e-4
# what may be missing of a scaled strip where unknowns meet all of them
_MET = 1e-9
_FEWEST_ENTRIES = 4000  # of H, from which on its zeros are worth leaving out


def propose(
    strips: tuple[Matrix, Matrix, Matrix], objective: Matrix, opposite: Indices, steps: int
) -> Matrix:
    """Multipliers (B, M) of upper bounds of objective (B, R); zeros where none were better.

    strips: H (M, R), residual, V (M,). opposite (B,): where the same bound from below is.
    """
    M, R = strips[0].shape
    if M == 0 or R == 0:
        return np.zeros((len(objective), M))
    with np.errstate(all="ignore"):
        scale = np.abs(objective).sum(axis=1)[:, None] + TINY
        iteration, rows = _scaled(strips, objective / scale)
        mu = iteration.best(steps, opposite) * (scale / rows)
    return np.where(np.isfinite(mu), mu, 0.0)


def propose_contradiction(strips: tuple[Matrix, Matrix, Matrix], steps: int) -> Matrix:
    """Multipliers (M,) with |H'mu|_1 + mu'residual + |mu|'V < 0: no unknowns meet all strips.

    Zeros where there are none, or none within so many steps. By Farkas' lemma the multipliers of
    the objective zero are of that kind, and grow without end, where the strips exclude each other.
    """
    M, R = strips[0].shape
    if M == 0 or R == 0:
        return np.zeros(M)
    with np.errstate(all="ignore"):
        iteration, rows = _scaled(strips, np.zeros((1, R)))
        mu = iteration.contradiction(steps) / rows
        mu = mu / np.abs(mu).max()
    return np.where(np.isfinite(mu), mu, 0.0)


def _scaled(strips: tuple[Matrix, Matrix, Matrix], g: Matrix) -> tuple[_Iteration, Matrix]:
    """The iteration with objectives g (B, R), and what its strips are divided by (M,)."""
    H, residual, V = strips
    rows = np.abs(H).sum(axis=1) + V + TINY
    w = np.concatenate([np.ones(H.shape[1]), np.maximum(V / rows, _SMALLEST_NOISE)])
    return _Iteration(H / rows[:, None], residual / rows, w, g), rows


class _Iteration:
    """z, lam and the multipliers of both ends of -w <= z <= w, for all directions.

    room, Z (B, 2, K): distance of z from its lower and upper end, and the multipliers of these;
    pulled: (H I)'lam; q: (-g, 0). open: the directions that are still searched, to which all of
    these belong; the best multipliers and their values are those of all directions.
    """

    def __init__(self, A: Matrix, rho: Matrix, w: Matrix, g: Matrix) -> None:
        self.A, self.rho, self.w = A, rho, w
        (self.M, self.R), B = A.shape, len(g)
        self.K = self.R + self.M
        self.q = np.concatenate([-g, np.zeros((B, self.M))], axis=1)
        self.z: Matrix = np.zeros((B, self.K))
        self.lam = np.zeros((B, self.M))
        self.pulled = np.zeros(self.q.shape)
        self.room = np.empty((B, 2, self.K))
        self.room[:] = w
        self.Z = np.maximum(self.q[:, None] * _SIGNS, 0.0) + _START / self.K / w
        self.blocks = _blocks(A)
        self.open = np.arange(B)
        self.best_mu = np.zeros((B, self.M))
        self.best_value = np.abs(g).sum(axis=1)

    def best(self, steps: int, opposite: Indices) -> Matrix:
        """The best multipliers of so many steps at most."""
        for _ in range(steps):
            gap = np.einsum("bik,bik->b", self.Z, self.room)
            missing = self.rho - self._product(self.z)
            # what is missing of H xi + s = residual may hide as much of the gap
            open_gap = gap + np.einsum("bm,bm->b", np.abs(self.lam), np.abs(missing))
            width = self.best_value + self.best_value[opposite]
            is_open = open_gap > _CONVERGED * width[self.open]  # not where it is no number
            self._keep(is_open)
            if not len(self.open):
                break
            self._step(gap[is_open], missing[is_open])
        return self.best_mu

    def contradiction(self, steps: int) -> Matrix:
        """Multipliers (M,) with a negative value of the objective zero; zeros without any.

        Ends where unknowns meet all strips.
        """
        for _ in range(steps):
            missing = self.rho - self._product(self.z)
            if not np.abs(missing).max() > _MET:
                break
            self._step(np.einsum("bik,bik->b", self.Z, self.room), missing)
        mu: Matrix = self.best_mu[0]
        return mu

    def _keep(self, is_open: NDArray[np.bool_]) -> None:
        """Go on with these directions alone."""
        if is_open.all():
            return
        for name in ("q", "z", "lam", "pulled", "room", "Z", "open"):
            setattr(self, name, getattr(self, name)[is_open])

    def _step(self, gap: Matrix, missing: Matrix) -> None:
        """One predictor and corrector step."""
        Z, room = self.Z, self.room
        ratio = Z / room
        theta = 1.0 / (ratio[:, 0] + ratio[:, 1])
        normal = self._normal(theta)
        slack = self.q - self.pulled
        dz = self._direction(normal, theta, missing, slack)[0]
        change = dz[:, None] * _SIGNS
        part = change / room
        after = 1.0 + part
        far, back = _lengths(part, after)
        gained = change * Z
        crossed = gained * after  # minus the product of both changes
        less = (1.0 - back) * gap + (far - back) * _sum(gained) - far * back * _sum(crossed)
        target = (less / gap) ** 3 * gap / (2 * self.K)
        lift = (target[:, None, None] + crossed) / room
        dz, dlam, pull = self._direction(
            normal, theta, missing, slack - lift[:, 0] + lift[:, 1]
        )  # fmt: skip
        change = dz[:, None] * _SIGNS
        part = change / room
        less = Z * (1.0 + part) - lift
        far, back = _lengths(part, less / Z)
        is_made = np.isfinite(far + back) & np.isfinite(dlam).all(axis=1)
        share = np.where(is_made, _TO_BOUNDARY, 0.0)
        self._move((share * far, share * back), [dz, change, dlam, pull, less])

    def _normal(self, theta: Matrix) -> Matrix:
        """H diag(theta) H' + diag of the rest, (B, M, M)."""
        B, M = len(theta), self.M
        normal = np.zeros((B, M, M))
        for first, columns in self.blocks:
            part = self.A[first:, columns]
            weighted = (part * theta[:, None, columns]).reshape(-1, part.shape[1])
            normal[:, first:, first:] += (weighted @ part.T).reshape(B, M - first, M - first)
        normal.reshape(B, -1)[:, :: M + 1] += theta[:, self.R :]
        return normal

    def _move(self, lengths: tuple[Matrix, Matrix], steps: list[Matrix]) -> None:
        """Go so far in z and room, and so far in lam, pulled and Z; keep the best multipliers."""
        is_made = lengths[0] > 0.0
        if not is_made.all():  # a step that is not finite is not made
            steps = [
                np.where(is_made.reshape(-1, *[1] * (x.ndim - 1)), x, 0.0) for x in steps
            ]  # fmt: skip
        dz, change, dlam, pull, less = steps
        far, back = (length[:, None] for length in lengths)
        self.z, self.room = self.z + far * dz, self.room + far[:, None] * change
        self.lam, self.pulled = self.lam + back * dlam, self.pulled + back * pull
        self.Z = self.Z - back[:, None] * less
        R = self.R
        half = np.abs(self.pulled[:, :R] - self.q[:, :R]).sum(axis=1)
        value = half + np.abs(self.lam) @ self.w[R:] - self.lam @ self.rho
        better = value < self.best_value[self.open]
        places = self.open[better]
        self.best_value[places] = value[better]
        self.best_mu[places] = -self.lam[better]

    def _direction(
        self, normal: Matrix, theta: Matrix, missing: Matrix, r: Matrix
    ) -> tuple[Matrix, Matrix, Matrix]:
        """(dz, dlam, (H I)'dlam) of the Newton equations."""
        weighted = theta * r
        right = missing + self._product(weighted)
        try:
            dlam = np.asarray(np.linalg.solve(normal, right[:, :, None])[:, :, 0], np.float64)
        except np.linalg.LinAlgError:
            dlam = np.full(right.shape, np.nan)
        pull = np.concatenate([dlam @ self.A, dlam], axis=1)
        return theta * pull - weighted, dlam, pull

    def _product(self, z: Matrix) -> Matrix:
        """(H I) z."""
        return z[:, : self.R] @ self.A.T + z[:, self.R :]


def _blocks(A: Matrix) -> list[tuple[int, slice]]:
    """(first row, columns): columns of later stages are zero in the rows of earlier samples."""
    M, R = A.shape
    count = 1 if M * R < _FEWEST_ENTRIES else 4
    first = np.minimum.accumulate(np.argmax(A != 0.0, axis=0)[::-1])[::-1]
    starts = [M * k // count for k in range(count)]
    ends = [*np.searchsorted(first, starts[1:]).tolist(), R]
    begins = [0, *ends[:-1]]
    return [(row, slice(a, b)) for row, a, b in zip(starts, begins, ends, strict=True) if b > a]


def _lengths(part: Matrix, less: Matrix) -> tuple[Matrix, Matrix]:
    """The longest steps, at most 1: one keeps z inside, the other its multipliers nonnegative.

    part: what the room grows by, in parts of it; less: what the multipliers lose, in parts of them.
    """
    B = len(part)
    far, back = -part.reshape(B, -1).min(axis=1), less.reshape(B, -1).max(axis=1)
    return 1.0 / np.maximum(far, 1.0), 1.0 / np.maximum(back, 1.0)


def _sum(values: Matrix) -> Matrix:
    """Sums (B,) of (B, 2, K)."""
    return np.asarray(np.einsum("bik->b", values))
