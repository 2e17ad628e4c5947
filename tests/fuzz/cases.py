"""Random cases: problems, designs with a digest that fits, data files. One generator, one stream."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

import obsdesign
from obsdesign.data.csv_text import table_text
from obsdesign.data.simulation import simulate
from obsdesign.document import digest
from obsdesign.kinds import KINDS
from tests.fuzz.differences import differs
from tests.fuzz.harness import Case
from tests.fuzz.mutate import NUMBERS, garbled, json_text, mutated, renumbered
from tests.fuzz.plants import KEYS, PROBLEMS, SHIPPED

Rng = np.random.Generator
ALL = PROBLEMS | SHIPPED
SMALL = tuple(PROBLEMS)
_CELLS = (
    "", " ", "0", "-0", "1", "nan", "inf", "-inf", "1e150", "-1e150", "1e-320", "1e308", "-1e308", "1e400",
    "1e149", "1e100", "-1e100", "1e15", "1e16", "text", '"', '"1"', "1_0", "0x1", "١", "True", "1e-9", "3.5", "2",
)  # fmt: skip


@cache
def design_text(name: str) -> str:
    """The design of a plant, as its file has it."""
    problem = obsdesign.Problem.from_dict(ALL[name])
    return json.dumps(obsdesign.design(problem).to_dict())


@cache
def data_text(name: str) -> str:
    """A record that the design of a plant can be run on."""
    problem = obsdesign.Problem.from_dict(ALL[name])
    announced = problem.kind != "impulsive_input"
    until, step = (4.0, 0.2 if name != "impulsive" else None) if name in PROBLEMS else (None, None)
    record = simulate(problem.plant, until=until, step=step, rng=np.random.default_rng(0),
                      announced=announced)  # fmt: skip
    record = replace(record, columns={name: values[:80] for name, values in record.columns.items()})
    return table_text(record.columns)


def start(name: str, rng: Rng) -> list[str]:
    """Where an observer starts: mostly as it has to."""
    bounds = ALL[name]["observer"]["kind"] == "interval"
    flow = ALL[name]["flow"]
    n = len(flow["A"] if "A" in flow else ALL[name]["mode"][0]["A"])
    pick = rng.random()
    if pick < 0.02:
        return [
            "--initial",
            str(rng.choice(["1e308,1e308", "nan,1", "inf,inf", "1", "", "a,b", "1e150,-1e150"])),
        ]
    if bounds:
        return [
            "--initial",
            ",".join([str(rng.choice(["0,2", "-5,9", "-1e150,1e150"], p=[0.8, 0.15, 0.05]))] * n),
        ]
    return []


def problem_case(rng: Rng, names: Sequence[str] = SMALL) -> Case:
    """A problem file, changed; TOML cannot hold all that JSON can, and is changed as text."""
    name = str(rng.choice(names))
    body = renumbered(rng, ALL[name]) if rng.random() < 0.6 else mutated(rng, ALL[name], KEYS)
    text = json_text(body, bool(rng.random() < 0.5)).encode("utf-8", "surrogatepass")
    suffix = "json"
    pick = rng.random()
    if pick < 0.08:
        text = garbled(rng, text)
    elif pick < 0.14:
        text, suffix = garbled(rng, toml_text(ALL[name])), "toml"
    file = f"p.{suffix}"
    kind = str(rng.choice(KINDS))
    ways: list[tuple[float, list[str], tuple[str, ...]]] = [
        (0.62, ["design", file, "-o", "d.json"], ("d.json",)),
        (0.08, ["design", file, "-o", "d.json", "--allow-undecided", "--json"], ("d.json",)),
        (0.10, ["design", file, "--kind", kind, "-o", "d.json"], ("d.json",)),
        (0.14, ["simulate", file, "--until", "3", "--step", "0.1", "-o", "x.csv"], ("x.csv",)),
        (0.03, ["check", file, "--json"], ()),
        (0.03, ["search", file, "--for", str(rng.choice(["shortest_dwell", "longest_dwell"])),
                "--accuracy", "0.1"], ()),
    ]  # fmt: skip
    _, arguments, outputs = ways[int(rng.choice(len(ways), p=[way[0] for way in ways]))]
    return Case(f"problem {name}", {file: text}, arguments, outputs=outputs)


def toml_text(body: dict[str, Any]) -> bytes:
    """A problem as TOML: JSON values are TOML values, but for tables."""

    def value(item: Any) -> str:
        if isinstance(item, dict):
            return "{ " + ", ".join(f"{key} = {value(x)}" for key, x in item.items()) + " }"
        return "inf" if item == "inf" else json.dumps(item)

    return "".join(f"{key} = {value(item)}\n" for key, item in body.items()).encode()


def design_case(rng: Rng, names: Sequence[str] = SMALL) -> Case:
    """A design, changed and signed again."""
    name = str(rng.choice(names))
    base = json.loads(design_text(name))
    block = str(rng.choice(["gains", "claims", "problem", "guarantees", "provenance", ""],
                           p=[0.4, 0.32, 0.12, 0.05, 0.04, 0.07]))  # fmt: skip
    if block and rng.random() < 0.5:
        body = base | {block: renumbered(rng, base[block], NUMBERS)}
    elif block:
        body = base | {block: mutated(rng, base[block], (*base["gains"], *KEYS))}
    else:
        body = mutated(rng, base, ("kind", "version", "a"))
    text = signed(body, rng).encode("utf-8", "surrogatepass")
    files = {"d.json": text, "x.csv": data_text(name).encode()}
    pick = rng.random()
    if pick < 0.5:
        return Case(f"verify {name}", files, ["verify", "d.json", *(["--json"] if pick < 0.1 else [])],
                    never_proved=differs(base, body))  # fmt: skip
    if pick < 0.85:
        arguments = ["run", "d.json", "x.csv", "-o", "e.csv", *start(name, rng)]
        return Case(f"run {name}", files, arguments, outputs=("e.csv",))
    if pick < 0.9:
        arguments = ["export", "d.json", "-o", "g.mat"]
        return Case(f"export {name}", files, arguments, outputs=("g.mat",))
    if pick < 0.97:
        arguments = ["simulate", "d.json", "--until", "2", "-o", "y.csv"]
        return Case(f"simulate {name}", files, arguments, outputs=("y.csv",))
    arguments = ["run", "d.json", *start(name, rng)]
    return Case(f"stream {name}", files, arguments, stdin=data_text(name))


def signed(body: Any, rng: Rng) -> str:
    """The text of a design with the digest that belongs to it, where it can have one."""
    text = json_text(body)
    if isinstance(body, dict) and rng.random() < 0.98:
        try:
            body = json.loads(text)
            text = json_text(body | {"digest": digest(body)})
        except (ValueError, RecursionError):  # refused before its digest is looked at
            return text
    return text


def data_case(rng: Rng, names: Sequence[str] = SMALL) -> Case:
    """A data file, changed, for an observer, from a file or a pipe."""
    name = str(rng.choice(names))
    rows = [line.split(",") for line in data_text(name).splitlines()]
    if mild := rng.random() < 0.5:
        _retell(rng, rows)
    for _ in range(0 if mild else int(rng.geometric(0.4))):
        _change(rng, rows)
    text = "\n".join(",".join(row) for row in rows) + "\n" * int(rng.random() < 0.9)
    content = text.encode()
    if not mild and rng.random() < 0.1:
        content = garbled(rng, content)
    files = {"d.json": design_text(name).encode()}
    pick = rng.random()
    if pick < 0.25:
        arguments = ["run", "d.json", *start(name, rng)]
        return Case(f"pipe {name}", files, arguments, stdin=content.decode("utf-8", "replace"))
    files["x.csv"] = content
    if pick < 0.3:
        # the data are what is garbled here: searches need not go on for long
        arguments = ["compare", "p.json", "--data", "x.csv", "--json", "--time", "1"]
        files["p.json"] = json.dumps(ALL[name]).encode()
        return Case(f"compare {name}", files, arguments)
    events = name in ("interval", "impulsive_input") and rng.random() < 0.3
    arguments = ["run", "d.json", "x.csv", "-o", "e.csv", *start(name, rng)]
    arguments += ["--events", "v.csv"] if events else []
    return Case(f"data {name}", files, arguments, outputs=("e.csv", "v.csv"))


def _change(rng: Rng, rows: list[list[str]]) -> None:
    """One change of a table, in place."""
    if len(rows) < 2:
        return
    k = int(rng.integers(1, len(rows)))
    column = int(rng.integers(max(len(rows[k]), 1)))
    ways: list[Callable[[], None]] = [
        lambda: _cell(rows[k], column, str(rng.choice(_CELLS))),
        lambda: _cell(rows[k], column, str(rng.choice(_CELLS))),
        lambda: _cell(rows[k], 0, repr(float(rng.choice([-1, 1]) * 10.0 ** rng.uniform(-3, 150)))),
        lambda: _cell(rows[-1], 0, repr(float(10.0 ** rng.uniform(0, 150)))),
        lambda: _cell(rows[1], 0, repr(-float(10.0 ** rng.uniform(-3, 150)))),
        lambda: _cell(rows[k], column, repr(float(rng.normal() * 10.0 ** rng.uniform(-30, 150)))),
        lambda: rows.insert(k, list(rows[k])),
        lambda: rows.insert(k, _between(rows, k, rng)),
        lambda: rows.__delitem__(k),
        lambda: rows.__delitem__(slice(k, k + int(rng.integers(1, 15)))),
        lambda: _cell(rows[0], int(rng.integers(len(rows[0]))), str(rng.choice(["t", "y1", "jump", "", "u1", "z"]))),
        lambda: rows[k].append("1"),
        lambda: [_cell(row, column, str(rng.choice(["", "1e150", "0", "1"]))) for row in rows[1:]] and None,
        lambda: [_shifted(row, float(rng.choice([1e5, -1e5, 1e12, 1e16, -1e100]))) for row in rows[1:]] and None,
    ]  # fmt: skip
    ways[int(rng.integers(len(ways)))]()


def _retell(rng: Rng, rows: list[list[str]]) -> None:
    """Other measurements, gaps, and times that still increase, in place: nothing to refuse."""
    # a named sensor is the first column after the time
    columns = [k for k, title in enumerate(rows[0]) if title[0] in "yuw"] or [1]
    for _ in range(int(rng.geometric(0.4))):
        k, column = int(rng.integers(1, len(rows))), int(rng.choice(columns))
        pick = rng.random()
        if pick < 0.5:
            size = (
                10.0 ** rng.uniform(-150, 150) if rng.random() < 0.3 else 10.0 ** rng.uniform(-6, 6)
            )
            rows[k][column] = repr(float(rng.normal() * size))
        elif pick < 0.6:
            rows[k][column] = ""
        elif pick < 0.75:
            del rows[k : k + int(rng.integers(1, 15))]
            if len(rows) < 3:
                return
        else:  # later from here on, or a row just after the one before
            by = float(
                10.0 ** (rng.uniform(-12, 150) if rng.random() < 0.3 else rng.uniform(-9, 3))
            )
            for row in rows[k:]:
                _shifted(row, by)
    last = -math.inf
    for row in rows[1:]:
        row[0] = repr(last := max(float(row[0]), math.nextafter(last, math.inf)))


def _cell(row: list[str], column: int, text: str) -> None:
    if column < len(row):
        row[column] = text


def _shifted(row: list[str], by: float) -> None:
    try:
        row[0] = repr(float(row[0]) + by)
    except (ValueError, IndexError):
        return


def _between(rows: list[list[str]], k: int, rng: Rng) -> list[str]:
    """A row right after the one before, by the smallest step or a small one."""
    row = list(rows[k])
    try:
        t = float(rows[k - 1][0])
    except (ValueError, IndexError):
        return row
    row[0] = repr(float(np.nextafter(t, math.inf)) if rng.random() < 0.5 else t + 1e-9)
    return row


CASES: dict[str, Callable[[Rng, Sequence[str]], Case]] = {
    "problem": problem_case,
    "design": design_case,
    "data": data_case,
}
