"""Random problems, designs and data files through the command line: `python -m tests.long.fuzz`.

Every batch of cases runs in a process of its own with limits of processor time and memory; a case
that reaches them is reported like any other fault. Exit code 1 if there is a fault.
"""

from __future__ import annotations

import argparse
import multiprocessing
import resource
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tests.fuzz.cases import ALL, CASES, SMALL, data_text, design_text
from tests.fuzz.harness import SECONDS, Case, judged, shape
from tests.fuzz.plants import SHIPPED

_MEMORY = 2**30
# address space that the libraries take beside what they use
_ADDRESSES = 6 * 2**30
_BATCH = 500


def case_of(sort: str, seed: int) -> Case:
    """The case with this number."""
    names = SMALL if seed % 5 else tuple(SHIPPED)
    return CASES[sort](np.random.default_rng([seed, sorted(CASES).index(sort)]), names)


def _batch(sort: str, seeds: range, pipe: Any) -> None:
    """Send (seed, exit code, faults) of each case; the seed first, so that a crash has a name."""
    resource.setrlimit(resource.RLIMIT_AS, (_ADDRESSES, _ADDRESSES))
    signal.signal(signal.SIGPROF, signal.SIG_DFL)  # ends the process, inside compiled code too
    with tempfile.TemporaryDirectory() as folder:
        for seed in seeds:
            pipe.send((seed, 0, None))
            signal.setitimer(signal.ITIMER_PROF, 1.5 * SECONDS)
            case = case_of(sort, seed)
            try:
                code, complaints = judged(case, Path(folder))
            except BaseException as error:  # what main() lets through
                code, complaints = -1, [f"escaped: {type(error).__name__}: {error}"]
                for path in Path(folder).iterdir():
                    path.unlink()
            signal.setitimer(signal.ITIMER_PROF, 0)
            used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
            if used > _MEMORY:
                complaints.append("more than 1 GB of memory")
            pipe.send((seed, code, complaints))
            if used > _MEMORY:
                break
    pipe.send(None)


def batches(sort: str, seeds: range, report: Callable[[int, int, list[str]], None]) -> None:
    """Run all cases of a sort; a process that dies is replaced, and its case is a fault."""
    following = seeds.start
    while following < seeds.stop:
        here, there = multiprocessing.Pipe(duplex=False)
        last = min(following + _BATCH, seeds.stop)
        process = multiprocessing.get_context("fork").Process(
            target=_batch, args=(sort, range(following, last), there)
        )
        process.start()
        there.close()
        try:
            while (message := here.recv()) is not None:
                seed, code, faults = message
                if faults is not None:
                    report(seed, code, faults)
                    following = seed + 1
                else:
                    following = seed
        except EOFError:
            process.join()
            report(
                following,
                -1,
                [f"the process ended with {process.exitcode}: time, memory or a crash"],
            )
            following += 1
        process.join()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=9000, help="of each sort")
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--sort", choices=sorted(CASES), action="append")
    options = parser.parse_args()
    for name in ALL:  # before the processes are made
        design_text(name)
        data_text(name)
    total, wrong, kinds = 0, 0, Counter[str]()
    for sort in options.sort or sorted(CASES):
        counts: Counter[str] = Counter()

        def report(
            seed: int, code: int, complaints: list[str], sort: str = sort, counts: Any = counts
        ) -> None:
            counts.update({"cases": 1, "faulty": bool(complaints), f"exit {code}": 1})
            for fault in complaints:
                name = f"{sort}: {shape(fault)}"
                kinds[name] += 1
                if kinds[name] <= 3:
                    print(f"{sort} {seed}: {case_of(sort, seed).name}: {fault}", flush=True)

        batches(sort, range(options.first, options.first + options.cases), report)
        codes = ", ".join(
            f"{counts[key]} {key}" for key in sorted(counts) if key.startswith("exit")
        )
        print(
            f"{sort}: {counts['cases']} cases, {counts['faulty']} with faults; {codes}", flush=True
        )
        total, wrong = total + counts["cases"], wrong + counts["faulty"]
    for name, number in kinds.most_common():
        print(f"{number:6d}  {name}")
    print(f"{total} cases, {wrong} with faults")
    sys.exit(wrong > 0)


if __name__ == "__main__":
    main()
