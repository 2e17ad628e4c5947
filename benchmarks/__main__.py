"""All claims about speed, one after the other: python -m benchmarks"""

from __future__ import annotations

import importlib
import sys

CLAIMS = (
    "find_is_fast", "search_is_fast", "proof_is_cheap", "check_is_fast", "grows_slowly",
    "memory_is_small", "cold_design_is_fast", "impulse_is_fast", "pulses_in_noise",
)  # fmt: skip


def main() -> int:
    kept = [importlib.import_module(f"benchmarks.{name}").main() for name in CLAIMS]
    print(f"{sum(kept)} of {len(kept)} claims hold")
    return 0 if all(kept) else 1


if __name__ == "__main__":
    sys.exit(main())
