"""Balls at few bits against exact numbers: at 256 bits a wrong radius shows in no verdict."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from obsdesign.checker import check_design as check

BITS = (6, 10, 16)


@pytest.fixture(params=BITS)
def rng(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> np.random.Generator:
    monkeypatch.setattr(check, "BITS", request.param)
    return np.random.default_rng(request.param)


def unit() -> Fraction:
    return Fraction(1, 1 << check.BITS)


def random_ball(rng: np.random.Generator, m: int, n: int, largest: int, radius: int) -> check.Ball:
    return check.Ball(rng.integers(-largest, largest + 1, (m, n)).tolist(), radius)


def corners(ball: check.Ball, rng: np.random.Generator, count: int) -> Iterator[Any]:
    """Matrices of the ball at the ends of every entry, among them the two with all alike."""
    m, n = len(ball.x), len(ball.x[0])
    signs = [np.ones((m, n), int), -np.ones((m, n), int)]
    signs += [rng.choice([-1, 1], (m, n)) for _ in range(count)]
    for sign in signs:
        entries = np.array(ball.x, dtype=object) + ball.radius * sign.astype(object)
        yield [[Fraction(int(a)) * unit() for a in row] for row in entries]


def holds(ball: check.Ball, X: Any) -> bool:
    return all(
        abs(a - Fraction(b) * unit()) <= ball.radius * unit()
        for rows in zip(X, ball.x, strict=True)
        for a, b in zip(*rows, strict=True)
    )


def is_tight(ball: check.Ball, X: Any) -> bool:
    """Is an entry further away than the radius less two units? The radius is no guess."""
    gaps = [
        abs(a - Fraction(b) * unit())
        for rows in zip(X, ball.x, strict=True)
        for a, b in zip(*rows, strict=True)
    ]
    return max(gaps) > (ball.radius - 3) * unit()


def test_products_hold_every_product(rng: np.random.Generator) -> None:
    tight = 0
    for radius_x, radius_y in itertools.product((0, 1, 3 << (check.BITS - 2)), repeat=2):
        X = random_ball(rng, 2, 3, 3 << check.BITS, radius_x)
        Y = random_ball(rng, 3, 2, 3 << check.BITS, radius_y)
        if (radius_x, radius_y) == (3 << (check.BITS - 2),) * 2:  # all entries alike: every term
            X, Y = (check.Ball([[5 << check.BITS] * n] * m, r) for m, n, r in
                    ((2, 3, radius_x), (3, 2, radius_y)))  # fmt: skip
        image = X.times(Y)
        for A, B in itertools.product(corners(X, rng, 6), corners(Y, rng, 6)):
            assert holds(image, check.product(A, B))
            tight += is_tight(image, check.product(A, B))
    assert tight


def test_sums_and_multiples(rng: np.random.Generator) -> None:
    for c in (Fraction(-7, 3), Fraction(1, 1000), Fraction(5), Fraction(0), Fraction(-1, 7)):
        X, Y = (random_ball(rng, 3, 3, 5 << check.BITS, r) for r in (2, 37))
        for A, B in zip(corners(X, rng, 8), corners(Y, rng, 8), strict=True):
            assert holds(X.plus(Y), check.total(A, B))
            assert holds(X.scaled(c), [[c * a for a in row] for row in A])
            assert holds(Y.scaled(c), [[c * a for a in row] for row in B])


def test_a_ball_holds_the_matrix_it_is_made_of(rng: np.random.Generator) -> None:
    for _ in range(20):
        X = [[Fraction(int(a), int(b)) for a, b in rng.integers(1, 99, (3, 2))] for _ in range(2)]
        X[0][0] *= -1
        assert holds(check.ball(X), X)


def exact_exponential(X: Any, terms: int = 60) -> Any:
    result = term = check.identity(len(X))
    for k in range(1, terms):
        term = [[a / k for a in row] for row in check.product(term, X)]
        result = check.total(result, term)
    return result


@pytest.mark.parametrize("size", [Fraction(1, 8), Fraction(1), Fraction(7, 2)])
def test_exponentials_hold_the_exact_one(rng: np.random.Generator, size: Fraction) -> None:
    for radius in (0, 1, 3):
        shape = (2, 2)
        largest = int(size * (1 << check.BITS))
        Y = random_ball(rng, *shape, max(largest // 2, 1), radius)
        image = check.exponential(Y)
        for X in corners(Y, rng, 2):
            assert holds(image, exact_exponential(X))


def is_exactly_positive(X: Any) -> bool:
    def determinant(rows: Any) -> Fraction:
        if not rows:
            return Fraction(1)
        return sum(
            (-1) ** j * a * determinant([row[:j] + row[j + 1 :] for row in rows[1:]])
            for j, a in enumerate(rows[0])
        )

    return all(determinant([row[:k] for row in X[:k]]) > 0 for k in range(1, len(X) + 1))


def symmetric_corners(ball: check.Ball, rng: np.random.Generator) -> Iterator[Any]:
    for X in corners(ball, rng, 6):
        yield [[X[max(i, j)][min(i, j)] for j in range(len(X))] for i in range(len(X))]


def test_positive_balls_are_positive_throughout(rng: np.random.Generator) -> None:
    certified = refused = 0
    for k in range(300):
        B = rng.standard_normal((3, 3))
        size = (1 << check.BITS) * rng.uniform(0.2, 2)
        S = np.rint((B @ B.T + 0.02 * np.eye(3)) * size).astype(int)
        ball = check.Ball((np.tril(S) + np.tril(S, -1).T).tolist(), k % 3)
        if not check.is_positive(ball):
            refused += not is_exactly_positive(next(symmetric_corners(ball, rng)))
            continue
        certified += 1
        assert all(is_exactly_positive(X) for X in symmetric_corners(ball, rng))
    assert certified > 20


def test_barely_positive_and_barely_not(rng: np.random.Generator) -> None:
    """Of integers next to a singular matrix none that is not positive is certified."""
    for a, b in itertools.product(range(1, 1 << min(check.BITS, 7), 3), repeat=2):
        for c in range(math.isqrt(a * b) - 1, math.isqrt(a * b) + 2):
            assert not check.is_positive(check.Ball([[a, c], [c, b]], 0)) or c * c < a * b


def test_small_balls_are_positive_throughout() -> None:
    """All 2 x 2 balls of small integers: the corner that is the least positive is so, too."""
    certified = 0
    assert not check.is_positive(check.Ball([[0]], 0))
    assert check.is_positive(check.Ball([[1]], 0))
    for a, b, c, r in itertools.product(range(9), range(9), range(-3, 4), range(3)):
        if check.is_positive(check.Ball([[a, c], [c, b]], r)):
            certified += 1
            assert a > r
            assert (a - r) * (b - r) > (abs(c) + r) ** 2
    assert certified > 50


@pytest.mark.parametrize("radius", [1, 3])
def test_exponentials_of_wide_balls(rng: np.random.Generator, radius: int) -> None:
    Y = check.Ball([[0]], radius << check.BITS)
    image = check.exponential(Y)
    for X in corners(Y, rng, 0):
        assert holds(image, exact_exponential(X))


def test_exponentials_that_grow_too_large_are_given_up() -> None:
    for value in (10**4, 10**6):
        with pytest.raises(check.NotProved):
            check.exponential(check.ball([[Fraction(value)]]))


def test_signs_and_comparisons() -> None:
    two, three = check.ball([[Fraction(2)]]), check.ball([[Fraction(3)]])
    minus = two.scaled(Fraction(-1))
    assert check.is_positive(two)
    assert not check.is_positive(minus)
    assert check.is_negative(minus)
    assert not check.is_negative(two)
    assert check.is_less(two, three)
    assert not check.is_less(three, two)
    assert not check.is_less(two, two)


def test_factors_are_certified_and_near_the_least() -> None:
    for value in (Fraction(3), Fraction(1, 777), Fraction(10**9)):
        X, Y = check.ball([[value]]), check.ball([[Fraction(1)]])
        c = check.bounding_factor(X, Y)
        assert c is not None
        assert value < c < value * Fraction(101, 100)
    assert (
        check.bounding_factor(check.ball([[Fraction(2**80)]]), check.ball([[Fraction(1)]])) is None
    )


def test_taylor_remainders_bound_what_they_stand_for() -> None:
    """Scalar: P(u) = p e^(2 f u), whose derivatives, mu and c are known."""
    f, p, h = Fraction(3, 4), Fraction(2), Fraction(1, 2)
    mu, c = 2 * f, (2 * f) ** (check.DEGREE + 1)  # R = p
    series = sum(p * (2 * f * h) ** k / math.factorial(k) for k in range(check.DEGREE + 1))
    exact = p * exact_exponential([[2 * f * h]])[0][0]
    assert exact - series <= check.remainder_factor(h, mu, c) * p
    assert check.remainder_factor(h, mu, c) < 5 * (exact - series)


def test_each_bernstein_coefficient_counts() -> None:
    """Polynomials whose coefficients are all below 1 but one: only that one decides."""
    d, h, one = check.DEGREE, Fraction(3, 4), check.ball([[Fraction(1)]])
    inequality = check.Decrease(check.Flow(check.ball([[Fraction(0)]])), one, [one], [])
    for i in range(d + 1):
        for top, holds_there in ((Fraction(9, 10), True), (Fraction(11, 10), False)):
            b = [top if j == i else Fraction(1, 2) for j in range(d + 1)]
            forms = []
            for k in range(d + 1):
                a = math.comb(d, k) * sum(
                    (-1) ** (k - j) * math.comb(k, j) * b[j] for j in range(k + 1)
                )
                forms.append(check.ball([[a * math.factorial(k) / h**k]]))
            for remainder, expected in ((Fraction(0), holds_there), (Fraction(1, 2), False)):
                box = inequality.is_box(forms, check.ball([[remainder]]), h)
                assert box == expected, (i, top)


def test_a_range_is_covered_without_gaps() -> None:
    """e^(F t) (0, 1)' = (t, 1)' for F = [[0, 1], [0, 0]]: where each proved part begins."""
    F = check.ball([[Fraction(0), Fraction(1)], [Fraction(0), Fraction(0)]])
    rng, parts = np.random.default_rng(4), list[tuple[float, float]]()

    def reach(E: check.Ball, length: Fraction) -> Fraction:
        u = length / 2 ** int(rng.integers(1, 4)) if length > Fraction(1, 2) else length
        start = E.x[0][0] / (1 << check.BITS)
        parts.append((start, start + float(u)))
        return u

    check.Flow(F).cover(check.ball([[Fraction(0)], [Fraction(1)]]), Fraction(3), reach)
    assert len(parts) > 5
    assert math.isclose(parts[0][0], 0.0, abs_tol=1e-12)
    assert math.isclose(parts[-1][1], 3.0)
    for (_, end), (start, _) in itertools.pairwise(parts):
        assert math.isclose(end, start, rel_tol=1e-12)


def test_the_series_is_cut_where_it_may_be() -> None:
    """At 256 bits, for row sums above 1/2, which are halved first."""
    for value in (Fraction(9, 10), Fraction(3, 5), Fraction(-19, 20)):
        image = check.exponential(check.ball([[value]]))
        assert image.radius < 1 << 20
        assert holds(image, exact_exponential([[value]], 90))


def slow_mode(rate: float) -> tuple[Any, Any]:
    """A flow whose slowest mode decays at this rate, and a Z with F'Z + ZF = -I."""
    F = np.array([[-rate, 1.0], [0.0, -1.0]])
    kron = np.kron(np.eye(2), F.T) + np.kron(F.T, np.eye(2))
    Z = np.linalg.solve(kron, -np.eye(2).ravel()).reshape(2, 2)
    return F, (Z + Z.T) / 2


def boxes_of(F: Any, Z: Any, gain: Fraction) -> tuple[Any, int]:
    """The inequality of P = I and the jump by a gain, proved for all times, and its boxes."""
    flow = check.Flow(check.ball([[Fraction(a) for a in row] for row in F]))
    unit, tail = check.ball(check.identity(2)), [[Fraction(a) for a in row] for row in Z]
    inequality = check.Decrease(flow, unit, [unit], [check.ball(tail)])
    inequality.prove(unit.scaled(gain), (Fraction(0), math.inf))
    return inequality, flow.boxes


def test_modes_that_hardly_decay_need_few_boxes() -> None:
    """A tail that is steep for the others holds soon after them, whatever the slowest rate."""
    for rate in (1e-2, 1e-4, 1e-6, 1e-8):
        F, Z = slow_mode(rate)
        inequality, boxes = boxes_of(F, Z, Fraction(7, 10))
        assert boxes <= 40
        (steep,) = inequality.steep(inequality.proposed[0])
        X = np.array([[a / 2.0**check.BITS for a in row] for row in steep.x])
        assert np.linalg.eigvalsh(X - np.eye(2)).min() > 0
        assert check.is_negative(check.lyapunov(inequality.flow.F, steep))


def test_a_mode_that_grows_has_no_steep_tail() -> None:
    """The twins: a flow that does not decay, and a jump that is too large."""
    F, Z = slow_mode(1e-4)
    with pytest.raises(check.NotProved):
        boxes_of(-F, Z, Fraction(1, 10))
    with pytest.raises(check.NotProved):
        boxes_of(F, Z, Fraction(71, 100))
    growing = check.Flow(
        check.ball([[Fraction(1, 10**6), Fraction(1)], [Fraction(0), Fraction(-1)]])
    )
    unit = check.ball(check.identity(2))
    inequality = check.Decrease(growing, unit, [unit], [])
    assert inequality.steep(check.ball([[Fraction(a) for a in row] for row in Z])) == []
