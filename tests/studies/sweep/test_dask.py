"""Sweeps on a Dask cluster: two workers, one of them killed in the middle."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from obsdesign import InputError
from obsdesign.studies.sweep.point import SweepPoint, evaluate
from obsdesign.studies.sweep.record import read_sweep
from obsdesign.studies.sweep.run import run_sweep
from tests.studies.sweep.test_sweep import ACADEMIC, DIED, dies, plan
from tests.systems.command_line import command

dask = pytest.importorskip("dask", reason="the extra `dask` is not installed")
distributed = pytest.importorskip("distributed", reason="the extra `dask` is not installed")
# connections that a killed worker leaves behind are closed by the garbage collector
pytestmark = pytest.mark.filterwarnings("default")


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=":0"
    ) as running:
        yield running


def test_a_killed_worker_loses_nothing(cluster: Any, tmp_path: Path) -> None:
    sweep_plan = plan("jump.dwell_time[1]=0.1:1:12", "jump.G[0][0]=0.2:0.6:2")
    expected = [evaluate(sweep_plan, index) for index in range(len(sweep_plan))]
    killed: list[int] = []

    def kill_one(done: int, total: int) -> None:
        if done >= 3 and not killed:
            killed.append(cluster.workers[0].pid)
            os.kill(killed[0], signal.SIGKILL)

    path = tmp_path / "s.jsonl"
    address = cluster.scheduler_address
    assert run_sweep(sweep_plan, str(path), scheduler=address, progress=kill_one) == expected
    assert killed
    here = tmp_path / "here.jsonl"
    run_sweep(sweep_plan, str(here), jobs=1)
    assert path.read_bytes() == here.read_bytes()


def test_from_the_command_line(cluster: Any, tmp_path: Path) -> None:
    arguments = ("sweep", ACADEMIC, "--over", "jump.dwell_time[0]=0.6:0.8:3")
    address = ("--scheduler", cluster.scheduler_address)
    done = command(*arguments, *address, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "written: sweep.jsonl, 3 points: 2 proved, 1 refuted\n"
    both = command(*arguments, *address, "--jobs", 2, "-o", "b.jsonl", cwd=tmp_path)
    assert (both.returncode, both.stdout) == (2, "")
    assert both.stderr == (
        "obsdesign: --jobs is for processes here, --scheduler has its own; give one.\n"
    )
    assert not (tmp_path / "b.jsonl").exists()


def test_a_point_that_kills_workers_is_told(tmp_path: Path, monkeypatch: Any) -> None:
    sweep_plan = plan("jump.dwell_time[1]=0.1:1:4", name="no/such/folder/flag")
    expected = [evaluate(sweep_plan, index) for index in range(len(sweep_plan))]
    expected[1] = SweepPoint(1, (0.4,), error=DIED)
    monkeypatch.setattr("obsdesign.studies.sweep.workers.evaluate", dies)
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=":0") as few,
    ):
        address = few.scheduler_address
        assert run_sweep(sweep_plan, str(tmp_path / "s.jsonl"), scheduler=address) == expected


CLUSTER = """
import sys, distributed
with distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=False,
                              protocol="tcp", dashboard_address=None) as running:
    print(running.scheduler_address, flush=True)
    sys.stdin.read()
"""


def test_a_scheduler_that_dies_is_one_line(tmp_path: Path) -> None:
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    quiet = pipes | {"stderr": subprocess.DEVNULL}
    path = tmp_path / "sweep.jsonl"
    with subprocess.Popen([sys.executable, "-c", CLUSTER], text=True, **quiet) as cluster:
        address = cluster.stdout.readline().strip()
        arguments = ("sweep", ACADEMIC, "--over", "jump.dwell_time[0]=0.6:1.4:60", "--scheduler")
        code = "from obsdesign.cli.main import main; main()"
        run = subprocess.Popen([sys.executable, "-c", code, *map(str, arguments), address],
                               cwd=tmp_path, text=True, **pipes)  # fmt: skip
        while not path.exists() or path.read_bytes().count(b"\n") < 4:
            assert run.poll() is None, run.stderr.read()
        cluster.kill()
        out, err = run.communicate(timeout=60)
    assert (run.returncode, out) == (2, "")
    assert err == (
        f"obsdesign: --scheduler {address}: the cluster is gone. Finished points are kept; the "
        "same command goes on from there.\n"
    )
    assert len(read_sweep(str(path)).points) >= 3


def test_nobody_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("obsdesign.studies.sweep.workers._ANSWER_SECONDS", 1)
    for address in ("tcp://127.0.0.1:9", "nonsense", "nonsense://x:1", "inproc://x"):
        with pytest.raises(InputError, match="no Dask scheduler answers there"):
            run_sweep(plan("jump.dwell_time[1]=0.1:1:2"), str(tmp_path / "s.jsonl"),
                      scheduler=address)  # fmt: skip
    assert not list(tmp_path.iterdir())


def test_without_dask(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError) as error:
        run_sweep(plan("jump.dwell_time[1]=0.1:1:2"), str(tmp_path / "s.jsonl"), scheduler="x")
    assert str(error.value) == (
        "--scheduler requires the extra `dask`; it is missing: pip install 'obsdesign[dask]'."
    )
    assert not list(tmp_path.iterdir())
