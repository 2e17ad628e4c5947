"""Claims about speed in one table, the quick ones or those named.

python -m benchmarks [NAME ...]
"""

from __future__ import annotations

import importlib
import sys

from benchmarks.cases import header

# without names: together some minutes of a free core
QUICK = (
    "run_command_is_fast", "luenberger_run_is_fast", "cold_start_is_short", "cold_design_is_fast",
    "imports_are_light", "interval_step_is_fast", "interval_run_is_fast", "interval_fleet_is_fast",
    "interval_stream_is_flat", "irregular_step_is_fast", "new_step_is_cheap",
    "unknown_input_stream_is_fast", "window_step_is_fast", "impulse_window_is_fast",
    "impulse_is_fast", "check_is_fast", "glance_is_fast", "proof_is_cheap", "grows_slowly",
    "windows_cost_nothing", "windows_close_the_gap", "parameters_cost_little",
    "interval_synthesis_is_fast", "window_gain_is_fast", "window_certificate_is_fast",
)  # fmt: skip
# each a minute or more, by its name
LONG = (
    "find_is_fast", "search_is_fast", "period_search_is_reliable", "pulses_in_noise",
    "bounds_are_tight", "memory_is_small",
)  # fmt: skip
CLAIMS = (*QUICK, *LONG)


def main(names: list[str]) -> int:
    if unknown := [name for name in names if name not in CLAIMS]:
        print(f"no claim {unknown[0]!r}; it must be one of {', '.join(CLAIMS)}", file=sys.stderr)
        return 2
    header()
    kept = []
    for name in names or QUICK:
        kept.append(bool(importlib.import_module(f"benchmarks.{name}").main()))
        if not kept[-1]:
            print(f"{name} DOES NOT HOLD", flush=True)
    print(f"{sum(kept)} of {len(kept)} claims hold")
    return 0 if all(kept) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
