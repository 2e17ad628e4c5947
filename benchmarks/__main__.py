"""Claims about speed, all or those that are named: python -m benchmarks [NAME ...]"""

from __future__ import annotations

import importlib
import sys

CLAIMS = (
    "find_is_fast", "search_is_fast", "proof_is_cheap", "check_is_fast", "grows_slowly",
    "memory_is_small", "cold_design_is_fast",
    "cold_start_is_short", "imports_are_light", "glance_is_fast",
    "windows_cost_nothing", "windows_close_the_gap", "parameters_cost_little",
    "run_command_is_fast", "luenberger_run_is_fast",
    "interval_step_is_fast", "interval_run_is_fast", "interval_fleet_is_fast",
    "interval_stream_is_flat", "interval_synthesis_is_fast",
    "window_gain_is_fast", "window_certificate_is_fast",
    "period_search_is_reliable", "window_step_is_fast",
    "unknown_input_stream_is_fast",
    "impulse_is_fast", "impulse_window_is_fast", "pulses_in_noise", "bounds_are_tight",
    "new_step_is_cheap", "irregular_step_is_fast",
)  # fmt: skip


def main(names: list[str]) -> int:
    if unknown := [name for name in names if name not in CLAIMS]:
        print(f"no claim {unknown[0]!r}; it must be one of {', '.join(CLAIMS)}", file=sys.stderr)
        return 2
    kept = []
    for name in names or CLAIMS:
        kept.append(bool(importlib.import_module(f"benchmarks.{name}").main()))
        print(f"{name}: {'holds' if kept[-1] else 'DOES NOT HOLD'}", flush=True)
    print(f"{sum(kept)} of {len(kept)} claims hold")
    return 0 if all(kept) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
