#!/usr/bin/env python3
"""Compare the gains of a design, with which its observer runs, with the problem it answers.

    python3 -I -S check_gains.py design.json          ("-" reads standard input)

This file needs nothing but Python >= 3.8 and its standard library. It is the second half of
check_design.py, which proves what the gains in a file do; here is whether they are those of the
plant that stands in the same file:

    A, B, C, G, E, dwell times, when y is measured: the same numbers and words
    L, M, splits and coordinates that were given: the same; zero where nothing is measured
    bounds of b = X w, lower <= w <= upper (and of c):
        stored lower_i <= sum_k min(X_ik lower_k, X_ik upper_k), likewise upper
    bounds of the noise, lower <= v <= upper, stored as |v - centre| <= radius:
        centre - radius <= lower, upper <= centre + radius

All numbers are taken exactly. Entries that are not known here are refused.

Exit code 0: they are. 1: they are not. 2: not a design that this program reads.
Whatever goes wrong on the way raises an error, and an error never confirms anything.
"""

import hashlib
import json
import math
import sys
from fractions import Fraction
from typing import Any, Dict, List, Tuple

Matrix = List[List[Fraction]]
Table = Dict[str, Any]

# What each entry is: letters, one for each size; words that are allowed; or as `read` says. Names
# with a dot are those of one block.
SHAPES = dict(
    entry.split(":")
    for entry in """
    A:nn B:nm C:pn D:nq E:nl G:nn H:nr L:np M:np R:nn S:nn S2:nn T:nn D0:nn D1:nn Gp:nn Gn:nn
    flow.disturbance_matrix:nb flow.disturbance:box-b flow.d_bounds:box-q flow.input_bound:m+
    jump.disturbance_matrix:nc jump.disturbance:box-c jump.input_bound:l+ dwell_time:range
    dwell_jitter:time output.noise_bound:pairs noise_std:p+ noise_cv:p+ period:time
    measured:continuous|at_jumps jump_measurement:before|after|none
    gain_limit:time objective:feasible|shortest_dwell|narrowest decay_rate:time
    observer.form:cooperative|split|coordinates|two_coordinates|auto
    gains.form:cooperative|split|coordinates|two_coordinates
    flow_lower:n flow_upper:n jump_lower:n jump_upper:n noise_bound:p+ noise_centre:p
    disturbance_matrix:nd disturbance_lower:d disturbance_upper:d jump_disturbance_matrix:nj
    jump_disturbance_lower:j jump_disturbance_upper:j M_cells:znp dwell_borders:y step_limit:time
    """.split()
)
# The entries of each block; those with ! must be there.
BLOCKS = {
    "design": "format! version! name! kind! problem! gains! claims! guarantees! warnings "
    "provenance! digest!",
    "problem": "name! names flow! jump output! observer!",
    "flow": "A! B D d_bounds disturbance! disturbance_matrix input_bound",
    "jump": "G! E H disturbance! disturbance_matrix dwell_time! dwell_jitter! input_bound",
    "output": "C! noise_bound noise_std! noise_cv! measured! period jump_measurement!",
    "given": "L M R D0 D1 Gp Gn S S2 T",
    "gains": "A! B C! flow_lower! flow_upper! G E jump_lower jump_upper dwell_time dwell_jitter "
    "noise_bound noise_centre jump_measurement! L! M!",
    "interval": "form! D0! D1! Gp Gn S S2 T step_limit disturbance_matrix disturbance_lower "
    "disturbance_upper jump_disturbance_matrix jump_disturbance_lower jump_disturbance_upper",
    "luenberger": "M_cells dwell_borders",
    "observer": "kind! gains! form gain_limit objective decay_rate schedule",
}
CHOICES = "poles weights width width_weights memory gain_norm structure region"
NOT_CHECKED = f"{CHOICES} objective decay_rate"  # the last: by check_design.py


class Difference(Exception):
    """What is wrong with a file."""


def demand(condition: bool, reason: str) -> None:
    """Difference unless the condition holds."""
    if not condition:
        raise Difference(reason)


# 1. Reading: all numbers exact, all entries known ------------------------------------------------


def number(value: Any) -> Fraction:
    """A number of the file, exact: a double, none beyond 1e150, no truth value, no word."""
    is_number = type(value) in (int, float) and abs(value) <= 1e150  # false for NaN and infinity
    demand(is_number and value == float(value), f"no double up to 1e150: {value!r:.40}")
    return Fraction(value)


def time(value: Any) -> Any:
    """A time >= 0, or another number that must not be negative; "inf" is infinity."""
    result = math.inf if value == "inf" else number(value)
    demand(result >= 0, "a number must not be negative")
    return result


def array(value: Any, shape: str, sizes: Dict[str, int]) -> Any:
    """Nested lists of numbers; each letter of the shape stands for one size, kept in `sizes`."""
    if not shape:
        return number(value)
    demand(type(value) is list and len(value) > 0, f"a list of numbers is due; got {value!r:.40}")
    demand(sizes.setdefault(shape[0], len(value)) == len(value), "sizes do not fit each other")
    return [array(entry, shape[1:], sizes) for entry in value]


def read(value: Any, shape: str, sizes: Dict[str, int]) -> Any:
    """An entry of the file by its shape, exact.

    box: {"lower": ..., "upper": ...}, as rows [lower, upper]; pairs: such rows, or b for [-b, b];
    range: [shortest, longest]; time: a number that may be "inf"; +: none of them is negative.
    """
    if "|" in shape:
        demand(
            isinstance(value, str) and value in shape.split("|"), f"{value!r:.40} is no word here"
        )
        return value
    if shape == "time":
        return time(value)
    if shape == "range":
        low, high = value
        demand(0 <= number(low) <= time(high), "a range must be [shortest, longest]")
        return [number(low), time(high)]
    if shape[-1] == "+":
        values = array(value, shape[:-1], sizes)
        demand(all(a >= 0 for a in values), "a number must not be negative")
        return values
    if shape[:3] == "box":
        known = {"lower", "upper", "rate"} if shape == "box-q" else {"lower", "upper"}
        demand({*value} <= known, "a box has lower and upper ends alone, that of d also a rate")
        if "rate" in value:
            read(value["rate"], "q+", sizes)
        rows = list(zip(*(array(value[end], shape[4:], sizes) for end in ("lower", "upper"))))
    elif shape == "pairs" and all(isinstance(entry, list) for entry in value):
        rows = [(low, high) for low, high in array(value, "p2", sizes)]
    elif shape == "pairs":
        rows = [(-b, b) for b in array(value, "p", sizes)]
    else:
        return array(value, shape, sizes)
    demand(all(low <= high for low, high in rows), "bounds cross")
    return rows


def block(value: Table, place: str, names: str, sizes: Dict[str, int]) -> Table:
    """The entries of a block, exact where `SHAPES` knows them; an unknown one is refused."""
    for name in names.split():
        demand(name[-1] != "!" or name[:-1] in value, f"{place}.{name[:-1]} is missing")
    result = {}
    for name, entry in value.items():
        known = names.replace("!", "").split()
        demand(name in known, f"{place}: {name!r:.40} is not known to this program")
        shape = SHAPES.get(f"{place}.{name}") or SHAPES.get(name)
        try:
            result[name] = entry if shape is None else read(entry, shape, sizes)
        except (Difference, TypeError, KeyError, ValueError) as error:
            raise Difference(f"{place}.{name}: {error}") from None
    return result


def check_sizes(value: Any) -> None:
    """Difference unless all numbers inside an entry of a problem are 0 or at least 1e-150."""
    if isinstance(value, (list, dict)):
        for entry in value.values() if isinstance(value, dict) else value:
            check_sizes(entry)
    elif type(value) in (int, float):
        demand(value == 0 or abs(value) >= 1e-150, "a number of the problem is below 1e-150")


def check_lists(value: Any, is_entry: bool = False) -> None:
    """Difference where a list of a certificate, or one inside of it, holds true or false."""
    demand(not is_entry or not isinstance(value, bool), "a list holds true or false")
    if isinstance(value, (list, dict)):
        for entry in value.values() if isinstance(value, dict) else value:
            check_lists(entry, isinstance(value, list))


def check_options(value: Any) -> None:
    """Difference unless lists inside of options hold numbers, or such lists."""
    if isinstance(value, dict):
        for entry in value.values():
            check_options(entry)
    elif isinstance(value, list):
        for entry in value:
            demand(type(entry) in (int, float, list) and entry != [], "an option has no numbers")
            check_options(entry)


def keys_once(items: List[Tuple[str, Any]]) -> Table:
    """A table of the file, whose keys must differ."""
    demand(len(dict(items)) == len(items), "a key stands twice in a table")
    return dict(items)


class Design:
    """A design that is unchanged since it was signed: its blocks, exact."""

    def __init__(self, text: str) -> None:
        body = json.loads(text, object_pairs_hook=keys_once)
        signed = {key: value for key, value in body.items() if key != "digest"}
        canonical = json.dumps(
            signed, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False
        )
        digest = "sha256:" + hashlib.sha256(canonical.encode("utf-8")).hexdigest()
        demand(body["digest"] == digest, "the digest is not that of the content")
        sizes: Dict[str, int] = {"2": 2}  # the one size that is known beforehand
        block(body, "design", BLOCKS["design"], sizes)
        is_design = body["format"] == "obsdesign/design" and repr(body["version"]) == "1"
        demand(is_design and body["kind"] in ("interval", "luenberger"), "no design of these kinds")
        self.kind = body["kind"]
        check_sizes(body["problem"])
        check_options(body["problem"]["observer"])
        check_lists([claim["evidence"] for claim in body["claims"]])
        problem = block(body["problem"], "problem", BLOCKS["problem"], sizes)
        is_named = type(body["name"]) is str and body["name"] == problem["name"]
        demand(is_named, "the design and its problem have different names")
        self.flow = block(problem["flow"], "flow", BLOCKS["flow"], sizes)
        self.rates = ["d_bounds.rate"] if "rate" in problem["flow"].get("d_bounds", {}) else []
        self.jump = (
            block(problem["jump"], "jump", BLOCKS["jump"], sizes) if "jump" in problem else {}
        )
        self.output = block(problem["output"], "output", BLOCKS["output"], sizes)
        options = f"{BLOCKS['observer']} {CHOICES}"
        self.options = block(problem["observer"], "observer", options, sizes)
        demand(self.options["kind"] == self.kind, "kind and problem.observer.kind differ")
        self.given = block(self.options["gains"], "given", BLOCKS["given"], sizes)
        names = f"{BLOCKS['gains']} {BLOCKS[self.kind]}"
        self.gains = block(body["gains"], "gains", names, sizes)
        self.n, self.p = sizes["n"], sizes["p"]


# 2. Comparing ------------------------------------------------------------------------------------


def check_gains(design: Design) -> None:
    """Difference unless the stored gains are those of the problem."""
    expected = {**plant_gains(design), **given_gains(design)}
    expected.update(check_disturbance(design, design.flow, ""))
    if design.jump:
        expected.update(check_disturbance(design, design.jump, "jump_"))
    check_noise(design)
    check_schedule(design)
    # what the search for gains chose may have any value
    chosen = (
        "L M D0 D1 Gp Gn S S2 T form step_limit M_cells dwell_borders noise_bound noise_centre "
    )
    chosen += "flow_lower flow_upper " + ("jump_lower jump_upper" if design.jump else "")
    for name in {*design.gains, *expected} - ({*chosen.split()} - {*expected}):
        same = design.gains.get(name) == expected.get(name)
        demand(same, f"gains.{name} is not that of the problem")


def plant_gains(design: Design) -> Table:
    """The numbers and words of the plant that stand among the gains."""
    jump, gains = design.jump, design.gains
    expected = {name: design.flow[name] for name in "AB" if name in design.flow}
    expected.update({name: design.output[name] for name in ("C", "jump_measurement")})
    if not jump:
        return expected
    names = ("G", "E", "dwell_time", "dwell_jitter")
    expected.update({name: jump[name] for name in names if name in jump})
    if jump["dwell_jitter"] == math.inf:
        del expected["dwell_jitter"]
    if design.options.get("objective") == "shortest_dwell":  # it may prove a wider range
        low, high = jump["dwell_time"]
        expected["dwell_time"] = [min(low, gains["dwell_time"][0]), high]
    return expected


def given_gains(design: Design) -> Table:
    """Gains that the problem states, and zeros where nothing is measured."""
    given, zeros = dict(design.given), [[Fraction(0)] * design.p] * design.n
    if "R" in given:  # R is stored as D0
        given["D0"], given["D1"] = given.pop("R"), [[Fraction(0)] * design.n] * design.n
    form = design.options.get("form", "auto")
    if design.kind == "interval" and form != "auto":
        given["form"] = form
    demand(bool(design.jump) or design.output["measured"] == "continuous", "there are no jumps")
    if design.output["measured"] == "at_jumps":
        given["L"] = zeros
    if not design.jump or design.output["jump_measurement"] == "none":
        given["M"] = zeros
    gains = [design.gains["L"], design.gains["M"], *design.gains.get("M_cells", [])]
    sizes = [abs(a) for gain in gains for row in gain for a in row]
    limit = design.options.get("gain_limit", math.inf)
    demand(max(sizes) <= limit, "a gain is larger than gain_limit")
    return given


def check_disturbance(design: Design, part: Table, prefix: str) -> Table:
    """Entries of a disturbance that the gains must have; Difference unless their bounds hold it.

    It is X w, lower <= w <= upper; X is the disturbance matrix, or the unit matrix, and the columns
    of D where d has bounds. An image is rounded outward, by less than 2^-40 of its terms.
    """
    is_plain = "disturbance_matrix" not in part
    unit = [[Fraction(i == j) for j in range(design.n)] for i in range(design.n)]
    X, box = part.get("disturbance_matrix", unit), part["disturbance"]
    if "D" in part and "d_bounds" in part:
        X, box, is_plain = [a + b for a, b in zip(X, part["D"])], box + part["d_bounds"], False
    demand(len(X[0]) == len(box), "a disturbance has another size than its bounds")
    lows, highs = (design.gains[f"{prefix or 'flow_'}{end}"] for end in ("lower", "upper"))
    for row, low, high in zip(X, lows, highs):
        products = [(c * a, c * b) for c, (a, b) in zip(row, box)]
        least, most = sum(map(min, products)), sum(map(max, products))
        size = sum(max(abs(a), abs(b)) for a, b in products)
        slack = Fraction(0) if is_plain else size / 2**40
        fits = 0 <= least - low <= slack and 0 <= high - most <= slack
        demand(fits, f"gains.{prefix or 'flow_'}lower or upper does not hold the disturbance")
    if design.kind == "luenberger":
        return {}
    demand("D" not in part or "d_bounds" in part, "an unknown input has no bounds")
    demand("H" not in part, "impulses of unknown weights have no bounds")
    ends = {"matrix": X, "lower": [a for a, _ in box], "upper": [b for _, b in box]}
    return {} if is_plain else {f"{prefix}disturbance_{end}": ends[end] for end in ends}


def check_noise(design: Design) -> None:
    """Difference unless |v - centre| <= radius, as stored, holds all noise of the problem.

    A centre is rounded, and a radius for it is rounded up: by less than 2^-40.
    """
    gains, bounds = design.gains, design.output.get("noise_bound")
    demand(bounds is not None or design.kind != "interval", "output.noise_bound is missing")
    demand((bounds is None) == ("noise_bound" not in gains), "gains.noise_bound differs")
    demand("noise_centre" not in gains or "noise_bound" in gains, "gains.noise_centre is not due")
    centre = gains.get("noise_centre", [Fraction(0)] * design.p)
    for (low, high), c, r in zip(bounds or [], centre, gains.get("noise_bound", [])):
        slack = Fraction(0) if low == -high else max(abs(low), abs(high)) / 2**40
        fits = c - r <= low and high <= c + r and 2 * r <= high - low + slack
        demand(fits, "gains.noise_bound does not hold the noise")


def check_schedule(design: Design) -> None:
    """Difference unless there is a jump gain for each cell of a schedule of dwell times."""
    schedule, cells = design.options.get("schedule"), design.gains.get("M_cells", [])
    demand((schedule is None) == (cells == []), "gains.M_cells are not those of the schedule")
    if type(schedule) is int:
        demand(len(cells) == schedule, "gains.M_cells are not those of the schedule")
    elif schedule is not None:
        borders = array(schedule, "y", {})
        demand(design.gains["dwell_borders"] == borders, "gains.dwell_borders is not the given one")
    demand(cells != [] or "dwell_borders" not in design.gains, "gains.dwell_borders is not due")


# 3. The answer -----------------------------------------------------------------------------------


def main(*paths: str) -> int:
    """Compare the gains of one design file, print the answer, return the exit code."""
    code = 2
    try:
        demand(len(paths) == 1, f"one design file is due. {__doc__}")
        with open(0 if paths == ("-",) else paths[0], "rb") as file:
            design = Design(file.read().decode("utf-8"))
        code = 1
        check_gains(design)
    except Exception as error:  # whatever goes wrong, nothing is confirmed
        reason = error if isinstance(error, Difference) else repr(error)
        print("not confirmed:" if code == 1 else "not read:", reason)
        return code
    print("confirmed: the stored gains are those of the stored problem")
    others = sorted({*NOT_CHECKED.split()} & {*design.options}) + design.rates
    print(f"not checked: {', '.join(others)}" if others else "no option is left unchecked")
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
