"""The programs of `obsdesign/checker`, run on a design as whoever signs it runs them.

They share nothing with the code here but the design file (docs/proofs.md).
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from lmi.verdict import proved, undecided
from obsdesign.document import Claim, Design

PROGRAMS = tuple(
    Path(__file__).parents[1] / "checker" / name
    for name in (
        "check_design.py", "check_widths.py", "check_gains.py", "check_uncertain.py",
        "check_events.py", "check_sets.py",
    )
)  # fmt: skip
_STABILITY = ("dwell_stability", "decay_rate", "hurwitz")


@dataclass(frozen=True)
class Answer:
    """What a program says of a design: its exit code (0 proved, 1 not, 2 not read), its lines."""

    program: Path
    code: int
    lines: tuple[str, ...]


def answers(design: Design) -> tuple[Answer, ...]:
    """Answers of all programs, each run without site packages and without the environment."""
    text = json.dumps(design.to_dict(), allow_nan=False)
    result = []
    for program in PROGRAMS:
        command = [sys.executable, "-I", "-S", str(program), "-"]
        run = subprocess.run(
            command, input=text, capture_output=True, text=True, encoding="utf-8", check=False
        )
        result.append(Answer(program, run.returncode, tuple(run.stdout.splitlines())))
    return tuple(result)


def checker_claims(design: Design) -> tuple[Claim, ...]:
    """The claim that the programs which read the design prove their part; none if none reads it.

    Nor is there one about a design of an earlier release, without the tails that they need.
    """
    if _lacks_tails(design):
        return ()
    opinions = [opinion for opinion in answers(design) if opinion.code != 2]
    return (_claim(opinions),) if opinions else ()


def _claim(opinions: Sequence[Answer]) -> Claim:
    lines = [line for opinion in opinions for line in opinion.lines]
    failed = next((opinion for opinion in opinions if opinion.code != 0), None)
    verdict = proved(answers=lines)
    if failed is not None:
        reason = " ".join(failed.lines) or f"it ended with exit code {failed.code}"
        verdict = undecided(f"{failed.program.name} does not confirm it: {reason}")
    return Claim.from_verdict(
        "checker",
        "what the evidence lists is proved again by programs that share no code with obsdesign",
        "obsdesign/checker",
        verdict,
    )


def _lacks_tails(design: Design) -> bool:
    """Does a proof for all late times stand in the design without matrices that fall?"""
    stated = {claim.id: claim.evidence for claim in design.claims if claim.id in _STABILITY}
    if design.kind == "luenberger" and "dwell_stability" not in stated:
        return any("tails" not in evidence for evidence in stated.values())
    ends = design.problem.get("jump", {}).get("dwell_time", [0.0, 0.0])
    by_matrix = [e for e in stated.values() if {"P", "windows", "P_cells"} & set(e)]
    return ends[1] == "inf" and any("tails" not in evidence for evidence in by_matrix)
