"""The status of a row: `ok`, or the reasons why its guarantee does not hold."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lmi.arithmetic.arrays import Matrix

# of a row without a sample that was due
MISSING_SAMPLE = "missing sample"
# how the refutation of bounds begins
VOID_SINCE = "void since time"


def status_of(reasons: Sequence[str], *values: Matrix) -> str:
    """`ok`, or the reasons why not; an estimate that is not finite is one."""
    if not all(np.isfinite(value).all() for value in values):
        reasons = [*reasons, "estimate is not finite"]
    return with_reasons("ok", reasons)


def with_reasons(status: str, reasons: Sequence[str]) -> str:
    """A status with further reasons why not: `ok` without any."""
    if not reasons:
        return status
    return "; ".join(reasons if status == "ok" else [status, *reasons])
