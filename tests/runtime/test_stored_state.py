"""A record run in parts gives what it gives in one go, bit for bit, for every kind."""

from __future__ import annotations

import functools
import json
import math
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.data.simulation import simulate
from obsdesign.data.stream import Stream
from obsdesign.document import digest
from obsdesign.errors import InputError
from obsdesign.kinds import GIVING_BOUNDS
from obsdesign.runtime import Sample, from_design
from obsdesign.runtime.base import rows_of
from obsdesign.runtime.progress import Progress
from obsdesign.runtime.step_cache import shared_step
from obsdesign.runtime.stored_state import progress_from_text, state_text

SEED = 1
EXAMPLES = Path(__file__).parents[2] / "examples"
_CLEARANCE = {"name": "k", "range": [-0.06, 0.06], "A": (-np.diag([0, 0, 0, 0, 1, 0])).tolist()}
# every kind, and of each what its state may hold: (example, rows, how its problem is changed)
CASES: dict[str, tuple[str, int, dict[str, Any]]] = {
    "interval, continuous": ("degue_4_1", 60, {}),
    "interval, two coordinates": ("degue_4_3", 60, {}),
    "luenberger, periodic": ("sampled_data", 60, {}),
    "interval, periodic": ("sampled_data", 60, {"kind": "interval"}),
    "impulsive, full": ("gantry_crane", 60, {}),
    "impulsive, quadratic": (
        "gantry_crane",
        60,
        {"strategy": "quadratic", "noise_target": None, "window": None},
    ),
    "impulsive, compressed": ("medina_spline", 60, {}),
    "finite time, bounds": ("mazenc_4", 300, {"method": "least_squares", "noise_bound": 0.01}),
    "finite time, exact": ("mazenc_4", 300, {"method": "exact"}),
    "finite time, approximate": ("mazenc_4", 300, {}),
    "unknown input, cell": ("ahn_1", 60, {}),
    "unknown input, fixed lag": (
        "ahn_1",
        60,
        {"differentiator": "fixed_lag", "lag": 4, "noise_std": 0.01},
    ),
    "unknown input, damped": ("ahn_2", 60, {"differentiator": "damped"}),
    "impulses, integral": ("mattsson_medvedev", 2600, {"period": 0.1}),
    "impulses, integral, noise": ("mattsson_medvedev_noise", 2600, {"period": 0.1}),
    "impulses, samples": ("luteinizing_hormone", 120, {}),
    "interval, doses": ("oral_doses", 120, {}),
    "set membership": ("gantry_crane_bounds", 40, {"window": 8, "fixed_lag": 3}),
    "interval, parameter": ("spring_damper", 60, {}),
    "interval, parameter, no box": ("spring_damper", 60, {"state": None}),
    "interval, parameter, proved box": ("oral_doses", 60, {"parameter": [_CLEARANCE]}),
    "set membership, parameter": ("spring_damper", 40, {"kind": "set_membership", "window": 6}),
}


@functools.cache
def recorded(case: str) -> tuple[Any, Any, Any, tuple[Sample, ...]]:
    """(design, its observer, a start, samples with noise and with a few of them missing)."""
    name, count, options = CASES[case]
    body = obsdesign.load_problem(EXAMPLES / f"{name}.toml").to_dict()
    options = dict(options)
    if "noise_bound" in options:
        body["output"]["noise_bound"] = [options.pop("noise_bound")] * len(body["output"]["C"])
    if "noise_std" in options:
        body["output"]["noise_std"] = [options.pop("noise_std")] * len(body["output"]["C"])
    if "period" in options:
        body["output"]["period"] = options.pop("period")
    body |= {key: options.pop(key) for key in ("parameter", "state") if key in options}
    body = {key: own for key, own in body.items() if own is not None}
    if "kind" in options:
        body["observer"] = options
        body["output"].setdefault("noise_bound", [0.1] * len(body["output"]["C"]))
    body["observer"] = {k: v for k, v in (body["observer"] | options).items() if v is not None}
    problem = obsdesign.Problem.from_dict(body)
    design = obsdesign.design(problem, allow_undecided=True)
    observer = from_design(design)
    announced = design.kind != "impulsive_input"
    record = simulate(problem.plant, rng=np.random.default_rng(3), announced=announced)
    given = {letter: record.block(letter) for letter in "uw" if record.block(letter).size}
    samples = list(rows_of(record.t, record.block("y"), **given, jump=record.columns.get("jump")))
    samples = samples[:count]
    for k in range(17, len(samples), 400 if count > 100 else 23):
        samples[k] = samples[k]._replace(y=None)
    initial = [-3.0, 3.0] * problem.plant.n if design.kind in GIVING_BOUNDS else None
    return design, observer, observer.start(samples[0].t, initial), tuple(samples)


def rows(estimates: Iterable[Any]) -> list[Any]:
    return [
        [
            None if x is None else np.array(x).tobytes()
            for x in (r.t, r.x, r.lower, r.upper, r.d, r.directions, r.lagged)
        ]
        + [r.status, [tuple(map(repr, e.row() if hasattr(e, "row") else e)) for e in r.events]]
        for r in estimates
    ]


def test_a_cached_step_does_not_depend_on_the_stamps_that_came_first() -> None:
    """Steps that differ by the rounding of their stamps share a length that covers all of them."""
    for h, size in ((0.05, 0.6), (0.05, 7.9), (1.0, 1.9), (0.1, 1e6), (1.0, 2.0**40)):
        steps = (h, h + math.ulp(size), h - math.ulp(size))
        matrices = []
        for order in (steps, steps[::-1]):
            cache: OrderedDict[tuple[float, int], Any] = OrderedDict()
            matrices += [shared_step(cache, step, size, lambda *built: built) for step in order]
        assert set(matrices[:3]) == set(matrices[3:])
        for step, (length, error) in zip(steps, matrices, strict=False):
            assert error >= abs(step - length) + math.ulp(size)


@pytest.mark.parametrize("live", [False, True])
@pytest.mark.parametrize("case", CASES)
def test_parts_give_what_the_whole_gives(case: str, live: bool) -> None:
    design, observer, state, samples = recorded(case)
    samples = samples[:800] if live else samples
    whole = rows(Stream(observer, Progress(state)).estimates(iter(samples), live=live))
    cuts = sorted(np.random.default_rng(SEED).choice(np.arange(1, len(samples)), 5, replace=False))
    progress, estimates = Progress(state), []
    for part in np.split(np.arange(len(samples)), cuts):
        fresh = from_design(design)  # another process: nothing is cached
        stream = Stream(fresh, progress)
        estimates += rows(stream.estimates(iter([samples[k] for k in part]), live=live))
        progress = progress_from_text(state_text(design, stream.progress), design, fresh, "s.json")
    assert estimates == whole
    assert len(whole) > len(samples) / 3


# --- states of another type -------------------------------------------------------------------------


def resumed(
    case: str,
    change: Callable[[Any], object],
    waiting: Callable[[Any], object] | None = None,
    live: bool = False,
) -> Progress:
    """The progress of a signed state file after a change of its state, and of its waiting rows."""
    design, observer, state, samples = recorded(case)
    stream = Stream(observer, Progress(state))
    list(stream.estimates(iter(samples[:30]), live=live))
    body = json.loads(state_text(design, stream.progress))
    change(body["progress"][0])
    if waiting is not None:
        waiting(body["progress"][1])
    text = json.dumps(body | {"digest": digest(body)})
    return progress_from_text(text, design, observer, "s.json")


@pytest.mark.parametrize("case", ["impulses, integral", "impulses, samples"])
def test_a_part_of_several_types_has_the_entries_of_its_own(case: str) -> None:
    assert resumed(case, lambda state: None).t > 0
    for change, words in (
        (lambda state: state["live"].update(t=None), "state.live.t"),
        (lambda state: state["live"].pop("t"), "state.live"),
        (lambda state: state["live"].update(type="Event"), "state.live"),
        (lambda state: state.update(live=None), "state.live"),
    ):
        with pytest.raises(InputError, match=f"{words}.* must be"):
            resumed(case, change)


MAY_BE = {
    "nan": {"state.window", "state.sent", "stages.strip", "waiting"},
    "inf": {"course.radius", "course.path", "bounds.radius", "cached_radius.radius"},
    "-inf": {"state.box", "stages.box", "state.start", "state.recent", "course.path"},
}  # fmt: skip


def arrays_by_name(entry: Any, name: str = "state", within: str = "") -> dict[int, str]:
    """The names of the field that holds each array of a state, and of that around it."""
    if isinstance(entry, dict) and set(entry) == {"array"}:
        return {entry["array"]: f"{within}.{name}"}
    named = isinstance(entry, dict)
    names: dict[int, str] = {}
    for key, part in entry.items() if named else [(name, part) for part in entry]:
        if isinstance(part, dict | list):
            names |= arrays_by_name(part, key, name if named else within)
    return names


@pytest.mark.parametrize("case", CASES)
def test_arrays_are_finite_where_their_meaning_allows_nothing_else(case: str) -> None:
    design, observer, state, samples = recorded(case)
    stream = Stream(observer, Progress(state))
    list(stream.estimates(iter(samples[:30])))
    text, count = state_text(design, stream.progress), 0
    body = json.loads(text)
    names = arrays_by_name(body["progress"][0]) | dict.fromkeys(
        arrays_by_name(body["progress"][1]), "waiting"
    )
    for place, name in names.items():
        if body["arrays"][place]["dtype"] != "float" or not body["arrays"][place]["values"]:
            continue
        for word in MAY_BE:
            changed = json.loads(text)
            changed["arrays"][place]["values"][0] = word
            signed = json.dumps(changed | {"digest": digest(changed)})
            if name in MAY_BE[word]:
                progress_from_text(signed, design, observer, "s.json")
                continue
            reason = rf"must (be finite.*; got \"{word}\"\.$|have lower <= upper|be at least 0)"
            with pytest.raises(InputError, match=reason):
                progress_from_text(signed, design, observer, "s.json")
            count += 1
    assert count >= 2


def reshaped(array: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """The numbers of an array with one axis more, a vector with one entry less or more."""
    shape, axes, values = array["shape"], array["axes"], array["values"]
    yield array | {"shape": [*shape, 1], "axes": [*axes, len(axes)]}
    if len(shape) == 1 and values:
        yield array | {"shape": [shape[0] + 1], "values": values + values[-1:]}
        yield array | {"shape": [shape[0] - 1], "values": values[1:]}


# rows that came, of a window or a grid: as many as there are
ANY_NUMBER = {"grid.onsets", "grid.cell", "stages.known", "scan.values"}


@pytest.mark.parametrize("case", CASES)
def test_arrays_have_the_sizes_of_the_design(case: str) -> None:
    """A wrong size is refused at the door: numpy would repeat a vector of one entry."""
    design, observer, state, samples = recorded(case)
    stream = Stream(observer, Progress(state))
    list(stream.estimates(iter(samples[:30]), live=True))
    text, count = state_text(design, stream.progress), 0
    body = json.loads(text)
    progress_from_text(text, design, observer, "s.json")  # the twin: the file as it was written
    for place, name in arrays_by_name(body["progress"][0]).items():
        if name in ANY_NUMBER:
            continue
        for array in reshaped(body["arrays"][place]):
            changed = body | {"arrays": [*body["arrays"]]}
            changed["arrays"][place] = array
            signed = json.dumps(changed | {"digest": digest(changed)})
            with pytest.raises(InputError, match=r"must be (of shape|a list of|at most)"):
                progress_from_text(signed, design, observer, "s.json")
            count += 1
    assert count >= 3


@pytest.mark.parametrize(
    ("case", "name", "words"),
    [
        ("interval, continuous", "state.box", "must have lower <= upper; got crossed bounds"),
        ("interval, periodic", "state.box", "must have lower <= upper; got crossed bounds"),
        ("set membership", "state.start", "must have lower <= upper; got crossed bounds"),
        ("set membership", "stages.box", "must have lower <= upper; got crossed bounds"),
        ("set membership", "stages.radius", "at least 0"),
        ("finite time, bounds", "bounds.radius", "at least 0"),
    ],
)
def test_bounds_of_a_state_are_in_order(case: str, name: str, words: str) -> None:
    design, observer, state, samples = recorded(case)
    stream = Stream(observer, Progress(state))
    list(stream.estimates(iter(samples[:30]), live=True))
    body = json.loads(state_text(design, stream.progress))
    places = arrays_by_name(body["progress"][0])
    place = next(k for k in sorted(places, reverse=True) if places[k] == name)
    values = body["arrays"][place]["values"]
    body["arrays"][place]["values"] = [-1.0] * len(values)
    if name.endswith("box") and case.startswith("interval"):  # [lower; -upper]
        body["arrays"][place]["values"] = [1.0] * len(values)
    elif "at least" not in words:
        body["arrays"][place]["values"] = values[::-1]
    text = json.dumps(body | {"digest": digest(body)})
    with pytest.raises(InputError, match=words):
        progress_from_text(text, design, observer, "s.json")


@pytest.mark.parametrize("case", ["interval, continuous", "set membership"])
def test_void_bounds_of_a_refuted_state_go_on(case: str) -> None:
    """The twin of crossed bounds: those that the data crossed, with the time since when."""
    design, observer, state, samples = recorded(case)
    k = next(k for k, sample in enumerate(samples) if k > 5 and sample.y is not None)
    far = samples[k]._replace(y=np.asarray(samples[k].y) + 1e4)
    stream = Stream(observer, Progress(state))
    rows = [*samples[:k], far, *samples[k + 1 : 30]]
    assert "void since" in list(stream.estimates(iter(rows), live=True))[-1].status
    text = state_text(design, stream.progress)
    kept = progress_from_text(text, design, observer, "s.json")
    assert kept.state.refutation
    for sentence in ("nan", "void", " "):
        body = json.loads(text)
        body["progress"][0]["refutation"] = sentence
        with pytest.raises(InputError, match=r"refutation must be empty or begin with 'void since"):
            progress_from_text(
                json.dumps(body | {"digest": digest(body)}), design, observer, "s.json"
            )


def reversed_stages(state: Any) -> None:
    state["stages"] = state["stages"][::-1]


def stages_twice(state: Any) -> None:
    state["stages"] = [stage for stage in state["stages"] for _ in range(2)]


def surplus_stages(state: Any) -> None:
    first = state["stages"][0]
    before = dict(first, h=0.0, t=first["t"] - first["h"])  # measurements alone, at one time
    state["stages"][0] = dict(first, h=first["t"] - before["t"])
    state["stages"] = [before] * 20 + state["stages"]


def later_stages(state: Any) -> None:
    state["stages"][-1] |= {"t": 1e3, "h": 1e3 - state["stages"][-2]["t"]}


def reversed_rows(state: Any) -> None:
    state["live"]["rows"] = state["live"]["rows"][::-1]


@pytest.mark.parametrize(
    ("case", "change", "words"),
    [
        ("set membership", reversed_stages, r"state.stages\[\d\].[ht] must be"),
        ("set membership", stages_twice, r"state.stages\[1\].h must be 0.0, since"),
        ("set membership", surplus_stages, "state.stages must be a list of 8 at most"),
        ("set membership", later_stages, r"state.stages\[\d\].t must be at most .*, state.t"),
        ("set membership", lambda state: state["sampled"].__setitem__(0, 1e3), "at most .*state.t"),
        ("impulses, samples", reversed_rows, r"state.live.rows\[1\].row.t must be at least"),
        ("interval, periodic", lambda state: state.update(sampled=1e3), "state.sampled must be"),
        ("finite time, bounds", lambda state: state.update(anchor_time=1e3), "anchor_time must be"),
        ("unknown input, cell", lambda state: state.update(t_measured=1e3), "t_measured must be"),
        ("gantry", lambda state: state["guard"].update(last_jump=1e3), "state.guard.last_jump must"),
        ("gantry", lambda state: state["guard"].update(longest=1e3), "that of the design"),
        ("set membership", lambda state: state.update(guards=[]), "guards must be 1 of them"),
    ],
)  # fmt: skip
def test_times_are_in_order_and_not_after_that_of_the_state(
    case: str, change: Any, words: str
) -> None:
    case = "impulsive, full" if case == "gantry" else case
    resumed(case, lambda state: None, live=True)  # the twin: the file as it was written
    with pytest.raises(InputError, match=words):
        resumed(case, change, live=True)


def test_times_of_an_array_are_in_order() -> None:
    design, observer, state, samples = recorded("impulses, integral")
    stream = Stream(observer, Progress(state))
    list(stream.estimates(iter(samples[:2600])))
    body = json.loads(state_text(design, stream.progress))
    place = body["progress"][0]["live"]["track"]["t"]["array"]
    body["arrays"][place]["values"].reverse()
    text = json.dumps(body | {"digest": digest(body)})
    with pytest.raises(InputError, match=r"state\.live\.track\.t must be in order"):
        progress_from_text(text, design, observer, "s.json")


@pytest.mark.parametrize("case", ["impulses, integral", "unknown input, fixed lag"])
def test_rows_that_wait_are_in_order(case: str) -> None:
    kept = resumed(case, lambda state: None, lambda rows: None)
    assert len(kept.waiting) > 5

    def swapped(rows: Any) -> None:
        rows[3], rows[4] = rows[4], rows[3]

    for change, words in (
        (swapped, r"waiting\[4\]\[0\] must be finite and after"),
        (lambda rows: rows[0].__setitem__(0, -1.0), r"waiting\[0\]\[0\] must be"),
        (lambda rows: rows[2].__setitem__(0, "inf"), r"waiting\[2\]\[0\] must be"),
    ):
        with pytest.raises(InputError, match=words):
            resumed(case, lambda state: None, change)
