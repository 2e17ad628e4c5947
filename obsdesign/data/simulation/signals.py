"""Signals of a simulated plant: disturbances inside their bounds, inputs, noise.

Every signal is constant between rows, or a sine, so that the flow is an exponential of one
matrix: x' = A x + c + sum of columns times sines, c' = 0, and an oscillator for each sine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Matrix
from obsdesign.problem.flow import Flow
from obsdesign.problem.plant import Plant

DISTURBANCES = ("zero", "extreme", "random", "sine")
_INPUT_CHANGES = 20  # a known input takes this many values over a record


@dataclass(frozen=True)
class Bounded:
    """A signal lower <= s(t) <= upper, held between rows or a sine; shapes (rows, k) or (k,)."""

    held: Matrix
    amplitude: Matrix
    omega: Matrix
    phase: Matrix

    def value(self, k: int, t: float) -> Matrix:
        """Value at time t of row k."""
        signal: Matrix = self.held[k] + self.amplitude * np.sin(self.omega * t + self.phase)
        return signal


@dataclass(frozen=True)
class Signals:
    """Signals of one run; rows are those of the record."""

    plant: Plant
    generator: Matrix
    flow: Bounded
    unknown_input: Bounded
    jump_disturbances: tuple[Bounded, ...]
    noise: Bounded
    gaussian: Matrix
    u: Matrix
    w: Matrix
    weights: Matrix

    def extended(self, x: Matrix, k: int, t: float) -> Matrix:
        """State of plant, constants and oscillators at the start (time t) of the step to row k."""
        flow = self.plant.flow
        constant = flow.disturbance_columns @ self.flow.held[k]
        if flow.B is not None:
            constant += flow.B @ self.u[max(k - 1, 0)]
        if flow.D is not None:
            constant += flow.D @ self.unknown_input.held[k]
        angles = np.concatenate([s.omega * t + s.phase for s in (self.flow, self.unknown_input)])
        return np.concatenate([x, constant, np.sin(angles), np.cos(angles)])

    def stepped(self, x: Matrix, k: int, t: float, count: int) -> Matrix:
        """State after so many steps of discrete time from time t, with the signals of row k."""
        flow = self.plant.flow
        for i in range(count):
            now = t + i * (flow.dt or 0.0)
            following = flow.A @ x + flow.disturbance_columns @ self.flow.value(k, now)
            if flow.B is not None:
                following += flow.B @ self.u[max(k - 1, 0)]
            if flow.D is not None:
                following += flow.D @ self.unknown_input.value(k, now)
            x = following
        return x

    def with_inputs(self, other: Signals) -> Signals:
        """These signals with the known and the unknown input of others of as many rows."""
        d = other.unknown_input
        generator = _generator(self.plant.flow, self.flow, d)
        return replace(self, u=other.u, unknown_input=d, generator=generator)

    def with_unknown_input(self, d: Matrix) -> Signals:
        """These signals with an unknown input that is held from row to row, (rows, q)."""
        still = np.zeros(d.shape[1])
        held = Bounded(d, still, still, still)
        return replace(
            self, unknown_input=held, generator=_generator(self.plant.flow, self.flow, held)
        )

    def of_plant(self, plant: Plant) -> Signals:
        """The same signals, of a plant with other matrices of the same sizes."""
        generator = _generator(plant.flow, self.flow, self.unknown_input)
        return replace(self, plant=plant, generator=generator)

    def jump(self, k: int, event: int) -> Matrix:
        """E w + H g + c of an event at row k."""
        jump, c = self.plant.events[event], self.jump_disturbances[event]
        total: Matrix = jump.disturbance_columns @ c.held[k]
        if jump.E is not None:
            total += jump.E @ self._own(self.w[k], "E", event)
        if jump.H is not None:
            total += jump.H @ self._own(self.weights[k], "H", event)
        return total

    def of_inputs(self, happens: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Which known inputs w (rows, l) act, from the events that happen (rows, events)."""
        return np.repeat(happens, _inputs_of(self.plant, "E"), axis=1)

    def weights_of(self, k: int, happening: Sequence[int]) -> Matrix:
        """Weights of impulses at row k, zero for events that do not happen."""
        counts = _inputs_of(self.plant, "H")
        acts = np.isin(np.repeat(np.arange(len(counts)), counts), happening)
        return np.where(acts, self.weights[k], 0.0)

    def _own(self, values: Matrix, key: str, event: int) -> Matrix:
        counts = _inputs_of(self.plant, key)
        first = sum(counts[:event])
        return values[first : first + counts[event]]

    def measurement(
        self, clean: Matrix, k: int, t: float, measured: NDArray[np.bool_]
    ) -> Matrix:  # fmt: skip
        """y at row k, NaN where there is none. A bound of the noise holds for all of it."""
        if not measured.any():
            return np.full_like(clean, np.nan)
        output = self.plant.outputs
        spread = np.hypot(output.noise_std, output.noise_cv * clean)
        lower, upper = noise_ends(self.plant)
        noise = self.noise.value(k, t) + spread * self.gaussian[k]
        if output.noise_bound is not None:
            noise = np.clip(noise, lower, upper)
        return np.where(measured, clean + noise, np.nan)

    def unknown(self, times: Matrix) -> Matrix:
        """Truth of the unknown input, (rows, q)."""
        return np.array(
            [self.unknown_input.value(k, t) for k, t in enumerate(times.tolist())]
        ).reshape(len(times), self.unknown_input.held.shape[1])


def signals(plant: Plant, kind: str, rows: int, rng: np.random.Generator) -> Signals:
    """Draw the signals of a run of that many rows; `kind` is one of DISTURBANCES."""
    flow, p = plant.flow, plant.p
    inputs, unknowns = _columns(flow.B), _columns(flow.D)
    b = _bounded(flow.lower, flow.upper, kind, rows, rng)
    d = _unknown_input(flow, unknowns, kind, rows, rng)
    # a jump has no duration: a sine is sampled there
    word = "random" if kind == "sine" else kind
    boxes = [(event.lower, event.upper) for event in plant.events]
    # drawn without events too: a seed gives the same noise with jumps and without
    c = tuple(_bounded(*box, word, rows, rng) for box in boxes or [(np.zeros(plant.n),) * 2])
    v = _bounded(*noise_ends(plant), kind, rows, rng)
    changes = np.minimum(np.arange(rows) * _INPUT_CHANGES // max(rows, 1), _INPUT_CHANGES - 1)
    return Signals(
        plant,
        _generator(flow, b, d),
        b,
        d,
        c,
        v,
        rng.standard_normal((rows, p)) * (kind != "zero"),
        rng.uniform(-1, 1, (_INPUT_CHANGES, inputs))[changes] * _or_one(flow.input_bound, inputs),
        rng.uniform(-1, 1, (rows, sum(_inputs_of(plant, "E")))) * _largest_inputs(plant),
        rng.uniform(0.5, 1.5, (rows, sum(_inputs_of(plant, "H")))),
    )


def _largest_inputs(plant: Plant) -> Matrix:
    """Bounds of |w| of all events, one where none is stated."""
    bounds = [_or_one(event.input_bound, event.inputs) for event in plant.events]
    return np.concatenate([np.zeros(0), *bounds])


def _or_one(bound: Matrix | None, inputs: int) -> Matrix:
    return np.ones(inputs) if bound is None else bound


def noise_ends(plant: Plant) -> tuple[Matrix, Matrix]:
    """Lower and upper bounds of the noise, (p,); zeros where they are not known."""
    bound = plant.outputs.noise_bound
    if bound is None:
        return np.zeros(plant.p), np.zeros(plant.p)
    return (-bound, bound) if bound.ndim == 1 else (bound[:, 0], bound[:, 1])


def _inputs_of(plant: Plant, key: str) -> list[int]:
    """Columns of E or H of every event."""
    return [_columns(getattr(event, key)) for event in plant.events]


def _columns(matrix: Matrix | None) -> int:
    return 0 if matrix is None else matrix.shape[1]


def _bounded(
    lower: Matrix, upper: Matrix, kind: str, rows: int, rng: np.random.Generator
) -> Bounded:
    size, middle, radius = len(lower), (lower + upper) / 2, (upper - lower) / 2
    still = np.zeros(size)
    if kind == "sine":
        held = np.tile(middle, (rows, 1))
        return Bounded(held, radius, rng.uniform(0.5, 3.0, size), rng.uniform(0, 2 * np.pi, size))
    if kind == "zero":
        held = np.tile(middle, (rows, 1))
    elif kind == "extreme":
        held = np.tile(np.where(rng.random(size) < 0.5, lower, upper), (rows, 1))
    else:
        held = rng.uniform(0, 1, (rows, size)) * (upper - lower) + lower
    return Bounded(np.clip(held, lower, upper), still, still, still)


def _unknown_input(
    flow: Flow, q: int, kind: str, rows: int, rng: np.random.Generator
) -> Bounded:  # fmt: skip
    """d inside its bounds, +-1 without any; with a rate of change a sine, or still."""
    own = flow.d_bounds
    lower, upper = (-np.ones(q), np.ones(q)) if own is None else (own.lower, own.upper)
    if own is None or own.rate is None or kind not in ("random", "sine"):
        return _bounded(lower, upper, kind, rows, rng)
    sine = _bounded(lower, upper, "sine", rows, rng)
    return replace(sine, amplitude=np.minimum(sine.amplitude, own.rate / sine.omega))


def _generator(flow: Flow, b: Bounded, d: Bounded) -> Matrix:
    """d/dt [x; c; sin; cos] for the sines that have an amplitude."""
    n = len(flow.A)
    D = flow.D if flow.D is not None else np.zeros((n, 0))
    through = np.hstack([flow.disturbance_columns * b.amplitude, D * d.amplitude])
    omega = np.diag(np.concatenate([b.omega, d.omega]))
    k = len(omega)
    zero = np.zeros
    return np.block(
        [
            [flow.A, np.eye(n), through, zero((n, k))],
            [zero((n, 2 * n + 2 * k))],
            [zero((k, 2 * n)), zero((k, k)), omega],
            [zero((k, 2 * n)), -omega, zero((k, k))],
        ]
    )
