"""Signs of exponential polynomials: boxes enclose the function, Bernstein decides its sign."""

from __future__ import annotations

import itertools
from fractions import Fraction

import numpy as np
import pytest
from scipy.linalg import expm

from lmi.arithmetic.balls import ball, exact, precision, scalar
from lmi.arithmetic.polynomials import times
from lmi.prove import exponential_sign as signs

TURN = np.array([[0.0, 1.0], [-4.0, 0.0]])  # from (1, 0): cos 2s, -2 sin 2s


def polynomial(*numbers: float) -> list:
    return [scalar(exact(x).item()) for x in numbers]


def value(p: list, v: float) -> object:
    return sum((c * scalar(exact(v).item()) ** k for k, c in enumerate(p)), scalar(0))


@pytest.mark.parametrize("size", [0.01, 1.0, 6.0])
def test_boxes_cover_the_range_and_enclose_the_function_closely(size: float) -> None:
    rng = np.random.default_rng(0)
    F, z = size * rng.standard_normal((3, 3)), rng.standard_normal((3, 1))
    with precision(160):
        cover = list(signs.boxes(exact(F), ball(exact(z)), 0.25, 2.0, [0, 2]))
        assert cover[0].start == 0.25
        assert cover[-1].start < 2.0 <= cover[-1].start + cover[-1].width
        for one, following in itertools.pairwise(cover):
            assert following.start == one.start + one.width
        norm = np.abs(F).sum(axis=1).max()
        assert len(cover) == 1 or 0.5 * norm * 1.75 <= len(cover)
        assert len(cover) <= 2 * norm * 1.75 + 1
        for box in cover[:: max(1, len(cover) // 5)]:
            for v in (0.0, 0.5, 1.0):
                truth = signs.value(exact(F), exact(z), box.start + v * box.width)
                for p, i in zip(box.rows, (0, 2), strict=True):
                    enclosed = value(p, v)
                    assert enclosed.overlaps(truth[i])
                    assert float(enclosed.rad()) < 1e-14 * (1 + norm**24) * float(
                        abs(truth[i]).upper() + 1
                    )
    np.testing.assert_allclose(
        [float(x) for x in signs.value(exact(F), exact(z), 0.7)],
        (expm(0.7 * F) @ z).ravel(),
        rtol=1e-10,
    )


def test_the_remainder_is_that_of_the_series() -> None:
    # e^s at s = 1 in one box: the error of 24 terms is below e/24!, and above 1/24!
    with precision(256):
        (box,) = signs.boxes(exact([[1.0]]), ball(exact([[1.0]])), 0.0, 1.0, [0])
        p = box.rows[0]
        assert len(p) == 24
        assert value(p, 1.0).contains(signs.value(exact([[1.0]]), exact([1.0])[:, None], 1.0)[0])
        radius = float(value(p, 1.0).rad())
        assert 1 / 6.3e23 < radius < 3 / 6.2e23


@pytest.mark.parametrize(
    ("p", "sign"),
    [
        ((1.0,), True),
        ((-1.0,), False),
        ((0.5, 1.0), True),
        ((0.5, -1.0), False),
        ((1.0, -3.0, 2.3), True),  # 1 - 9/9.2 > 0 in the middle
        ((1.0, -3.0, 2.2), False),  # 1 - 9/8.8 < 0 in the middle, positive at both ends
        ((0.26, -1.0, 1.0), True),
        ((0.24, -1.0, 1.0), False),
        ((0.25, -1.0, 1.0), None),  # touches zero at 1/2
        ((0.1, 1.0, -0.8, 0.3, -0.5), True),
        ((0.1, 1.0, -0.8, 0.3, -0.7), False),  # at the end alone
    ],
)
def test_positive_on_the_unit_interval(p: tuple[float, ...], sign: bool | None) -> None:
    with precision(128):
        assert signs.positive(polynomial(*p)) is sign
        mirrored = np.polynomial.Polynomial(p)(np.polynomial.Polynomial([1.0, -1.0])).coef
        assert sign is None or signs.positive(polynomial(*mirrored)) is sign


def test_products_and_sums() -> None:
    p, q = (1.0, -2.0, 0.5), (3.0, 4.0)
    with precision(128):
        product = [float(x) for x in times(polynomial(*p), polynomial(*q))]
        total = signs.combined((2, polynomial(*p)), (scalar(-1), polynomial(*q)))
        assert [float(x) for x in total] == [-1.0, -8.0, 1.0]
    assert product == np.convolve(p, q).tolist()


def test_a_sign_over_boxes_and_the_place_that_decides() -> None:
    z = ball(exact([[1.0], [0.0]]))
    with precision(128):

        def sign_until(end: float, sign: int) -> tuple[bool | None, float]:
            cover = signs.boxes(exact(TURN), z, 0.0, end, [0])
            return signs.one_sign(cover, lambda box: box.rows[0], sign)

        assert sign_until(0.75, 1)[0] is True  # cos 2s > 0 up to pi/4 = .785
        for end in (0.79, 0.9, 1.5):
            verdict, place = sign_until(end, 1)
            assert verdict is False
            assert np.cos(2 * place) < 0
        assert sign_until(0.75, -1) == (False, 0.0)


def test_an_effort_ends() -> None:
    z = ball(exact([[1.0], [0.0]]))
    with precision(128):
        enough = signs.Effort(left=1000)
        count = len(list(signs.boxes(exact(TURN), z, 0.0, 8.0, [0], effort=enough)))
        assert enough.left == 1000 - count
        assert (
            len(list(signs.boxes(exact(TURN), z, 0.0, 8.0, [0], effort=signs.Effort(left=count))))
            == count
        )
        with pytest.raises(ValueError, match=r"\|F\| times the length is 32"):
            next(signs.boxes(exact(TURN), z, 0.0, 8.0, [0], effort=signs.Effort(left=count - 1)))
        with pytest.raises(ValueError, match="too much to cover"):
            next(signs.boxes(exact(1e4 * TURN), z, 0.0, 8.0, [0]))


@pytest.mark.parametrize("ulps", [0.75, 1.0, 1.25])
def test_boxes_reach_the_end_where_the_length_rounds_down(ulps: float) -> None:
    # 2 + 2^-51 - ulps 2^-51 is 2 in floats for each of them
    start, end = ulps * 2.0**-51, 2.0 + 2.0**-51
    assert end - start == 2.0
    with precision(128):
        cover = list(signs.boxes(exact([[1.0]]), ball(exact([[1.0]])), start, end, [0]))
    assert len(cover) * Fraction(cover[0].width) >= Fraction(end) - Fraction(start)
