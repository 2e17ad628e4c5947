"""The programs of `obsdesign/checker` against `verify`: designs, mutants, mutants of their source.

python -m tests.long.checker designs FOLDER [COUNT]    make and keep designs; who accepts them, how fast
python -m tests.long.checker mutants FOLDER [COUNT] [SEED]   changed designs, signed again: who accepts
python -m tests.long.checker source [COUNT]            one operator or number of the checker changed

A mutant is falsely accepted if both programs accept it, and `verify` does not prove a claim of
theirs or does not read the file. Those are printed, each with its change. `source` copies the
project and runs tests/checker on each changed source; whoever survives is printed, and stands in
`EXPLAINED` with the reason if no test can see it.
"""

from __future__ import annotations

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
from obsdesign.checker import check_design, check_gains
from obsdesign.design_file import from_dict
from obsdesign.document import digest
from obsdesign.errors import InputError
from obsdesign.problem.problem import load_for_kind
from tests.long.mutations import mutants_of
from tests.systems.checked import FOLDER, PROBLEMS, exit_code
from tests.systems.interval import FORMS, random_problem

ROOT = Path(__file__).parents[2]
SCOPE = {"consistent", "flow_positive", "jump_positive", "hurwitz", "dwell_stability", "decay_rate"}
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


def accepts(document: dict[str, Any]) -> bool:
    """Do both programs accept it?"""
    return not (exit_code(document, check_design) or exit_code(document, check_gains))


def verified(document: dict[str, Any]) -> tuple[bool, bool]:
    """Does `verify` read it and prove the claims that the programs are about; and all of it?"""
    try:
        outcome = obsdesign.verify(from_dict(document))
    except InputError:
        return False, False
    claims = [claim for claim in outcome.claims if claim.id in SCOPE]
    is_proved = bool(claims) and all(claim.verdict == "proved" for claim in claims)
    return is_proved, outcome.verdict == "proved"


def make_designs(folder: Path, count: int) -> None:
    """Keep the proved designs of the scope in a folder, and print who accepts them, how fast."""
    folder.mkdir(exist_ok=True)
    rows: dict[int, list[tuple[float, float]]] = {}
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
        own = time.perf_counter() - start
        if code == 2:
            tally["out of scope"] += 1
            continue
        start = time.perf_counter()
        assert all(verified(document))
        rows.setdefault(problem.plant.n, []).append((own, time.perf_counter() - start))
        code = max(code, exit_code(document, check_gains))
        tally["accepted" if code == 0 else "not accepted"] += 1
        if code:
            print(f"not accepted: {name}", flush=True)
        (folder / f"{name.replace(' ', '_')}.json").write_text(json.dumps(document), "utf-8")
    print(dict(tally))
    print("n, designs, checker median / max, verify median / max (seconds)")
    for n, times in sorted(rows.items()):
        own, verify = np.array(times).T
        print(
            f"{n} {len(times)} {np.median(own):.2g} / {own.max():.2g} "
            f"{np.median(verify):.2g} / {verify.max():.2g}"
        )


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
        own, (theirs, whole) = accepts(document), verified(document)
        other = theirs if own else whole  # what `verify` says of the rest of the file is not theirs
        tally[own, other] += 1
        if own != other:
            print(f"{'checker' if own else 'verify'} only: {document['name']}: {text}", flush=True)
        if (k + 1) % 500 == 0:
            print(k + 1, names_of(tally), flush=True)
    print(names_of(tally))


def names_of(tally: Counter[tuple[bool, bool]]) -> dict[str, int]:
    """The tally in words."""
    words = {
        (True, True): "accepted by both", (False, False): "refused by both",
        (True, False): "checker only", (False, True): "verify only",
    }  # fmt: skip
    return {word: tally[key] for key, word in words.items()}


# functions of the checker whose mutants are met
FUNCTIONS = (
    "times", "scaled", "plus", "norm", "ball", "is_positive", "is_negative", "is_less", "between",
    "lyapunov", "bounding_factor", "prove_range", "cover", "time_of_tail", "bounded", "exponential",
    "falling", "holds_from", "holds", "advance", "best_remainder", "is_box", "remainder_factor",
    "rates", "check_partition", "common_cells", "is_reachable", "edges_of", "prove_hurwitz",
)  # fmt: skip
# survivors that no test has to see: a part of the changed line, and why
EXPLAINED = {
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
    "max(cells, default=(1))": "one cell more, the whole range, changes nothing",
}


def mutate_source(count: int) -> None:
    """Run tests/checker on changed sources of the checker and print who survives."""
    path = FOLDER / "check_design.py"
    every = [
        mutant for mutant in mutants_of(str(path), path.read_bytes())
        if mutant.function.split(".")[-1] in FUNCTIONS
    ]  # fmt: skip
    chosen = np.random.default_rng(1).permutation(len(every))[:count]
    tally: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as name:
        tree = Path(name) / "tree"
        ignored = shutil.ignore_patterns(".venv", ".git", "*.egg-info", "__pycache__")
        shutil.copytree(ROOT, tree, ignore=ignored)
        for k in chosen:
            mutant = every[int(k)]
            (tree / "obsdesign" / "checker" / "check_design.py").write_bytes(mutant.source)
            word = "killed"
            if _survives(tree):
                reasons = [EXPLAINED[part] for part in EXPLAINED if part in mutant.now]
                word = "explained" if reasons else "survived"
            tally[word] += 1
            if word == "survived":
                print(f"survived: {mutant.function}: {mutant.was}  ->  {mutant.now}", flush=True)
            if tally.total() % 10 == 0:
                print(tally.total(), dict(tally), flush=True)
    print(len(every), "sites;", dict(tally))


def _survives(tree: Path) -> bool:
    """Do the tests of the checker pass in a copy of the project?"""
    tests = ["tests/checker/test_balls.py", "tests/checker/test_check_design.py"]
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
        mutate_source(int(words[0]) if words else 10_000)


if __name__ == "__main__":
    main()
