"""The same problem gives the same design, byte by byte, whatever differs between two runs."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

import obsdesign
from obsdesign.design_file import from_dict
from obsdesign.document import digest
from tests.cli.test_commands import ROOT

# every kind, and a search for gains, for a form and for windows among them
EXAMPLES = (
    "degue_4_1", "degue_4_1_narrowest", "medina_spline", "mazenc_4", "mattsson_medvedev", "ahn_1",
    "sampled_data",
)  # fmt: skip
DESIGNS = """
import sys, time, obsdesign
slow = float(sys.argv[1])
clock = time.process_time
time.process_time = lambda: slow * clock()  # a machine that is so many times as slow
for name in sys.argv[2:]:
    obsdesign.design(obsdesign.load_problem(name)).save(name.rpartition("/")[2] + ".json")
"""


def test_two_processes_write_the_same_bytes(tmp_path: Path) -> None:
    files = []
    paths = [str(ROOT / "examples" / f"{name}.toml") for name in EXAMPLES]
    for seed, slow in (("0", "1"), ("1", "10")):
        folder = tmp_path / seed
        folder.mkdir()
        environment = os.environ | {"PYTHONHASHSEED": seed, "PYTHONPATH": str(ROOT)}
        run = [sys.executable, "-c", DESIGNS, slow, *paths]
        subprocess.run(run, cwd=folder, env=environment, check=True)
        files.append({path.name: path.read_bytes() for path in sorted(folder.iterdir())})
    assert len(files[0]) == len(EXAMPLES)
    assert files[0] == files[1]


@pytest.mark.parametrize("seconds", [None, 1000.0])
def test_a_slow_machine_comes_to_the_same_gains(
    seconds: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Searches end by their iterations and evaluations, as long as no total ends them."""
    body: dict[str, Any] = {
        "flow": {"A": [[0, 0.15], [-0.15, 0]]},
        "output": {"C": [[0.3, 0.0]], "measured": "periodic", "period": 0.05},
        "observer": {"kind": "finite_time", "method": "exact", "objective": "least_noise"},
    }
    clock, texts = time.process_time, []
    for slow in (1.0, 10.0):
        monkeypatch.setattr(time, "process_time", lambda slow=slow: slow * clock())
        outcome = obsdesign.investigate(obsdesign.Problem.from_dict(body), seconds=seconds)
        assert outcome.design is not None
        texts.append((outcome.design.to_dict(), outcome.result.get("remarks")))
    assert texts[0] == texts[1]


def older(body: dict[str, Any], provenance: dict[str, Any]) -> dict[str, Any]:
    changed = body | {"provenance": body["provenance"] | provenance}
    return changed | {"digest": digest(changed)}


@pytest.mark.parametrize("provenance", [{"seconds": 0.25}, {"date": "2025-01-01"}])
def test_older_files_still_verify(academic_design: Path, provenance: dict[str, Any]) -> None:
    """They say how long their search took; nobody is told otherwise of it."""
    body = json.loads(academic_design.read_text("utf-8"))
    assert set(body["provenance"]) == {"versions", "solver", "options"}
    outcome = obsdesign.verify(from_dict(older(body, provenance)))
    assert outcome.verdict == "proved"
    assert any(entry.given for entry in outcome.guarantees)


def test_seconds_are_printed_instead(academic_design: Path) -> None:
    outcome = obsdesign.investigate(obsdesign.load_problem(ROOT / "examples" / "degue_4_1.toml"))
    assert outcome.result["seconds"] > 0
    assert "seconds" not in json.loads(academic_design.read_text("utf-8"))["provenance"]
