"""Change the source of the checkers, one expression at a time: a test of theirs must fail.

python -m tests.long.checker_source PROGRAM [FUNCTION...]   check_design, check_widths, check_events, check_sets

The tests of the program are collected and run once, with their lines; then a process of its own
for each mutant runs those that run its lines, the quickest first, up to the first that fails, or
until `SECONDS` are full. Tests that start the program as a process start the mutant, and are run for
functions that write sentences alone. Functions that a program before it in the list has word for
word are met there. Who survives is printed unless `checker_explained.toml` says why no test can see
it; the run fails if any are printed, and names what is explained there and does not survive.
"""

from __future__ import annotations

import ast
import gc
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

from tests.long.checker_mutations import changes
from tests.long.mutations import Mutant, mutants_of
from tests.systems.checked import FOLDER

EXPLAINED = Path(__file__).with_name("checker_explained.toml")
TESTS = {
    "check_design": (
        "test_steps.py",
        "test_balls.py",
        "test_forms.py",
        "test_sentences.py",
        "test_traps.py",
        "test_check_design.py",
        "test_scope.py",
    ),
    "check_widths": (
        "test_width_steps.py",
        "test_forms.py",
        "test_sentences.py",
        "test_traps.py",
        "test_check_widths.py",
    ),
    "check_events": ("test_event_steps.py", "test_traps.py", "test_check_events.py"),
    "check_sets": ("test_check_sets.py",),
}
# functions whose words only the output of the program shows
SPEAKING = ("main", "prove_design", "prove_rates", "prove_width", "listed")
SECONDS = 4.0  # of tests for a mutant
LONGEST, FACTOR = 2.0, 10.0  # processor seconds of a test, beside what it takes without a change
MEMORY = 4 << 30


def sites(name: str) -> list[Mutant]:
    """The mutants of a program, but for functions that an earlier program has word for word."""
    known = set[str]()
    for earlier in [*TESTS][: [*TESTS].index(name)]:
        known |= _definitions(earlier)
    own = _definitions(name)
    new = {text.split("(")[0].split(":")[0].split()[-1] for text in own - known}
    path = FOLDER / f"{name}.py"
    mutants = mutants_of(path.name, path.read_bytes(), changes)
    differ = {"\n".join((*m.expression, m.source.decode())): m for m in mutants}.values()
    return [m for m in differ if m.function.split(".")[0] in new]


def _definitions(name: str) -> set[str]:
    """Sources of the functions and classes of a program."""
    tree = ast.parse((FOLDER / f"{name}.py").read_text("utf-8"))
    kinds = ast.FunctionDef | ast.ClassDef
    return {ast.unparse(node) for node in tree.body if isinstance(node, kinds)}


class Meeting:
    """A pytest plugin: runs the tests once, then the mutants against them."""

    def __init__(self, name: str, mutants: Sequence[Mutant]) -> None:
        self.path, self.mutants = str(FOLDER / f"{name}.py"), mutants
        self.module = import_module(f"obsdesign.checker.{name}")
        self.lines: dict[str, set[int]] = defaultdict(set)
        self.seconds: dict[str, float] = {}
        self.starts: set[str] = set()
        self.failed = False
        self.survivors: list[Mutant] = []

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Keep whether a test has failed."""
        self.failed |= report.failed

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Run each test without a change, then what a mutant meets."""
        for item in session.items:
            self._learn(item)
        assert not self.failed, "the tests fail without a change"
        order = sorted(session.items, key=lambda x: (x.nodeid in self.starts, self._time(x)))
        tally: Counter[str] = Counter()
        gc.freeze()
        same = replace(self.mutants[0], source=Path(self.path).read_bytes())
        assert _in_a_process(lambda: self._meet(same, order)) == "survived"  # no change at all
        for mutant in self.mutants:
            items = self._against(mutant, order)
            word = _in_a_process(lambda m=mutant, own=items: self._meet(m, own))
            tally[word] += 1
            if word == "survived":
                self.survivors.append(mutant)
                print(
                    f"\n{mutant.statement.start} {mutant.function}: {len(items)} tests", flush=True
                )
                print(f"    {mutant.was}\n    {mutant.now}", flush=True)
        print(f"\n{len(self.mutants)} mutants: {dict(tally)}", flush=True)
        return True

    def _against(self, mutant: Mutant, order: Sequence[pytest.Item]) -> list[pytest.Item]:
        """Tests for a mutant, in this order."""
        lines, speaks = set(mutant.statement), mutant.function in SPEAKING
        chosen, total = [], 0.0
        for item in order:
            begins = item.nodeid in self.starts
            if speaks if begins else lines & self.lines[item.nodeid]:
                total += 0.0 if begins else self._time(item)
                if total > SECONDS and chosen:
                    break
                chosen.append(item)
        return chosen

    def _time(self, item: pytest.Item) -> float:
        return self.seconds[item.nodeid]

    def _learn(self, item: pytest.Item) -> None:
        """Run a test; keep the lines of the program that it runs, and whether it starts it."""
        lines, run = self.lines[item.nodeid], subprocess.run

        def local(frame: FrameType, event: str, argument: object) -> Any:
            lines.add(frame.f_lineno)
            return local

        def trace(frame: FrameType, event: str, argument: object) -> Any:
            return local if frame.f_code.co_filename == self.path else None

        def noted(command: Any, *words: Any, **options: Any) -> Any:
            if self.path in map(str, command):
                self.starts.add(item.nodeid)
            return run(command, *words, **options)

        subprocess.run = noted  # type: ignore[assignment]
        begin = time.process_time()
        sys.settrace(trace)
        item.ihook.pytest_runtest_protocol(item=item, nextitem=None)
        sys.settrace(None)
        self.seconds[item.nodeid] = time.process_time() - begin
        subprocess.run = run

    def _meet(self, mutant: Mutant, items: Sequence[pytest.Item]) -> None:
        """Run tests with the mutant in place of the program, up to the first that fails."""
        run, self.failed = subprocess.run, False
        with tempfile.NamedTemporaryFile(suffix=".py") as file:
            file.write(mutant.source)
            file.flush()

            def other(command: Any, *words: Any, **options: Any) -> Any:
                new = [file.name if str(word) == self.path else word for word in command]
                return run(new, *words, **options)

            subprocess.run = other  # type: ignore[assignment]
            exec(compile(mutant.source, self.path, "exec"), self.module.__dict__)
            for item in items:
                limit = LONGEST + FACTOR * self._time(item)
                signal.setitimer(signal.ITIMER_PROF, limit)
                item.ihook.pytest_runtest_protocol(item=item, nextitem=None)
                if self.failed:
                    raise AssertionError(item.nodeid)


def _in_a_process(work: Callable[[], None]) -> str:
    """Do it in a copy of this process, which ends: "survived", or "killed" where it failed."""
    child = os.fork()
    if not child:
        code = 1
        try:
            nothing = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nothing, 1)
            os.dup2(nothing, 2)
            resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
            work()
            code = 0
        finally:
            os._exit(code)
    return "killed" if os.waitpid(child, 0)[1] else "survived"


def explained(name: str) -> set[tuple[str, str]]:
    """(function, changed line) of mutants that no test can see."""
    entries = tomllib.loads(EXPLAINED.read_text("utf-8"))["line"]
    return {
        (entry["function"], now)
        for entry in entries
        if entry["program"] == name
        for now in entry["now"]
    }


def main(name: str, *functions: str) -> int:
    """Meet the mutants of a program, or of some of its functions; 1 if some are unexplained."""
    known = explained(name)
    mutants = [m for m in sites(name) if not functions or m.function in functions]
    meeting = Meeting(name, mutants)
    tests = [str(FOLDER.parents[1] / "tests" / "checker" / file) for file in TESTS[name]]
    code = pytest.main(["-s", "-p", "no:xdist", "-p", "no:terminal", *tests], [meeting])
    survivors = {(m.function, m.now) for m in meeting.survivors}
    for function, now in sorted(survivors - known):
        print(f"not explained: {function}\n    {now}")
    met = {m.function for m in mutants}
    for function, now in sorted(known - survivors):
        if function in met:
            print(f"explained, and no survivor: {function}\n    {now}")
    return int(bool(survivors - known) or code != 0)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
