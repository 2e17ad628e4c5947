"""Each step of check_widths.py by itself, against numbers computed another way."""

from __future__ import annotations

import math
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lmi.arithmetic.exponential import expm
from obsdesign.checker import check_widths as check


def exact(X: Any) -> Any:
    return [[Fraction(float(a)) for a in row] for row in np.asarray(X).tolist()]


def column(v: Any) -> Any:
    return exact(np.reshape(v, (-1, 1)))


def fractions(v: Any) -> Any:
    return [Fraction(float(a)) for a in v]


def floats(X: Any) -> Any:
    return np.array([[float(a) for a in row] for row in X])


def test_comparisons_of_vectors() -> None:
    X, above = exact([[1, 2]]), exact([[2, 3]])
    assert check.is_below(X, above)
    assert check.is_at_most(X, above)
    assert check.is_at_most(X, X)
    for Y in (X, exact([[1, 3]]), exact([[2, 2]])):
        assert not check.is_below(X, Y)
    for Y in (exact([[0, 3]]), exact([[2, 1]])):
        assert not check.is_at_most(X, Y)
    assert check.column([Fraction(1), Fraction(2)]) == [[1], [2]]


def test_upper_ends_count_the_radius() -> None:
    X = check.Ball([[3, -4]], 2)
    unit = Fraction(1, 1 << check.BITS)
    assert check.upper_ends(X) == [[5 * unit, -2 * unit]]


def test_the_same_map_in_other_units() -> None:
    X = check.in_units(exact([[1, 2], [3, 4]]), column([2, 4]), column([8, 16]))
    assert X == [[4, 16], [6, 16]]


# paths -------------------------------------------------------------------------------------------


def path(W: Any, f: Any, start: Any, X: Any = None) -> Any:
    result = check.Path(exact(W), column(f), column(start))
    result.X, result.resting = exact(np.eye(len(W)) if X is None else X), []
    return result


def proves(W: Any, f: Any, start: Any, X: Any, ends: Any) -> bool:
    low, high = ends
    try:
        end = high if high == math.inf else Fraction(high)
        path(W, f, start).prove(exact(X), (Fraction(low), end))
    except check.NotProved:
        return False
    return True


@pytest.mark.parametrize(
    ("W", "f", "start"),
    [
        ([[-1, -1e-9], [0, -1]], [1, 1], [1, 1]), ([[-1, 0], [-1e-9, -1]], [1, 1], [1, 1]),
        ([[-1]], [-1e-9], [1]), ([[-1, 0], [0, -1]], [1, -1e-9], [1, 1]),
        ([[-1]], [1], [-1e-9]), ([[-1, 0], [0, -1]], [1, 1], [-1e-9, 1]),
    ],
)  # fmt: skip
def test_systems_that_are_not_positive_are_refused(W: Any, f: Any, start: Any) -> None:
    with pytest.raises(check.NotProved):
        path(W, f, start)
    path(np.abs(np.array(W)), np.abs(f), np.abs(start))


def test_a_map_with_a_negative_entry_is_refused() -> None:
    assert proves([[-1]], [0], [1], [[0.5]], (0, 1))
    assert not proves([[-1]], [0], [1], [[-0.5]], (0, 1))


def test_a_path_that_rises_stays_below_what_it_tends_to() -> None:
    """u' = 1 - u from 1/10: no u is its own upper end for ever, the resting point is."""
    for share, expected in ((1.001, True), (0.999, False)):
        assert proves([[-1]], [1], [0.1], [[1 / share]], (0, math.inf)) == expected
    assert proves([[-1]], [1], [3], [[1 / 3.001]], (0, math.inf))
    assert not proves([[1]], [1], [0.1], [[1e-9]], (0, math.inf))
    assert not proves([[0]], [0], [1], [[0.5]], (0, math.inf))


def test_a_tail_needs_each_of_its_three_inequalities() -> None:
    one = path([[-1]], [1], [0.5])
    y = check.ball(column([0.5, 1]))
    for z, X, expected in (
        ([2], 0.4, True), ([2], 0.5, False), ([2], 0.6, False), ([0.4], 0.1, False),
        ([0.9], 0.1, False), ([1], 0.4, True),
    ):  # fmt: skip
        one.X, one.resting = exact([[X]]), [column(z)]
        assert one.holds_from(y) == expected
    two = path([[-1, 0], [0, -1]], [1, 1], [0.5, 0.5])
    y = check.ball(column([0.5, 0.5, 1]))
    for z, expected in (
        ([2, 2], True), ([2, 0.9], False), ([0.9, 2], False), ([2, 9], False), ([9, 2], False),
        ([0.4, 2], False), ([2, 0.4], False),
    ):  # fmt: skip
        two.X, two.resting = exact([[0.3, 0], [0, 0.3]]), [column(z)]
        assert two.holds_from(y) == expected


def test_every_entry_is_below_the_resting_point() -> None:
    """(1/2, 1/2) rises to (0.6, 0.1): it is no bound of itself."""
    for z, expected in (([2, 0.6], True), ([2, 0.4], False), ([0.6, 0.6], True)):
        one = path([[-1, 0], [0, -1]], [0.6, 0.1], [0.5, 0.5], [[0.3, 0], [0, 0.3]])
        one.resting = [column(z)]
        assert one.holds_from(check.ball(column([0.5, 0.5, 1]))) == expected


def test_a_start_at_the_bound_is_not_below_it() -> None:
    """A range that is one time, and a ball whose upper end is 1."""
    one, whole = path([[1]], [0], [1]), 1 << check.BITS
    ends = {}
    for k in range(8):
        y = check.Ball([[whole - k], [whole]], 0)
        ends[k] = check.upper_ends(check.ball(one.X).times(check.Ball([[whole - k]], 0)))[0][0]
        if ends[k] < 1:
            assert one.advance(y, Fraction(0)) == 0
        else:
            with pytest.raises(check.NotProved):
                one.advance(y, Fraction(0))
    assert 1 in ends.values()
    assert min(ends.values()) < 1


def test_derivatives_of_a_path() -> None:
    """u' = W u + f, u'' = W u', ...: DEGREE of them, and the absolute values of the next."""
    W, f, u = np.array([[-1.0, 2.0], [0.5, -3.0]]), np.array([0.25, 1.0]), np.array([0.5, 0.125])
    one = path(W, f, u, [[0.01, 0.02], [0.0, 0.01]])
    speed, got = float(one.flow.speed), []
    one.is_box = lambda *values: got.append(values) or True
    assert one.advance(check.ball(column([*u, 1])), Fraction(1, 2)) == Fraction(1, 2)
    ((rows, last, h),) = got
    derivatives = [u, (W @ u + f) / speed]
    while len(derivatives) < check.DEGREE + 2:
        derivatives.append(W @ derivatives[-1] / speed)
    assert len(rows) == check.DEGREE + 1
    assert h == Fraction(1, 2)
    X = floats(one.X)
    for row, derivative in zip(rows, derivatives, strict=False):
        middle = np.array([a / 2.0**check.BITS for (a,) in row.x])
        assert np.allclose(middle, X @ derivative, rtol=1e-12, atol=0)
    assert np.allclose(floats(last)[:, 0], np.abs(derivatives[-1]), rtol=1e-12, atol=0)


def test_a_box_that_fails_is_halved_and_a_start_that_fails_ends_it() -> None:
    one, tried = path([[1]], [0], [1], [[0.5]]), []
    one.is_box = lambda rows, last, h: tried.append(h) or h <= Fraction(1, 8)
    assert one.advance(check.ball(column([1, 1])), Fraction(1)) == Fraction(1, 8)
    assert tried == [Fraction(1, 2**k) for k in range(4)]
    with pytest.raises(check.NotProved):
        one.advance(check.ball(column([2, 1])), Fraction(1))
    one.is_box = lambda *values: False
    with pytest.raises(check.NotProved):
        one.advance(check.ball(column([1, 1])), Fraction(1))


def test_each_bernstein_coefficient_counts() -> None:
    """Polynomials whose coefficients are all below 1 but one: only that one decides."""
    d, h = check.DEGREE, Fraction(3, 4)
    one = path([[0]], [0], [1])
    for i in range(d + 1):
        for top, expected in ((0.9, True), (1.1, False)):
            b = [top if j == i else 0.5 for j in range(d + 1)]
            rows = []
            for k in range(d + 1):
                a = math.comb(d, k) * sum(
                    (-1) ** (k - j) * math.comb(k, j) * Fraction(b[j]) for j in range(k + 1)
                )
                rows.append(check.ball([[a * math.factorial(k) / h**k]]))
            assert one.is_box(rows, [[Fraction(0)]], h) == expected
            one.remainders = {h: [[Fraction(1, 2)]]}
            assert not one.is_box(rows, [[Fraction(2)]], h)
            one.remainders = {}
    assert one.is_box([], [], Fraction(0))


def test_every_row_of_a_box_counts() -> None:
    one, h = path([[0, 0], [0, 0]], [0, 0], [1, 1]), Fraction(1)
    zeros = [check.ball(column([0, 0]))] * check.DEGREE
    last = column([0, 0])
    for first, expected in (([0.9, 0.9], True), ([1.1, 0.9], False), ([0.9, 1.1], False)):
        assert one.is_box([check.ball(column(first)), *zeros], last, h) == expected


@pytest.mark.parametrize("h", [0.25, 0.5])
def test_remainders_of_two_states(h: float) -> None:
    """K = 3 h^d / d! X (I/h - W)^-1."""
    W, X = np.array([[-1.0, 0.25], [0.5, -0.5]]), np.array([[1.0, 2.0], [0.0, 3.0]])
    one = path(W, [0, 0], [1, 1], X)
    own = floats(one.W)
    R = np.linalg.inv(np.eye(2) / h - own)
    d = check.DEGREE
    expected = 3 * h**d / math.factorial(d) * X @ R
    assert np.allclose(floats(one.remainder_map(Fraction(h))), expected, rtol=1e-12, atol=0)


def test_a_remainder_needs_an_inverse_without_signs() -> None:
    one = path([[2, 0], [0, -1]], [0, 0], [1, 1])
    assert one.remainder_map(Fraction(1, 2)) != []
    zeros = [check.ball(column([0, 0]))] * (check.DEGREE + 1)
    assert one.is_box(zeros, column([0, 0]), Fraction(1, 2))
    for h in (Fraction(1), Fraction(3)):
        assert one.remainder_map(h) == []
        assert not one.is_box(zeros, column([0, 0]), h)


def test_resting_points() -> None:
    """W z + f < 0 and X z < 1; none where the flow does not decay, or tends to too much."""
    W, f, X, start = exact([[-2, 1], [0, -1]]), column([1, 1]), exact([[0.5, 0.5]]), column([1, 3])
    for scale, expected in ((0.999, True), (1.0, False), (1.001, False)):  # it tends to (1, 1)
        own = [[Fraction(scale) * a for a in row] for row in X]
        if not expected:
            with pytest.raises(check.NotProved):
                check.resting_point(W, f, own, start)
            continue
        z = check.resting_point(W, f, own, start)
        assert all(a < 0 for (a,) in check.total(check.product(W, z), f))
        assert all(a < 1 for (a,) in check.product(own, z))
    for grows in ([[1, 0], [0, -1]], [[-1, 0], [0, 1]], [[-1, 2], [1, -1]], [[-1, 1], [1, -1]]):
        with pytest.raises(check.NotProved):
            check.resting_point(exact(grows), column([0, 0]), exact([[1e-9, 1e-9]]), start)
    for rows in ([[0.1, 0.1], [2, 0]], [[2, 0], [0.1, 0.1]]):
        with pytest.raises(check.NotProved):
            check.resting_point(W, f, exact(rows), start)
    for rows in ([[0.5, 0.49], [0.1, 0.1]], [[0.1, 0.1], [0.5, 0.49]]):
        z = check.resting_point(W, f, exact(rows), start)
        assert all(a < 1 for (a,) in check.product(exact(rows), z))
    z = check.resting_point(W, f, exact([[0.1, 0.1]]), column([1, 0]))
    assert all(a < 0 for (a,) in check.total(check.product(W, z), f))
    with pytest.raises(check.NotProved):  # what grows starts at zero
        check.resting_point(
            exact([[-1, 0], [0, 1]]), column([0, 0]), exact([[1, 1]]), column([1, 0])
        )
    z = check.resting_point(W, f, exact([[0, 0]]), start)
    assert all(a < 0 for (a,) in check.total(check.product(W, z), f))


# samples, and widths -----------------------------------------------------------------------------


def system(W: Any, f: Any, N: Any, h: Any, out: Any) -> Any:
    return check.System(exact(W), column(f), exact(N), column(h), exact(out))


def sampled_plant(S: Any) -> Any:
    """A design that `with_samples` reads."""
    gains: dict[str, Any] = {
        "A": exact([[-1, 0.5], [-0.25, -2]]), "C": exact([[1, -0.5], [0, 2]]),
        "L": exact([[0.5, 0], [-0.25, 1]]),
    }  # fmt: skip
    if S is not None:
        gains["S"] = exact(S)
    return SimpleNamespace(
        n=2, gains=gains, array=lambda name, shape: gains[name],
        disturbance=lambda prefix, letter: (exact([[1, 0], [0.5, -1]]), column([0.25, 0.5])),
    )  # fmt: skip


@pytest.mark.parametrize("S", [None, [[1.0, 0.5], [-0.25, 1.0]]])
@pytest.mark.parametrize("v", [[1.0, 1.0], [4.0, 0.125]])
def test_what_samples_leave_of_the_width(S: Any, v: Any) -> None:
    """r' = Mz r + d, s' = |C A| r + |C| d in natural units, then in those of v."""
    plant, limit = sampled_plant(S), 0.3
    A, C, L = (floats(plant.gains[name]) for name in "ACL")
    T = np.eye(2) if S is None else np.array(S)
    A, C, L = np.linalg.solve(T, A @ T), C @ T, np.linalg.solve(T, L)
    X, box = (floats(x) for x in plant.disturbance("", "b"))
    d = np.abs(np.linalg.solve(T, X)) @ box
    metzler = np.abs(A)
    np.fill_diagonal(metzler, np.diag(A))
    Z = np.zeros((5, 5))
    Z[:2, :2], Z[:2, 4:] = metzler, d
    Z[2:4, :2], Z[2:4, 4:] = np.abs(C @ A), np.abs(C) @ d
    E = expm(Z * limit)[2:4]
    W, f = np.array([[-1.5, 0.25], [0.5, 0.75]]), np.array([0.5, 0.25])
    slow = np.diag(np.exp(-np.minimum(np.diag(W), 0) * limit))
    whole = W + np.abs(L) @ E[:, :2] @ slow
    inputs = f + np.abs(L) @ E[:, 4]
    units = np.array(v)
    own = system(W * units / units[:, None], f / units, np.eye(2), [0, 0], np.eye(2))
    image = check.with_samples(plant, own, column(v), Fraction(limit))
    assert np.allclose(floats(image.W), whole * units / units[:, None], rtol=1e-12, atol=0)
    assert np.allclose(floats(image.f)[:, 0], inputs / units, rtol=1e-12, atol=0)
    assert (image.N, image.h, image.out) == (own.N, own.h, own.out)


def limits(W: Any, f: Any, N: Any, h: Any, T: float) -> tuple[Any, Any, Any]:
    """Widths before and after jumps, and on average, at one dwell time."""
    n = len(f)
    Z = np.zeros((2 * n + 1, 2 * n + 1))
    Z[:n, :n], Z[:n, n], Z[n + 1 :, :n] = W, f, np.eye(n)
    E = expm(Z * T)
    flow, g = E[:n, :n], E[:n, n]
    before = np.linalg.solve(np.eye(n) - flow @ N, flow @ h + g)
    after = N @ before + h
    return before, after, (E[n + 1 :, :n] @ after + E[n + 1 :, n]) / T


def test_widths_at_one_dwell_time() -> None:
    W, f = np.array([[-1.0, 0.25], [0.5, -2.0]]), np.array([0.5, 0.25])
    N, h, T = np.array([[0.5, 0.75], [0.25, 1.0]]), np.array([0.125, 0.25]), 0.75
    out = np.array([[1.0, 0.5], [0.0, 2.0]])
    own = system(W, f, N, h, out)
    names = ("before_jump", "after_jump", "mean")
    stated = {
        name: (out @ x * (1 + 1e-9)).tolist() for name, x in zip(names, limits(W, f, N, h, T), strict=True)
    }  # fmt: skip
    row = {"dwell_time": T, **stated}
    ends = Fraction(1, 2), Fraction(1)
    check.prove_constant_dwell(own, ends, row)
    check.prove_constant_dwell(own, (Fraction(T), Fraction(T)), row)
    for name in names:
        for i in range(2):
            lower = [a * (1 - 2e-9) if j == i else a for j, a in enumerate(stated[name])]
            with pytest.raises(check.NotProved):
                check.prove_constant_dwell(own, ends, row | {name: lower})
    for other in ((Fraction(4, 5), Fraction(1)), (Fraction(0), Fraction(7, 10))):
        with pytest.raises(check.NotProved):
            check.prove_constant_dwell(own, other, row)
    for T in (0.0, "inf"):
        with pytest.raises((check.NotProved, TypeError, OverflowError)):
            check.prove_constant_dwell(own, (Fraction(0), math.inf), row | {"dwell_time": T})


def test_no_limit_where_the_jump_is_too_large() -> None:
    """E N = 2: the equation for b has a solution below zero alone."""
    own = system([[0]], [1], [[2]], [1], [[1]])
    row = {"dwell_time": 1.0, **{name: [9.0] for name in ("before_jump", "after_jump", "mean")}}
    with pytest.raises(check.NotProved):
        check.prove_constant_dwell(own, (Fraction(0), Fraction(2)), row)


SCALES = [[1.0, 1.0], [8.0, 0.125]]


@pytest.mark.parametrize("scale", SCALES)
def test_each_bound_of_a_width_counts(scale: Any) -> None:
    """A rotation-free pair; peaks of the path from the tube on a grid, in two units."""
    W, f = np.array([[-1.0, 0.0], [1.0, -2.0]]), np.array([0.25, 0.125])
    N, h = np.array([[0.5, 0.25], [0.25, 0.5]]), np.array([0.125, 0.125])
    out, d = np.array([[1.0, 0.5], [0.0, 2.0]]), np.array(scale)
    v, ends = np.array([0.9, 0.9]), (0.5, 2.0)
    Z = np.zeros((3, 3))
    Z[:2, :2], Z[:2, 2] = W, f
    times = np.linspace(0, 2, 2001)[:, None, None]
    u = (expm(Z * times) @ np.append(v, 1.0))[:, :2]
    before = (u[500:] @ out.T).max(axis=0) * (1 + 1e-5)
    always = (u @ out.T).max(axis=0) * (1 + 1e-5)
    assert (u[500:] @ N.T + h < v).all()
    own = system(W * d / d[:, None], f / d, N * d / d[:, None], h / d, out * d)
    stated = {
        "tube": (v / d).tolist(), "always": always.tolist(), "before_jump": before.tolist(),
        "after_jump": (out @ v * (1 + 1e-9)).tolist(),
    }  # fmt: skip
    design: Any = SimpleNamespace(n=2, ends=tuple(map(Fraction, ends)))
    text = check.prove_width(design, own, stated, math.inf)
    assert f"{stated['after_jump'][0]!r}, " in text
    for name in ("always", "before_jump", "after_jump"):
        for i in range(2):
            lower = [a * (1 - 4e-5) if j == i else a for j, a in enumerate(stated[name])]
            with pytest.raises(check.NotProved):
                check.prove_width(design, own, stated | {name: lower}, math.inf)
    for i in range(2):
        steps = own._replace(h=[[a if j != i else a + 10] for j, (a,) in enumerate(own.h)])
        negative = own._replace(h=[[a if j != i else -a] for j, (a,) in enumerate(own.h)])
        for other in (steps, negative):
            with pytest.raises(check.NotProved):
                check.prove_width(design, other, stated, math.inf)
        for name in ("tube", "always", "before_jump"):
            none = [0.0 if j == i else a for j, a in enumerate(stated[name])]
            with pytest.raises((check.NotProved, ZeroDivisionError)):
                check.prove_width(design, own, stated | {name: none}, math.inf)


def test_a_width_without_jumps() -> None:
    """W v + f < 0, and |S| v at most the bound."""
    design: Any = SimpleNamespace(n=2)
    W, out = [[-1, 0.5], [0, -1]], [[1, 1], [0, 1]]
    stated = {"tube": [1.0, 1.0], "always": [2.0, 1.0]}
    own = system(W, [0.25, 0.5], np.zeros((0, 0)), np.zeros((0, 1)), out)._replace(N=[], h=[])
    assert "(2.0, 1.0)" in check.prove_width(design, own, stated, math.inf)
    for f in ([0.5, 0.5], [0.25, 1.0]):
        with pytest.raises(check.NotProved):
            check.prove_width(design, own._replace(f=column(f)), stated, math.inf)
    for always in ([1.999, 1.0], [2.0, 0.999]):
        with pytest.raises(check.NotProved):
            check.prove_width(design, own, stated | {"always": always}, math.inf)


def test_bounds_have_a_sign() -> None:
    """A tube below zero shrinks where the flow grows."""
    design: Any = SimpleNamespace(n=2)
    for rates, tube, always in (
        ([1, 1], [-1, -1], [1, 1]), ([-1, 1], [1, -1], [1, 1]), ([1, 1], [-0.5, -0.5], [1, 1]),
        ([-1, -1], [-1, -1], [-1, -1]), ([-1, -1], [-0.5, -0.5], [-0.5, -0.5]),
        ([-1, -1], [1, -1], [1, -1]),
    ):  # fmt: skip
        own = system(np.diag(rates), [0, 0], np.zeros((0, 0)), np.zeros((0, 1)), np.eye(2))
        stated = {
            "tube": np.array(tube, float).tolist(),
            "always": np.array(always, float).tolist(),
        }
        with pytest.raises(check.NotProved):
            check.prove_width(design, own._replace(N=[], h=[]), stated, math.inf)


def test_the_longest_dwell_time_counts_for_jumps_and_between_them() -> None:
    """u' = u / 2 from 1, N = 1/2: N e^(T / 2) < 1 up to 2 log 2, and e^(T / 2) <= 2."""
    own = system([[0.5]], [0], [[0.5]], [0], [[1]])
    stated = {"tube": [1.0], "after_jump": [1.0], "before_jump": [2.0], "always": [2.0]}
    limit = 2 * math.log(2)
    for high, entries, expected in (
        (limit - 1e-6, {}, True), (limit - 1e-6, {"always": [1.99]}, False),
        (limit - 1e-6, {"before_jump": [1.99]}, False),
        (limit + 1e-6, {"before_jump": [9.0], "always": [9.0]}, False),
    ):  # fmt: skip
        design: Any = SimpleNamespace(n=1, ends=(Fraction(1, 4), Fraction(high)))
        try:
            check.prove_width(design, own, stated | entries, math.inf)
        except check.NotProved:
            assert not expected
        else:
            assert expected


def test_a_vector_has_one_sign() -> None:
    F, H, ends = exact(-np.eye(2)), exact(np.eye(2) / 2), (Fraction(0), Fraction(1))
    for v, expected in (([1, 3], True), ([1, -3], False), ([-0.5, 1], False), ([-1, -3], False)):
        evidence = {"vector": v, "side": "left", "form": "before_jump"}
        try:
            check.prove_vector(F, H, ends, evidence)
        except check.NotProved:
            assert not expected
        else:
            assert expected


def stored(**gains: Any) -> Any:
    """What inputs and noise are read from."""
    return SimpleNamespace(n=2, gains=gains, array=lambda name, shape: gains[name])


def test_boxes_of_inputs() -> None:
    """(X, widths), with and without a matrix; no bounds cross, in whichever entry."""
    ends = {"flow_lower": fractions([-1, 0]), "flow_upper": fractions([1, 0.5])}
    assert check.Design.disturbance(stored(**ends), "", "b") == (
        check.identity(2),
        column([2, 0.5]),
    )
    shaped = {"disturbance_matrix": exact([[1], [2]]), "disturbance_lower": fractions([-3]),
              "disturbance_upper": fractions([-1])}  # fmt: skip
    plant = stored(**ends, **shaped)
    assert check.Design.disturbance(plant, "", "b") == (exact([[1], [2]]), column([2]))
    ends = {"jump_lower": fractions([0, 0]), "jump_upper": fractions([1, 2])}
    assert check.Design.disturbance(stored(**ends), "jump_", "c")[1] == column([1, 2])
    for upper in ([-1e-9, 2], [1, -1e-9]):
        crossed = ends | {"jump_upper": fractions(upper)}
        with pytest.raises(check.NotProved):
            check.Design.disturbance(stored(**crossed), "jump_", "c")


def test_noise_enters_by_the_size_of_gains() -> None:
    gain, bounds = exact([[-1, 2], [0, -3]]), stored(noise_bound=fractions([1, 0.5]))
    assert check.Design.noise(bounds, gain) == column([4, 3])
    for V in ([-1e-9, 1], [1, -1e-9]):
        with pytest.raises(check.NotProved):
            check.Design.noise(stored(noise_bound=fractions(V)), gain)


def test_the_step_limit_is_that_of_the_gains() -> None:
    def limit(stated: Any, own: Any = None, measured: str = "continuous", L: float = 1.0) -> Any:
        gains = {} if own is None else {"step_limit": own}
        design: Any = SimpleNamespace(
            measured=measured, gains=gains, array=lambda name, shape: [[Fraction(L)]]
        )
        return check.step_limit(design, {"step_limit": stated})

    assert limit(0.5) == limit(0.5, 0.5) == Fraction(1, 2)
    assert limit("inf", L=0.0) == math.inf
    for values in ((0.5, 0.25), (0.25, 0.5), (0.0, 0.0), (0.0,), ("inf",), (0.5, None, "at_jumps")):
        with pytest.raises(check.NotProved):
            limit(*values)


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("form", ["before_jump", "after_jump"])
def test_a_vector_shrinks_by_its_own_product(side: str, form: str) -> None:
    """v' M < v' or M v < v, M = E H or H E: the jump scaled to just below and above the limit."""
    F, H, T = np.array([[-1.0, 0.5], [0.25, -2.0]]), np.array([[1.0, 0.25], [0.5, 2.0]]), 0.5
    v = np.array([1.0, 3.0])
    E = expm(F * T)
    M = E @ H if form == "before_jump" else H @ E
    ratio = np.max(v @ M / v if side == "left" else M @ v / v)
    evidence = {"vector": v.tolist(), "side": side, "form": form}
    ends = Fraction(T), Fraction(T)
    check.prove_vector(exact(F), exact(H / ratio * (1 - 1e-9)), ends, evidence)
    with pytest.raises(check.NotProved):
        check.prove_vector(exact(F), exact(H / ratio * (1 + 1e-9)), ends, evidence)
    for vector in ([0.0, 3.0], [1.0, 0.0], [-1.0, -3.0]):
        with pytest.raises((check.NotProved, ZeroDivisionError)):
            check.prove_vector(exact(F), exact(H / ratio / 9), ends, evidence | {"vector": vector})
