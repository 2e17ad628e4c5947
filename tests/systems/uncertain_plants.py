"""Random plants with parameters, observers for them, and runs under parameters that vary."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lmi.arithmetic.exponential import expm
from obsdesign.equations.estimation_error import flow_error_matrix, jump_error_matrix
from obsdesign.equations.interval import splits
from obsdesign.runtime.base import Sample
from obsdesign.runtime.bounds_observer import BoundsObserver
from obsdesign.runtime.interval.observer import IntervalObserver
from obsdesign.runtime.set_membership.uncertain_observer import UncertainSetMembershipObserver

PATTERNS = ("adversarial", "bang-bang", "constant")
# pieces of a step in which parameters and disturbances are constant
PIECES = 6


@dataclass
class Uncertain:
    """Numbers of an uncertain plant, nominal and effects, and of gains; any of the effects."""

    A: Any
    C: Any
    V: Any
    b: Any  # (2, n): middle and radius
    effects: list[dict[str, Any]]
    G: Any = None
    c: Any = None
    B: Any = None
    E: Any = None
    gains: dict[str, Any] = field(default_factory=dict)

    @property
    def n(self) -> int:
        return len(self.A)

    def entries(self, **more: Any) -> dict[str, Any]:
        """Entries of a design's gains, with the smallest splits."""
        given = {"L": np.zeros(self.C.shape[::-1]), "M": np.zeros(self.C.shape[::-1])}
        given |= {"jump_measurement": "before", "form": "split", **self.gains, **more}
        data = {
            "A": self.A, "C": self.C, "B": self.B, "noise_bound": self.V,
            "flow_lower": self.b[0] - self.b[1], "flow_upper": self.b[0] + self.b[1],
        }  # fmt: skip
        names = ("A", "B", "G", "E", "C")
        data["effects"] = [
            {"name": f"p{i}", **{key: each[key] for key in names if key in each}}
            for i, each in enumerate(self.effects)
        ]
        for key, name in (("Q", "flow_correction"), ("T", "jump_correction")):
            zero = np.zeros(self.C.shape[::-1])
            data[name] = np.array([each.get(key, zero) for each in self.effects])
        F = self.A if given.get("period") else flow_error_matrix(self.A, given["L"], self.C)
        data["D0"], data["D1"] = splits.metzler_split(_similar(F, given.get("S")))
        if self.G is not None:
            H = self.G if given.get("period") else jump_error_matrix(
                self.G, given["M"], self.C, given["jump_measurement"])  # fmt: skip
            data["Gp"], data["Gn"] = splits.nonnegative_split(_similar(H, given.get("S")))
            data |= {"G": self.G, "E": self.E, "jump_lower": self.c[0] - self.c[1],
                     "jump_upper": self.c[0] + self.c[1]}  # fmt: skip
        return {name: value for name, value in (data | given).items() if value is not None}

    def observer(self, **more: Any) -> IntervalObserver:
        """The observer of these gains."""
        return IntervalObserver.from_gains(self.entries(**more))

    def set_membership(self, window: int, **more: Any) -> UncertainSetMembershipObserver:
        """The observer that looks back at a window of stages."""
        own = self.entries()
        names = ("A", "B", "C", "G", "E", "noise_bound", "flow_lower", "flow_upper", "jump_lower",
                 "jump_upper", "effects", "jump_measurement")  # fmt: skip
        entries = {name: own[name] for name in names if name in own}
        entries |= {"window": window, "steps": 2, "measured": "continuous"}
        return UncertainSetMembershipObserver.from_gains(entries | more)

    def at(self, key: str, p: Any) -> Any:
        """A(p), B(p), G(p), E(p) or C(p)."""
        nominal = getattr(self, key)
        added = [own * each[key] for own, each in zip(p, self.effects, strict=True) if key in each]
        return nominal if nominal is None else nominal + sum(added, np.zeros_like(nominal))


def _similar(X: Any, S: Any) -> Any:
    return X if S is None else np.linalg.solve(S, X @ S)


@dataclass
class Play:
    """A plant whose parameters and disturbances one pattern chooses; x: its state."""

    plant: Uncertain
    pattern: str
    rng: np.random.Generator
    x: Any
    scale: float = 1.0  # 1: parameters keep their ranges

    def __post_init__(self) -> None:
        self.fixed = self.rng.uniform(-1, 1, len(self.plant.effects))
        self.fixed = np.where(
            self.rng.random(self.fixed.shape) < 0.5, np.sign(self.fixed), self.fixed
        )
        self.target = self.rng.standard_normal(self.plant.n)
        self.lower = self.upper = self.x

    def parameters(self, key: str, known: Any = None, sign: float = 1.0) -> Any:
        """Values now: for A and G those that drive the state towards the target."""
        if self.pattern == "constant":
            return self.scale * self.fixed
        q = len(self.plant.effects)
        if self.pattern == "bang-bang":
            return self.scale * self.rng.choice([-1.0, 1.0], q)
        other = {"A": "B", "G": "E"}.get(key, "")
        p = np.zeros(q)
        for i, each in enumerate(self.plant.effects):
            push = each[key] @ self.x if key in each else 0.0
            push = push + (each[other] @ known if other in each and known is not None else 0.0)
            target = self.target if key != "C" else self.target[: len(self.plant.C)]
            p[i] = np.sign(np.sum(target * push)) or 1.0
        return self.scale * sign * p

    def disturbance(self, box: Any) -> Any:
        """A value in a box, (2, n): at a corner towards the target, or any corner."""
        if self.pattern == "adversarial":
            return box[0] + box[1] * np.sign(self.target[: len(box[0])])
        return box[0] + box[1] * self.rng.choice([-1.0, 1.0], len(box[0]))

    def flow(self, h: float, u: Any) -> None:
        """The state after a step, exact for constant numbers in each of its pieces."""
        plant, n = self.plant, self.plant.n
        for _ in range(PIECES):
            p = self.parameters("A", u)
            b = self.disturbance(plant.b)
            b = b if plant.B is None else b + plant.at("B", p) @ u
            block = np.zeros((n + 1, n + 1))
            block[:n, :n], block[:n, n] = plant.at("A", p), b
            self._reach((expm(block * (h / PIECES)) @ np.append(self.x, 1.0))[:n])

    def measured(self) -> Any:
        """A measurement now."""
        p = self.parameters("C", sign=float(self.rng.choice([-1.0, 1.0])))
        noise = self.rng.choice([-1.0, 1.0], len(self.plant.V)) * self.plant.V
        return self.plant.at("C", p) @ self.x + noise

    def jump(self, w: Any) -> None:
        """The state after a jump."""
        p = self.parameters("G", w)
        x = self.plant.at("G", p) @ self.x + self.disturbance(self.plant.c)
        self._reach(x if self.plant.E is None else x + self.plant.at("E", p) @ w)

    def _reach(self, x: Any) -> None:
        self.x, self.lower = x, np.minimum(self.lower, x)
        self.upper = np.maximum(self.upper, x)


@dataclass
class Course:
    """Rows of a play: samples, states just after them, and the box of all states on the way."""

    samples: list[Sample]
    x: Any  # (rows, n)
    lower: Any
    upper: Any


def course(
    play: Play, rows: int, step: float, *, at_jumps: bool = False, largest: float = 1.0
) -> Course:
    """Rows of different lengths, a fifth without a sample, jumps now and then.

    at_jumps: samples at jumps alone; largest: magnitude of known inputs in a fifth of the rows.
    """
    plant, rng = play.plant, play.rng
    m, inputs = (0 if X is None else X.shape[1] for X in (plant.B, plant.E))
    when = plant.gains["jump_measurement"]
    u, t = np.zeros(m), 0.0
    samples, x = ([Sample(0.0, u=u)], [play.x]) if m else ([], [])
    for _ in range(rows):
        h = step * float(rng.choice([1.0, 1.0, 1.0, 0.3, 2.0]))
        play.flow(h, u)
        t += h
        jump = plant.G is not None and rng.random() < 0.15
        size = largest if rng.random() < 0.2 else 1.0
        before, w = play.measured(), size * rng.uniform(-1, 1, inputs)
        if jump:
            play.jump(w)
        y = play.measured() if jump and when == "after" else before
        is_missing = rng.random() < 0.2 or (at_jumps and not jump)
        if is_missing or (jump and when == "none"):
            y = None
        u = size * rng.uniform(-1, 1, m)
        samples.append(Sample(t, y, u, w if inputs else None, jump))
        x.append(play.x)
    spread = 0.1 * (play.upper - play.lower) + 0.1
    return Course(samples, np.array(x), play.lower - spread, play.upper + spread)


def margins(observer: BoundsObserver[Any], run: Course, lower: Any, upper: Any) -> tuple[Any, Any]:
    """(worst relative margin of the enclosure per row, widths (rows, n)) from bounds at the start.

    A margin below zero is a state outside its bounds.
    """
    state, worst, widths = observer.init(0.0, lower=lower, upper=upper), [], []
    for sample, x in zip(run.samples, run.x, strict=True):
        state, estimate = observer.step(state, sample)
        assert estimate.lower is not None
        assert estimate.upper is not None
        room = np.minimum(estimate.upper - x, x - estimate.lower)
        widths.append(estimate.upper - estimate.lower)
        size = np.where(np.isfinite(widths[-1]), widths[-1], 0.0)  # bounds that overflowed hold
        worst.append(float((room / np.maximum(size, np.abs(x).max() + 1e-3)).min()))
    return np.array(worst), np.array(widths)


def boxed(plant: Uncertain, lower: Any, upper: Any) -> dict[str, Any]:
    """Entries of a design that knows lower <= x <= upper, and inputs up to 1: wider bounds."""
    centre, radius = 0.5 * (lower + upper), 0.5 * (upper - lower)
    sizes = {}
    for key, known, shape in (("A", "B", plant.n), ("G", "E", plant.n), ("C", "", len(plant.C))):
        total = np.zeros(shape)
        for each in plant.effects:
            if key in each:
                total += np.abs(each[key] @ centre) + np.abs(each[key]) @ radius
            if known in each:
                total += np.abs(each[known]).sum(axis=1)
        sizes[key] = total * (1 + 1e-12)
    entries = {"state_lower": lower, "state_upper": upper, "flow_effect": sizes["A"],
               "output_effect": sizes["C"], "noise_bound": plant.V + sizes["C"]}  # fmt: skip
    for name, size, own in (("flow", "A", plant.b), ("jump", "G", plant.c)):
        if own is not None:
            entries |= {f"{name}_effect": sizes[size],
                        f"{name}_lower": own[0] - own[1] - sizes[size],
                        f"{name}_upper": own[0] + own[1] + sizes[size]}  # fmt: skip
    return entries


def boxed_columns(plant: Uncertain, lower: Any, upper: Any) -> dict[str, Any]:
    """The same for `set_membership`: bounds of effects along each of their columns."""
    centre, radius = 0.5 * (lower + upper), 0.5 * (upper - lower)
    own = plant.set_membership(1).gains
    entries: dict[str, Any] = {"output_effect": boxed(plant, lower, upper)["output_effect"]}
    for name, state in (("flow", "A"), ("jump", "G")):
        if getattr(plant, state) is not None:
            factors = getattr(own, f"{name}_factors")
            X, inputs = np.split(factors.rows, [plant.n], axis=1)
            sizes = np.abs(X @ centre) + np.abs(X) @ radius + np.abs(inputs).sum(axis=1)
            entries[f"{name}_effect"] = factors.bounds(sizes) * (1 + 1e-12)
    return entries


def random_uncertain(rng: np.random.Generator, *, periodic: bool | None = None) -> Uncertain:
    """Two or three states; uncertain A, B, G, E and C, any gains, coordinates now and then."""
    n, p = int(rng.integers(2, 4)), int(rng.integers(1, 3))
    m, inputs = int(rng.integers(0, 2)), int(rng.integers(0, 2))
    A = rng.standard_normal((n, n)) - rng.uniform(0, 2) * np.eye(n)
    C = rng.standard_normal((p, n)) * (rng.random((p, n)) < 0.7)
    G = rng.standard_normal((n, n)) * rng.uniform(0.1, 0.7) if rng.random() < 0.7 else None
    B = rng.standard_normal((n, m)) if m else None
    E = rng.standard_normal((n, inputs)) if inputs and G is not None else None
    size = rng.uniform(0, 0.1, 2) * (rng.random(2) < 0.7)
    b = np.array([rng.standard_normal(n) * 0.2, np.full(n, size[0])])
    c = np.array([rng.standard_normal(n) * 0.2, np.full(n, size[1])])
    when = str(rng.choice(["before", "after", "none"]))
    is_periodic = bool(rng.random() < 0.4) if periodic is None else periodic
    effects = [_random_effect(rng, {"A": A, "B": B, "G": G, "E": E, "C": C}, is_periodic, when)
               for _ in range(int(rng.integers(1, 4)))]  # fmt: skip
    gains: dict[str, Any] = {"L": rng.standard_normal((n, p)) * rng.choice([0.0, 0.4, 2.0]),
                             "M": rng.standard_normal((n, p)) * 0.4, "jump_measurement": when}  # fmt: skip
    if when == "none":
        gains["M"] = 0 * gains["M"]
    if is_periodic:
        gains["period"] = 0.1
    if rng.random() < 0.4:
        gains |= {"form": "coordinates", "S": rng.standard_normal((n, n)) + 2 * np.eye(n)}
    V = rng.uniform(0, 0.1, p) * (rng.random() < 0.8)
    return Uncertain(A, C, V, b, effects, G, c if G is not None else None, B, E, gains)


def _random_effect(
    rng: np.random.Generator, nominal: dict[str, Any], periodic: bool, when: str
) -> dict[str, Any]:
    effect: dict[str, Any] = {}
    for key, values in nominal.items():
        if values is None or rng.random() < 0.5:
            continue
        shape = np.shape(values)
        effect[key] = 0.3 * rng.standard_normal(shape) * (rng.random(shape) < 0.5)
    if not effect:
        effect["A"] = 0.3 * rng.standard_normal(nominal["A"].shape)
    n, p = nominal["C"].shape[::-1]
    if "A" in effect and not periodic and rng.random() < 0.6:
        effect["Q"] = rng.standard_normal((n, p)) * 0.2
    if "G" in effect and not periodic and when == "before" and rng.random() < 0.6:
        effect["T"] = rng.standard_normal((n, p)) * 0.2
    return effect
