"""Signs of parameters on a grid of time that make a product of maps grow, by its own orbits.

For a product with eigenvalue lambda, x(t) its right eigenvector along the orbit and y(t) the left
one, the derivative of log |lambda| with respect to p_i(t) is Re(y'A_i x / y'x): the best p_i is its
sign (Pontryagin's maximum principle). The step is repeated from many starts at once. Floats only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Array
from lmi.arithmetic.exponential import expm

_STARTS, _SWEEPS = 48, 24
# steps of the grid for each stay: so many in a turn of the fastest mode
_STEPS_PER_TURN, _FEWEST, _MOST = 24, 12, 64
# dwell times change by this part of their range in the first sweep, and by less in each other one
_FIRST_STEP, _SHRINKING = 0.3, 0.85
# of the log of the growth, between words that are two
_DISTINCT = 1e-4


@dataclass(frozen=True)
class Signs:
    """Starts: dwell times (B, J); p of each factor (B, J, 1 + M, q), that of the jump first."""

    thetas: Array
    p: Array

    def where(self, mask: Array, other: Signs) -> Signs:
        """Of each start these where the mask (B,) is set, else the other ones."""
        return Signs(
            np.where(mask[:, None], self.thetas, other.thetas),
            np.where(mask[:, None, None, None], self.p, other.p),
        )


@dataclass(frozen=True)
class SignSearch:
    """A, G: (1 + q, n, n); constant: (q,) which parameters; ends: of dwell times; jumps: J.

    Without jumps a stay is a flow alone.
    """

    A: Array
    G: Array
    constant: Array
    ends: tuple[float, float]
    jumps: int
    has_jumps: bool = True

    @property
    def steps(self) -> int:
        """Steps M of the grid for each stay."""
        speed = float(np.abs(np.linalg.eigvals(self.A[0])).max(initial=0.0))
        turns = self.ends[1] * speed / (2 * math.pi)
        return int(np.clip(_STEPS_PER_TURN * turns, _FEWEST, _MOST))

    def best(self, rng: np.random.Generator, count: int) -> list[Signs]:
        """The fastest growing of all sweeps from so many starts, best first; one start each."""
        signs = self._random(rng)
        best, values = signs, np.full(_STARTS, -np.inf)
        for sweep in range(_SWEEPS):
            growth, better = self._improved(signs, _FIRST_STEP * _SHRINKING**sweep)
            is_best = growth > values
            values, best = np.where(is_best, growth, values), signs.where(is_best, best)
            # where all signs follow at once they may swing to and fro
            share = 0.5 if sweep > _SWEEPS // 3 else 0.0
            keep = (rng.random(signs.p.shape[:3]) < share)[..., None] & ~self.constant
            signs = Signs(better.thetas, np.where(keep, signs.p, better.p))
        order = [int(k) for k in np.argsort(-values) if np.isfinite(values[k])]
        # many starts end in the same word
        kept = [k for i, k in enumerate(order) if i == 0 or (
            values[order[i - 1]] - values[k] > _DISTINCT)]  # fmt: skip
        return [Signs(best.thetas[k : k + 1], best.p[k : k + 1]) for k in kept[:count]]

    def _random(self, rng: np.random.Generator) -> Signs:
        (low, last), q = self.ends, len(self.constant)
        shape = (_STARTS, self.jumps)
        share = np.clip(rng.uniform(-0.3, 1.3, shape), 0.0, 1.0)
        # every other start has the same p throughout a stay
        turns = rng.uniform(0, 3, (*shape, 1, q)) * (np.arange(_STARTS) % 2)[:, None, None, None]
        waves = turns * np.linspace(0, 2 * math.pi, 1 + self.steps)[:, None]
        waves = waves + rng.uniform(0, 2 * math.pi, (*shape, 1, q))
        p = np.where(np.cos(waves) < 0, -1.0, 1.0)
        p[..., self.constant] = p[:, :1, :1, self.constant]
        return Signs(low + share * (last - low), p)

    def maps(self, signs: Signs) -> tuple[Array, Array]:
        """(A(p), factor) of each jump and step: e^{A(p) step}, or G(p), (B, J, 1 + M, n, n)."""
        flows = self.A[0] + np.tensordot(signs.p, self.A[1:], 1)
        lengths = (signs.thetas / (signs.p.shape[2] - 1))[:, :, None, None, None]
        factors = np.empty_like(flows)
        with np.errstate(all="ignore"):
            factors[:, :, 1:] = expm(flows[:, :, 1:] * lengths)
        at_jump = self.G[0] + np.tensordot(signs.p[:, :, 0], self.G[1:], 1)
        factors[:, :, 0] = at_jump if self.has_jumps else np.eye(len(self.A[0]))
        return flows, factors

    def _improved(self, signs: Signs, step: float) -> tuple[Array, Signs]:
        """(log of the growth per jump, signs and dwell times by the slopes there)."""
        flows, factors = self.maps(signs)
        x, y, growth = _orbits(factors)
        with np.errstate(all="ignore"):
            after, before = (factors @ x[..., None])[..., 0], (y[..., None, :] @ factors)[..., 0, :]
            scale = (y * after).sum(axis=-1)
            slopes = _forms(y, self.A[1:], after) + _forms(before, self.A[1:], x)
            slopes[:, :, 0] = _forms(y, self.G[1:], x)[:, :, 0]
            slopes = np.real(slopes / scale[..., None])
            speeds = np.real((y * (flows @ after[..., None])[..., 0]).sum(axis=-1) / scale)
        slopes[..., self.constant] = slopes.sum(axis=(1, 2), keepdims=True)[..., self.constant]
        low, last = self.ends
        away = step * (last - low) * np.sign(np.nan_to_num(speeds[:, :, 1:].mean(axis=2)))
        thetas = np.clip(signs.thetas + away, low, last)
        p = np.where(slopes > 0, 1.0, np.where(slopes < 0, -1.0, signs.p))
        return growth / self.jumps, Signs(thetas, p)


def _forms(y: Array, D: Array, x: Array) -> Array:
    """y'D_i x of each pair of vectors (..., n), (..., q)."""
    forms: Array = np.einsum("...k,ikl,...l->...i", y, D, x, optimize=True)
    return forms


def _orbits(factors: Array) -> tuple[Array, Array, Array]:
    """(x before, y after) each factor, scaled, and log |lambda| of each product; -inf if none.

    factors: (B, J, 1 + M, n, n), multiplied in order.
    """
    B, n = len(factors), factors.shape[-1]
    flat = factors.reshape(B, -1, n, n)
    product, sizes = np.tile(np.eye(n), (B, 1, 1)), np.zeros(B)
    with np.errstate(all="ignore"):
        for k in range(flat.shape[1]):
            product = flat[:, k] @ product
            norms = np.linalg.norm(product, axis=(1, 2))
            product, sizes = product / norms[:, None, None], sizes + np.log(norms)
        usable: Array = np.asarray(np.isfinite(product).all(axis=(1, 2)))
        product = np.where(usable[:, None, None], product, 0.0)
        values, vectors = np.linalg.eig(product)
        top = np.argmax(np.abs(values), axis=1)
        chosen = values[np.arange(B), top]
        lefts, left_vectors = np.linalg.eig(np.swapaxes(product, 1, 2))
        near = np.argmin(np.abs(lefts - chosen[:, None]), axis=1)
        x = np.empty((B, flat.shape[1], n), dtype=complex)
        y = np.empty_like(x)
        x[:, 0], y[:, -1] = vectors[np.arange(B), :, top], left_vectors[np.arange(B), :, near]
        for k in range(1, flat.shape[1]):
            x[:, k] = _unit((flat[:, k - 1] @ x[:, k - 1, :, None])[..., 0])
            y[:, -1 - k] = _unit((y[:, -k, None, :] @ flat[:, -k])[:, 0])
        growth = np.where(usable, np.log(np.abs(chosen)) + sizes, -np.inf)
    shape = (*factors.shape[:3], n)
    return x.reshape(shape), y.reshape(shape), growth


def _unit(v: Array) -> Array:
    return np.asarray(v / np.linalg.norm(v, axis=-1, keepdims=True))
