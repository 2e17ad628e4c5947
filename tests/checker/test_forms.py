"""Signs, splits and coordinates of each form: the system of the width, and what is refused."""

from __future__ import annotations

from fractions import Fraction
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from obsdesign.checker import check_design, check_widths

FORMS = ("cooperative", "split", "coordinates", "two_coordinates")
ZEROS = np.zeros((2, 2))
# with entries below zero in each, in their inverses and in S^-1 S2
S, S2 = np.array([[1.0, -0.5], [0.0, -1.0]]), np.array([[1.0, 0.0], [0.5, -1.0]])
F, H = np.array([[-1.0, 0.5], [0.25, -2.0]]), np.array([[0.5, 0.25], [0.0, 1.0]])
C, L, M = np.array([[0.5, 1.0]]), np.array([[0.25], [-0.5]]), np.array([[0.5], [-0.25]])
PLACE = np.array([[0.0, 1.0], [0.0, 0.0]])  # the entry that changes


def matrices(form: str, **parts: Any) -> dict[str, Any]:
    """Gains with L and M, by F, H, D0, D1, Gp, Gn in the coordinates of the form."""
    own = {"F": F, "H": H, "D1": ZEROS, "Gn": ZEROS} | parts
    own = {"D0": own["F"] + own["D1"], "Gp": own["H"] + own["Gn"]} | own
    flow = S if "coordinates" in form else np.eye(2)
    jump = S2 if form == "two_coordinates" else flow
    gains = {
        "form": form, "jump_measurement": own.get("when", "before"), "C": C, "L": L, "M": M,
        "A": flow @ own["F"] @ np.linalg.inv(flow) + L @ C, "D0": own["D0"], "D1": own["D1"],
        "Gp": own["Gp"], "Gn": own["Gn"], "G": jump @ own["H"] @ np.linalg.inv(jump),
        "flow_lower": [-0.5, 0.0], "flow_upper": [0.5, 0.25], "jump_lower": [0.0, -1.0],
        "jump_upper": [0.5, 0.0], "noise_bound": [0.125],
    }  # fmt: skip
    if gains["jump_measurement"] == "before":
        gains["G"] = gains["G"] + M @ C
    elif gains["jump_measurement"] == "after":  # H = (I - M C) G
        gains["G"] = np.linalg.solve(np.eye(2) - M @ C, gains["G"])
    gains |= {"S": S} if "coordinates" in form else {}
    gains |= {"S2": S2, "T": own["Gp"]} if form == "two_coordinates" else {}
    return {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in gains.items()}


def design(program: ModuleType, gains: dict[str, Any], measured: str = "continuous") -> Any:
    """A design of these gains that nobody signed."""
    result = program.Design.__new__(program.Design)
    result.gains, result.n, result.sizes, result.measured = gains, 2, {}, measured
    result.has_jumps = "G" in gains
    return result


def system(gains: dict[str, Any]) -> Any:
    return check_widths.width_system(design(check_widths, gains))


def is_refused(gains: dict[str, Any]) -> bool:
    """By both programs, or by none."""
    answers = set()
    for program, step in ((check_widths, "width_system"), (check_design, "width_maps")):
        try:
            getattr(program, step)(design(program, gains))
        except (program.NotProved, KeyError):
            answers.add(True)
        else:
            answers.add(False)
    (answer,) = answers
    return answer


def floats(X: Any) -> Any:
    return np.array([[float(a) for a in row] for row in X])


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("when", ["before", "after"])
def test_the_system_of_the_width(form: str, when: str) -> None:
    gains = matrices(form, when=when)
    flow = S if "coordinates" in form else np.eye(2)
    jump = S2 if form == "two_coordinates" else flow
    there, back = np.abs(np.linalg.solve(jump, flow)), np.abs(np.linalg.solve(flow, jump))
    box = (np.array([1.0, 0.25]), np.array([0.5, 1.0]))
    X = np.eye(2) - M @ C if when == "after" else np.eye(2)
    f = np.abs(np.linalg.inv(flow)) @ box[0]
    f = f + np.abs(np.linalg.solve(flow, L))[:, 0] * 0.25
    h = np.abs(np.linalg.solve(jump, X)) @ box[1]
    h = back @ (h + np.abs(np.linalg.solve(jump, M))[:, 0] * 0.25)
    own = system(gains)
    for got, expected in (
        (own.W, F), (own.N, back @ H @ there), (own.out, np.abs(flow)), (own.f, f[:, None]),
        (own.h, h[:, None]),
    ):  # fmt: skip
        assert np.allclose(floats(got), expected, rtol=1e-12, atol=0)
    W, N = check_design.width_maps(design(check_design, gains))
    assert np.allclose(floats(W), F, rtol=1e-12, atol=0)
    assert np.allclose(floats(N), back @ H @ there, rtol=1e-12, atol=0)


@pytest.mark.parametrize("form", FORMS)
def test_without_jumps_there_is_no_map_of_them(form: str) -> None:
    gains = matrices(form)
    del gains["G"]
    own = system(gains)
    assert (own.N, own.h) == ([], [])
    assert np.allclose(floats(own.out), np.abs(S) if "coordinates" in form else np.eye(2))
    assert check_design.width_maps(design(check_design, gains))[1] is None


SPLITS = [
    # parts, the forms that take them
    ({"F": F - PLACE, "D1": 0.5 * PLACE}, ("split", "coordinates")),
    ({"D1": 0.25 * PLACE}, ("split", "coordinates", "two_coordinates")),
    ({"D1": -0.25 * PLACE}, ()),
    ({"F": F - PLACE}, ()),
    ({"F": F - PLACE, "D1": 0.25 * PLACE}, ()),
    ({"D0": F + 2.0**-40 * PLACE}, ()),
    ({"H": H - 0.5 * PLACE, "Gn": 0.25 * PLACE}, ("split", "coordinates")),
    ({"Gn": 0.25 * PLACE}, ("split", "coordinates")),
    ({"Gn": -0.25 * PLACE}, ()),
    ({"H": H - 0.5 * PLACE}, ()),
    ({"Gp": H + 2.0**-40 * PLACE}, ()),
]


@pytest.mark.parametrize(("parts", "takes"), SPLITS)
@pytest.mark.parametrize("form", FORMS)
def test_signs_that_a_form_needs(parts: Any, takes: tuple[str, ...], form: str) -> None:
    assert is_refused(matrices(form, **parts)) == (form not in takes)


def test_splits_add_what_they_take_away() -> None:
    own = system(matrices("split", D1=0.25 * PLACE, Gn=0.5 * PLACE))
    assert np.array_equal(floats(own.W), F + 0.5 * PLACE)
    assert np.array_equal(floats(own.N), H + PLACE)


@pytest.mark.parametrize("form", FORMS)
def test_what_is_below_zero_by_rounding(form: str) -> None:
    """F_12 = -e: D1 holds it in two coordinates, up to 2^-46 of the largest entry, 2."""
    flow = F - F * PLACE
    for e, takes in (
        (2.0**-45, ("split", "coordinates", "two_coordinates")), (2.0**-44, ("split", "coordinates")),
        (0.25, ("split", "coordinates")),
    ):  # fmt: skip
        gains = matrices(form, F=flow - e * PLACE, D1=e * PLACE)
        assert is_refused(gains) == (form not in takes)
    unheld = matrices(form, F=flow - 2.0**-50 * PLACE, D0=flow)
    assert is_refused(unheld) == (form == "cooperative")
    jump = H - H * PLACE
    unheld = matrices(form, H=jump - 2.0**-50 * PLACE, Gp=jump)
    assert is_refused(unheld) == (form == "cooperative")


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("name", ["S", "S2", "T", "M_cells"])
def test_gains_are_those_of_their_form(form: str, name: str) -> None:
    gains = matrices(form)
    assert not is_refused(gains)
    if name in gains:
        del gains[name]
    else:
        gains[name] = [[1.0, 0.0], [0.0, 1.0]]
    assert is_refused(gains)


@pytest.mark.parametrize("form", ["", "none", "Cooperative", None])
def test_forms_are_known_words(form: Any) -> None:
    assert is_refused(matrices("cooperative") | {"form": form})


def test_nothing_is_corrected_by_what_is_not_measured() -> None:
    gains = matrices("split", when="none")
    with pytest.raises(check_widths.NotProved):
        system(gains)
    own = system(gains | {"M": [[0.0], [0.0]]})
    assert np.array_equal(floats(own.N), H)


@pytest.mark.parametrize("program", [check_design, check_widths])
def test_the_error_between_jumps_and_at_them(program: ModuleType) -> None:
    A, G = np.array([[-1.0, 2.0], [3.0, -4.0]]), np.array([[0.5, 1.0], [-1.0, 2.0]])
    gain = [[Fraction(float(a)) for a in row] for row in M]
    stored = {"A": A.tolist(), "G": G.tolist(), "C": C.tolist(), "L": L.tolist()}
    for when, expected in (("before", G - M @ C), ("after", G - M @ C @ G), ("none", G)):
        plant = design(program, stored | {"jump_measurement": when})
        own_F, own_H = program.error_maps(plant, gain)
        assert np.array_equal(floats(own_F), A - L @ C)
        assert np.array_equal(floats(own_H), expected)
    plant = design(program, stored | {"jump_measurement": "between"})
    with pytest.raises(KeyError):
        program.error_maps(plant, gain)
    plant = design(program, stored | {"jump_measurement": "before"}, "at_jumps")
    with pytest.raises(program.NotProved):
        program.error_maps(plant, gain)
    plant.gains["L"] = [[0.0], [0.0]]
    assert np.array_equal(floats(program.error_maps(plant, gain)[0]), A)
