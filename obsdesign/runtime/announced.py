"""Events at uncertain times: they are announced to the rows that come before their stamps.

An event with the stamp tau happens within `error` of it: rows from tau - error on may be after it,
also those before its own row. Such rows carry it in `Sample.ahead`.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import defaultdict, deque
from collections.abc import Iterable, Iterator, Sequence

from obsdesign.runtime.base import Announced, Sample
from obsdesign.runtime.clocks.time_stamps import time_tolerance


def opening(stamp: float, error: float) -> float:
    """Earliest time of an event, rounded down."""
    return stamp - error - math.ulp(max(abs(stamp), abs(stamp - error)))


def closing(stamp: float, error: float) -> float:
    """Latest time of an event, rounded up."""
    return stamp + error + math.ulp(max(abs(stamp), abs(stamp + error)))


def uncertain(sample: Sample, errors: Sequence[float]) -> list[Announced]:
    """Events of a row whose times are uncertain."""
    places = sample.events or ((0,) if sample.jump else ())
    return [
        Announced(k, float(sample.t), sample.w) for k in places if k < len(errors) and errors[k]
    ]


def first_changed(sample: Sample, errors: Sequence[float]) -> float:
    """Time from which on a row changes what is known."""
    times = [opening(each.t, errors[each.event]) for each in uncertain(sample, errors)]
    return min([sample.t, *times])


def with_events_ahead(samples: Sequence[Sample], errors: Sequence[float]) -> list[Sample]:
    """Rows in the order of time, each with the events behind it that may come before it."""
    if not any(errors):
        return list(samples)
    ahead = defaultdict[int, list[Announced]](list)
    for place, row in enumerate(samples):
        for each in uncertain(row, errors):
            earliest = opening(each.t, errors[each.event])
            since = bisect_left(samples, earliest, hi=place, key=lambda x: x.t)
            for k in range(since, place):
                ahead[k].append(each)
    return [
        row._replace(ahead=tuple(ahead[k])) if k in ahead else row for k, row in enumerate(samples)
    ]


def announcing(samples: Iterable[Sample], errors: Sequence[float]) -> Iterator[Sample]:
    """A stream of rows with the events behind them, each once no further one can matter."""
    reach, waiting = max(errors), deque[Sample]()
    for sample in samples:
        waiting.append(sample)
        while sample.t - waiting[0].t > reach + time_tolerance(reach, sample.t):
            yield with_events_ahead(waiting, errors)[0]
            waiting.popleft()
    while waiting:
        yield with_events_ahead(waiting, errors)[0]
        waiting.popleft()
