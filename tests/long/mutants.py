"""Change one operator or number of the code at a time: the tests that run that line must fail.

python -m tests.long.mutants [COUNT] [SEED] [JOBS]      600 mutants, seed 0, two at once

Prints the survivors and their share. Needs `pip install coverage pytest-cov`. The suite runs once
to learn which tests run which line; a mutant meets those tests alone, the most specific first.
Lines that run at import are left out: no test is known to run them.
"""

from __future__ import annotations

import ast
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PLACES = ("obsdesign/equations", "obsdesign/verification", "obsdesign/runtime", "lmi/prove")
SECONDS = 300  # a mutant that takes longer is killed: it runs for ever
_TURNED = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
    ast.Lt: ast.GtE, ast.GtE: ast.Lt, ast.Gt: ast.LtE, ast.LtE: ast.Gt,
    ast.Eq: ast.NotEq, ast.NotEq: ast.Eq, ast.And: ast.Or, ast.Or: ast.And,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip


@dataclass(frozen=True)
class Mutant:
    """One expression of a file and what stands in its place; offsets count bytes."""

    path: str
    line: int
    start: int
    end: int
    before: str
    after: str

    def applied(self, source: bytes) -> bytes:
        """The file with the mutant."""
        return source[: self.start] + self.after.encode() + source[self.end :]


def mutants_of(path: str, source: bytes) -> Iterator[Mutant]:
    """Every mutant of one file inside of its functions."""
    starts = [0]
    for text in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(text))
    functions = [n for n in ast.walk(ast.parse(source)) if isinstance(n, ast.FunctionDef)]
    nodes = {id(node): node for body in functions for part in body.body for node in ast.walk(part)}
    for node in nodes.values():
        if isinstance(node, ast.expr) and node.end_lineno and (changed := _mutated(node)):
            assert node.end_col_offset is not None
            start = starts[node.lineno - 1] + node.col_offset
            end = starts[node.end_lineno - 1] + node.end_col_offset
            before = source[start:end].decode()
            yield Mutant(path, node.lineno, start, end, before, f"({changed})")


def _mutated(node: ast.expr) -> str:
    """The source of the node with its operator turned or its number changed; "" if it has none."""
    match node:
        case ast.BinOp(left, op, right) if type(op) in _TURNED:
            return ast.unparse(ast.BinOp(left, _TURNED[type(op)](), right))
        case ast.Compare(left, [op], [right]) if type(op) in _TURNED:
            return ast.unparse(ast.Compare(left, [_TURNED[type(op)]()], [right]))
        case ast.BoolOp(op, values):
            return ast.unparse(ast.BoolOp(_TURNED[type(op)](), values))
        case ast.UnaryOp(ast.Not() | ast.USub(), operand):
            return ast.unparse(operand)
        case ast.Constant(bool(value)):
            return str(not value)
        case ast.Constant(int(value) | float(value)):
            return str(value + 1) if isinstance(value, int) else str(5.0 * value or 1.0)
    return ""


def covering_tests(folder: Path) -> Mapping[tuple[str, int], list[str]]:
    """(file, line) -> the tests that run it, those that run fewest lines first."""
    from coverage import CoverageData

    packages = ("--cov=obsdesign", "--cov=lmi", "--cov-report=", "--cov-context=test")
    _pytest(folder, [*packages, "-n", "2", "-q", "-p", "no:cacheprovider"], None)
    data = CoverageData(str(folder / ".coverage"))
    data.read()
    tests: dict[tuple[str, int], list[str]] = {}
    lines_of: dict[str, int] = {}
    for name in data.measured_files():
        for line, contexts in data.contexts_by_lineno(name).items():
            called = sorted({one.rsplit("|", 1)[0] for one in contexts if one})
            tests[str(Path(name).relative_to(folder)), line] = called
            for test in called:
                lines_of[test] = lines_of.get(test, 0) + 1
    return {key: sorted(names, key=lines_of.__getitem__) for key, names in tests.items()}


def _pytest(folder: Path, arguments: list[str], seconds: float | None) -> int:
    command = [sys.executable, "-m", "pytest", *arguments]
    try:
        done = subprocess.run(
            command, cwd=folder, timeout=seconds, capture_output=True, check=False
        )
    except subprocess.TimeoutExpired:
        return 1
    return done.returncode


def survives(mutant: Mutant, tests: list[str], folder: Path) -> bool:
    """Do all tests that run its line pass with the mutant?"""
    file = folder / mutant.path
    source = file.read_bytes()
    file.write_bytes(mutant.applied(source))
    try:
        for some in (tests[:10], tests[10:]):
            quiet = ["-x", "-q", "-n", "0", "-p", "no:cacheprovider"]
            if some and _pytest(folder, [*quiet, *some], SECONDS):
                return False
    finally:
        file.write_bytes(source)
    return True


def _copy(folder: Path) -> Path:
    ignored = shutil.ignore_patterns(".git", ".venv", "__pycache__", ".*_cache")
    shutil.copytree(ROOT, folder, ignore=ignored)
    return folder


def main(count: int = 600, seed: int = 0, jobs: int = 2) -> None:
    """Sample mutants, run their tests, print the survivors."""
    with tempfile.TemporaryDirectory() as scratch:
        folders = [_copy(Path(scratch) / str(k)) for k in range(jobs)]
        tests = covering_tests(folders[0])
        files = [path for place in PLACES for path in sorted((ROOT / place).rglob("*.py"))]
        every = [
            mutant
            for path in files
            for mutant in mutants_of(str(path.relative_to(ROOT)), path.read_bytes())
            if tests.get((str(path.relative_to(ROOT)), mutant.line))
        ]
        chosen = random.Random(seed).sample(every, min(count, len(every)))
        print(f"{len(every)} mutants of {len(files)} files, {len(chosen)} sampled", flush=True)

        def run(k: int) -> list[Mutant]:
            survivors = []
            for mutant in chosen[k::jobs]:
                if survives(mutant, tests[mutant.path, mutant.line], folders[k]):
                    survivors.append(mutant)
                    print(f"{mutant.path}:{mutant.line}: {mutant.before!r} -> {mutant.after!r}",
                          flush=True)  # fmt: skip
            return survivors

        with ThreadPoolExecutor(jobs) as pool:
            alive = sum(map(len, pool.map(run, range(jobs))))
    print(f"{len(chosen) - alive} of {len(chosen)} killed, {alive} survive")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
