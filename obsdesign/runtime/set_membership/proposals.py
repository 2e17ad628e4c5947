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
_CONVERGED = 1e-11


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
    """The state of the iteration: z, lam, zl, zu for all directions."""

    def __init__(self, A: Matrix, rho: Matrix, w: Matrix, g: Matrix) -> None:
        self.A, self.rho, self.w, self.g = A, rho, w, g
        self.M, self.R = A.shape
        B = len(g)
        self.q = np.concatenate([-g, np.zeros((B, self.M))], axis=1)
        self.z = np.zeros((B, self.R + self.M))
        self.lam = np.zeros((B, self.M))
        k = _START / (self.R + self.M)
        self.zl = np.maximum(self.q, 0.0) + k / w
        self.zu = np.maximum(-self.q, 0.0) + k / w
        self.best_mu = np.zeros((B, self.M))
        self.best_value = np.abs(g).sum(axis=1)

    def best(self, steps: int) -> Matrix:
        """The best multipliers of so many steps."""
        for _ in range(steps):
            if not self._step():
                break
        return self.best_mu

    def _keep_best(self, pulled: Matrix) -> None:
        """Compare the bounds of lam with the best; pulled: lam A."""
        R = self.R
        value = np.abs(self.g + pulled).sum(axis=1) - self.lam @ self.rho
        value = value + np.abs(self.lam) @ self.w[R:]
        better = value < self.best_value
        self.best_value = np.where(better, value, self.best_value)
        self.best_mu[better] = -self.lam[better]

    def _step(self) -> bool:
        """One predictor and corrector step; False where nothing changes any more."""
        A, w, R = self.A, self.w, self.R
        z, zl, zu = self.z, self.zl, self.zu
        low, high = w + z, w - z
        inverse_low, inverse_high = 1.0 / low, 1.0 / high
        dl, du = zl * inverse_low, zu * inverse_high
        theta = 1.0 / (dl + du)
        normal = ((A * theta[:, None, :R]).reshape(-1, R) @ A.T).reshape(-1, self.M, self.M)
        diagonal = np.arange(self.M)
        normal[:, diagonal, diagonal] += theta[:, R:]
        rd = self.q - zl + zu - self._transposed(self.lam)
        rp = self.rho - self._product(z)
        gap = (zl * low + zu * high).sum(axis=1) / (2 * z.shape[1])
        open_ = np.isfinite(gap) & (gap > _CONVERGED)
        if not open_.any():
            return False
        # predictor: cl = -zl low, cu = -zu high
        dz, dlam = self._solved(normal, theta, rp, rd + zl - zu)
        dzl, dzu = -zl - dl * dz, -zu + du * dz
        step = self._length(dz, dzl, dzu)[:, None]
        after = ((zl + step * dzl) * (low + step * dz)).sum(axis=1)
        after += ((zu + step * dzu) * (high - step * dz)).sum(axis=1)
        target = ((after / (2 * z.shape[1] * gap)) ** 3 * gap)[:, None]
        cl = (target - dz * dzl) * inverse_low - zl
        cu = (target + dz * dzu) * inverse_high - zu
        dz, dlam = self._solved(normal, theta, rp, rd - cl + cu)
        dzl, dzu = cl - dl * dz, cu + du * dz
        step = np.where(open_, _TO_BOUNDARY * self._length(dz, dzl, dzu), 0.0)[:, None]
        usable = (np.isfinite(dlam).all(axis=1) & np.isfinite(step[:, 0]))[:, None]
        self.z = np.where(usable, z + step * dz, z)
        self.lam = np.where(usable, self.lam + step * dlam, self.lam)
        self.zl = np.where(usable, zl + step * dzl, zl)
        self.zu = np.where(usable, zu + step * dzu, zu)
        self._keep_best(self.lam @ A)
        return True

    def _solved(
        self, normal: Matrix, theta: Matrix, rp: Matrix, r: Matrix
    ) -> tuple[Matrix, Matrix]:
        right = rp + self._product(theta * r)
        try:
            dlam = np.asarray(np.linalg.solve(normal, right[:, :, None])[:, :, 0], np.float64)
        except np.linalg.LinAlgError:
            dlam = np.full(right.shape, np.nan)
        return theta * (self._transposed(dlam) - r), dlam

    def _product(self, z: Matrix) -> Matrix:
        return z[:, : self.R] @ self.A.T + z[:, self.R :]

    def _transposed(self, lam: Matrix) -> Matrix:
        return np.concatenate([lam @ self.A, lam], axis=1)

    def _length(self, dz: Matrix, dzl: Matrix, dzu: Matrix) -> Matrix:
        """The longest step, at most 1, that keeps z in the box and zl, zu nonnegative."""
        rate = np.maximum(np.abs(dz) / np.where(dz > 0, self.w - self.z, self.w + self.z), 0.0)
        rate = np.maximum(rate, np.maximum(-dzl / self.zl, -dzu / self.zu))
        return np.asarray(1.0 / np.maximum(rate.max(axis=1), 1.0))
