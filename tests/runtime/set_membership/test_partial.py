"""Measurements of some outputs alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.systems.set_membership import cases, observer_of

CASES = cases()


def test_outputs_that_are_missing_drop_their_strip_alone() -> None:
    """Never wider than without the row's sample, nor narrower than with all of it."""
    case = replace(CASES["rand4_42"], missing=0.0)
    record = case.record(extreme=True)
    samples = list(record.samples[:40])

    def widths(hidden: list[int]) -> tuple[list[str], np.ndarray]:
        changed = []
        for k, sample in enumerate(samples):
            y = np.array(sample.y)
            if k % 2:
                y[hidden] = np.nan
            changed.append(sample._replace(y=y))
        observer = observer_of(case, 8, steps=12)
        state = observer.init(0.0, lower=case.x0[0], upper=case.x0[1])
        estimates = list(observer.run(state, changed))
        for estimate, x in zip(estimates, record.truth, strict=False):
            assert ((estimate.lower <= x) & (x <= estimate.upper)).all()
        size = [np.subtract(e.upper, e.lower) for e in estimates]
        return [e.status for e in estimates], np.array(size)

    (_, whole), (partly, second), (none, without) = widths([]), widths([1]), widths([0, 1])
    assert partly[1] == "missing sample of y2"
    assert none[1] == "missing sample"
    assert partly[2] == "ok"
    assert (second[8:].mean(axis=0) < without[8:].mean(axis=0)).all()
    assert (second[8:].mean(axis=0) > whole[8:].mean(axis=0)).all()
