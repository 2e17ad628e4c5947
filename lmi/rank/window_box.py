"""States of a stack over one box of thetas: centre, slopes and bounds of the error.

With W_i = X_i Z at the centre c of the box, F and P_i = e^{F c_i} H, and s_i = theta_i - c_i,

    X_i(theta) Z e^{-K s_0} = W_i + D_i,
    D_i = P_i D_(i-1) + (e^{F s_i} - 1) P_i (W_(i-1) + D_(i-1)),

K only where the stack flows first: what theta_0 does to the columns alone is undone. Hence, with
the rows Y of the blocks summed up from the last, V_i = Y_i C + V_(i+1) P_(i+1),

    Y O(theta) Z e^{-K s_0} = V_0 W_0 + V_0 D_0 + sum_i V_i (e^{F s_i} - 1) P_i (W_(i-1) + D_(i-1)).

Terms of first and second order in s are matrices at the centre, worked out in balls, so that the
basis of the state does not matter to them; only the rest is bounded entry by entry.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import Balls, ball, exact, identity, middle
from lmi.rank.normalised_stack import RAISED, NormalisedStack, magnitudes

# from here on the series of e^x is bounded by its first term and e^x
_LARGEST_EXPONENT = 30.0


@dataclass(frozen=True)
class WindowBox:
    """Balls at the centre, and nonnegative floats that bound what varies over the box.

    states: W_i; varied: bounds of |D_i|; error: of |1 - Y O Z e^{-K s}|; shares: of it, by theta;
    undone: of |e^{K s} - 1|.
    """

    states: list[Balls]
    varied: list[Matrix]
    error: Matrix
    shares: list[Matrix]
    undone: Matrix


@dataclass
class _Sweep:
    """Forward through the blocks: slopes of the state so far, and bounds of the second order."""

    family: NormalisedStack
    back: list[Balls]
    halves: list[float]
    slopes: list[Balls]
    second_order: Matrix
    shares: list[Matrix]

    def varied(self) -> Matrix:
        """Above |D_i| for the state reached so far."""
        first = (magnitudes(B) * h for B, h in zip(self.slopes, self.halves, strict=False))
        return sum(first, self.second_order) * RAISED


def window_box(
    family: NormalisedStack,
    states: list[Balls],
    steps: list[Balls],
    halves: list[float],
    *,
    Y: list[Balls],
    Z: Balls,
    flows_first: bool,
) -> WindowBox:
    """Enclose the window over a box.

    states: balls X_i at the centre; steps: balls P_1, P_2, ...; halves: half widths of the sides;
    Y: balls, one for each block; Z: ball.
    """
    W = [X * Z for X in states]
    back = _backward(family, steps, Y)
    size = W[0].ncols()
    sweep = _Sweep(family, back, halves, [], np.zeros((W[0].nrows(), size)), [])
    undone = np.zeros((size, size))
    if flows_first:
        undone = _first_flow(sweep, W[0])
    varied = [sweep.varied()]
    for i, P in enumerate(steps, start=1):
        _step(sweep, P, W[i], i, halves[i - 1 + flows_first])
        varied.append(sweep.varied())
    centre = magnitudes(identity(size) - back[0] * W[0])
    error = sum(sweep.shares, centre) * RAISED
    return WindowBox(W, varied, error, sweep.shares, undone)


def _backward(family: NormalisedStack, steps: list[Balls], Y: list[Balls]) -> list[Balls]:
    """V_0, V_1, ...: what the rows make of a change of the state at each block."""
    back = [Y[-1] * family.C]
    for P, rows in zip(reversed(steps), reversed(Y[:-1]), strict=True):
        back.append(rows * family.C + back[-1] * P)
    return back[::-1]


def _first_flow(sweep: _Sweep, W: Balls) -> Matrix:
    """The flow before the first block; above |e^{K s} - 1| for the K that undoes most of it."""
    F, h = sweep.family.F, sweep.halves[0]
    flow = F * W
    K = _undoing(W, flow)
    G = flow - W * K
    twice = F * G - G * K
    grows, size = _exponential(sweep.family.size * h), magnitudes(K)
    undone = _exponential(size * h)
    V, second = sweep.back[0], magnitudes(twice)
    third = sweep.family.size @ second + second @ size
    sweep.slopes.append(G)
    sweep.second_order = grows @ second @ undone * (h * h / 2 * RAISED)
    sweep.shares.append(
        (magnitudes(V * G) * h + magnitudes(V * twice) * (h * h / 2)
         + magnitudes(V) @ grows @ third @ undone * (h**3 / 6)) * RAISED
    )  # fmt: skip
    unit: Matrix = np.eye(len(size))
    return undone - unit


def _step(sweep: _Sweep, P: Balls, W: Balls, block: int, h: float) -> None:
    """One jump and flow: P = e^{F c} H takes the state to W, the flow varies by up to h."""
    F, V, halves = sweep.family.F, sweep.back[block], sweep.halves
    flow = F * W
    again, through = F * flow, V * F
    grows, reach = _exponential(sweep.family.size * h), magnitudes(through)
    carried = [P * B for B in sweep.slopes]
    flows = [F * B for B in carried]
    pairs = list(zip(flows, halves, strict=False))
    crossed = sum((magnitudes(B) * k for B, k in pairs), np.zeros(sweep.second_order.shape))
    inherited = magnitudes(P) @ sweep.second_order
    own = magnitudes(again)
    share = magnitudes(V * flow) * h + magnitudes(V * again) * (h * h / 2)
    for B, k in zip(carried, halves, strict=False):
        share = share + magnitudes(through * B) * (h * k)
    remainder = own * (h**3 / 6) + crossed * (h * h / 2) + inherited * h
    sweep.shares.append((share + reach @ grows @ remainder) * RAISED)
    sweep.second_order = grows @ (inherited + own * (h * h / 2) + crossed * h) * RAISED
    sweep.slopes = [*carried, flow]


def _undoing(W: Balls, flow: Balls) -> Balls:
    """The K, floats as a ball matrix, for which W K is closest to F W."""
    K = np.linalg.lstsq(middle(W), middle(flow), rcond=None)[0]
    return ball(exact(np.where(np.isfinite(K), K, 0.0)))


def _exponential(X: Matrix) -> Matrix:
    """Above e^X entry by entry for a nonnegative X; infinite where it is not worth a number."""
    norm = float(X.sum(axis=1).max(initial=0.0))
    if not norm < _LARGEST_EXPONENT:
        return np.full(X.shape, np.inf)
    halvings = max(0, int(np.ceil(np.log2(max(norm, 1e-300)))) + 2)
    small = X / 2**halvings
    unit: Matrix = np.eye(len(X))
    total, term = unit + small, small
    for k in range(2, 14):
        term = term @ small / k
        total = total + term
    # what follows is below the last term, entry by entry of a matrix of norm 1/4 at most
    total = total + float(term.max(initial=0.0))
    for _ in range(halvings):
        total = total @ total
    above: Matrix = total * RAISED
    return above
