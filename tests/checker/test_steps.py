"""Each step of check_design.py by itself: what it computes, what it must refuse."""

from __future__ import annotations

import itertools
import math
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from obsdesign.checker import check_design as check


def exact(X: Any) -> Any:
    """Rows of fractions."""
    return [[Fraction(a) for a in row] for row in X]


def ball(X: Any) -> check.Ball:
    return check.ball(exact(X))


# matrices ----------------------------------------------------------------------------------------


def test_sums_and_the_largest_entry() -> None:
    X, Y = exact([[1, -5], [2, 3]]), exact([[7, 1], [-1, 4]])
    assert check.total(X, Y) == [[8, -4], [1, 7]]
    assert check.total(X, Y, Fraction(1, 2)) == [[Fraction(9, 2), Fraction(-9, 2)], [1.5, 5]]
    assert check.difference(X, Y) == [[-6, -6], [3, -1]]
    assert check.product(X, exact([[1], [2]])) == [[-9], [8]]
    assert check.absolute(X) == [[1, 5], [2, 3]]
    assert check.identity(2) == [[1, 0], [0, 1]]
    assert check.largest(X) == 5
    assert check.largest([]) == 0


def test_echelon_forms_of_any_rank() -> None:
    """X = X[:, pivots] R, R the unit matrix at its pivots, as many rows as X has rank."""
    rng = np.random.default_rng(25)
    for rank, m, n in itertools.product((0, 1, 2, 3), (3, 4), (3, 5)):
        X = rng.integers(-2, 3, (m, rank)) @ rng.integers(-3, 4, (rank, n))
        X[:, 0] *= int(rng.integers(0, 2))
        rows, pivots = check.echelon(exact(X.tolist()))
        assert len(rows) == len(pivots) == np.linalg.matrix_rank(X.astype(float))
        assert pivots == sorted(pivots)
        assert [[row[j] for j in pivots] for row in rows] == check.identity(len(rows))
        if rows:
            assert check.product(exact(X[:, pivots].tolist()), rows) == exact(X.tolist())


def test_solutions_are_exact_and_singular_matrices_have_none() -> None:
    X, Y = exact([[0, 2, 1], [1, 0, 3], [2, 1, 0]]), exact([[1, 2], [3, 4], [5, 6]])
    assert check.product(X, check.solution(X, Y)) == Y
    for singular in ([[1, 2], [2, 4]], [[0, 0], [0, 0]], [[0, 1], [0, 0]]):
        with pytest.raises(check.NotProved):
            check.solution(exact(singular), exact([[1], [1]]))


# flows and ranges of time ------------------------------------------------------------------------


def never(E: Any) -> bool:
    return False


def test_a_flow_is_measured_in_its_own_time() -> None:
    for speed in (Fraction(1, 1000), Fraction(1), Fraction(1000)):
        flow = check.Flow(check.ball([[-speed]]))
        assert abs(float(flow.speed / speed) - 1) < 1e-9
        assert abs(flow.F.x[0][0] / 2**check.BITS + 1) < 1e-9
    still = check.Flow(ball([[0, 0], [0, 0]]))
    assert 0 < still.speed <= Fraction(1, 2**200)
    assert check.Flow(ball([[1, 3], [2, 0]])).speed == 4


def test_a_range_begins_and_ends_where_it_is_stated() -> None:
    """x' = 3 x from 1: e^(3 low) at its start, and a length in units of the flow."""
    flow, met = check.Flow(ball([[3]])), []

    def advance(E: Any, length: Any) -> Any:
        met.append((E.x[0][0] / 2**check.BITS, length))
        return length

    flow.prove_range(ball([[1]]), (Fraction(1, 4), Fraction(2)), never, advance)
    ((start, length),) = met
    assert math.isclose(start, math.exp(0.75))
    assert length == Fraction(21, 4)
    flow.prove_range(ball([[1]]), (Fraction(1, 4), math.inf), lambda E: True, advance)
    assert len(met) == 1


def test_an_endless_range_is_covered_up_to_a_tail_that_holds() -> None:
    """e^-t < 1/5 from t = log 5 on, by doubling: boxes reach at least so far."""
    flow, lengths = check.Flow(ball([[-1]])), []

    def late(E: Any) -> bool:
        return E.x[0][0] < 2**check.BITS // 5

    def advance(E: Any, length: Any) -> Any:
        lengths.append(length)
        return length

    flow.prove_range(ball([[1]]), (Fraction(0), math.inf), late, advance)
    assert math.log(5) <= sum(lengths) <= 2 * math.log(5)
    with pytest.raises(check.NotProved):
        flow.prove_range(ball([[1]]), (Fraction(0), math.inf), never, advance)


def test_boxes_and_numbers_have_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(check, "MOST_BOXES", 8)
    one = ball([[1]])
    check.Flow(ball([[0]])).cover(one, Fraction(1), lambda E, h: h / 8 if h == 1 else h)
    with pytest.raises(check.NotProved):
        check.Flow(ball([[0]])).cover(one, Fraction(1), lambda E, h: h / 512 if h == 1 else h)
    with pytest.raises(check.NotProved):
        check.Flow(ball([[0]])).cover(one, Fraction(1), lambda E, h: h / 8)
    most = 1 << (4 * check.BITS)
    check.bounded(check.Ball([[most - 1]], most - 1))
    for x, radius in ((most, 0), (-most, 0), (0, most)):
        with pytest.raises(check.NotProved):
            check.bounded(check.Ball([[x]], radius))


# one inequality ----------------------------------------------------------------------------------


def eigenvalues(X: check.Ball) -> Any:
    rows = np.array([[a / 2.0**check.BITS for a in row] for row in X.x])
    return np.linalg.eigvalsh((rows + rows.T) / 2)


def random_inequality(seed: int) -> tuple[Any, Any]:
    """P > 0, a Hurwitz F or none, and E."""
    rng = np.random.default_rng([7, seed])
    n = 2 + seed % 2
    F = rng.uniform(-1, 1, (n, n)) - (seed % 3) * np.eye(n)
    B = rng.uniform(-1, 1, (n, n))
    P, E = ball((B @ B.T + 0.1 * np.eye(n)).tolist()), ball(rng.uniform(-1, 1, (n, n)).tolist())
    flow = check.Flow(ball(F.tolist()))
    return check.Decrease(flow, P, [ball((9 * np.eye(n)).tolist())], [P]), E


@pytest.mark.parametrize("seed", range(6))
def test_factors_of_the_remainder_are_bounds(seed: int) -> None:
    inequality, E = random_inequality(seed)
    R, mu, c = inequality.best_remainder(E)
    F = inequality.flow.F
    assert mu >= 0
    assert c >= 0
    assert eigenvalues(R).min() > 0
    assert eigenvalues(check.lyapunov(F, R).plus(R.scaled(-mu))).max() <= 1e-12
    last = inequality.P
    for _ in range(check.DEGREE + 1):
        last = check.lyapunov(F, last)
    assert eigenvalues(last.plus(R.scaled(-c))).max() <= 1e-12


def test_derivatives_are_those_of_the_form() -> None:
    """P(u) = p e^(2 f u) for scalars: p (2 f)^k."""
    flow = check.Flow(ball([[Fraction(-1, 2)]]))
    inequality = check.Decrease(flow, ball([[3]]), [ball([[4]])], [])
    f = Fraction(-1)  # in units of the flow
    values = [Fraction(X.x[0][0], 2**check.BITS) for X in inequality.derivatives]
    assert len(values) == check.DEGREE + 2
    for k, value in enumerate(values):
        assert abs(value - 3 * (2 * f) ** k) < Fraction(1, 2**200)


def test_a_tail_is_above_p_and_falls() -> None:
    flow = check.Flow(ball([[-1, 3], [0, -1]]))
    inequality = check.Decrease(flow, ball([[2, 0], [0, 1]]), [ball([[1, 0], [0, 1]])], [])
    assert inequality.tails == []  # P does not fall
    X = inequality.falling(ball([[1, 1], [1, 6]]))
    assert X is not None
    assert eigenvalues(X.plus(inequality.P.scaled(Fraction(-1)))).min() > 0
    assert eigenvalues(check.lyapunov(flow.F, X)).max() < 0
    assert inequality.falling(ball([[-1, -1], [-1, -6]])) is None
    assert inequality.falling(ball([[1, 0], [0, 1]])) is None


def test_every_source_counts() -> None:
    flow = check.Flow(ball([[-1]]))
    one, two, three = (ball([[a]]) for a in (1, 2, 3))
    for sources, expected in (([two, three], True), ([three, one], False), ([one, three], False)):
        inequality = check.Decrease(flow, two.scaled(Fraction(3, 4)), sources, [])
        assert inequality.holds(inequality.P) == expected
        for ends in ((Fraction(0), Fraction(1)), (Fraction(0), math.inf)):
            assert proves(inequality, one, ends) == expected


def proves(inequality: check.Decrease, right: check.Ball, ends: Any) -> bool:
    try:
        inequality.prove(right, ends)
    except check.NotProved:
        return False
    return True


@pytest.mark.parametrize("rate", [Fraction(1, 2), Fraction(-1, 2), Fraction(0)])
def test_inequalities_hold_up_to_the_end_of_their_range_and_not_beyond(rate: Fraction) -> None:
    """e^(2 f t) < S at the end that is larger: by 1e-9 more it is not proved."""
    low, high = Fraction(1, 2), Fraction(2)
    top = math.exp(2 * float(rate) * float(high if rate > 0 else low))
    for share, expected in ((1 + 1e-9, True), (1 - 1e-9, False)):
        source = check.ball([[Fraction(top * share)]])
        inequality = check.Decrease(check.Flow(check.ball([[rate]])), ball([[1]]), [source], [])
        assert proves(inequality, ball([[1]]), (low, high)) == expected


def test_a_peak_inside_of_a_range_is_met() -> None:
    """|e^(F t) (1, 0)'|^2 weighs the second state most in between: e^-t - e^-2t, squared."""
    flow, P = check.Flow(ball([[-1, 0], [1, -2]])), ball([[0, 0], [0, 16]])
    right = ball([[1, 0], [0, 0]])
    for top, expected in ((Fraction(1001, 1000), True), (Fraction(999, 1000), False)):
        sources = [check.ball([[top, Fraction(0)], [Fraction(0), Fraction(1)]])]
        tails = [ball([[3, 1], [1, 3]])]
        inequality = check.Decrease(flow, P, sources, tails)
        for ends in ((Fraction(0), Fraction(3)), (Fraction(0), math.inf)):
            assert proves(inequality, right, ends) == expected


@pytest.mark.parametrize("h", [Fraction(1, 3), Fraction(1), Fraction(5, 2)])
def test_the_remainder_has_each_of_its_factors(h: Fraction) -> None:
    d = check.DEGREE
    plain = h ** (d + 1) / math.factorial(d + 1)
    assert check.remainder_factor(h, Fraction(0), Fraction(2)) == 2 * plain
    assert check.remainder_factor(h, 1 / h, Fraction(1)) == 3 * plain
    assert check.remainder_factor(h, Fraction(11, 10) / h, Fraction(1)) == 9 * plain


# windows of dwell times --------------------------------------------------------------------------

ENDS = (Fraction(0), Fraction(4))


def cell(low: int, high: int) -> Any:
    return Fraction(low), Fraction(high)


def test_cells_of_a_window_and_the_next() -> None:
    """Offset 0 of the next is offset 1 of the first."""
    first, later = {0: cell(0, 2), -1: cell(1, 3)}, {-1: cell(1, 4), 0: cell(2, 3)}
    assert check.common_cells(first, later, ENDS) == {-1: cell(1, 3), 0: cell(1, 2), 1: cell(2, 3)}
    assert check.common_cells({0: cell(0, 2)}, {-1: cell(2, 4)}, ENDS) is None
    assert check.common_cells({0: cell(0, 2)}, {-1: cell(3, 4)}, ENDS) is None
    assert check.common_cells({}, {-1: cell(1, 2)}, ENDS) == {0: cell(1, 2)}


def test_cells_that_the_jitter_allows() -> None:
    """Neighbours differ by at most the jitter, over missing offsets too."""
    for cells, jitter, expected in (
        ({0: cell(0, 1), 1: cell(3, 4)}, 2, False), ({0: cell(0, 1), 1: cell(3, 4)}, 3, True),
        ({0: cell(3, 4), 1: cell(0, 1)}, 2, False), ({0: cell(3, 4), 1: cell(0, 1)}, 3, True),
        ({0: cell(0, 1), 2: cell(3, 4)}, 1, False), ({0: cell(0, 1), 2: cell(3, 4)}, 2, True),
        ({-2: cell(0, 1), 0: cell(3, 4)}, 1, False), ({-2: cell(0, 1), 0: cell(3, 4)}, 2, True),
        ({-2: cell(0, 1), -1: cell(3, 4)}, 2, False), ({}, 1, True), ({2: cell(1, 2)}, 0, True),
        ({0: cell(0, 1), 1: cell(3, 4)}, math.inf, True),
    ):  # fmt: skip
        jitter = Fraction(jitter) if jitter < math.inf else jitter
        assert check.is_reachable(cells, ENDS, jitter) == expected, (cells, jitter)


def test_edges_lead_wherever_dwell_times_may_go() -> None:
    """Random dwell times, their windows by hand: each step has its edge, and each edge is a step."""
    cells = [cell(0, 1), cell(1, 3), cell(3, 4)]
    windows = [{-1: a, 0: b} for a in cells for b in cells]
    for jitter in (Fraction(3, 4), Fraction(5, 2), math.inf):
        edges = check.edges_of(windows, ENDS, jitter)
        steps = set()
        times = np.arange(0.25, 4, 0.5)
        for a, b, c in itertools.product(times, repeat=3):
            if max(abs(b - a), abs(c - b)) <= jitter:
                x, y, z = (next(k for k in cells if k[0] < t < k[1]) for t in (a, b, c))
                steps.add((windows.index({-1: x, 0: y}), windows.index({-1: y, 0: z}), *y))
        assert set(edges) == steps


def test_one_window_is_followed_by_itself() -> None:
    assert check.edges_of([{}], ENDS, math.inf) == [(0, 0, *ENDS)]


def halves(low: int, cut: int, high: int) -> Any:
    return {0: cell(low, cut)}, {0: cell(cut, high)}


def test_what_divides_and_what_does_not() -> None:
    low, high = halves(0, 1, 4)
    early, late = {-1: cell(0, 2), **low}, {-1: cell(2, 4), **low}
    for windows in ([{}], [low, high], [high, low], [early, late, high], [early, high, late]):
        check.check_partition(windows, {}, ENDS)
    again = {-1: cell(1, 4), **low}
    for windows in (
        [], [high], [early, high], [early, again, high], [early, late], [early, late, high, high],
        [{0: cell(0, 3)}, high], [{0: cell(1, 4)}], [{-1: cell(0, 2)}, {0: cell(0, 4)}],
    ):  # fmt: skip
        with pytest.raises(check.NotProved):
            check.check_partition(windows, {}, ENDS)


# reading -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [0, 1, -2, 0.1, 5e-324, 1e150, -1e150, 2**53])
def test_numbers(value: Any) -> None:
    assert check.number(value) == Fraction(value)


NO_NUMBERS = [True, False, None, "1", [], [1.0], 1.1e150, -1.1e150, math.inf, -math.inf, math.nan,
              2**53 + 1, 10**400]  # fmt: skip


@pytest.mark.parametrize("value", NO_NUMBERS)
def test_what_is_no_number(value: Any) -> None:
    for read in (check.number, check.time, lambda x: check.array([x], "n", {})):
        if read is not check.time or value != "inf":
            with pytest.raises(check.NotProved):
                read(value)


def test_times_and_ranges() -> None:
    assert check.time("inf") == math.inf
    assert check.time(0.0) == 0
    assert check.interval([0.5, "inf"]) == (Fraction(1, 2), math.inf)
    assert check.interval([0.5, 0.5]) == (Fraction(1, 2), Fraction(1, 2))
    assert check.interval([0, 1]) == (0, 1)
    with pytest.raises(check.NotProved):
        check.time(-5e-324)
    for value in ([1.0, 0.5], [-0.5, 1.0], ["inf", "inf"], [True, 2.0], [0.0, True], (0.0, 1.0),
                  {"0": 0.0, "1": 1.0}):  # fmt: skip
        with pytest.raises((check.NotProved, ValueError)):
            check.interval(value)


def test_arrays_have_one_size_for_each_letter() -> None:
    sizes: dict[str, int] = {}
    assert check.array([[1, 2, 3], [4, 5, 6]], "pn", sizes) == [[1, 2, 3], [4, 5, 6]]
    assert sizes == {"p": 2, "n": 3}
    for value, shape in (
        ([[1, 2], [3]], "nm"), ([[1, 2, 3]], "nn"), ([], "n"), ([[]], "nm"), (1.0, "n"),
        ([1, 2], "nm"), ([[1]], "n"), ("12", "n"), ({"0": 1}, "n"), (True, ""),
    ):  # fmt: skip
        with pytest.raises(check.NotProved):
            check.array(value, shape, {})
    with pytest.raises(check.NotProved):
        check.array([1, 2], "n", {"n": 3})


def test_keys_that_stand_twice() -> None:
    assert check.keys_once([("a", 1), ("b", 2)]) == {"a": 1, "b": 2}
    with pytest.raises(check.NotProved):
        check.keys_once([("a", 1), ("a", 1)])


# signs and splits --------------------------------------------------------------------------------


def test_signs() -> None:
    tiny = Fraction(1, 10**30)
    assert check.is_metzler(exact([[-1, 0], [2, -3]]))
    assert check.is_metzler([[tiny, -tiny], [tiny, tiny]], tiny)
    for X in ([[1, -tiny], [1, 1]], [[1, 1], [-tiny, 1]]):
        assert not check.is_metzler(X)
        assert not check.is_metzler([[2 * a for a in row] for row in X], tiny)
        assert not check.is_nonnegative(X)
    assert check.is_nonnegative(exact([[0, 1], [2, 0]]))
    assert not check.is_nonnegative([[-tiny]])


def test_the_map_of_a_width_counts_what_the_split_leaves() -> None:
    X, minus = exact([[1, -2], [3, 4]]), exact([[0, 2], [0, 0]])
    plus = exact([[1, 0], [3, 4]])
    assert check.width_map(X, plus, minus) == [[1, 2], [3, 4]]
    near, far = Fraction(4, 2**46), Fraction(4, 2**46) + Fraction(1, 2**90)
    for sign in (1, -1):
        off = exact([[1, 0], [3 + sign * near, 4]])
        assert check.width_map(X, off, minus) == [[1, 2], [3 + sign * near + near, 4]]
        with pytest.raises(check.NotProved):
            check.width_map(X, exact([[1, 0], [3 + sign * far, 4]]), minus)
    with pytest.raises(check.NotProved):
        check.width_map(X, exact([[1, -2], [2, 4]]), exact([[0, 0], [-1, 0]]))


# stability ---------------------------------------------------------------------------------------


def refused(step: Any, *values: Any) -> bool:
    try:
        step(*values)
    except check.NotProved:
        return True
    return False


def test_hurwitz_or_not() -> None:
    rotation, falls = exact([[-1, 9], [-9, -1]]), exact([[-2, 1], [1, -2]])
    unit, minus = ball([[1, 0], [0, 1]]), ball([[-1, 0], [0, -1]])
    small = ball([[1]])
    for F, forms, expected in (
        (rotation, [unit], True), (rotation, [minus, unit], True), (rotation, [small, unit], True),
        (rotation, [], False), (rotation, [minus], False), (rotation, [small], False),
        (falls, [], True), (falls, [minus], True), (exact([[-1, 1], [1, -1]]), [unit], False),
        (exact([[-1, 2], [1, -1]]), [], False), (exact([[1, 0], [0, -1]]), [unit], False),
        (exact([[2, 1], [1, 2]]), [minus], False), (exact([[-1, 0], [0, 0]]), [], False),
        (exact([[-1, 9], [-1, -1]]), [unit], False), (exact([[0, 1], [-1, 0]]), [unit], False),
    ):  # fmt: skip
        assert refused(check.prove_hurwitz, F, forms) != expected, F


def test_a_vector_proves_metzler_flows_alone() -> None:
    """F v = -(1, 1) for v = (1, 1), and F has the eigenvalue 3."""
    assert refused(check.prove_hurwitz, exact([[1, -2], [-2, 1]]), [])


def test_row_sums_of_one_are_no_contraction() -> None:
    """Thirds are rounded down: their sum is below 1 but for the radius."""
    third = [[Fraction(1, 3)] * 3] * 3
    assert refused(check.prove_one_dwell_time, exact(np.zeros((3, 3))), third, Fraction(1))
    less = [[Fraction(1, 3) - Fraction(1, 10**9)] * 3] * 3
    assert not refused(check.prove_one_dwell_time, exact(np.zeros((3, 3))), less, Fraction(1))


def test_one_dwell_time() -> None:
    for F, H, T, expected in (
        ([[-1]], [[2]], 1, True), ([[-1]], [[3]], 1, False), ([[0]], [[1]], 1, False),
        ([[0, 9], [0, 0]], [[0.5, 0], [0, 0.5]], 2, True), ([[0]], [[-1]], 1, False),
        ([[0, 9], [0, 0]], [[1, 0], [0, 0.5]], 2, False), ([[0]], [[1 - 1e-9]], 1, True),
    ):  # fmt: skip
        step = (check.prove_one_dwell_time, exact(F), exact(H), Fraction(T))
        assert refused(*step) != expected


def test_windows_of_matrices() -> None:
    """x' = 0, jumps 1/2 and P in ratio 3: from the larger to the smaller P alone it falls."""
    F, H, P = exact([[0]]), exact([[Fraction(1, 2)]]), [ball([[1]]), ball([[3]])]
    for (now, after), expected in (((1, 0), True), ((0, 1), True), ((0, 0), True)):
        edges = [(now, after, Fraction(0), Fraction(1))]
        assert refused(check.prove_windows, F, H, edges, P, []) != expected
    P = [ball([[1]]), ball([[5]])]
    for (now, after), expected in (((1, 0), True), ((0, 1), False)):
        edges = [(now, after, Fraction(0), Fraction(1)), (0, 0, Fraction(0), Fraction(1))]
        for order in (edges, edges[::-1]):
            assert refused(check.prove_windows, F, H, order, P, []) != expected
    edges = [(0, 0, Fraction(0), Fraction(1))]
    assert refused(check.prove_windows, F, H, [], P, [])
    assert refused(check.prove_windows, F, H, edges, [P[0], ball([[-1]])], [])
    assert refused(check.prove_windows, F, H, edges, [ball([[0]])], [])


def test_a_reduced_matrix_stands_for_the_rows_of_the_jump() -> None:
    """H = (1, 2)' (1/8, 1/4): V = (1, 2), and V e^(F T) U = 5/8 e^T < 1 up to log 1.6 = 0.47."""
    F, H = exact([[1, 0], [0, 1]]), exact([[0.125, 0.25], [0.25, 0.5]])
    for end, expected in ((Fraction(46, 100), True), (Fraction(48, 100), False)):
        edges = [(0, 0, Fraction(0), end)]
        assert refused(check.prove_windows, F, H, edges, [ball([[1]])], []) != expected
    assert refused(check.prove_windows, F, exact([[0.1, 0], [0, 0.1]]), edges, [ball([[1]])], [])


def test_units_are_positive_and_balance() -> None:
    D = check.units(exact([[-1, 2.0**40], [0, -1]]), exact([[1, 0], [2.0**-40, 1]]))
    assert D[0][1] == D[1][0] == 0
    ratio = D[0][0] / D[1][1]
    assert Fraction(2) ** 38 <= ratio <= Fraction(2) ** 42
    for scale in (D[0][0], D[1][1]):
        assert scale > 0
        assert math.log2(scale) % 1 == 0
    assert check.units(exact([[0]]), exact([[0]])) == [[1]]
