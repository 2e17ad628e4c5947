"""The programs of `obsdesign/checker` against `verify`: designs, mutants, mutants of their source.

python -m tests.long.checker designs FOLDER [COUNT]    make and keep designs; who accepts them, how fast
python -m tests.long.checker mutants FOLDER [COUNT] [SEED]   changed designs, signed again: who accepts

A mutant is falsely accepted if all programs that read it accept it, and `verify` does not prove a
claim of theirs. Those are printed, each with its change, as are those that `verify` does not read:
`check_events` leaves entries of the file unread, and compares no bounds of gains and problem, those
that `check_sets` compares may be rounded outward by 2^-40 of their size. What
a program refuses is met by no other one.
Their source is changed by `tests.long.checker_source`.
"""

from __future__ import annotations

import json
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import obsdesign
from obsdesign.checker import check_design, check_events, check_gains, check_sets, check_widths
from obsdesign.design_file import from_dict
from obsdesign.document import digest
from obsdesign.errors import InputError
from obsdesign.problem.problem import load_for_kind
from tests.systems.checked import PROBLEMS, exit_code
from tests.systems.interval import FORMS, random_problem
from tests.systems.random_sets import random_set_problem

ROOT = Path(__file__).parents[2]
SIGNS = {"consistent", "flow_positive", "jump_positive"}
STABILITY = {"hurwitz", "dwell_stability", "decay_rate", "rates"}
WIDTHS = {"width", "sampled_width"}
# claims of each program, of a design that it accepts
SCOPES = {check_design: SIGNS | STABILITY, check_widths: SIGNS | WIDTHS}
CLOCKS = {"event_stability", "event_width"}
SETS = {"width", "optimal"}
SCOPE = set.union(*SCOPES.values(), CLOCKS, SETS)
# entries of evidence that `verify` reads and the programs work out, or do without
UNREAD = {"edges", "cells"}
SECONDS = 20.0


def problems(count: int) -> Iterator[tuple[str, obsdesign.Problem]]:
    """Examples, plants of the tests, then random ones of three kinds."""
    for path in sorted((ROOT / "examples").glob("*.toml")):
        for kind in ("interval", "luenberger", "set_membership"):
            try:
                problem = load_for_kind(str(path), kind)[0]
            except InputError:
                continue
            yield f"{path.stem} {kind}", problem
    for name, body in PROBLEMS.items():
        yield name, obsdesign.Problem.from_dict(body)
    for seed in range(count):
        rng = np.random.default_rng([25, seed])
        form = FORMS[seed % 4]
        if seed % 2:
            yield f"{form} {seed}", random_problem(form, rng)
        else:
            yield f"point {seed}", random_point_problem(rng)
        yield f"sets {seed}", obsdesign.Problem.from_dict(random_set_problem(rng))


def random_point_problem(rng: np.random.Generator) -> obsdesign.Problem:
    """A plant for a point observer: n = 2..8, ranges with and without end, jitter, decay."""
    n = int(rng.integers(2, 9))
    p = int(rng.integers(1, n))
    A = rng.standard_normal((n, n)) - rng.uniform(0.5, 1.5) * np.sqrt(n) * np.eye(n)
    if rng.random() < 0.3:
        A *= 10.0 ** rng.uniform(-1, 1, (n, 1))
    low = float(rng.uniform(0.1, 1))
    jump: dict[str, Any] = {
        "G": rng.standard_normal((n, n)) / np.sqrt(n) * rng.uniform(0.3, 1.5),
        "dwell_time": [low, np.inf if rng.random() < 0.4 else low + float(rng.uniform(0, 3))],
    }
    if rng.random() < 0.3:
        jump["dwell_jitter"] = float(rng.uniform(0.1, 1))
    observer: dict[str, Any] = {"kind": "luenberger"}
    if rng.random() < 0.3:
        observer["decay_rate"] = 0.05
    output = {"C": rng.standard_normal((p, n)), "measured": rng.choice(["continuous", "at_jumps"])}
    return obsdesign.Problem(flow={"A": A}, jump=jump, output=output, observer=observer)


def accepted(document: dict[str, Any]) -> set[str]:
    """Claims of the programs that accept it; none where one of them, or the gains, is refused."""
    if "sensor" in document["problem"]:  # clocks of their own: one program, which reads the gains
        scope = {"event_stability"} if document["problem"].get("event") else CLOCKS
        return set() if exit_code(document, check_events) else scope
    if document["kind"] == "set_membership":  # the same
        claimed = {claim["id"] for claim in document["claims"]}
        return set() if exit_code(document, check_sets) else SETS & claimed
    if exit_code(document, check_gains):
        return set()
    claims = set[str]()
    for program, scope in SCOPES.items():
        code = exit_code(document, program)
        if code == 1:
            return set()
        claims |= scope if code == 0 else set()
    return claims


def met_by_verify(document: dict[str, Any], scope: set[str]) -> str:
    """Whether `verify` reads what programs accept, and proves the claims of a scope."""
    try:
        outcome = obsdesign.verify(from_dict(document))
    except InputError:
        return "accepted, and not read by verify"
    verdicts = {claim.id: claim.verdict for claim in outcome.claims}
    if scope <= CLOCKS | SETS and verdicts["consistent"] != "proved":
        return "accepted, and of gains that are another problem's"
    claims = [claim for claim in outcome.claims if claim.id in scope]
    is_proved = bool(claims) and all(claim.verdict == "proved" for claim in claims)
    return "accepted by both" if is_proved else "falsely accepted"


def make_designs(folder: Path, count: int) -> None:
    """Keep the proved designs of the scope in a folder, and print who accepts them, how fast."""
    folder.mkdir(exist_ok=True)
    rows: dict[tuple[str, int], list[tuple[float, float, float]]] = {}
    tally: Counter[str] = Counter()
    for name, problem in problems(count):
        try:
            outcome = obsdesign.investigate(problem, seconds=SECONDS)
        except InputError:
            continue
        if outcome.verdict != "proved" or outcome.design is None:
            tally["no design"] += 1
            continue
        document = json.loads(json.dumps(outcome.design.to_dict()))
        start = time.perf_counter()
        is_sets = document["kind"] == "set_membership"
        code = exit_code(document, check_sets if is_sets else check_design)
        middle = time.perf_counter()
        widths = exit_code(document, check_widths)
        end = time.perf_counter()
        if code == widths == 2:
            tally["out of scope"] += 1
            continue
        assert met_by_verify(document, SETS if is_sets else SCOPE) == "accepted by both"
        each = (middle - start, end - middle, time.perf_counter() - end)
        first = "check_sets" if is_sets else "check_design"
        rows.setdefault((first, problem.plant.n), []).append(each)
        is_accepted = bool(accepted(document))
        tally["accepted" if is_accepted else "not accepted"] += 1
        tally["widths"] += widths == 0
        if not is_accepted:
            print(f"not accepted: {name}", flush=True)
        (folder / f"{name.replace(' ', '_')}.json").write_text(json.dumps(document), "utf-8")
    print(dict(tally))
    print("program, n, designs, program, check_widths, verify: median / max (seconds)")
    for key, times in sorted(rows.items()):
        columns = (f"{np.median(each):.2g} / {each.max():.2g}" for each in np.array(times).T)
        print(*key, len(times), *columns)


def leaves(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Where the numbers, words and flags of a table are."""
    items = (
        value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list)
        else None
    )  # fmt: skip
    if items is None:
        yield path
        return
    for key, entry in items:
        yield from leaves(entry, (*path, key))


def mutated(document: dict[str, Any], rng: np.random.Generator) -> tuple[dict[str, Any], str]:
    """A document with one to three changes, signed again, and what was changed."""
    result = json.loads(json.dumps(document))
    evidence = {claim["id"]: claim["evidence"] for claim in result["claims"]}
    texts = []
    for _ in range(int(rng.choice([1, 1, 1, 2, 3]))):
        roots = [result["problem"], result["gains"]]
        roots += [evidence[name] for name in sorted(SCOPE & set(evidence) - {"consistent"})]
        root = roots[int(rng.integers(len(roots)))]
        own = UNREAD if root in evidence.values() else set()
        places = [path for path in leaves(root) if path[0] not in own]
        if not places:
            continue
        path = places[int(rng.integers(len(places)))]
        values = changes_of(value_at(root, path), rng)
        value = values[int(rng.integers(len(values)))]
        targets = [root]
        if rng.random() < 0.5 and root is result["gains"]:  # the plant too: consistent, and another
            targets += [
                block for block in result["problem"].values()
                if isinstance(block, dict) and path in {*leaves(block)}
            ]  # fmt: skip
        for target in targets:
            value_at(target, path[:-1])[path[-1]] = value
        texts.append(f"{'/'.join(map(str, path))} = {value!r}")
    return result | {"digest": digest(result)}, "; ".join(texts)


def value_at(root: Any, path: tuple[Any, ...]) -> Any:
    """The entry at a path."""
    for key in path:
        root = root[key]
    return root


def changes_of(value: Any, rng: np.random.Generator) -> list[Any]:
    """Values to put in place of one."""
    words: list[Any] = [
        True,
        None,
        "inf",
        "cooperative",
        "before",
        "none",
        [],
        {},
        -1.0,
        0.0,
        1e200,
    ]
    if isinstance(value, float | int) and not isinstance(value, bool):
        size = 10.0 ** rng.uniform(-14, 1)
        near = [
            value * (1 + size),
            value * (1 - size),
            value + size,
            value - size,
            -value,
            value * 2,
        ]
        near += [float(np.nextafter(value, np.inf)), float(np.nextafter(value, -np.inf)), value / 2]
        return near * 4 + words
    return words


def compare_mutants(folder: Path, count: int, seed: int) -> None:
    """Print who accepts mutants of the designs in a folder."""
    rng = np.random.default_rng(seed)
    documents = [json.loads(path.read_text("utf-8")) for path in sorted(folder.glob("*.json"))]
    quick = [document for document in documents if len(json.dumps(document)) < 60_000]
    tally: Counter[str] = Counter()
    for k in range(count):
        document, text = mutated(quick[k % len(quick)], rng)
        scope = accepted(document)
        word = met_by_verify(document, scope) if scope else "refused"
        tally[word] += 1
        if word not in ("refused", "accepted by both"):
            print(f"{word}: {document['name']}: {text}", flush=True)
        if (k + 1) % 100 == 0:
            print(k + 1, dict(tally), flush=True)
    print(dict(tally))


def main() -> None:
    """What the command line asks for."""
    what, *words = sys.argv[1:]
    if what == "designs":
        make_designs(Path(words[0]), int(words[1]) if len(words) > 1 else 200)
    elif what == "mutants":
        count, seed = [*map(int, words[1:]), *(10_000, 25)[len(words) - 1 :]]
        compare_mutants(Path(words[0]), count, seed)


if __name__ == "__main__":
    main()
