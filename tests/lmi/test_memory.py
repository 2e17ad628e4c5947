"""Budget of memory: refusals before anything is built, and estimates of real sizes."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from lmi.arithmetic.balls import ball, entries, exact, precision
from lmi.arithmetic.exponential import exponential_grid
from lmi.arithmetic.norms import well_ranked
from lmi.bounds.peak_gain import peak_gains
from lmi.find.affine import Unknown, best_margin
from lmi.find.linear_program import minimise
from lmi.find.semidefinite import common_matrices
from lmi.memory import BUDGET_BYTES, OversizeError, require_memory
from lmi.prove.hurwitz import lyapunov_matrix
from lmi.rank.stack import Stack


def peak(build) -> int:  # type: ignore[no-untyped-def]
    tracemalloc.start()
    try:
        build()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def window(n: int, blocks: int) -> Stack:
    unit = exact(np.eye(n))
    return Stack(exact(-np.eye(n)), unit, unit[:1], unit, blocks)


def test_the_budget_itself_is_allowed_and_no_number_more() -> None:
    require_memory("a matrix", BUDGET_BYTES / 8, "none")
    with pytest.raises(OversizeError):
        require_memory("a matrix", BUDGET_BYTES / 8 + 1, "none")
    with pytest.raises(OversizeError, match="needs more than 1 TiB of memory"):
        require_memory("a matrix", float("inf"), "none")


@pytest.mark.parametrize(
    ("build", "text"),
    [
        (
            lambda: lyapunov_matrix(-np.eye(150), np.eye(150)),
            "a Lyapunov equation of 150 states needs 15.1 GiB of memory, and the budget is "
            "512 MiB: fewer states are required.",
        ),
        (
            lambda: exponential_grid(np.eye(150), 0.0, 1.0, 20_000),
            "20000 exponentials of 150 states needs 3.35 GiB of memory, and the budget is "
            "512 MiB: a shorter window is required.",
        ),
        (
            lambda: window(4, 4000).approx(np.ones((601, 3999))),
            "a window of 4000 impulses and 4 states, at 601 places, needs 2.87 GiB of memory, "
            "and the budget is 512 MiB: a shorter window or fewer states are required.",
        ),
        (
            lambda: peak_gains(*(exact(X) for X in (-np.eye(60), np.eye(60)[:, :1], np.eye(60)))),
            "a Lyapunov equation of 60 states in balls needs 2 GiB of memory, and the budget is "
            "512 MiB: fewer states are required.",
        ),
        (
            lambda: common_matrices(np.zeros((2, 100, 100))),
            "a search for 1 matrices of 100 states with 2 maps needs 8.55 GiB of memory, and the "
            "budget is 512 MiB: fewer states, or a shorter range of dwell times, are required.",
        ),
    ],
)
def test_refusals_are_one_line_before_anything_is_built(build, text: str) -> None:  # type: ignore[no-untyped-def]
    def refused() -> None:
        with pytest.raises(OversizeError) as caught:
            build()
        assert str(caught.value) == text

    assert peak(refused) < 20e6


def test_a_matrix_inequality_and_a_linear_program_are_refused() -> None:
    with pytest.raises(OversizeError, match=r"^a matrix inequality in 11325 unknown numbers needs"):
        best_margin([Unknown(150, 150, True)], lambda P: P[None], 1e4)
    entry = np.broadcast_to(0, 10**8)
    with pytest.raises(OversizeError, match=r"^a linear program in 1 unknown numbers with 1 ineq"):
        minimise(np.ones(1), (entry, entry, entry), (np.zeros(1),) * 2, (np.zeros(1),) * 2)


def test_estimates_are_of_the_size_of_what_is_built() -> None:
    """Real peaks lie between a tenth of the estimate and the estimate."""
    n, places, blocks = 6, 100, 12
    flows = places * (blocks - 1) * 10 * n**2 * 8
    assert (
        flows / 10 < peak(lambda: window(n, blocks).approx(np.ones((places, blocks - 1)))) < flows
    )
    equation = 4 * 24**4 * 8
    assert equation / 10 < peak(lambda: lyapunov_matrix(-np.eye(24), np.eye(24))) < equation
    grid = 4000 * 36 * 8
    assert grid / 10 < peak(lambda: exponential_grid(np.eye(6), 0.0, 1e-3, 4000)) < 2 * grid


def test_the_rank_of_a_tall_matrix_takes_no_square_of_its_rows() -> None:
    with precision(128):
        X = entries(ball(exact(np.random.default_rng(1).standard_normal((3000, 2)))))
        assert peak(lambda: well_ranked(X, 1e-10)) < 20e6  # a 3000 x 3000 factor takes 72e6
