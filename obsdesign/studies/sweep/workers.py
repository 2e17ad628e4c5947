"""Who works on the points of a sweep: this process, joblib's processes, or a Dask cluster.

All three call `obsdesign.studies.sweep.point.evaluate` and yield its lines in the order they are
ready. A worker that dies takes no finished point with it, and its own point is tried again.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError, as_completed
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from obsdesign.errors import InputError
from obsdesign.output_files import unwinding_signals
from obsdesign.studies.sweep.point import Plan, evaluate

Row = dict[str, Any]

# starting processes, each with its imports, takes about as long: shorter sweeps stay here
_SERIAL_SECONDS = 3.0
_ANSWER_SECONDS = 10
_DIED = "the process that worked on this point died more than once; was it out of memory?"


def evaluate_all(
    plan: Plan, points: Sequence[int], jobs: int | None = None, scheduler: str | None = None
) -> Iterator[Row]:
    """Lines of these points. jobs: processes; None for as many as there are cores, if it pays.

    scheduler: address of a Dask scheduler that is used instead. InputError when it cannot be.
    """
    left = list(points)
    if scheduler is not None:
        if jobs is not None:
            raise InputError("--jobs is for processes here, --scheduler has its own; give one.")
        yield from _on_cluster(plan, left, scheduler)
        return
    if jobs is None:
        until = time.monotonic() + _SERIAL_SECONDS
        while left and time.monotonic() < until:
            yield evaluate(plan, left.pop(0))
        if len(left) > 1:
            from joblib import cpu_count

            jobs = cpu_count()
    if jobs is None or jobs == 1:
        yield from (evaluate(plan, index) for index in left)
    else:
        yield from _on_processes(plan, left, jobs)


def _on_processes(plan: Plan, points: Sequence[int], jobs: int) -> Iterator[Row]:
    """A pool that breaks names no point: the next one then runs alone, and is to blame or not."""
    from joblib import Parallel, delayed, parallel_config
    from joblib.externals.loky import get_reusable_executor

    left, alone = dict.fromkeys(points), False
    while left:
        batch = list(left)[:1] if alone else list(left)
        with parallel_config(backend="loky", inner_max_num_threads=1):
            pool = Parallel(n_jobs=jobs, batch_size=1, return_as="generator_unordered")
        try:
            with unwinding_signals():
                for row in pool(delayed(evaluate)(plan, index) for index in batch):
                    del left[row["point"]]
                    yield row
            alone = False
        except SystemExit:  # of a signal: processes that go on would hold our output open
            get_reusable_executor().shutdown(wait=False, kill_workers=True)
            raise
        except BrokenProcessPool:
            if alone:
                del left[batch[0]]
                yield _lost(plan, batch[0])
            alone = not alone


def _on_cluster(plan: Plan, points: Sequence[int], address: str) -> Iterator[Row]:
    """The scheduler gives the point of a dead worker to another, up to its `allowed-failures`."""
    try:
        from distributed import Client, KilledWorker
        from distributed.comm.addressing import parse_address, parse_host_port
        from distributed.comm.registry import get_backend
    except ImportError:
        raise InputError(
            "--scheduler requires the extra `dask`; it is missing: pip install 'obsdesign[dask]'."
        ) from None
    try:
        # a client that fails while it is made hangs when it is collected: look at the address first
        scheme, location = parse_address(address)
        get_backend(scheme)
        if scheme == "inproc":
            raise ValueError("another process cannot be reached by inproc")
        parse_host_port(location)
        client = Client(address, timeout=_ANSWER_SECONDS, set_as_default=False)
    except (OSError, ValueError, ImportError) as error:
        text = " ".join(str(error).split()) or type(error).__name__
        raise InputError(
            f"--scheduler {address}: no Dask scheduler answers there: {text}"
        ) from None
    with client:
        executor, accused = client.get_executor(pure=False), []
        futures = {executor.submit(evaluate, plan, index): index for index in points}
        try:
            for future in as_completed(futures):
                try:
                    yield future.result()
                except KilledWorker:  # the points beside the culprit are blamed with it
                    accused.append(futures[future])
            for index in accused:
                try:
                    yield executor.submit(evaluate, plan, index).result()
                except KilledWorker:
                    yield _lost(plan, index)
        except (CancelledError, OSError):
            raise InputError(
                f"--scheduler {address}: the cluster is gone. Finished points are kept; the same "
                "command goes on from there."
            ) from None


def _lost(plan: Plan, index: int) -> Row:
    return {"point": index, "at": plan.at(index), "error": _DIED}
