"""The programs of `obsdesign/checker` against `verify`: designs, mutants, mutants of their source.

python -m tests.long.checker designs FOLDER [COUNT]    make and keep designs; who accepts them, how fast
python -m tests.long.checker mutants FOLDER [COUNT] [SEED]   changed designs, signed again: who accepts
python -m tests.long.checker source PROGRAM [COUNT]    one operator or number of check_design.py, ... changed

A mutant is falsely accepted if all programs that read it accept it, and `verify` does not prove a
claim of theirs or does not read the file. Those are printed, each with its change. `source` copies the
project and runs tests/checker on each changed source; whoever survives is printed, and stands in
`EXPLAINED` with the reason if no test can see it.
"""

from __future__ import annotations

import ast
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import obsdesign
from obsdesign.checker import check_design, check_gains, check_widths
from obsdesign.design_file import from_dict
from obsdesign.document import digest
from obsdesign.errors import InputError
from obsdesign.problem.problem import load_for_kind
from tests.long.mutations import mutants_of
from tests.systems.checked import FOLDER, PROBLEMS, exit_code
from tests.systems.interval import FORMS, random_problem

ROOT = Path(__file__).parents[2]
SIGNS = {"consistent", "flow_positive", "jump_positive"}
STABILITY = {"hurwitz", "dwell_stability", "decay_rate", "rates"}
WIDTHS = {"width", "sampled_width"}
# claims of each program, of a design that it accepts
SCOPES = {check_design: SIGNS | STABILITY, check_widths: SIGNS | WIDTHS}
SCOPE = set.union(*SCOPES.values())
SECONDS = 20.0


def problems(count: int) -> Iterator[tuple[str, obsdesign.Problem]]:
    """Examples, plants of the tests, then random ones of both kinds."""
    for path in sorted((ROOT / "examples").glob("*.toml")):
        for kind in ("interval", "luenberger"):
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
    codes = {program: exit_code(document, program) for program in SCOPES}
    if 1 in codes.values() or exit_code(document, check_gains):
        return set()
    return set[str]().union(*(SCOPES[program] for program, code in codes.items() if code == 0))


def verified(document: dict[str, Any], scope: set[str]) -> tuple[bool, bool]:
    """Does `verify` read it and prove the claims of a scope; and all of it?"""
    try:
        outcome = obsdesign.verify(from_dict(document))
    except InputError:
        return False, False
    claims = [claim for claim in outcome.claims if claim.id in scope]
    is_proved = bool(claims) and all(claim.verdict == "proved" for claim in claims)
    return is_proved, outcome.verdict == "proved"


def make_designs(folder: Path, count: int) -> None:
    """Keep the proved designs of the scope in a folder, and print who accepts them, how fast."""
    folder.mkdir(exist_ok=True)
    rows: dict[int, list[tuple[float, float, float]]] = {}
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
        code = exit_code(document, check_design)
        middle = time.perf_counter()
        widths = exit_code(document, check_widths)
        end = time.perf_counter()
        if code == widths == 2:
            tally["out of scope"] += 1
            continue
        assert all(verified(document, SCOPE))
        each = (middle - start, end - middle, time.perf_counter() - end)
        rows.setdefault(problem.plant.n, []).append(each)
        is_accepted = bool(accepted(document))
        tally["accepted" if is_accepted else "not accepted"] += 1
        tally["widths"] += widths == 0
        if not is_accepted:
            print(f"not accepted: {name}", flush=True)
        (folder / f"{name.replace(' ', '_')}.json").write_text(json.dumps(document), "utf-8")
    print(dict(tally))
    print("n, designs, check_design, check_widths, verify: median / max (seconds)")
    for n, times in sorted(rows.items()):
        columns = (f"{np.median(each):.2g} / {each.max():.2g}" for each in np.array(times).T)
        print(n, len(times), *columns)


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
        places = list(leaves(root))
        if not places:
            continue
        path = places[int(rng.integers(len(places)))]
        values = changes_of(value_at(root, path), rng)
        value = values[int(rng.integers(len(values)))]
        targets = [root]
        if rng.random() < 0.5 and root is result["gains"]:  # the plant too: consistent, and another
            targets += [
                block for block in result["problem"].values()
                if isinstance(block, dict) and path[0] in block
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
    tally: Counter[tuple[bool, bool]] = Counter()
    for k in range(count):
        document, text = mutated(quick[k % len(quick)], rng)
        scope = accepted(document)
        own, (theirs, whole) = bool(scope), verified(document, scope)
        other = theirs if own else whole  # what `verify` says of the rest of the file is not theirs
        tally[own, other] += 1
        if own != other:
            print(f"{'checker' if own else 'verify'} only: {document['name']}: {text}", flush=True)
        if (k + 1) % 100 == 0:
            print(k + 1, names_of(tally), flush=True)
    print(names_of(tally))


def names_of(tally: Counter[tuple[bool, bool]]) -> dict[str, int]:
    """The tally in words."""
    words = {
        (True, True): "accepted by both", (False, False): "refused by both",
        (True, False): "checker only", (False, True): "verify only",
    }  # fmt: skip
    return {word: tally[key] for key, word in words.items()}


# tests of each program
TESTS = {
    "check_design.py": ["tests/checker/test_balls.py", "tests/checker/test_check_design.py"],
    "check_widths.py": ["tests/checker/test_check_widths.py"],
    "check_events.py": ["tests/checker/test_check_events.py"],
}
# functions of the checker whose mutants are met
FUNCTIONS = (
    "upper_ends", "resting_point", "remainder_map", "in_units", "with_samples", "prove_width",
    "prove_constant_dwell", "prove_vector", "units", "prove_rates", "prove", "width_system",
    "disturbance", "noise", "times", "scaled", "plus", "norm", "ball", "is_positive", "is_negative", "is_less", "congruence",
    "lyapunov", "bounding_factor", "prove_range", "cover", "time_of_tail", "bounded", "exponential",
    "falling", "holds_from", "holds", "advance", "best_remainder", "is_box", "remainder_factor",
    "check_partition", "common_cells", "is_reachable", "edges_of", "prove_hurwitz", "steep",
    "box", "is_below", "time_of_return", "dot", "least", "corrected", "sampled", "happened",
    "is_read", "meet", "less", "until", "preceding", "ages_at_marks", "grown", "since", "unsampled",
    "from_first", "last_of_both", "prove_graph", "prove_stability", "prove_still", "read_sensors",
    "read_events", "read",
)  # fmt: skip
# survivors that no test has to see: a part of the changed line, and why
EXPLAINED = {
    "Fraction(1, (3)**20)": "any b > 0 serves",
    "c = min(": "what it returns is certified by `holds_from`",
    "derivatives[(1)]": "in units of the flow, |W| <= 1, the first derivative is no smaller",
    "* (n + (2))": "zip drops what is too long",
    "(2 * n + (2))": "the same",
    "cost = max(": "floats choose among matrices R, each of which is certified",
    "+ (3))": "a radius larger by a unit is right too",
    "// a.denominator for a in row] for row in X], (2))": "a radius larger by a unit is right too",
    "for _ in range(MOST_HALVINGS if": "when a box that fails is given up; it is certified or not",
    "is_positive(X.scaled(Fraction(-(2))))": "a positive multiple has the same sign",
    "c, coarse = ": "where a search begins; what it returns is certified",
    "c *= 1 + Fraction(1, (17))": "a smaller step; what it returns is certified",
    "self.boxes += (2)": "fewer boxes",
    "numbers grow too large": "when numbers are given up",
    "g = total(tops, self.v,": "any positive share of v makes an upper bound without zeros",
    "while (norm(Z.x) - n * Z.radius)": "where radii count, they are larger than the rest",
    "if p <= (1):": "a pivot of one unit is given away",
    "size = (1)": "a second cell, where there is one, is reached at once",
    "i + (2)} of a bound": "words of a refusal",
    "h * (3)**MOST_HALVINGS": "when a range that fails is given up",
    "(is_short and any(": "the same: it fails at an end then, too",
    "sorted({(2), cells})": "of two graphs that whose nodes are as many as the bounds is taken",
    "max(a, (1))": "P larger by a unit is right too",
    "max(cells, default=(1))": "one cell more, the whole range, changes nothing",
}


def mutate_source(count: int, name: str) -> None:
    """Run tests/checker on changed sources of a program and print who survives."""
    path = FOLDER / name
    known = _shared(path)
    every = [
        mutant for mutant in mutants_of(str(path), path.read_bytes())
        if mutant.function.split(".")[-1] in FUNCTIONS and mutant.function.split(".")[0] not in known
    ]  # fmt: skip
    chosen = np.random.default_rng(1).permutation(len(every))[:count]
    tally: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        ignored = shutil.ignore_patterns(".venv", ".git", "*.egg-info", "__pycache__")
        shutil.copytree(ROOT, tree, ignore=ignored)
        for k in chosen:
            mutant = every[int(k)]
            (tree / "obsdesign" / "checker" / name).write_bytes(mutant.source)
            word = "killed"
            if _survives(tree, TESTS[name]):
                reasons = [EXPLAINED[part] for part in EXPLAINED if part in mutant.now]
                word = "explained" if reasons else "survived"
            tally[word] += 1
            if word == "survived":
                print(f"survived: {mutant.function}: {mutant.was}  ->  {mutant.now}", flush=True)
            if tally.total() % 10 == 0:
                print(tally.total(), dict(tally), flush=True)
    print(len(every), "sites;", dict(tally))


def _shared(path: Path) -> set[str]:
    """Functions and classes of a program that are those of check_design.py, met there."""
    if path.name == "check_design.py":
        return set()
    own, first = (
        {node.name: ast.unparse(node) for node in ast.parse(each.read_text("utf-8")).body
         if isinstance(node, ast.FunctionDef | ast.ClassDef)}
        for each in (path, FOLDER / "check_design.py")
    )  # fmt: skip
    return {name for name in own if own[name] == first.get(name)}


def _survives(tree: Path, tests: list[str]) -> bool:
    """Do the tests of the checker pass in a copy of the project?"""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests]
    environment = {**os.environ, "PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": "1"}
    try:
        run = subprocess.run(
            command, cwd=tree, env=environment, capture_output=True, check=False, timeout=300
        )
    except subprocess.TimeoutExpired:
        return False
    return run.returncode == 0


def main() -> None:
    """What the command line asks for."""
    what, *words = sys.argv[1:]
    if what == "designs":
        make_designs(Path(words[0]), int(words[1]) if len(words) > 1 else 200)
    elif what == "mutants":
        count, seed = [*map(int, words[1:]), *(10_000, 25)[len(words) - 1 :]]
        compare_mutants(Path(words[0]), count, seed)
    else:
        mutate_source(int(words[1]) if len(words) > 1 else 10_000, words[0])


if __name__ == "__main__":
    main()
