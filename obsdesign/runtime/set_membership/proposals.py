"""Multipliers for all directions at once, by a batched interior point method in floats.

    maximise  g_b'xi,   |xi| <= 1,   |residual - H xi| <= V

With s = residual - H xi the unknowns are z = (xi, s), |z| <= w = (1, V), and the multipliers of
H xi + s = residual are those of the strips. Predictor and corrector steps as in S. Mehrotra, On the
implementation of a primal-dual interior point method, SIAM J. Optim. 2 (1992). Whatever comes out
serves: `evaluation` bounds with any multipliers.
"""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import TINY

_START = 10.0
_TO_BOUNDARY = 0.995
_SMALLEST_NOISE = 1e-7  # of a scaled row: strips of no width keep an interior
# duality gap, in parts of the half width that the multipliers give, at which the search ends
_CONVERGED = 1e-4
_FEWEST_ENTRIES = 4000  # of H, from which on its zeros are worth leaving out


def propose(H: Matrix, residual: Matrix, V: Matrix, objective: Matrix, steps: int) -> Matrix:
    """Multipliers (B, M) of upper bounds of objective (B, R); zeros where none were better.

    H (M, R), residual, V (M,).
    """
    M, R = H.shape
    B = len(objective)
    if M == 0 or R == 0:
        return np.zeros((B, M))
    with np.errstate(all="ignore"):
        rows = np.abs(H).sum(axis=1) + V + TINY
        scale = np.abs(objective).sum(axis=1)[:, None] + TINY
        A, rho = H / rows[:, None], residual / rows
        w = np.concatenate([np.ones(R), np.maximum(V / rows, _SMALLEST_NOISE)])
        mu = _Iteration(A, rho, w, objective / scale).best(steps)
        mu = mu * (scale / rows)
    return np.where(np.isfinite(mu), mu, 0.0)


class _Iteration:
    """z, lam and the multipliers zl, zu of -w <= z <= w, for all directions.

    pulled: (H I)'lam; q: (-g, 0).
    """

    def __init__(self, A: Matrix, rho: Matrix, w: Matrix, g: Matrix) -> None:
        self.A, self.rho, self.w = A, rho, w
        (self.M, self.R), B = A.shape, len(g)
        self.q = np.concatenate([-g, np.zeros((B, self.M))], axis=1)
        self.z: Matrix = np.zeros((B, self.R + self.M))
        self.lam = np.zeros((B, self.M))
        self.pulled = np.zeros(self.q.shape)
        start = _START / (self.R + self.M) / w
        self.zl = np.maximum(self.q, 0.0) + start
        self.zu = np.maximum(-self.q, 0.0) + start
        self.blocks = _blocks(A)
        self.best_mu = np.zeros((B, self.M))
        self.best_value = self.half_width = np.abs(g).sum(axis=1)

    def best(self, steps: int) -> Matrix:
        """The best multipliers of so many steps."""
        for _ in range(steps):
            if not self._step():
                break
        return self.best_mu

    def _step(self) -> bool:
        """One predictor and corrector step; False where nothing changes any more."""
        w, z, zl, zu = self.w, self.z, self.zl, self.zu
        inverse_low, inverse_high = 1.0 / (w + z), 1.0 / (w - z)
        theta = 1.0 / (zl * inverse_low + zu * inverse_high)
        total = (w * (zl + zu) + z * (zl - zu)).sum(axis=1)
        count = 2 * z.shape[1]
        is_open = np.isfinite(total) & (total > _CONVERGED * self.half_width)
        if not is_open.any():
            return False
        normal = self._normal(theta)
        slack, missing = self.q - self.pulled, self.rho - self._product(z)
        dz = self._direction(normal, theta, missing, slack)[0]
        low, high = dz * inverse_low, dz * inverse_high
        length = _length(high, low, 1.0 + low, 1.0 - high)
        cross_low, cross_high = dz * zl * (1.0 + low), dz * zu * (1.0 - high)
        after = (1.0 - length) * total - length * length * (cross_low - cross_high).sum(axis=1)
        target = ((after / total) ** 3 * total / count)[:, None]
        lift_low = (target + cross_low) * inverse_low
        lift_high = (target - cross_high) * inverse_high
        dz, dlam, pull = self._direction(normal, theta, missing, slack - lift_low + lift_high)
        low, high = dz * inverse_low, dz * inverse_high
        less_low, less_high = zl * (1.0 + low) - lift_low, zu * (1.0 - high) - lift_high
        length = _TO_BOUNDARY * _length(high, low, less_low / zl, less_high / zu)
        usable = is_open & np.isfinite(length) & np.isfinite(dlam).all(axis=1)
        self._move(np.where(usable, length, 0.0)[:, None], [dz, dlam, pull, less_low, less_high])
        return True

    def _normal(self, theta: Matrix) -> Matrix:
        """H diag(theta) H' + diag of the rest, (B, M, M)."""
        B, M = self.lam.shape
        normal = np.zeros((B, M, M))
        for first, columns in self.blocks:
            part = self.A[first:, columns]
            weighted = (part * theta[:, None, columns]).reshape(-1, part.shape[1])
            normal[:, first:, first:] += (weighted @ part.T).reshape(B, M - first, M - first)
        diagonal = np.arange(M)
        normal[:, diagonal, diagonal] += theta[:, self.R :]
        return normal

    def _move(self, length: Matrix, steps: list[Matrix]) -> None:
        """Go so far in z, lam and pulled, back in zl and zu; keep the best multipliers."""
        if not length.all():  # a step that is not finite is not made
            steps = [np.where(length > 0, step, 0.0) for step in steps]
        dz, dlam, pull, less_low, less_high = (length * step for step in steps)
        self.z, self.lam, self.pulled = self.z + dz, self.lam + dlam, self.pulled + pull
        self.zl, self.zu = self.zl - less_low, self.zu - less_high
        R = self.R
        half = np.abs(self.pulled[:, :R] - self.q[:, :R]).sum(axis=1)
        self.half_width = half + np.abs(self.lam) @ self.w[R:]
        value = self.half_width - self.lam @ self.rho
        better = value < self.best_value
        self.best_value = np.where(better, value, self.best_value)
        self.best_mu[better] = -self.lam[better]

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


def _length(high: Matrix, low: Matrix, less_low: Matrix, less_high: Matrix) -> Matrix:
    """The longest step, at most 1, that keeps z inside and its multipliers nonnegative."""
    rate = np.maximum(high.max(axis=1), -low.min(axis=1))
    rate = np.maximum(rate, np.maximum(less_low.max(axis=1), less_high.max(axis=1)))
    return np.asarray(1.0 / np.maximum(rate, 1.0))
