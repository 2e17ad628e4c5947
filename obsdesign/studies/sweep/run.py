"""The story of a sweep: plan, what the file holds already, the points that are left."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

from obsdesign.studies.sweep.point import Plan
from obsdesign.studies.sweep.record import Record
from obsdesign.studies.sweep.workers import evaluate_all


def run_sweep(
    plan: Plan,
    path: str,
    *,
    jobs: int | None = None,
    scheduler: str | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> list[Mapping[str, Any]]:
    """Lines of all points, in order; `path` holds them, and what it held already is not redone.

    jobs, scheduler: as in `evaluate_all`. progress: called with the points that are finished, and
    all. InputError when the file is of another sweep.
    """
    with Record(path, plan) as record:
        progress(len(record.rows), len(plan))
        left = [index for index in range(len(plan)) if index not in record.rows]
        if left:
            for row in evaluate_all(plan, left, jobs, scheduler):
                record.append(row)
                progress(len(record.rows), len(plan))
    return [record.rows[index] for index in range(len(plan))]


def counted(rows: list[Mapping[str, Any]]) -> Counter[str]:
    """How many points have which verdict; "error" for those without."""
    return Counter(str(row.get("verdict", "error")) for row in rows)
