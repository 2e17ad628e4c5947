"""The same certificates proved by boxes and by steps: boxes are at least 10 times faster.

For the sampled-data system, whose jumps lose a dimension. Certificates with so much room that steps
come to the end in a few dozen are shown beside it.
"""

from __future__ import annotations

import sys
from typing import Any

from benchmarks.cases import ALTERNATING, MIXED, SAMPLED, report, seconds
from lmi.decide.stability import decide
from lmi.prove.windows_proof import prove_windows

FLOOR = 10.0
TIGHT = tuple((SAMPLED, 1.0, 0.4, high) for high in (1.84, 1.85, 1.87, 1.875, 1.88))
ROOMY = (
    *((ALTERNATING, gain, 0.37, 2.27) for gain in (0.55, 0.57, 0.578)),
    *((MIXED, gain, 0.3, 0.82) for gain in (0.68, 0.69, 0.694)),
)


def compared(cases: tuple[Any, ...]) -> tuple[list[float], list[float]]:
    """Seconds of boxes and of steps."""
    taken: dict[str, list[float]] = {"bernstein": [], "march": []}
    for (F, H), gain, low, high in cases:
        found = decide(F, gain * H, low, high).evidence
        for method, times in taken.items():
            time, verdict = seconds(
                lambda m=method, F=F, H=gain * H, e=found, a=low, b=high: prove_windows(
                    F, H, e, a, b, method=m
                )
            )
            assert verdict.outcome == "proved"
            times.append(time)
    return taken["bernstein"], taken["march"]


def main() -> bool:
    report("proof of windows with room, march", *compared(ROOMY), 1.0)
    return report("proof of windows, sampled data, march", *compared(TIGHT), FLOOR)


if __name__ == "__main__":
    sys.exit(not main())
