"""Change one operator or number of the code at a time: the tests that run that line must fail.

python -m tests.long.mutants FOLDER [COUNT] [JOBS]          600 mutants, two at once
python -m tests.long.mutants FOLDER --survivors TEST...     meet the survivors with these tests
python -m tests.long.mutants FOLDER --control [COUNT]       no change at all: none may be killed
python -m tests.long.mutants FOLDER --report                outcomes per place

Needs `pip install coverage pytest-cov`. FOLDER keeps all there is: `tree`, a copy of the project
whose suite runs once to learn which tests run which line, and `outcomes.jsonl`, one line for each
mutant met, so that a run goes on where it ended. Mutants come in an order drawn by their hash: the
first COUNT are a sample, and so are the first few. A mutant meets the tests that run its statement,
those that run fewest lines first, then the others of the same files (a fixture's lines count for
its first test alone), until `SECONDS` of the suite's own time are full. It is killed by a test that
fails, or by more processor time than `GRACE` + `FACTOR` times what the tests need without it: the
load of the machine is in neither. More than `LATEST` seconds on the clock decide nothing.

A mutant that survives has often met too few tests: `SECONDS` end before the one that would fail.
`--survivors` with the test files of its module says whether a test is missing.

Equivalent mutants stand in `mutants_explained.toml`, each with its reason, and count apart. Where
only the import of a module runs a statement, the tests that run any line of its file are met.
"""

from __future__ import annotations

import hashlib
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
import tomllib
import xml.etree.ElementTree as ElementTree
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from multiprocessing import Process
from pathlib import Path

from tests.long.mutations import Mutant, mutants_of

ROOT = Path(__file__).parents[2]
EXPLAINED = Path(__file__).with_name("mutants_explained.toml")
PLACES = (
    "obsdesign/equations", "obsdesign/verification", "obsdesign/runtime",
    "lmi/prove", "lmi/refute", "lmi/rank", "lmi/bounds", "lmi/arithmetic",
)  # fmt: skip
SECONDS, GRACE, FACTOR, LATEST = 60.0, 30.0, 1.0, 900.0
MEMORY = 8 << 30


@dataclass(frozen=True)
class Suite:
    """Which tests run which line, how many lines each runs, and how many seconds each takes."""

    tests: Mapping[str, Mapping[int, frozenset[str]]]
    lines: Mapping[str, int]
    seconds: Mapping[str, float]

    @classmethod
    def measured(cls, tree: Path) -> Suite:
        """Run the suite of a tree once, unless its data are there."""
        from coverage import CoverageData

        if not (tree / ".coverage").exists():
            packages = ("--cov=obsdesign", "--cov=lmi", "--cov-report=", "--cov-context=test")
            command = [sys.executable, "-m", "pytest", "-q", "-n", "2", "--junitxml=suite.xml"]
            subprocess.run([*command, *packages], cwd=tree, check=True)
        data = CoverageData(str(tree / ".coverage"))
        data.read()
        tests, lines = {}, Counter[str]()
        for path in sorted(data.measured_files()):
            local = str(Path(path).relative_to(tree))
            if local.startswith(PLACES):
                tests[local] = {
                    line: frozenset(name.rsplit("|", 1)[0] for name in names)
                    for line, names in data.contexts_by_lineno(path).items()
                }
                lines.update(name for names in tests[local].values() for name in names)
        seconds = {}
        for case in ElementTree.parse(tree / "suite.xml").iter("testcase"):
            file = case.attrib["classname"].replace(".", "/") + ".py"
            seconds[f"{file}::{case.attrib['name']}"] = float(case.attrib["time"])
        return cls(tests, lines, seconds)

    def against(self, mutant: Mutant) -> list[str]:
        """Tests that the mutant meets, in order; none where none runs it."""
        by_line = self.tests.get(mutant.path, {})
        names = frozenset[str]().union(*(by_line.get(k, ()) for k in mutant.statement))
        if "" in names and len(names) == 1:  # at import alone
            names = frozenset[str]().union(*by_line.values())
        order = sorted(names - {""}, key=lambda name: (self.lines[name], name))
        files = {name.split("::")[0] for name in order}
        order += sorted(
            (name for name in self.seconds if name.split("::")[0] in files and name not in names),
            key=lambda name: (self.seconds[name], name),
        )
        chosen, total = order[:1], sum(self.seconds.get(name, 1.0) for name in order[:1])
        for name in order[1:]:
            total += self.seconds.get(name, 1.0)
            if total > SECONDS:
                break
            chosen.append(name)
        return chosen


class _FirstFailure:
    """A pytest plugin: the first test that fails."""

    name = ""

    def pytest_runtest_logreport(self, report: object) -> None:
        """Keep the name of the first failure."""
        if getattr(report, "failed", False) and not self.name:
            self.name = str(getattr(report, "nodeid", ""))


def outcome(tree: Path, tests: Sequence[str], seconds: float) -> dict[str, object]:
    """Meet a tree with tests in a process of their own, which starts with the libraries loaded."""
    reader, writer = os.pipe()
    begin = time.monotonic()
    child = os.fork()
    if not child:
        os.close(reader)
        _run(tree, tests, seconds, writer)
    os.close(writer)
    late = False
    while not (done := os.wait4(child, os.WNOHANG))[0]:
        if time.monotonic() - begin > LATEST:
            os.killpg(child, signal.SIGKILL)
            late, done = True, os.wait4(child, 0)
            break
        time.sleep(0.02)
    with os.fdopen(reader) as pipe:
        by = pipe.read()
    code = os.waitstatus_to_exitcode(done[1])
    word = "late" if late else "survived" if code == 0 else "killed"
    spent = done[2].ru_utime + done[2].ru_stime
    by = by or ("processor time" if code < 0 else f"exit code {code}" if code else "")
    return {
        "outcome": word,
        "by": by,
        "cpu": round(spent, 2),
        "clock": round(time.monotonic() - begin, 2),
    }


def _run(tree: Path, tests: Sequence[str], seconds: float, writer: int) -> None:
    """Run pytest in this process, and end it."""
    import pytest

    code = 3
    try:
        os.setsid()
        os.chdir(tree)
        sys.path[0] = str(tree)
        for name in [name for name in sys.modules if name.split(".")[0] == "tests"]:
            del sys.modules[name]
        nothing = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, 1)
        os.dup2(nothing, 2)
        limit = int(GRACE + FACTOR * seconds)
        resource.setrlimit(resource.RLIMIT_CPU, (limit, limit + 5))
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        first = _FirstFailure()
        quiet = ["-x", "-q", "-p", "no:xdist", "-p", "no:cov", "-o", "addopts="]
        loaded = ["-W", "ignore::pytest.PytestAssertRewriteWarning"]
        code = int(pytest.main([*quiet, *loaded, *tests], [first]))
        os.write(writer, first.name.encode())
    finally:
        os._exit(code)


def _prepared() -> None:
    """Load what every test needs and no mutant changes."""
    sys.dont_write_bytecode = True
    os.environ.update(PYTHONDONTWRITEBYTECODE="1", OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
    names = "casadi clarabel click cvxpy flint highspy hypothesis jsonschema numpy pytest rich "
    for name in (names + "scipy.linalg scipy.optimize scipy.signal").split():
        __import__(name)


def meet(file: Path, mutants: Iterable[tuple[Mutant, Sequence[str]]], suite: Suite, k: int) -> None:
    """Meet each mutant with its tests in the k-th copy of the tree; keep the outcomes in a file."""
    folder = file.parent
    tree = folder / f"tree-{k}"
    shutil.rmtree(tree, ignore_errors=True)
    ignored = shutil.ignore_patterns(".git", ".venv", ".*_cache", ".coverage", "tree-*")
    shutil.copytree(folder / "tree", tree, ignore=ignored)
    _prepared()
    for mutant, tests in mutants:
        seconds = sum(suite.seconds.get(name, SECONDS) for name in tests)
        code = tree / mutant.path
        source, times = code.read_bytes(), code.stat()
        code.write_bytes(mutant.source)
        record = outcome(tree, tests, seconds) if tests else {"outcome": "untested"}
        code.write_bytes(source)
        os.utime(code, ns=(times.st_atime_ns, times.st_mtime_ns))  # its bytecode stays good
        entry = {"key": mutant.key, "line": mutant.statement.start, "tests": len(tests), **record}
        with file.open("a") as outcomes:
            outcomes.write(json.dumps(entry) + "\n")
        if record["outcome"] != "killed":
            words = f"{mutant.path}:{mutant.statement.start}: {mutant.was}  ->  {mutant.now}"
            print(record["outcome"], words, flush=True)


def _every(folder: Path) -> list[Mutant]:
    """All mutants of the tree, in the order of their hashes."""
    tree = folder / "tree"
    paths = [path for place in PLACES for path in (tree / place).rglob("*.py")]
    every = [
        mutant
        for path in paths
        for mutant in mutants_of(str(path.relative_to(tree)), path.read_bytes())
    ]
    return sorted(every, key=lambda mutant: hashlib.sha256(mutant.key.encode()).digest())


def _outcomes(folder: Path) -> dict[str, dict[str, object]]:
    """Key of a mutant -> its last outcome."""
    file = folder / "outcomes.jsonl"
    entries = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    return {entry["key"]: entry for entry in entries if entry["outcome"] != "late"}


def _explained() -> set[tuple[str, str, str, str]]:
    entries = tomllib.loads(EXPLAINED.read_text())["mutant"]
    return {(one["file"], one["function"], one["was"], one["now"]) for one in entries}


def report(folder: Path, chosen: Iterable[Mutant]) -> None:
    """Print the outcomes of the sample per place."""
    outcomes, explained = _outcomes(folder), _explained()
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    chosen = list(chosen)
    for gone in sorted(explained - {mutant.expression for mutant in chosen}):
        print(f"explained, and no mutant any more: {gone[0]} {gone[1]}")
    for mutant in chosen:
        if not (entry := outcomes.get(mutant.key)):
            continue
        word = str(entry["outcome"])
        if word != "killed" and mutant.expression in explained:
            word = "explained"
        place = next(place for place in PLACES if mutant.path.startswith(place))
        for name in (place, "all"):
            counts[name][word] += 1
        if word in ("survived", "untested"):
            print(f"{word} {mutant.path}:{mutant.statement.start} {mutant.function}")
            print(f"    {mutant.was}\n    {mutant.now}")
    for name in (*PLACES, "all"):
        words, total = counts[name], counts[name].total()
        share = (words["killed"] + words["explained"]) / max(total, 1)
        print(f"{name:24} {total:4} sampled: {dict(words)}, {100 * share:.1f} %")


def main(folder: Path, *options: str) -> None:
    """Sample mutants, meet them with the tests, print what survives."""
    if not (folder / "tree").exists():
        ignored = shutil.ignore_patterns(".git", ".venv", "__pycache__", ".*_cache")
        shutil.copytree(ROOT, folder / "tree", ignore=ignored)
    suite, every = Suite.measured(folder / "tree"), _every(folder)
    words = [option for option in options if option.startswith("--")]
    numbers = [int(option) for option in options if option.isdigit()]
    done = _outcomes(folder)
    jobs = numbers[1] if len(numbers) > 1 else 2
    count, file = numbers[0] if numbers else 600, folder / "outcomes.jsonl"
    if "--report" in words:
        report(folder, every)
        return
    if "--survivors" in words:
        tests = [option for option in options if not option.startswith("--")]
        shutil.copytree(ROOT / "tests", folder / "tree" / "tests", dirs_exist_ok=True)
        pairs = [
            (m, tests)
            for m in every
            if done.get(m.key, {}).get("outcome") in ("survived", "untested")
        ]
        jobs = 1
    elif "--control" in words:
        file, sources = folder / "control.jsonl", folder / "tree"
        same = [replace(m, source=(sources / m.path).read_bytes()) for m in every[:count]]
        pairs = [(m, suite.against(m)) for m in same]
    else:
        pairs = [(m, suite.against(m)) for m in every[:count] if m.key not in done]
    print(f"{len(every)} mutants, {len(pairs)} to meet", flush=True)
    workers = [Process(target=meet, args=(file, pairs[k::jobs], suite, k)) for k in range(jobs)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    report(folder, every)


if __name__ == "__main__":
    main(Path(sys.argv[1]).absolute(), *sys.argv[2:])
