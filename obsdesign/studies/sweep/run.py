"""A whole sweep: the points that its file does not hold yet are evaluated and written."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

from obsdesign.studies.sweep.point import Plan, SweepPoint
from obsdesign.studies.sweep.record import SweepWriter
from obsdesign.studies.sweep.workers import evaluate_all


def run_sweep(
    plan: Plan,
    path: str,
    *,
    jobs: int | None = None,
    scheduler: str | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> list[SweepPoint]:
    """All points, in order; `path` holds them, and what it held already is not redone.

    jobs, scheduler: as in `evaluate_all`. progress: called with the points that are finished, and
    all. InputError when the file is of another sweep.
    """
    with SweepWriter(path, plan) as writer:
        progress(len(writer.points), len(plan))
        left = [index for index in range(len(plan)) if index not in writer.points]
        if left:
            for point in evaluate_all(plan, left, jobs, scheduler):
                writer.append(point)
                progress(len(writer.points), len(plan))
    return [writer.points[index] for index in range(len(plan))]


def counted(points: list[SweepPoint]) -> Counter[str]:
    """Number of points by verdict; "error" for those without."""
    return Counter(point.verdict for point in points)
